"""How many particles are enough: KLD sampling (Fox 2001), which Woodman & Harle 2008 use for every generation."""

from __future__ import annotations

import math
from statistics import NormalDist


def kld_bound(num_bins: int, epsilon: float, z: float) -> int:
    """Number of particles that keeps the sampling error below `epsilon`.

    With k occupied bins, n = (k-1)/(2 epsilon) * (1 - c + z sqrt(c))^3 and c = 2/(9(k-1)); Fox 2001. That is
    Wilson and Hilferty's approximation of chi2(k-1) / (2 epsilon) at the quantile that `z` stands for. A distribution
    of a single bin, or of none, is known from one particle.

    Plain float64 arithmetic: compiled by numba it gives the same number.

    Args:
        num_bins: Occupied histogram bins.
        epsilon: Bound on the Kullback-Leibler distance.
        z: Upper standard normal quantile, 2.33 for 99 %; see `normal_quantile`.

    Returns:
        At least 1.

    >>> kld_bound(8, 0.05, 2.33), kld_bound(31, 0.05, 2.33)
    (186, 510)
    """
    if num_bins < 2:
        return 1
    c = 2.0 / (9.0 * (num_bins - 1))
    root = 1.0 - c + z * math.sqrt(c)
    return max(1, math.ceil((num_bins - 1) / (2.0 * epsilon) * root * root * root))


def normal_quantile(delta: float) -> float:
    """The z that a standard normal exceeds with probability `delta`.

    >>> round(normal_quantile(0.01), 3)
    2.326
    """
    return NormalDist().inv_cdf(1.0 - delta)
