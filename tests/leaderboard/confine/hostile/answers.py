"""Answers that make no sense, or too much."""

from __future__ import annotations

import numpy as np

from hostile.common import Honest, define
from pdrbench.localizer import Estimate, Observation

define(
    globals(),
    Honest,
    "step",
    {
        "NotFinite": lambda self, observation: Estimate(np.array([np.nan, np.inf]), 0),
        "SaysNothing": lambda self, observation: None,
        "WrongShape": lambda self, observation: Estimate(np.zeros((3, 7)), 0),
    },
)


class OddTypes(Honest):
    """Estimates with arbitrary fields."""

    def misbehave(self) -> object:
        odd = Estimate(np.zeros(2), 0)
        object.__setattr__(odd, "level", {"a": [object()] * 3})
        object.__setattr__(odd, "sigma_m", "wide")
        return odd


class Extremes(Honest):
    """Extreme floats in every optional field."""

    def step(self, observation: Observation) -> Estimate:
        super().step(observation)
        size = (1e308, -1e308, 5e-324)[self.count % 3]
        return Estimate(np.array([size, -size]), 10**15, heading_rad=size, sigma_m=-size, converged=True)


class FutureDated(Honest):
    """A revised past that is the future."""

    def revise(self) -> np.ndarray:
        t_s = np.array([1e6, 2e6, 1e9])
        return np.column_stack([t_s, np.full((3, 2), 77.0), np.zeros(3)])


class PastWithoutEnd(Honest):
    """A revised past of 10 MB, for 13 observations."""

    def revise(self) -> np.ndarray:
        rows = np.zeros((300_000, 4))
        rows[:, 0] = np.arange(300_000) * 1e-5
        return rows
