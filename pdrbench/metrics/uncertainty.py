"""How well the claimed uncertainty of an estimate, an isotropic normal with `sigma_m` per axis, fits its errors.

d_k is the error in the plane at a surveyed position, sigma_k the claim of the estimate in force there. A claim that is
missing, zero, negative or not finite cannot be scored: `sigma_unusable` counts those, and belongs beside every other
value.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from pdrbench.geometry import BoolArray, FloatArray
from pdrbench.metrics.hold import MAX_COORDINATE_M, Held
from pdrbench.metrics.level import level_differences
from pdrbench.metrics.position import errors_m
from pdrbench.trajectory import Trajectory

MAX_SIGMA_RATIO: Final = 1e6  # an error of more standard deviations counts as this many, so that no score overflows
AXES: Final = 2


def energy_scores_m(distance_m: FloatArray, sigma_m: FloatArray) -> FloatArray:
    """(N,) energy scores in metres, E|X - y| - E|X - X'| / 2 for independent X, X' of an isotropic normal in the plane.

    |X - y| has a Rice distribution, |X - X'| a Rayleigh distribution; with u = d^2 / (4 sigma^2) and the Bessel
    functions I scaled by e^-u (Gneiting & Raftery 2007, section 4.3):

        E|X - y|  = sigma sqrt(pi/2) ((1 + 2u) I0(u) + 2u I1(u)),   E|X - X'| = sigma sqrt(pi).

    Far from the centre E|X - y| is d. For a point estimate, sigma = 0, the score is d. It is proper: only the spread
    that the errors really have makes it least on average.

    Args:
        distance_m: (N,) d between the centre of the normal and the truth.
        sigma_m: (N,) standard deviation per axis, at least 0.
    """
    from scipy.special import i0e, i1e

    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        ratio = distance_m / sigma_m
    near = ratio < MAX_SIGMA_RATIO
    u = np.square(np.where(near, ratio, 0.0) / 2)
    rice = math.sqrt(math.pi / 2) * ((1 + 2 * u) * i0e(u) + 2 * u * i1e(u))
    expected_m = np.where(near, sigma_m * rice, distance_m)
    return np.asarray(expected_m - sigma_m * math.sqrt(math.pi) / 2)


def energy_score_m(held: Held, reference: Trajectory) -> float:
    """Mean energy score in metres over the surveyed positions with a usable sigma; the level is not in it.

    E|X - p_ref| - E|X - X'| / 2, X and X' independent draws of the claimed normal around p_est; see `energy_scores_m`.
    """
    usable, sigma_m = _usable(held, reference)
    if not usable.any():
        return math.nan
    return float(energy_scores_m(errors_m(held, reference)[usable], sigma_m[usable]).mean())


def coverage(held: Held, reference: Trajectory, *, fraction: float = 0.95) -> float:
    """Fraction of surveyed positions with a usable sigma that lie in the disc that should hold `fraction` of them.

    Its radius is sigma sqrt(-2 ln(1 - fraction)), it lies on the level of the estimate. Too low is overconfident, too
    high is underconfident.
    """
    usable, sigma_m = _usable(held, reference)
    if not usable.any():
        return math.nan
    radius_m = sigma_m[usable] * math.sqrt(-2.0 * math.log1p(-fraction))
    is_inside = errors_m(held, reference)[usable] <= radius_m
    return float(np.mean(is_inside & (level_differences(held, reference)[usable] == 0)))


def anees(held: Held, reference: Trajectory) -> float:
    """Average normalised estimation error squared: mean of d^2 / (2 sigma^2) over positions with a usable sigma.

    1 is consistent, above is overconfident; `anees_band` gives how far from 1 chance takes it. Bar-Shalom et al. 2001,
    section 5.4, divided by the number of axes.
    """
    usable, sigma_m = _usable(held, reference)
    if not usable.any():
        return math.nan
    with np.errstate(over="ignore"):
        ratio = np.minimum(errors_m(held, reference)[usable] / sigma_m[usable], MAX_SIGMA_RATIO)
    return float(np.mean(np.square(ratio)) / AXES)


def anees_band(num_walks: int, dof: int = AXES, level: float = 0.95) -> tuple[float, float]:
    """Where the mean over walks of `anees` lies with probability `level` if every claim is right.

    With one independent error per walk, num_walks dof ANEES has a chi-squared distribution with num_walks dof degrees
    of freedom. Positions of one walk depend on each other, so a walk counts once; where they depend little the true
    band is narrower.

    Args:
        num_walks: Independent walks, at least 1.
        dof: Axes.
        level: Probability.

    >>> [round(bound, 3) for bound in anees_band(20)]
    [0.611, 1.484]
    """
    from scipy.stats import chi2

    total = num_walks * dof
    return float(chi2.ppf((1 - level) / 2, total) / total), float(chi2.ppf((1 + level) / 2, total) / total)


def sigma_unusable(held: Held, reference: Trajectory) -> float:
    """Number of surveyed positions whose sigma is missing, zero, negative or not finite; NaN where none is claimed."""
    usable, sigma_m = _usable(held, reference)
    return math.nan if np.isnan(sigma_m).all() else float(np.count_nonzero(~usable))


def _usable(held: Held, reference: Trajectory) -> tuple[BoolArray, FloatArray]:
    """(n,) at the surveyed positions: which sigma can be scored, and sigma, beyond `MAX_COORDINATE_M` as that."""
    sigma_m = held.sigma_m[reference.surveyed]
    return np.isfinite(sigma_m) & (sigma_m > 0), np.minimum(sigma_m, MAX_COORDINATE_M)
