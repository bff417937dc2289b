"""Displacements second by second while a phone's samples come in."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from pdrbench.errors import RecordingError, UnsuitableError
from pdrbench.geometry import FloatArray
from pdrbench.localizer import Briefing
from pdrbench_baselines.learned.signals import (
    GRAVITY_MPS2,
    HORIZON,
    LEAST_HZ,
    RATE_HZ,
    UNITS_MPS2,
    WINDOW,
    grid_signals,
    turned,
    window_before,
)
from pdrbench_baselines.learned.steady import SteadyYaw

if TYPE_CHECKING:
    from torch import Tensor

    from pdrbench_baselines.learned.model import Network

SENSORS: Final = ("accel", "gyro", "rotation")
KEPT_S: Final = WINDOW / RATE_HZ + 1.5
EVERY_S: Final = HORIZON / RATE_HZ
UNITS_AFTER_S: Final = 2.0
MOST_RADPS: Final = 36.0  # 2000 degrees/s, where gyroscopes of phones end; a phone in degrees/s passes it at once
FADES: Final = 0.5  # of a displacement for every second without samples: who walked may have stopped


@dataclass(frozen=True, slots=True)
class Move:
    """One second.

    Attributes:
        end_s: When it ended.
        move_m: (2,) in the frame of the rotation vector.
        covariance_m2: (2, 2) of it.
        stands: Whether the network takes its bearer to stand.
        is_guess: True where samples were missing: the last move goes on, fading.
    """

    end_s: float
    move_m: FloatArray
    covariance_m2: FloatArray
    stands: bool
    is_guess: bool


class Reckoner:
    """Takes the rows of a phone and tells by how much its bearer moves.

    Args:
        network: In the state of being asked.
        briefing: Tells sensors and the height of the person.
        stand_logit: From where on somebody is taken to stand.

    Raises:
        UnsuitableError: A sensor is missing or slower than `LEAST_HZ`.
    """

    def __init__(self, network: Network, briefing: Briefing, stand_logit: float = 0.0) -> None:
        briefing.require(sensors=SENSORS)
        for name in SENSORS:
            rate_hz = briefing.sensors[name].rate_hz
            if rate_hz is not None and rate_hz < LEAST_HZ:
                raise UnsuitableError(f"needs {name} at {LEAST_HZ:g} Hz or more; here it comes at {rate_hz:g} Hz")
        self._network, self._stand_logit = network, stand_logit
        self._rows: dict[str, FloatArray] = {name: np.zeros((0, 5 if name == "rotation" else 4)) for name in SENSORS}
        height_m = briefing.subject.get("height_m", 0.0)
        self._height_m = float(height_m) if isinstance(height_m, int | float) else 0.0
        self._steady = SteadyYaw()
        self._memory: Tensor | None = None
        self._first_s: float | None = None
        self._last = Move(0.0, np.zeros(2), np.eye(2) * 0.25, True, True)

    def update(self, rows: Mapping[str, FloatArray]) -> Iterator[Move]:
        """Takes the next rows and gives the seconds that are complete with them.

        Raises:
            RecordingError: Other units than m/s2 and rad/s, or times that go back.
        """
        new = {name: rows[name][np.isfinite(rows[name]).all(axis=1)] for name in SENSORS}
        new["rotation"] = self._steady.update(new["rotation"], new["gyro"])
        for name in SENSORS:
            self._rows[name] = np.concatenate([self._rows[name], new[name]])
        if any(len(one) < 2 for one in self._rows.values()):
            return
        if self._first_s is None:
            self._first_s = max(float(one[0, 0]) for one in self._rows.values())
            self._end_s = self._first_s + EVERY_S
            self._check_units_at_s = self._first_s + UNITS_AFTER_S
        newest_s = max(float(one[-1, 0]) for one in self._rows.values())
        ready_s = min(float(one[-1, 0]) for one in self._rows.values())
        if newest_s - ready_s > EVERY_S:
            ready_s = newest_s - EVERY_S  # a sensor has fallen silent
        while self._end_s <= ready_s + 1e-6:
            yield self._move(self._end_s)
            self._end_s += EVERY_S
        self._forget()

    def _move(self, end_s: float) -> Move:
        import torch

        assert self._first_s is not None
        if end_s >= self._check_units_at_s:
            self._check_units()
        begin_s = max(end_s - WINDOW / RATE_HZ, self._first_s) + 1.0 / RATE_HZ
        signals = grid_signals(self._rows["accel"], self._rows["gyro"], self._rows["rotation"], begin_s, end_s)
        if not signals.is_whole[-HORIZON:].all():
            return self._guess(end_s)
        features, yaw_rad = window_before(signals, len(signals))
        torch.set_num_threads(1)  # a window of 4 s takes less time than waking another thread
        with torch.inference_mode():
            window = torch.from_numpy(features).to(torch.float32)[None]
            height_m = torch.tensor([self._height_m], dtype=torch.float32)
            told, self._memory = self._network(window, height_m, self._memory)
        stands = bool(float(told.standing[0]) > self._stand_logit)
        move_m = np.zeros(2) if stands else turned(told.move_m[0].numpy().astype(np.float64), yaw_rad)
        factor = turned(told.cholesky_m[0].numpy().astype(np.float64).T, yaw_rad).T
        self._last = Move(end_s, move_m, factor @ factor.T, stands, False)
        return self._last

    def _guess(self, end_s: float) -> Move:
        last = self._last
        wider = last.covariance_m2 + np.eye(2) * 0.25 * float(np.sum(last.move_m**2))
        self._last = Move(end_s, FADES * last.move_m, wider, last.stands, True)
        return self._last

    def _check_units(self) -> None:
        self._check_units_at_s = np.inf
        force_mps2 = float(np.linalg.norm(self._rows["accel"][:, 1:].mean(axis=0)))
        if not UNITS_MPS2[0] <= force_mps2 <= UNITS_MPS2[1]:
            hint = f"multiply by {GRAVITY_MPS2}" if 0.7 < force_mps2 < 1.3 else "gravity has to be in it"
            raise RecordingError(f"accel: {force_mps2:.3g} in the mean; about 9.8 m/s2 are expected: {hint}")
        fastest_radps = float(np.percentile(np.linalg.norm(self._rows["gyro"][:, 1:], axis=1), 90))
        if fastest_radps > MOST_RADPS:
            raise RecordingError(
                f"gyro: {fastest_radps:.3g} for a tenth of the time; rad/s are expected: divide by 57.3"
            )

    def _forget(self) -> None:
        for name, rows in self._rows.items():
            kept = rows[rows[:, 0] >= self._end_s - EVERY_S - KEPT_S]
            self._rows[name] = kept if len(kept) >= 2 else rows[-2:]
