"""Foot-mounted inertial navigation: dead reckoning with zero-velocity updates, no map and no radio.

Frank et al. 2009, section 3, and Woodman & Harle 2008, "Tracking using a foot mounted IMU": claims W2, W3, F6, F7.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray, IntArray, path_heading_rad
from pdrbench.inertial import (
    DETECTORS,
    LITERAL,
    FootFilter,
    FootParams,
    FootStates,
    LevelChange,
    LevelTracker,
    Strides,
    StrideSegmenter,
    check_units,
    find_strides,
    level_heights,
    navigate_smoothed,
)
from pdrbench.inertial.pairing import SamplePairs
from pdrbench.inertial.zero_velocity import Kind
from pdrbench.localizer import Briefing, Estimate, Observation

_UNITS_AFTER_S: Final = (5.0, 30.0)  # a foot that stands says nothing of the unit of its rate: look twice
_MIN_TRACK_M: Final = 0.3


@dataclass(frozen=True, slots=True)
class FootInsParams:
    """Settings of `FootIns`.

    Attributes:
        filter: See `FootParams`.
        detector: Name of a zero-velocity detector, in place of that of the filter: `shoe`, `are`, `mv`, `mag` of Skog
            et al. 2010, `interval` of Frank et al. 2009 (F6), `soft` of foot_ins_robust.
        aligned_after_m: Length of the walk over which the track is turned to the heading of the start, through the
            places where the foot stood; until then along the displacement so far.
        level_height_m: Rise that counts as a level, where no height of a level is known.
        revises: Whether the samples are kept, from which `revise` smooths the track.
    """

    filter: FootParams = LITERAL
    detector: Kind | None = None
    aligned_after_m: float = 0.5  # ours
    level_height_m: float = 3.0  # ours
    revises: bool = True

    def with_detector(self) -> FootParams:
        """Settings of the filter, with the detector that is asked for."""
        return self.filter if self.detector is None else replace(self.filter, detector=DETECTORS[self.detector])


FOOT_INS: Final = FootInsParams()
FOOT_INS_ROBUST: Final = FootInsParams(filter=FootParams())


class FootIns:
    """Navigates by a shoe: zero-velocity updates with the settings of the papers.

    By default with nine states and a fixed threshold on the SHOE statistic: the settings of the literature (F7, W2).

    The filter knows its own frame only. Where the briefing gives the heading of the start, the track is turned so that
    it leaves in that direction, as one lays a track on a map by hand; else the frame stays as it is, and
    only aligned scores mean something. A sensor that never rests leaves the estimate at the start, with a sigma that
    grows as fast as people walk. `revise` gives the smoothed track.

    Args:
        params: See `FootInsParams`.
    """

    def __init__(self, params: FootInsParams = FOOT_INS) -> None:
        self._params, self._filter_params = params, params.with_detector()

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        briefing.require(sensors=("accel", "gyro"), start=True, carrier="foot")
        assert briefing.start is not None
        self._start = briefing.start
        self._rate_hz = briefing.sensors["accel"].rate_hz or 200.0
        self._filter = FootFilter(self._rate_hz, self._filter_params)
        self._segmenter = StrideSegmenter()
        self._uses_field = self._filter_params.field is not None and "mag" in briefing.sensors
        self._pairs = SamplePairs()
        self._rows: list[FloatArray] = []
        self._steps_s: FloatArray = np.zeros(0)  # of this observation
        self._travel_rad: float | None = None
        self._turn_rad, self._is_aligned = 0.0, False
        self._stood_m: FloatArray = np.zeros((1, 2))
        self._num_checks = 0
        self._estimate = Estimate(xy_m=self._start.xy_m, level=self._start.level, sigma_m=self._start.radius_m or 0.05)
        self._last: FloatArray | None = None

    def step(self, observation: Observation) -> Estimate:
        rows = self._pairs.update(observation["accel"], observation["gyro"])
        if len(rows):
            states = self._filter.update(rows[:, 0], rows[:, 1:4], rows[:, 4:7], self._field(observation, rows[:, 0]))
            self._remember(rows, observation.now_s)
            self._follow(states)
        if not self._filter.is_started:
            self._estimate = replace(self._estimate, sigma_m=0.05 + 1.4 * observation.now_s)
        return self._estimate

    def revise(self) -> FloatArray | None:
        """(K, 5) t_s, x_m, y_m, level, sigma_m of the smoothed track, 20 rows a second.

        None without one, and where the samples of the whole walk contradict each other: the answers stay as they were.
        """
        if not self._params.revises or self._last is None:
            return None
        rows = np.concatenate(self._rows)
        try:
            states = navigate_smoothed(rows[:, 0], rows[:, 1:4], rows[:, 4:7], self._filter_params)
        except RecordingError:
            return None
        known = np.flatnonzero(np.isfinite(states.x[:, 0]))
        ticks = np.arange(states.t_s[known[0]], states.t_s[-1], 0.05)
        chosen = known[np.unique(np.searchsorted(states.t_s[known], ticks, side="right") - 1)]
        chosen = np.append(chosen, known[-1]) if chosen[-1] != known[-1] else chosen
        xyz_m = states.position_m[chosen]
        self._is_aligned = False
        self._stood_m = np.zeros((1, 2))
        self._align(find_strides(states), xyz_m[-1])
        level = self._levels(states.t_s[chosen], xyz_m[:, 2])
        return np.column_stack([states.t_s[chosen], self._placed(xyz_m[:, :2]), level, states.sigma_m[chosen]])

    def _levels(self, t_s: FloatArray, rise_m: FloatArray) -> IntArray:
        """(k,) levels at some times, where the foot is so much above the start."""
        return self._start.level + np.rint(rise_m / self._params.level_height_m).astype(np.int64)

    def _field(self, observation: Observation, t_s: FloatArray) -> FloatArray | None:
        """(n, 3) the magnetic field at the samples that have one."""
        if not self._uses_field:
            return None
        field, mag = np.full((len(t_s), 3), np.nan), observation["mag"]
        at = np.searchsorted(t_s, mag[:, 0])
        inside = at < len(t_s)
        hits = inside & (t_s[np.minimum(at, len(t_s) - 1)] == mag[:, 0])
        field[at[hits]] = mag[hits, 1:4]
        return field

    def _remember(self, rows: FloatArray, now_s: float) -> None:
        """Keeps the samples for the smoother, and refuses other units before they have done harm."""
        if self._params.revises or self._num_checks < len(_UNITS_AFTER_S):
            self._rows.append(rows)
        if self._num_checks < len(_UNITS_AFTER_S) and now_s >= _UNITS_AFTER_S[self._num_checks]:
            seen = np.concatenate(self._rows)
            check_units(seen[:, 1:4], seen[:, 4:7])
            self._num_checks += 1
            if self._num_checks == len(_UNITS_AFTER_S) and not self._params.revises:
                self._rows = []

    def _follow(self, states: FootStates) -> None:
        """Turns what the filter knows into the answer."""
        strides = self._segmenter.update(states)
        self._steps_s = np.column_stack([(strides.start_s + strides.end_s) / 2, strides.end_s]).ravel()  # of both feet
        if len(strides.heading_rad):
            self._travel_rad = float(strides.heading_rad[-1])
        if np.isnan(states.x[-1, 0]):
            return
        self._last = states.position_m[-1]
        self._align(strides, self._last)
        self._estimate = Estimate(
            xy_m=self._placed(self._last[:2]),
            level=int(self._levels(states.t_s[-1:], self._last[2:])[0]),
            heading_rad=None if self._travel_rad is None else self._travel_rad + self._turn_rad,
            sigma_m=max(float(states.sigma_m[-1]), 1e-3),
        )

    def _align(self, strides: Strides, last_m: FloatArray) -> None:
        """Turns the track to the heading of the start: for good once the foot has stood far enough away."""
        given_rad = self._start.heading_rad
        if given_rad is None or self._is_aligned:
            return
        self._stood_m = np.concatenate([self._stood_m, strides.end_xyz_m[:, :2]])
        track_rad = path_heading_rad(self._stood_m, self._params.aligned_after_m)
        self._is_aligned = track_rad is not None
        if track_rad is None and math.hypot(*last_m[:2]) >= _MIN_TRACK_M:
            track_rad = math.atan2(last_m[1], last_m[0])
        if track_rad is not None:
            self._turn_rad = given_rad - track_rad

    def _placed(self, xy_m: FloatArray) -> FloatArray:
        """(..., 2) from the frame of the filter into that of the building."""
        c, s = math.cos(self._turn_rad), math.sin(self._turn_rad)
        placed: FloatArray = self._start.xy_m + np.asarray(xy_m) @ np.array([[c, s], [-s, c]])
        return placed


class FootInsRobust(FootIns):
    """Navigates by a shoe with one set of settings for any gait and unit; see `FootParams`.

    Zero velocities are soft, and doubted as far as the filter knows the foot to move; biases, the clock and the range
    of the sensor are estimated on the way. Levels are those of a barometer, if there is one: a lift carries a shoe that
    stands. Without one the nearest of the heights of the building counts, if there is a building.

    Args:
        params: See `FootInsParams`.

    Attributes:
        level_changes: By the barometer, of the last observation.
    """

    def __init__(self, params: FootInsParams = FOOT_INS_ROBUST) -> None:
        super().__init__(params)

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        super().reset(briefing, rng)
        heights_m = {} if briefing.building is None else level_heights(briefing.building)
        self._heights_m = heights_m if self._start.level in heights_m else {}
        has_air = "baro" in briefing.sensors
        self._tracker = LevelTracker(self._start.level, self._heights_m or None) if has_air else None
        self._changed: list[tuple[float, int]] = [(-math.inf, self._start.level)]  # when, and to which level
        self.level_changes: list[LevelChange] = []

    def step(self, observation: Observation) -> Estimate:
        self._steps_s = np.zeros(0)
        estimate = super().step(observation)
        if self._tracker is None:
            return estimate
        self.level_changes = self._tracker.update(observation["baro"], self._steps_s)
        for change in self.level_changes:
            self._changed.append((change.t_s, self._changed[-1][1] + change.levels))
        self._estimate = replace(estimate, level=self._tracker.level)
        return self._estimate

    def _levels(self, t_s: FloatArray, rise_m: FloatArray) -> IntArray:
        if self._tracker is not None:
            since_s = np.array([when_s for when_s, _ in self._changed])
            reached = np.array([level for _, level in self._changed], dtype=np.int64)
            at: IntArray = reached[np.searchsorted(since_s, t_s, side="right") - 1]
            return at
        if not self._heights_m:
            return super()._levels(t_s, rise_m)
        levels = np.array(list(self._heights_m), dtype=np.int64)
        off_m = rise_m[:, None] + self._heights_m[self._start.level] - np.array(list(self._heights_m.values()))
        nearest: IntArray = levels[np.abs(off_m).argmin(axis=1)]
        return nearest
