"""Counts the steps of Li et al. 2012 along a straight line, one metre each: where places are counts."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from pdrbench.geometry import FloatArray
from pdrbench.inertial import find_adaptive_steps
from pdrbench.inertial.step_detection import GENTLE, StepDetector, StepParams
from pdrbench.localizer import Briefing, Estimate, Observation
from pdrbench.params import merged
from pdrbench.sensors.checks import rate_of


class StepCount:
    """Walks a metre a step along the heading of the start, along x where there is no heading.

    A step is known two or more steps late; when the walk is over, the count is dated back to when each step was made.

    Args:
        params: Of step detection; None for `GENTLE`.
        adapts: Counts again when the walk is over, by `find_adaptive_steps`.
    """

    counts: ClassVar[str] = "steps"  # metres of its path are a count, no places

    def __init__(self, params: StepParams | Mapping[str, Any] | None = None, *, adapts: bool = False) -> None:
        self._params, self._adapts = merged(GENTLE, params, "step_count"), adapts

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        briefing.require(sensors=("accel",), start=True)
        assert briefing.start is not None
        self._start = briefing.start
        heading_rad = briefing.start.heading_rad or 0.0
        self._ahead = np.array([math.cos(heading_rad), math.sin(heading_rad)])
        self._detector = StepDetector(briefing.sensors["accel"].rate_hz or 50.0, self._params)
        self._made_s: list[float] = []
        self._rows: list[FloatArray] = []

    def step(self, observation: Observation) -> Estimate:
        self._made_s += self._detector.update(observation["accel"]).peak_s.tolist()
        if self._adapts:
            self._rows.append(observation["accel"].copy())
        return Estimate(xy_m=self._at(np.array([float(len(self._made_s))]))[0], level=self._start.level)

    def revise(self) -> FloatArray:
        """(K, 4) the count at every step, and before the first one."""
        self._made_s += self._detector.finish().peak_s.tolist()
        if self._adapts:
            rows = np.concatenate(self._rows)
            self._made_s = find_adaptive_steps(rows, rate_of(rows[:, 0])).peak_s.tolist()
        t_s, last = np.unique(np.array([0.0, *self._made_s])[::-1], return_index=True)
        count = (len(self._made_s) - last).astype(np.float64)
        return np.column_stack([t_s, self._at(count), np.full(len(t_s), self._start.level)])

    def _at(self, count: FloatArray) -> FloatArray:
        """(n, 2) where the walker is after so many steps (n,)."""
        return np.asarray(self._start.xy_m + count[:, None] * self._ahead)


def adaptive(params: StepParams | Mapping[str, Any] | None = None) -> StepCount:
    """Counted again with a threshold that goes by the place of the phone and by the person."""
    return StepCount(params, adapts=True)


def literal() -> StepCount:
    """With every number of the paper."""
    return StepCount(StepParams())
