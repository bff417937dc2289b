"""Counts the steps of Li et al. 2012 along a straight line, one metre each: where places are counts."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from pdrbench.geometry import FloatArray
from pdrbench.inertial.step_detection import GENTLE, StepDetector, StepParams
from pdrbench.localizer import Briefing, Estimate, Observation
from pdrbench.sensors.checks import rate_of
from pdrbench_lab.adaptive_steps import find_adaptive_steps


@dataclass(frozen=True, slots=True)
class StepCountParams:
    """Settings of `StepCount`; with `adapts=false&detection.swing_g=0.2,2` they are the paper's.

    Attributes:
        detection: Of steps while the walk goes on.
        adapts: Counts again when the walk is over, with a threshold that goes by the place of the phone and the person.
    """

    detection: StepParams = GENTLE
    adapts: bool = True


STEP_COUNT: Final = StepCountParams()


class StepCount:
    """Walks a metre a step along the heading of the start, along x where there is no heading.

    A step is known two or more steps late; when the walk is over, the count is dated back to when each step was made.

    Args:
        params: See `StepCountParams`.
    """

    def __init__(self, params: StepCountParams = STEP_COUNT) -> None:
        self._params = params

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        briefing.require(sensors=("accel",), start=True)
        assert briefing.start is not None
        self._start = briefing.start
        heading_rad = briefing.start.heading_rad or 0.0
        self._ahead = np.array([math.cos(heading_rad), math.sin(heading_rad)])
        self._detector = StepDetector(briefing.sensors["accel"].rate_hz or 50.0, self._params.detection)
        self._made_s: list[float] = []
        self._rows: list[FloatArray] = []

    def step(self, observation: Observation) -> Estimate:
        self._made_s += self._detector.update(observation["accel"]).peak_s.tolist()
        if self._params.adapts:
            self._rows.append(observation["accel"].copy())
        return Estimate(xy_m=self._at(np.array([float(len(self._made_s))]))[0], level=self._start.level)

    def revise(self) -> FloatArray:
        """(K, 4) the count at every step, and before the first one."""
        self._made_s += self._detector.finish().peak_s.tolist()
        if self._params.adapts:
            rows = np.concatenate(self._rows)
            self._made_s = find_adaptive_steps(rows, rate_of(rows[:, 0])).peak_s.tolist()
        t_s, last = np.unique(np.array([0.0, *self._made_s])[::-1], return_index=True)
        count = (len(self._made_s) - last).astype(np.float64)
        return np.column_stack([t_s, self._at(count), np.full(len(t_s), self._start.level)])

    def _at(self, count: FloatArray) -> FloatArray:
        """(n, 2) where the walker is after so many steps (n,)."""
        return np.asarray(self._start.xy_m + count[:, None] * self._ahead)
