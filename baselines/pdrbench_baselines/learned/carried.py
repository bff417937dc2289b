"""Rows of a phone, or of a unit on a foot, as the network wants them: with an attitude, z up.

A phone reports one, of which only the yaw is made steady. A unit on a foot reports none: it gets that of the
error-state filter of `pdrbench.inertial`, which finds the vertical while the foot rests and keeps it by zero
velocities. Behind this, both are treated alike.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray, course_rad
from pdrbench.inertial import ADAPTIVE, FootFilter, FootStates, SamplePairs, StrideSegmenter, check_units, to_world
from pdrbench.inertial.user_heading import multiply
from pdrbench.localizer import Briefing
from pdrbench.recording import Recording
from pdrbench_baselines.learned.signals import LEAST_HZ
from pdrbench_baselines.learned.steady import SteadyYaw

PHONE: Final = "phone"
FOOT: Final = "foot"
CARRIED: Final = (PHONE, FOOT)
FOOT_LEAST_HZ: Final = 80.0  # ours: heel strikes ring at 40 Hz, and the filter was made for 100 Hz and more
USUAL_FOOT_HZ: Final = 200.0  # as foot_ins-v0, where nobody tells
ALIGNED_AFTER_M: Final = 0.5  # likewise
CHECKED_AT_S: Final = (5.0, 30.0)  # likewise: a foot that stands tells nothing of the unit of its rate


class PhoneRows:
    """Rotation vectors with a steady yaw; their frame is that of the building.

    Attributes:
        sensors: That are needed.
        least_hz: At which they are needed.
        turn_rad: From the frame of the attitudes to that of the building; None as long as nobody knows.
        rise_m: By how much the bearer is higher than at the start; nobody tells of a phone.
    """

    sensors: Final = ("accel", "gyro", "rotation")
    least_hz: Final = LEAST_HZ
    turn_rad: Final[float | None] = 0.0
    rise_m: Final = 0.0

    def __init__(self) -> None:
        self._steady = SteadyYaw()

    def update(self, rows: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        """Takes the next rows, finite, in the order of time; gives accel, gyro and rotation."""
        return {**rows, "rotation": self._steady.update(rows["rotation"], rows["gyro"])}


class FootRows:
    """Attitudes of a foot. Nothing is given until the foot has rested for a tenth of a second.

    Units are strapped on anyhow, and one that lies on its side has no yaw of its own. So the axes are laid flat once:
    what is given is what a unit would record that was level when the filter began.

    The filter begins with a yaw of its own. Where a heading is told, the line through the places at which the foot
    stood is laid along it, once that line is half a metre long.

    Args:
        rate_hz: Of the accelerometer.
        heading_rad: Told of the start, or None: then the frame stays that of the filter.

    Attributes as of `PhoneRows`.
    """

    sensors: Final = ("accel", "gyro")
    least_hz: Final = FOOT_LEAST_HZ

    def __init__(self, rate_hz: float, heading_rad: float | None = None) -> None:
        self._heading_rad = heading_rad
        self.turn_rad: float | None = 0.0 if heading_rad is None else None
        self._filter, self._segmenter, self._pairs = FootFilter(rate_hz, ADAPTIVE), StrideSegmenter(), SamplePairs()
        self._flat: FloatArray | None = None  # (4,) from the axes of the unit to those that are given
        self._from_s, self.rise_m = np.inf, 0.0
        self._stood_m: FloatArray = np.zeros((1, 2))
        self._last_s = dict.fromkeys(self.sensors, -np.inf)
        self._seen: list[FloatArray] = []
        self._to_check_s = list(CHECKED_AT_S)

    def update(self, rows: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        """Takes the next rows, finite; gives accel, gyro and rotation.

        Raises:
            RecordingError: Other units than m/s2 and rad/s, or times that go back.
        """
        _, out = self.navigated(rows)
        return out

    def navigated(self, rows: Mapping[str, FloatArray]) -> tuple[FootStates | None, dict[str, FloatArray]]:
        """The same, with the states of the filter, None where no sample was complete."""
        for name in self.sensors:
            self._check_times(name, rows[name][:, 0])
        pairs = self._pairs.update(rows["accel"], rows["gyro"])
        self._check_units(pairs)
        out = {"accel": np.zeros((0, 4)), "gyro": np.zeros((0, 4)), "rotation": np.zeros((0, 5))}
        if not len(pairs):
            return None, out if self._flat is None else {**out, **self._laid_flat(rows)}
        states = self._filter.update(pairs[:, 0], pairs[:, 1:4], pairs[:, 4:7])
        known = np.isfinite(states.x[:, 0])
        if not known.any():
            return states, out
        if self._flat is None:
            self._flat, self._from_s = states.quaternion[known][0], float(states.t_s[known][0])
        back = self._flat * np.array([1.0, -1.0, -1.0, -1.0])
        out = self._laid_flat(rows)
        quaternion = np.clip(multiply(states.quaternion, back), -1.0, 1.0)  # 1 + 2e-16 is none
        out["rotation"] = np.column_stack([states.t_s, quaternion])[known]
        self.rise_m = float(states.position_m[-1, 2])
        self._align(states)
        return states, out

    def _laid_flat(self, rows: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        assert self._flat is not None
        since = {name: rows[name][rows[name][:, 0] >= self._from_s] for name in self.sensors}
        return {name: np.column_stack([one[:, :1], to_world(self._flat, one[:, 1:4])]) for name, one in since.items()}

    def _align(self, states: FootStates) -> None:
        if self.turn_rad is not None or self._heading_rad is None:
            return
        self._stood_m = np.concatenate([self._stood_m, self._segmenter.update(states).end_xyz_m[:, :2]])
        course = course_rad(self._stood_m, ALIGNED_AFTER_M)
        if course is not None:
            self.turn_rad = self._heading_rad - course

    def _check_times(self, name: str, t_s: FloatArray) -> None:
        if len(t_s):
            if np.any(np.diff(t_s, prepend=self._last_s[name]) < 0):
                raise RecordingError(f"{name}: rows in the order of time are expected; sort or repair the recording")
            self._last_s[name] = float(t_s[-1])

    def _check_units(self, pairs: FloatArray) -> None:
        if not self._to_check_s or not len(pairs):
            return
        self._seen.append(pairs)
        if pairs[-1, 0] >= self._to_check_s[0]:
            seen = np.concatenate(self._seen)
            check_units(seen[:, 1:4], seen[:, 4:7])
            apart_s = float(np.median(np.diff(seen[:, 0])))
            if apart_s > 1.5 / FOOT_LEAST_HZ:
                raise RecordingError(
                    f"accel: comes at {1 / apart_s:.3g} Hz; {FOOT_LEAST_HZ:g} Hz or more are needed of a foot"
                )
            self._to_check_s.pop(0)
            if not self._to_check_s:
                self._seen = []


def rows_of(briefing: Briefing) -> PhoneRows | FootRows:
    """What makes rows with an attitude of those that a briefing tells of."""
    if carried_of(briefing.mounting) == PHONE:
        return PhoneRows()
    heading_rad = None if briefing.start is None else briefing.start.heading_rad
    accel = briefing.sensors.get("accel")
    return FootRows((accel.rate_hz if accel else None) or USUAL_FOOT_HZ, heading_rad)


def carried_of(mounting: str) -> str:
    """One of `CARRIED`."""
    return FOOT if mounting == FOOT else PHONE


def foot_rows(recording: Recording) -> tuple[FootStates, dict[str, FloatArray]]:
    """States of the filter on a whole recording of a foot, and its rows with attitudes.

    Raises:
        RecordingError: As `FootRows`, or the foot never rests.
    """
    accel = recording.streams["accel"]
    rows = FootRows(accel.spec.rate_hz or USUAL_FOOT_HZ)
    states, out = rows.navigated({name: recording.streams[name].rows for name in FootRows.sensors})
    if states is None or not len(out["rotation"]):
        raise RecordingError(f"{recording.id}: the foot never rests; leave the recording out")
    return states, out
