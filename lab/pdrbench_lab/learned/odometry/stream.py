"""Rows of a phone as they come, checked, with an attitude, at the even times at which a network is asked."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from pdrbench.errors import UnsuitableError
from pdrbench.geometry import FloatArray
from pdrbench.localizer import Briefing
from pdrbench_baselines.learned.attitude_sources import rows_of
from pdrbench_baselines.learned.kernels import attitudes_at
from pdrbench_baselines.learned.row_checks import SENSORS, RowChecks
from pdrbench_lab.learned.odometry.aligned import RATE_HZ, Aligned, aligned

KEPT_S: Final = 2.5  # longer than a window, and than a sensor may lag
LATE_S: Final = 1.0  # a sensor that is later than the others by more has stopped


class PhoneStream:
    """Takes the rows of a phone and gives samples at 200 Hz up to the last time for which all sensors have come.

    Args:
        briefing: Gives the sensors, and the heading of the start.

    Raises:
        UnsuitableError: A sensor is missing or too slow, the unit is on a foot, or nothing gives the yaw.
    """

    def __init__(self, briefing: Briefing) -> None:
        briefing.require(carrier="phone")
        has_heading = briefing.start is not None and briefing.start.heading_rad is not None
        if not has_heading and not {"rotation", "mag"} & set(briefing.sensors):
            raise UnsuitableError("needs a rotation vector, a magnetometer or the heading of the start")
        self._source = source = rows_of(briefing)
        briefing.require(sensors=source.sensors, min_rate_hz=source.min_rate_hz)
        self.rows: dict[str, FloatArray] = {name: np.zeros((0, 5 if name == "rotation" else 4)) for name in SENSORS}
        self._checks = RowChecks("odometry", self.rows)
        self._first_s: float | None = None
        self._taken = 0  # samples of the grid that were given

    @property
    def turn_rad(self) -> float:
        """From the frame of the samples to that of the building; known once there is a sample."""
        return self._source.turn_rad or 0.0

    def update(self, rows: Mapping[str, FloatArray]) -> None:
        """Takes the next rows.

        Raises:
            RecordingError: Other units than m/s2 and rad/s, attitudes of another convention, or times that go back.
        """
        new = {name: rows[name][np.isfinite(rows[name]).all(axis=1)] for name in self._source.sensors}
        new = self._source.update(new)
        self._checks.take(new)
        self._forget()
        for name in SENSORS:
            self.rows[name] = np.concatenate([self.rows[name], new[name]])

    def ready(self, multiple: int) -> int:
        """How many samples have come since the last ones that were taken, rounded down to a multiple."""
        if any(len(one) < 2 for one in self.rows.values()):
            return 0
        if self._first_s is None:
            self._first_s = max(float(one[0, 0]) for one in self.rows.values())
        ends_s = [float(one[-1, 0]) for one in self.rows.values()]
        ready_s = max(min(ends_s), max(ends_s) - LATE_S)
        count = int((ready_s - self._first_s) * RATE_HZ + 1e-6) + 1 - self._taken
        return max(count, 0) // multiple * multiple

    def take(self, count: int, before: int = 0, *, in_body: bool = False) -> Aligned:
        """The next samples, after those `before` them; fewer of the latter where the walk is young.

        Args:
            count: Of new ones, at most `ready`.
            before: Of those that were taken already.
            in_body: In the frame of the phone rather than in that of its attitude.
        """
        assert self._first_s is not None
        before = min(before, self._taken)
        from_s = self._first_s + (self._taken - before) / RATE_HZ
        rotation = self.rows["rotation"]
        if in_body:
            rotation = np.column_stack([rotation[:, 0], np.tile([1.0, 0.0, 0.0, 0.0], (len(rotation), 1))])
        samples = aligned(self.rows["accel"], self.rows["gyro"], rotation, from_s, before + count)
        self._taken += count
        return samples

    def attitude(self, t_s: float) -> FloatArray:
        """(4,) that the phone reports, its yaw made steady."""
        quaternion: FloatArray = attitudes_at(self.rows["rotation"], np.array([t_s]))[0]
        return quaternion

    def _forget(self) -> None:
        if self._first_s is None:
            return
        now_s = self._first_s + self._taken / RATE_HZ
        for name, rows in self.rows.items():
            kept = rows[rows[:, 0] >= now_s - KEPT_S]
            self.rows[name] = kept if len(kept) >= 2 else rows[-2:]
