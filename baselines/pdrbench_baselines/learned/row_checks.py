"""Whether the rows of a phone can be meant: rate, units, and the convention of its attitudes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray
from pdrbench.inertial import to_world
from pdrbench.sensors.checks import Gate
from pdrbench_baselines.learned.attitude_sources import PhoneSource
from pdrbench_baselines.learned.kernels import attitudes_at
from pdrbench_baselines.learned.signals import GRAVITY_MPS2, MAX_GAP_S, MIN_RATE_HZ, UNITS_MPS2

SENSORS: Final = PhoneSource.sensors
CHECK_EVERY_S: Final = 2.0
CHECK_UNTIL_S: Final = 20.0  # into the walk; who stood still at first has walked by then
MAX_SAMPLE_GAP_S: Final = 1.5 / MIN_RATE_HZ  # the median time between samples of a sensor that comes as briefed
TURNED_RAD: Final = 5.0  # by which a gyroscope must have turned before it can be judged
MAX_TURN_RATIO: Final = 8.0  # times what the rotation vector turned meanwhile; 57 in degrees/s
UPRIGHT: Final = 0.85  # of gravity at least is vertical in the frame of the rotation vector


class RowChecks:
    """Looks at what a phone reports, `CHECK_EVERY_S` at a time, as long as its walk is young.

    Args:
        who: Asks, for messages.
        rows: By sensor none yet, with the columns that will come.
    """

    def __init__(self, who: str, rows: Mapping[str, FloatArray]) -> None:
        self._gate = Gate(who)
        self._unchecked: dict[str, FloatArray] | None = dict(rows)

    def take(self, new: Mapping[str, FloatArray]) -> None:
        """Takes the next rows of each of `SENSORS`.

        Raises:
            RecordingError: As `check_rows`, or what comes is the time, the rate or the units of no sensor.
        """
        if self._unchecked is None:
            return
        self._gate.take({name: new[name] for name in ("accel", "gyro")})
        rows = {name: np.concatenate([self._unchecked[name], new[name]]) for name in SENSORS}
        ends_s = [float(t_s) for one in rows.values() if len(one) for t_s in one[[0, -1], 0]]
        if ends_s and max(ends_s) - min(ends_s) >= CHECK_EVERY_S:
            if all(len(one) > 1 for one in rows.values()):
                check_rows(rows)
            self._unchecked = {name: one[:0] for name, one in rows.items()} if max(ends_s) < CHECK_UNTIL_S else None
        else:
            self._unchecked = rows


def check_rows(rows: Mapping[str, FloatArray]) -> None:
    """Refuses a phone that cannot be meant.

    Args:
        rows: Some seconds of each of `SENSORS`, two rows or more.

    Raises:
        RecordingError: Slower than briefed, other units than m/s2 and rad/s, or attitudes that are none of this phone.
    """
    accel, gyro, rotation = (rows[name] for name in SENSORS)
    for name, one in rows.items():
        apart_s = float(np.median(np.diff(one[:, 0])))
        if apart_s > MAX_SAMPLE_GAP_S:
            raise RecordingError(f"{name}: comes at {1 / apart_s:.3g} Hz; {MIN_RATE_HZ:g} Hz or more are needed")
    mean = accel[:, 1:].mean(axis=0)
    force_mps2 = float(np.linalg.norm(mean))
    if not UNITS_MPS2[0] <= force_mps2 <= UNITS_MPS2[1]:
        hint = f"multiply by {GRAVITY_MPS2}" if 0.7 < force_mps2 < 1.3 else "gravity has to be in it"
        raise RecordingError(f"accel: {force_mps2:.3g} in the mean; about 9.8 m/s2 are expected: {hint}")
    steps_s = np.diff(gyro[:, 0])
    steps_s = np.where(steps_s <= MAX_GAP_S, steps_s, 0.0)  # over a gap the rate is not that of its end
    own_rad = float(np.sum(np.linalg.norm(gyro[1:, 1:], axis=1) * steps_s))
    same = np.abs(np.sum(rotation[1:, 1:] * rotation[:-1, 1:], axis=1))
    vector_rad = float(np.sum(2 * np.arccos(np.minimum(same, 1.0))))
    if own_rad > max(TURNED_RAD, MAX_TURN_RATIO * vector_rad):
        raise RecordingError(
            f"gyro: has turned by {own_rad:.3g}, the rotation vector by {vector_rad:.2g} rad; rad/s are expected: "
            "divide degrees/s by 57.3"
        )
    attitude = attitudes_at(np.ascontiguousarray(rotation), accel[:, 0].copy())
    vertical_mps2 = float(to_world(attitude, accel[:, 1:]).mean(axis=0)[2])
    upright = vertical_mps2 / min(force_mps2, GRAVITY_MPS2)  # a swinging hand pulls outwards by some m/s2
    if upright < UPRIGHT:
        raise RecordingError(
            f"rotation: turns {100 * upright:.0f} % of gravity upwards; "
            "unit quaternions w, x, y, z from phone to world (z up) are expected"
        )
