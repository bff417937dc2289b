"""Strides and what the foot has done since the last one, from a sensor of strides or from a unit on the foot."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np

from pdrbench.errors import UnsuitableError
from pdrbench.geometry import FloatArray, IntArray, path_heading_rad, wrap_rad
from pdrbench.inertial import FootFilter, Strides, StrideSegmenter, check_units
from pdrbench.inertial.pairing import SamplePairs
from pdrbench.localizer import Briefing, Observation

ALIGNED_AFTER_M: Final = 0.5  # as the localizers of `foot_ins`
UNITS_AFTER_S: Final = 5.0  # as the localizers of `foot_ins`, the first of their two looks


@dataclass(frozen=True, slots=True)
class Advance:
    """What one observation brought.

    Attributes:
        strides: (n, 4) columns of the sensor `stride`.
        since_m: (2,) from the end of the last stride to where the foot is now, x in the direction of that stride.
    """

    strides: FloatArray
    since_m: FloatArray


class Odometry(Protocol):
    """A source of strides."""

    def update(self, observation: Observation) -> Advance:
        """Strides of the next observation."""


class StrideSensor:
    """Strides as the sensor delivers them: where the foot is between two is not known."""

    def update(self, observation: Observation) -> Advance:
        return Advance(observation["stride"], np.zeros(2))


class FootUnit:
    """Strides of the inertial filter of `foot_ins_robust`.

    Every stride goes where its displacement points, the shortest too, so that strides add up to the track of the
    filter. The walk begins in the direction in which the foot leaves a circle of `ALIGNED_AFTER_M`; until then its
    strides wait, and it is ahead of the start by as much as it is away from it.

    Args:
        rate_hz: Of the unit.
    """

    def __init__(self, rate_hz: float) -> None:
        self._filter, self._pairs = FootFilter(rate_hz), SamplePairs()
        self._segmenter = StrideSegmenter()
        self._rows: list[FloatArray] = []
        self._is_checked = False
        self._way_m: FloatArray = np.zeros((0, 2))
        self._waiting: FloatArray = np.zeros((0, 4))
        self._heading_rad: float | None = None
        self._since_m: FloatArray = np.zeros(2)

    def update(self, observation: Observation) -> Advance:
        rows = self._pairs.update(observation["accel"], observation["gyro"])
        if not len(rows):
            return Advance(np.zeros((0, 4)), self._since_m)
        self._check(rows, observation.now_s)
        states = self._filter.update(rows[:, 0], rows[:, 1:4], rows[:, 4:7])
        strides = self._released(self._segmenter.update(states))
        at_m = states.position_m[-1, :2]
        if np.isnan(at_m).any():
            return Advance(strides, self._since_m)
        if self._heading_rad is None:
            self._since_m = np.array([math.hypot(*at_m), 0.0])
        else:
            c, s = math.cos(self._heading_rad), math.sin(self._heading_rad)
            self._since_m = (at_m - self._way_m[-1]) @ np.array([[c, -s], [s, c]])
        return Advance(strides, self._since_m)

    def _released(self, strides: Strides) -> FloatArray:
        """(n, 4) as the sensor `stride` has them; none until the direction of the start is known."""
        if not len(strides.length_m):
            return np.zeros((0, 4))
        moved_m = strides.end_xyz_m - strides.start_xyz_m
        direction_rad = np.arctan2(moved_m[:, 1], moved_m[:, 0])
        new = np.column_stack([strides.known_s, strides.length_m, strides.rise_m, direction_rad])
        before_m = self._way_m if len(self._way_m) else strides.start_xyz_m[:1, :2]
        self._way_m, self._waiting = (
            np.concatenate([before_m, strides.end_xyz_m[:, :2]]),
            np.concatenate([self._waiting, new]),
        )
        if self._heading_rad is None:
            self._heading_rad = path_heading_rad(self._way_m, ALIGNED_AFTER_M)
            if self._heading_rad is None:
                return np.zeros((0, 4))
        rows, self._waiting, self._way_m = self._waiting, np.zeros((0, 4)), self._way_m[-1:]
        heading_rad, self._heading_rad = self._heading_rad, float(rows[-1, 3])
        return np.column_stack([rows[:, :3], wrap_rad(np.diff(rows[:, 3], prepend=heading_rad))])

    def _check(self, rows: FloatArray, now_s: float) -> None:
        """Refuses other units before they have done harm."""
        if not self._is_checked:
            self._rows.append(rows)
            if now_s >= UNITS_AFTER_S:
                seen = np.concatenate(self._rows)
                check_units(seen[:, 1:4], seen[:, 4:7])
                self._is_checked, self._rows = True, []


def odometry_of(briefing: Briefing) -> Odometry:
    """The source that a briefing has: strides before a unit on the foot.

    Raises:
        UnsuitableError: It has neither, or strides without the heading of the start.
    """
    briefing.require(start=True)
    assert briefing.start is not None
    if "stride" in briefing.sensors:
        if briefing.start.heading_rad is None:
            raise UnsuitableError("needs the heading of the start to add strides")
        return StrideSensor()
    briefing.require(sensors=("accel", "gyro"), carrier="foot")
    return FootUnit(briefing.sensors["accel"].rate_hz or 200.0)


def level_heights(briefing: Briefing, level_height_m: float) -> tuple[IntArray, FloatArray]:
    """Levels (L,) and how high each is above that of the start (L,): of the plan, or all `level_height_m` apart."""
    assert briefing.start is not None
    own = briefing.start.level
    if briefing.building is None:
        level: IntArray = np.arange(own - 20, own + 21, dtype=np.int64)
        return level, level_height_m * (level - own).astype(np.float64)
    floors = [polygon for polygon in briefing.building.polygons if polygon.kind == "floor"]
    level = np.asarray(sorted({polygon.level for polygon in floors}), dtype=np.int64)
    height_m = np.array([float(np.median([p.height_m for p in floors if p.level == one])) for one in level])
    return level, height_m - height_m[level == own].mean()
