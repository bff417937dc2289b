"""`learned`: dead reckoning by a network."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from pdrbench.localizer import Briefing, Estimate, Observation
from pdrbench_baselines.learned.base import CARRY_S, NetworkLocalizer


@dataclass(frozen=True, slots=True)
class ReckoningErrors:
    """By how much dead reckoning is off, for `sigma_m`; ours.

    Attributes:
        scale_sigma: Of lengths, for a whole walk, as a fraction.
        heading_sigma_rad: Of headings, for a whole walk.
        error_correlation: The variance of the sum of seconds is so many times the sum of their variances.
    """

    scale_sigma: float = 0.05
    heading_sigma_rad: float = math.radians(14.0)  # 11 degrees of the phone (sources.md 1.5), the rest ours
    error_correlation: float = 3.0  # on recorded mall walks 95 % discs hold 86 % (train) and 98 % (val)


@dataclass(frozen=True, slots=True)
class LearnedParams:
    """Settings of `Learned`; all ours.

    Attributes:
        weights: File of a training run; None for the network that comes with pdrbench.
        carry_s: Between seconds the answer goes on at the last velocity, so long at most.
        start_sigma_m: Spread around a start, per axis, at least.
        errors: For `sigma_m`.
    """

    weights: str | None = None
    carry_s: float = CARRY_S
    start_sigma_m: float = 0.5
    errors: ReckoningErrors = field(default_factory=ReckoningErrors)


LEARNED: Final = LearnedParams()


class Learned(NetworkLocalizer):
    """Adds up the displacements of the network, second by second, from a known start.

    Needs accelerometer and gyroscope of a phone at 20 Hz or more, with a rotation vector, a magnetometer or the heading
    of the start.

    Args:
        params: See `LearnedParams`.
    """

    def __init__(self, params: LearnedParams = LEARNED) -> None:
        super().__init__(params.weights, params.carry_s)
        self._params = params

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        briefing.require(start=True)
        assert briefing.start is not None
        p = self._params
        self._begin(briefing)
        self._xy_m, self._level = np.array(briefing.start.xy_m), briefing.start.level
        self._start_m = self._xy_m.copy()
        self._spread_m2 = max(briefing.start.radius_m / 2, p.start_sigma_m) ** 2

    def step(self, observation: Observation) -> Estimate:
        errors = self._params.errors
        for move in self._reckoner.update(observation.rows):
            self._xy_m = self._xy_m + move.move_m
            self._spread_m2 += errors.error_correlation * float(move.covariance_m2[0, 0] + move.covariance_m2[1, 1]) / 2
            self._follow(move.move_m, move.end_s)
        if self._has_level_changes:
            self._level += int(observation["level_change"][:, 1].sum())
        away_m2 = math.dist(self._xy_m, self._start_m) ** 2
        fraction2 = (errors.scale_sigma**2 + errors.heading_sigma_rad**2) / 2
        return Estimate(
            xy_m=self._xy_m + self._extrapolated_m(observation.now_s),
            level=self._level,
            heading_rad=self._heading_rad,
            sigma_m=math.sqrt(self._spread_m2 + fraction2 * away_m2),
        )
