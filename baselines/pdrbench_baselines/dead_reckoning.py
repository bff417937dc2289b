"""Dead reckoning: add up strides or steps from a known start, with no map and no radio."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from pdrbench.errors import UnsuitableError
from pdrbench.geometry import FloatArray
from pdrbench.inertial import PeakStepDetector, phone_heading_rad
from pdrbench.localizer import Briefing, Estimate, Observation


@dataclass(frozen=True, slots=True)
class DeadReckoningParams:
    """Defaults for `DeadReckoning`."""

    step_length_m: float = 0.63  # path length over detected steps, all train walks of MallPhone-v2
    level_height_m: float = 3.0  # rise that counts as a level where the briefing has no building


DEAD_RECKONING: Final = DeadReckoningParams()


class DeadReckoning:
    """Adds stride events where the environment offers them, else phone steps of one fixed length.

    A stride first turns and then moves (Woodman & Harle 2008, eq. 9-11). A phone step moves along the top edge of the
    phone, which is where people hold it to; in a trouser pocket it points elsewhere. Where a phone has changes of level
    (`level_change`), the level follows them.

    Args:
        params: See `DeadReckoningParams`.
    """

    def __init__(self, params: DeadReckoningParams = DEAD_RECKONING) -> None:
        self._params = params

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        briefing.require(start=True)
        assert briefing.start is not None
        start = briefing.start
        self._xy_m = np.array(start.xy_m)
        self._level = start.level
        if "stride" in briefing.sensors:
            if start.heading_rad is None:
                raise UnsuitableError("needs the heading of the start to add strides")
            self._levels = _LevelByHeight(briefing, self._params.level_height_m)
            self._heading_rad, self._rise_m = start.heading_rad, 0.0
            self._advance = self._add_strides
        else:
            briefing.require(sensors=("accel", "rotation"))
            self._detector = PeakStepDetector(briefing.sensors["accel"].rate_hz or 50.0)
            self._rotation: FloatArray = np.zeros((0, 5))
            self._has_level_changes = "level_change" in briefing.sensors
            self._advance = self._add_steps

    def step(self, observation: Observation) -> Estimate:
        self._advance(observation)
        return Estimate(xy_m=self._xy_m, level=self._level)

    def _add_strides(self, observation: Observation) -> None:
        for _, length_m, height_m, turn_rad in observation["stride"].tolist():
            self._heading_rad += turn_rad
            self._move(length_m)
            self._rise_m += height_m
            self._level = self._levels.at(self._rise_m)

    def _add_steps(self, observation: Observation) -> None:
        self._rotation = np.concatenate([self._rotation[-1:], observation["rotation"]])
        for step_t_s in self._detector.update(observation["accel"]).tolist():
            if len(self._rotation):
                row = max(int(np.searchsorted(self._rotation[:, 0], step_t_s, side="right")) - 1, 0)
                self._heading_rad = float(phone_heading_rad(self._rotation[row, 1:]))
                self._move(self._params.step_length_m)
        if self._has_level_changes:
            self._level += int(observation["level_change"][:, 1].sum())

    def _move(self, length_m: float) -> None:
        self._xy_m = self._xy_m + length_m * np.array([np.cos(self._heading_rad), np.sin(self._heading_rad)])


class _LevelByHeight:
    """The level whose floor is nearest to a height above the start."""

    def __init__(self, briefing: Briefing, level_height_m: float) -> None:
        assert briefing.start is not None
        start = briefing.start
        if briefing.building is None:
            self._level = np.arange(start.level - 20, start.level + 21)
            self._height_m = (self._level - start.level) * level_height_m
        else:
            floors = [p for p in briefing.building.polygons if p.kind == "floor"]
            self._level = np.array(sorted({p.level for p in floors}))
            height_m = np.array([np.median([p.height_m for p in floors if p.level == one]) for one in self._level])
            self._height_m = height_m - height_m[self._level == start.level].mean()

    def at(self, rise_m: float) -> int:
        return int(self._level[np.argmin(np.abs(self._height_m - rise_m))])
