"""How far the mean of a compass is off: much at first, less the longer the walk.

Displacements are turned to the mean of the compass so far, and that mean moves by 10 degrees or so in the first half
minute of a walk: the field of a building is bent in the place where a walk begins, and otherwise ten metres on. When
it moves, headings that walls and scans have borne out would be turned away with it. Here a particle keeps its heading,
as the gyroscope has it, and how well that agrees with the mean, the better known the more, chooses between particles.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pdrbench.geometry import FloatArray


@dataclass(frozen=True, slots=True)
class CompassParams:
    """Errors of the mean of a compass, in rad; see the notebook on fusion.

    Attributes:
        sigma_rad: Their standard deviation on a long walk.
        early_sigma_rad: That of what comes on top when a walk begins.
        settles_s: After which half of the variance of that is left.
        freedom: Degrees of freedom of their distribution, Student's t: some compasses are off by a right angle.
        walk_rad: By which the error of a heading wanders in a second, that follows the gyroscope alone.
    """

    sigma_rad: float = math.radians(5.0)
    early_sigma_rad: float = math.radians(9.0)
    settles_s: float = 8.0
    freedom: float = 4.0
    walk_rad: float = math.radians(0.5)


class CompassMean:
    """What the mean of the compass says of headings while it moves.

    Args:
        params: See `CompassParams`.
    """

    def __init__(self, params: CompassParams) -> None:
        self._params, self._mean_rad = params, 0.0
        self.spread_rad = self._before_rad = self._spread_rad(0.0)

    def update(self, mean_rad: float, now_s: float) -> float:
        """Takes the mean at a time, and gives by how much the frame of displacements turned since the last one."""
        turn_rad = mean_rad - self._mean_rad
        self._mean_rad, self._before_rad, self.spread_rad = mean_rad, self.spread_rad, self._spread_rad(now_s)
        return turn_rad

    def log_gain(self, before_rad: FloatArray, after_rad: FloatArray) -> FloatArray:
        """(N,) by how much likelier headings became with the last update, that were off the mean by so much (N,)."""
        return self._log_density(after_rad / self.spread_rad) - self._log_density(before_rad / self._before_rad)

    def _spread_rad(self, now_s: float) -> float:
        p = self._params
        return math.sqrt(p.sigma_rad**2 + p.early_sigma_rad**2 * p.settles_s / (p.settles_s + now_s))

    def _log_density(self, off: FloatArray) -> FloatArray:
        freedom = self._params.freedom
        density: FloatArray = -0.5 * (freedom + 1.0) * np.log1p(off**2 / freedom)
        return density
