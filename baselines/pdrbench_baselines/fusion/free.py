"""Particles that no wall stops: what scans and the compass say of a walk, whatever the plan says.

Headings that are wrong can find room where the right ones meet walls, and a cloud on a map that has lost the right ones
never finds them again. These particles begin with headings as wide as a compass errs, walk by the same displacements,
and are weighed by the same scans and the same mean of the compass. When that evidence has become far better for them
than for the cloud on the map, it is the cloud that is lost.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from pdrbench.filters import multinomial
from pdrbench.geometry import FloatArray
from pdrbench_baselines.fusion.compass import CompassMean
from pdrbench_baselines.fusion.lost import States
from pdrbench_baselines.fusion.radio import RadioEvidence
from pdrbench_baselines.learned.map_filter import LearnedMapFilterParams

LEAST: Final = 1.0 / 3.0  # of the particles; where fewer count (1 / sum of squared weights), they are drawn anew


@dataclass(frozen=True, slots=True)
class FreeParams:
    """Ours; see the notebook on fusion.

    Attributes:
        num_particles: That no wall stops.
        lead: Logarithm of the odds by which their evidence is to be better.
        fraction: Of the cloud on the map, that is then put where they are.
    """

    num_particles: int = 1000
    lead: float = 15.0
    fraction: float = 0.5


class FreeCloud:
    """Particles from a known start, and by how much their evidence is ahead of that of a cloud on the map.

    Args:
        params: See `FreeParams`.
        map_params: Of the cloud on the map; errors of lengths and headings are as there.
        start_m: (2,) the start.
        sigma_m: Spread around it, per axis.
        compass: Whose errors headings begin with, Student's t.
        radio: The survey.
        rng: Start, motion and choice draw from it.

    Attributes:
        params: See `FreeParams`.
        lead: By how much their log-evidence is ahead.
    """

    def __init__(
        self,
        params: FreeParams,
        map_params: LearnedMapFilterParams,
        start_m: FloatArray,
        sigma_m: float,
        compass: CompassMean,
        radio: RadioEvidence,
        rng: np.random.Generator,
    ) -> None:
        self.params, self._map_params, self._radio, self._rng = params, map_params, radio, rng
        count = params.num_particles
        self._states = States(
            start_m + sigma_m * rng.standard_normal((count, 2)),
            np.exp(map_params.scale_sigma * rng.standard_normal(count)),
            compass.draw_rad(count, rng),
            rng.choice(len(radio.prior), size=count, p=radio.prior),
        )
        self._log_weight = np.zeros(count)
        self.lead = 0.0

    @property
    def offset_fraction(self) -> FloatArray:
        """(K,) of the weights, by the offset of the device."""
        weight = self._weight()
        return np.asarray(np.bincount(self._states.offset, weight, len(self._radio.prior)) / weight.sum())

    def turn(self, turn_rad: float, compass: CompassMean, cloud_gain: float) -> None:
        """As `Cloud.turn`, whose gain in log-evidence is given."""
        before_rad = self._states.bias_rad
        self._states = replace(self._states, bias_rad=before_rad - turn_rad)
        self._weigh(compass.log_gain(before_rad, self._states.bias_rad), cloud_gain)

    def move(self, move_m: FloatArray, covariance_m2: FloatArray) -> None:
        """One displacement (2,) and its covariance (2, 2)."""
        at, rng = self._states, self._rng
        count = len(at.scale)
        bias_rad = at.bias_rad + self._map_params.bias_walk_rad * rng.standard_normal(count)
        drawn_m = move_m + rng.standard_normal((count, 2)) @ np.linalg.cholesky(covariance_m2).T
        way = at.scale * np.exp(1j * bias_rad) * (drawn_m[:, 0] + 1j * drawn_m[:, 1])
        self._states = replace(at, xy_m=at.xy_m + np.column_stack([way.real, way.imag]), bias_rad=bias_rad)

    def weigh_by(self, log_likelihood: FloatArray, level: int, cloud_gain: float) -> None:
        """Weighs by the log-likelihoods (N, K) of a scan, for which the gain of `Cloud.weigh_by` is given."""
        at = self._states
        square = self._radio.squares_at(at.xy_m, np.full(len(at.xy_m), level))
        gain = np.where(square >= 0, log_likelihood[square, at.offset], log_likelihood.min()) - log_likelihood.max()
        self._weigh(gain, cloud_gain)
        weight = self._weight()
        if weight.sum() ** 2 < LEAST * len(weight) * (weight**2).sum():
            self._states, self._log_weight = self.draw(len(weight)), np.zeros(len(weight))

    def draw(self, count: int) -> States:
        """States of so many particles by their weights, each with the jitter that a cloud on a map gives to twins."""
        p, at, rng = self._map_params, self._states, self._rng
        chosen = multinomial(self._weight(), rng.random(count))
        return States(
            at.xy_m[chosen] + p.near_m * rng.standard_normal((count, 2)),
            at.scale[chosen] * np.exp(p.near_scale * rng.standard_normal(count)),
            at.bias_rad[chosen] + p.near_bias_rad * rng.standard_normal(count),
            at.offset[chosen],
        )

    def _weigh(self, log_gain: FloatArray, cloud_gain: float) -> None:
        before = np.logaddexp.reduce(self._log_weight)
        self._log_weight = self._log_weight + log_gain
        self.lead += float(np.logaddexp.reduce(self._log_weight) - before) - cloud_gain

    def _weight(self) -> FloatArray:
        weight: FloatArray = np.exp(self._log_weight - self._log_weight.max())
        return weight
