"""Units on both feet: two inertial filters, and the fact that the feet are never farther apart than a step.

The inequality on the distance is that of Skog, Nilsson, Zachariah, Handel (IPIN 2012) and of Hu, Hu (PLANS 2025).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from pdrbench.geometry import FloatArray, path_heading_rad, wrap_rad
from pdrbench.inertial import FootFilter, FootParams, FootStates, StrideSegmenter, check_units
from pdrbench.inertial.pairing import SamplePairs
from pdrbench.localizer import Briefing, Estimate, Observation

_UNITS: Final = (("accel", "gyro"), ("accel_2", "gyro_2"))
_UNITS_AFTER_S: Final = 10.0  # a foot that stands says nothing of the unit of its rate
_MIN_TRACK_M: Final = 0.3


@dataclass(frozen=True, slots=True)
class FootPairParams:
    """Settings of `FootPair`.

    Attributes:
        filter: Of each foot.
        max_step_m: Two feet that both stand are never farther apart: a long step and the width of the hips.
        step_sigma_m: Standard deviation of that limit.
        stride_sigma_m: Of the place at the end of a stride, per axis.
        turn_sigma: Of the heading of a track, rad per root second: what the bias of a gyroscope does meanwhile.
        given_sigma_rad: Of the heading of a track that was turned to the heading of the start.
        aligned_after_m: Length of the walk over which that is done.
        joined_after_m: Length of the walk over which the track of the other foot is turned to that of the first.
        joined_sigma_rad: Standard deviation of that.
        apart_sigma_m: How far apart the feet stand at the start, per axis.
    """

    filter: FootParams = field(default_factory=FootParams)
    max_step_m: float = 0.9
    step_sigma_m: float = 0.05
    stride_sigma_m: float = 0.015
    turn_sigma: float = math.radians(0.3)
    given_sigma_rad: float = math.radians(2.0)
    aligned_after_m: float = 0.5
    joined_after_m: float = 2.0
    joined_sigma_rad: float = math.radians(4.0)
    apart_sigma_m: float = 0.3


FOOT_PAIR: Final = FootPairParams()


class _Foot:
    """One unit: its filter, and where the foot stood in the frame of the filter."""

    def __init__(self, rate_hz: float, params: FootParams) -> None:
        self.pairs, self.filter, self.segmenter = SamplePairs(), FootFilter(rate_hz, params), StrideSegmenter()
        self.stood_m: FloatArray = np.zeros((1, 2))
        self.stood_s = 0.0
        self.last_m: FloatArray = np.zeros(2)
        self.is_placed = False

    def update(self, accel: FloatArray, gyro: FloatArray) -> list[tuple[float, float, FloatArray]]:
        """(known, end in seconds, place (2,)) of each stride that the next samples make known."""
        rows = self.pairs.update(accel, gyro)
        if not len(rows):
            return []
        states: FootStates = self.filter.update(rows[:, 0], rows[:, 1:4], rows[:, 4:7])
        if not np.isnan(states.x[-1, 0]):
            self.last_m = states.position_m[-1, :2]
        found = self.segmenter.update(states)
        return [
            (float(known_s), float(end_s), end_m)
            for known_s, end_s, end_m in zip(found.known_s, found.end_s, found.end_xyz_m[:, :2], strict=True)
        ]


class FootPair:
    """Navigates by the units on both feet.

    Each foot has a filter of its own. What they give are strides; a Kalman filter over place and heading of both feet
    adds them up, and whenever the two would stand farther apart than a step, the distance is measured as that. The
    answer is the foot of `accel` and `gyro`.
    """

    def __init__(self, params: FootPairParams = FOOT_PAIR) -> None:
        self._params = params

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        briefing.require(sensors=tuple(name for unit in _UNITS for name in unit), start=True, carrier="foot")
        assert briefing.start is not None
        self._start = briefing.start
        rate_hz = briefing.sensors["accel"].rate_hz or 200.0
        self._feet = tuple(_Foot(rate_hz, self._params.filter) for _ in _UNITS)
        self._state: FloatArray = np.array([*self._start.xy_m, 0.0, *self._start.xy_m, 0.0])
        self._cov: FloatArray = np.zeros((6, 6))
        self._seen: list[FloatArray] | None = []

    def step(self, observation: Observation) -> Estimate:
        self._check_units(observation)
        strides: list[tuple[float, int, float, FloatArray]] = []
        for side, (foot, (accel, gyro)) in enumerate(zip(self._feet, _UNITS, strict=True)):
            found = foot.update(observation[accel], observation[gyro])
            strides += [(known_s, side, end_s, end_m) for known_s, end_s, end_m in found]
        for _, side, end_s, end_m in sorted(strides, key=lambda stride: stride[:2]):
            self._take(side, end_s, end_m)
        return self._estimate(observation.now_s)

    def _check_units(self, observation: Observation) -> None:
        """Refuses other units once the first seconds have come."""
        if self._seen is None:
            return
        for accel, gyro in _UNITS:
            count = min(len(observation[accel]), len(observation[gyro]))
            self._seen.append(np.column_stack([observation[accel][:count, 1:4], observation[gyro][:count, 1:4]]))
        if observation.now_s >= _UNITS_AFTER_S:
            rows, self._seen = np.concatenate(self._seen), None
            check_units(rows[:, :3], rows[:, 3:])

    def _take(self, side: int, end_s: float, end_m: FloatArray) -> None:
        """Adds a stride to the track of a foot, then the limit on the distance."""
        foot = self._feet[side]
        moved_m, lasted_s = end_m - foot.stood_m[-1], end_s - foot.stood_s
        foot.stood_m, foot.stood_s = np.vstack([foot.stood_m, end_m]), end_s
        if not foot.is_placed:
            (self._place_first, self._place_second)[side](foot)
            return
        i, p = 3 * side, self._params
        ahead_m = _turned(moved_m, self._state[i + 2])
        self._state[i : i + 2] += ahead_m
        f = np.eye(6)
        f[i : i + 2, i + 2] = -ahead_m[1], ahead_m[0]
        self._cov = f @ self._cov @ f.T
        noise = (p.stride_sigma_m**2, p.stride_sigma_m**2, p.turn_sigma**2 * lasted_s)
        self._cov[range(i, i + 3), range(i, i + 3)] += noise
        if all(each.is_placed for each in self._feet):
            self._limit()

    def _place_first(self, foot: _Foot) -> None:
        """Turns the track of the first foot to the heading of the start, where one is given."""
        given_rad, p = self._start.heading_rad, self._params
        if given_rad is None:
            track_rad, given_rad = 0.0, 0.0
        else:
            found = path_heading_rad(foot.stood_m, p.aligned_after_m)
            if found is None:
                return
            track_rad = found
        turn_rad = float(wrap_rad(given_rad - track_rad))
        from_start_m = _turned(foot.stood_m[-1], turn_rad)
        self._state[:3] = *(self._start.xy_m + from_start_m), turn_rad
        lever = np.array([-from_start_m[1], from_start_m[0], 1.0])
        self._cov[:3, :3] = p.given_sigma_rad**2 * np.outer(lever, lever) + np.diag([p.stride_sigma_m**2] * 2 + [0.0])
        foot.is_placed = True

    def _place_second(self, foot: _Foot) -> None:
        """Turns the track of the other foot to that of the first, once both have gone far enough."""
        p, first_m = self._params, self._state[:2] - self._start.xy_m
        if not self._feet[0].is_placed or min(math.hypot(*first_m), math.hypot(*foot.stood_m[-1])) < p.joined_after_m:
            return
        turn_rad = float(
            wrap_rad(math.atan2(first_m[1], first_m[0]) - math.atan2(foot.stood_m[-1, 1], foot.stood_m[-1, 0]))
        )
        from_start_m = _turned(foot.stood_m[-1], turn_rad)
        self._state[3:] = *(self._start.xy_m + from_start_m), turn_rad
        lever = np.array([-from_start_m[1], from_start_m[0], 1.0])
        self._cov[3:, :3] = np.outer(lever, self._cov[2, :3])
        self._cov[:3, 3:] = self._cov[3:, :3].T
        self._cov[3:, 3:] = (self._cov[2, 2] + p.joined_sigma_rad**2) * np.outer(lever, lever)
        self._cov[3:, 3:] += np.diag([p.apart_sigma_m**2] * 2 + [0.0])
        foot.is_placed = True

    def _limit(self) -> None:
        """Two feet that would stand farther apart than a step stand as far apart as a step."""
        p, apart_m = self._params, self._state[:2] - self._state[3:5]
        distance_m = math.hypot(*apart_m)
        if distance_m <= p.max_step_m:
            return
        along = apart_m / distance_m
        h = np.array([*along, 0.0, *-along, 0.0])
        gain = self._cov @ h / (h @ self._cov @ h + p.step_sigma_m**2)
        self._state += gain * (p.max_step_m - distance_m)
        self._cov -= np.outer(gain, h @ self._cov)

    def _estimate(self, now_s: float) -> Estimate:
        """The first foot now: where it stood last, and how far its filter has gone since."""
        foot, level = self._feet[0], self._start.level
        if foot.is_placed:
            xy_m = self._state[:2] + _turned(foot.last_m - foot.stood_m[-1], self._state[2])
            sigma_m = math.sqrt(max((self._cov[0, 0] + self._cov[1, 1]) / 2, 1e-6))
            return Estimate(xy_m=xy_m, level=level, sigma_m=sigma_m)
        if not foot.filter.is_started:
            return Estimate(xy_m=self._start.xy_m, level=level, sigma_m=0.05 + 1.4 * now_s)
        turn_rad = 0.0
        if self._start.heading_rad is not None and math.hypot(*foot.last_m) >= _MIN_TRACK_M:
            turn_rad = self._start.heading_rad - math.atan2(foot.last_m[1], foot.last_m[0])
        return Estimate(xy_m=self._start.xy_m + _turned(foot.last_m, turn_rad), level=level, sigma_m=0.1)


def _turned(xy_m: FloatArray, angle_rad: float) -> FloatArray:
    """(2,) counter-clockwise."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([c * xy_m[0] - s * xy_m[1], s * xy_m[0] + c * xy_m[1]])
