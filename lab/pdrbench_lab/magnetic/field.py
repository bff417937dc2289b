"""The magnetic field on a lattice, from a survey by walks of which each adds an offset of its own.

Steel bends the field of the Earth from metre to metre (Shu et al. 2015, "Magicol"). Horizontal magnitude h and
vertical part v are a mean and a Gaussian process with an exponential kernel each. A phone adds a vector b of its own
frame, what is left of its hard iron: to v it adds b_z, to h nearly u . b, u being the direction of the measured
horizontal field in the level frame of the phone. All that is linear in normal variables, so that offsets of the walks
of a survey go into its covariance, and what their crossings say of them comes out of the same equations.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.spatial import KDTree
from scipy.spatial.distance import cdist

from pdrbench.geometry import FloatArray, IntArray
from pdrbench.recording import MagneticMap

COMPONENTS: Final = 2  # horizontal magnitude, vertical part
MIN_HORIZONTAL_UT: Final = 1.0  # below it, the horizontal field points nowhere


@dataclass(frozen=True, slots=True)
class MagneticFieldParams:
    """Ours, read off pairs of train walks of `MallPhoneMagnetic-v1` that lie in different sessions; magnetic.md.

    Attributes:
        lattice_m: Between places where the field is evaluated.
        margin_m: Farther from every sample the field is its mean, with the whole variance.
        thin_m: Samples of a walk are averaged in squares of this side.
        sigma_ut: Spread of h and of v.
        length_m: Of the exponential kernel.
        nugget_ut: Of a sample: places are off, and so is the height of the phone.
        offset_ut: Spread of the offset of a phone, per axis.
    """

    lattice_m: float = 1.0
    margin_m: float = 6.0
    thin_m: float = 1.5
    sigma_ut: tuple[float, float] = (5.5, 6.5)
    length_m: float = 5.0
    nugget_ut: float = 3.0
    offset_ut: float = 7.0


def magnitudes_of(field_ut: FloatArray) -> tuple[FloatArray, FloatArray]:
    """What is compared of level fields (n, 3).

    Returns:
        value_ut: (n, 2) horizontal magnitude and vertical part.
        toward: (n, 2) unit vector of the horizontal field in the level frame of the phone; 0 where there is none.
    """
    horizontal_ut = np.hypot(field_ut[:, 0], field_ut[:, 1])
    toward = field_ut[:, :2] / np.maximum(horizontal_ut, MIN_HORIZONTAL_UT)[:, None]
    return np.column_stack([horizontal_ut, field_ut[:, 2]]), toward


class MagneticField:
    """The field of a survey; a level is fitted when it is first asked for.

    Args:
        magnetic_map: With one sample or more.
        params: See `MagneticFieldParams`.

    Attributes:
        levels: (L,) int, that are surveyed.
        mean_ut: (2,) of the survey, of horizontal magnitude and vertical part.
    """

    def __init__(self, magnetic_map: MagneticMap, params: MagneticFieldParams) -> None:
        self.params, self._map = params, magnetic_map
        self.levels = np.unique(magnetic_map.level)
        self.mean_ut: FloatArray = magnitudes_of(magnetic_map.field_ut)[0].mean(axis=0)
        self._level: dict[int, _Level] = {}

    def at(self, xy_m: FloatArray, level: IntArray) -> tuple[FloatArray, FloatArray]:
        """Mean (N, 2) in microtesla and variance (N, 2) of the field at places (N, 2) on levels (N,)."""
        mean_ut = np.tile(self.mean_ut, (len(xy_m), 1))
        variance_ut2 = np.tile(np.square(self.params.sigma_ut), (len(xy_m), 1))
        for one in self.levels.tolist():
            here = np.flatnonzero(level == one)
            if len(here):
                fitted = self.level(one)
                square, inside = fitted.squares_at(xy_m[here])
                mean_ut[here[inside]] = fitted.mean_ut[square]
                variance_ut2[here[inside]] = fitted.variance_ut2[square]
        return mean_ut, variance_ut2

    def level(self, level: int) -> _Level:
        """The lattice of a surveyed level."""
        if level not in self._level:
            on = self._map.level == level
            places = self._map.xy_m[on], self._map.walk[on], self._map.field_ut[on]
            self._level[level] = _Level(*places, self.mean_ut, self.params)
        return self._level[level]


class _Level:
    """One level on a rectangular lattice.

    Attributes:
        samples_m: (n, 2) places of the samples, thinned.
        mean_ut, variance_ut2: (X, Y, 2).
    """

    def __init__(
        self, xy_m: FloatArray, walk: IntArray, field_ut: FloatArray, mean_ut: FloatArray, params: MagneticFieldParams
    ) -> None:
        p = self._params = params
        self.samples_m, walk, value_ut, toward = _thinned(xy_m, walk, field_ut, p.thin_m)
        self._low_m = self.samples_m.min(axis=0) - p.margin_m
        size = np.ceil((self.samples_m.max(axis=0) + p.margin_m - self._low_m) / p.lattice_m).astype(np.int64)
        row = np.stack(np.meshgrid(*map(np.arange, size), indexing="ij"), axis=-1).reshape(-1, 2)
        lattice_m = self._low_m + (row + 0.5) * p.lattice_m
        near = np.flatnonzero(KDTree(self.samples_m).query(lattice_m)[0] <= p.margin_m)
        apart = np.exp(-cdist(self.samples_m, self.samples_m) / p.length_m)
        cross = np.exp(-cdist(self.samples_m, lattice_m[near]) / p.length_m)
        same = walk[:, None] == walk[None, :]
        mean, variance = np.tile(mean_ut, (len(row), 1)), np.tile(np.square(p.sigma_ut), (len(row), 1))
        for component, shared in enumerate((toward @ toward.T, np.ones_like(apart))):
            sigma2 = p.sigma_ut[component] ** 2
            covariance = sigma2 * apart + p.offset_ut**2 * shared * same
            covariance[np.diag_indices(len(covariance))] += p.nugget_ut**2
            left_ut = value_ut[:, component] - mean_ut[component]
            covariance[np.diag_indices(len(covariance))] += _disagreement_ut2(covariance, left_ut, walk)
            factor = cho_factor(covariance, lower=True, overwrite_a=True, check_finite=False)
            mean[near, component] += sigma2 * (cho_solve(factor, left_ut, check_finite=False) @ cross)
            known = solve_triangular(factor[0], cross, lower=True, check_finite=False)
            variance[near, component] -= sigma2**2 * (known**2).sum(axis=0)
        self.mean_ut, self.variance_ut2 = mean.reshape(*size, COMPONENTS), variance.reshape(*size, COMPONENTS)

    def squares_at(self, xy_m: FloatArray) -> tuple[tuple[IntArray, IntArray], FloatArray]:
        """Which places (N, 2) are on the lattice, (N,) bool, and rows and columns of those that are."""
        row = np.floor((xy_m - self._low_m) / self._params.lattice_m).astype(np.int64)
        inside = (row >= 0).all(axis=1) & (row < self.mean_ut.shape[:2]).all(axis=1)
        x, y = row[inside].T
        return (x, y), inside


def _disagreement_ut2(covariance: FloatArray, left_ut: FloatArray, walk: IntArray) -> FloatArray:
    """(n,) by how much more variance the samples of a walk have than a covariance (n, n) says.

    The mean, over a walk, of the squares of what its samples are off from what all others predict, less the variance of
    that (Rasmussen & Williams 2006, section 5.4.2); offsets that are as large as the field itself show there.
    """
    inverse = cho_solve(cho_factor(covariance, lower=True, check_finite=False), np.eye(len(covariance)))
    variance = 1.0 / np.diag(inverse)
    more = (variance * (inverse @ left_ut)) ** 2 - variance
    _, number, count = np.unique(walk, return_inverse=True, return_counts=True)
    return np.asarray(np.maximum(np.bincount(number, more) / count, 0.0)[number])


def _thinned(
    xy_m: FloatArray, walk: IntArray, field_ut: FloatArray, side_m: float
) -> tuple[FloatArray, IntArray, FloatArray, FloatArray]:
    """Samples averaged by walk and square: places (n, 2), walks (n,), values (n, 2) and directions (n, 2)."""
    key = np.column_stack([walk, np.floor(xy_m / side_m).astype(np.int64)])
    found, square, count = np.unique(key, axis=0, return_inverse=True, return_counts=True)
    rows = np.column_stack([xy_m, *magnitudes_of(field_ut)])
    means = np.column_stack([np.bincount(square.ravel(), column, len(count)) / count for column in rows.T])
    return means[:, :2], found[:, 0], means[:, 2:4], means[:, 4:]
