"""Dynamic time warping: how far two waves are apart when one may be stretched in time to fit the other."""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit

from pdrbench.errors import PdrbenchError
from pdrbench.geometry import FloatArray

FLAT: Final = 1e-9  # a wave with a smaller standard deviation has no shape: it is not blown up to one


def z_scored(wave: FloatArray) -> FloatArray:
    """(n,) the wave with mean 0 and standard deviation 1; a flat one becomes 0."""
    centred = wave - wave.mean()
    return np.asarray(centred / max(float(centred.std()), FLAT))


def warped_distance(one: FloatArray, other: FloatArray, band: int | None = None) -> float:
    """Square root of the least sum of squared differences along a path that pairs the samples of two waves in order.

    A path begins at both first samples, ends at both last ones and moves on by one sample of either wave or of both.

    Args:
        one: (n,) finite, not empty.
        other: (m,) finite, not empty.
        band: Samples that a path may leave the diagonal by; where lengths differ, the parallelogram between the
            diagonals of both ends (Sakoe and Chiba 1978). 0 with equal lengths is the Euclidean distance. None: no
            limit.

    >>> warped_distance(np.array([0.0, 1.0, 0.0]), np.array([0.0, 1.0, 1.0, 0.0]))
    0.0
    """
    if not len(one) or not len(other) or (band is not None and band < 0):
        raise PdrbenchError(
            f"waves of {len(one)} and {len(other)} samples and a band of {band}; give samples and a band of 0 or more"
        )
    width = len(one) + len(other) if band is None else band
    return float(np.sqrt(_warped(np.asarray(one, float), np.asarray(other, float), width)))


@njit(cache=True, nogil=True)
def _warped(a, b, band):  # type: ignore[no-untyped-def]
    """Least sum of squares of a (n,) and b (m,), row by row of the table of all pairs."""
    n, m = len(a), len(b)
    below, above = band + max(0, n - m), band + max(0, m - n)  # i - j and j - i may be so much
    last, new = np.full(m + 2, np.inf), np.full(m + 2, np.inf)
    last[0] = 0.0
    for i in range(n):
        low, high = max(0, i - below), min(m - 1, i + above)
        new[low] = left = np.inf
        for j in range(low, high + 1):
            apart = a[i] - b[j]
            left = apart * apart + min(last[j + 1], last[j], left)
            new[j + 1] = left
        new[high + 2] = np.inf
        last, new = new, last
    return last[m]
