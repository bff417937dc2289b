"""Resampling: particles are drawn by weight, at evenly spaced offsets (systematic) or independently (multinomial)."""

from __future__ import annotations

import numpy as np

from pdrbench.compiled import compiled
from pdrbench.geometry import FloatArray, IntArray


@compiled
def systematic(weight: FloatArray, offset: float) -> IntArray:
    """(N,) ascending indices of particles, each N w / sum(w) times, rounded up or down.

    Args:
        weight: (N,) at least one of them above 0.
        offset: In [0, 1), of the first draw; draws are 1 / N apart.
    """
    cumulative, count = np.cumsum(weight), len(weight)
    chosen, one = np.empty(count, np.int64), 0
    for i in range(count):
        at = (offset + i) / count
        while one < count - 1 and cumulative[one] / cumulative[-1] <= at:
            one += 1
        chosen[i] = one
    return chosen


def multinomial(weight: FloatArray, draw: FloatArray) -> IntArray:
    """(n,) indices of particles drawn by weight (N,), one for each of `draw` (n,), uniform in [0, 1)."""
    cumulative = np.cumsum(weight)
    chosen: IntArray = np.searchsorted(cumulative, draw * cumulative[-1], side="right").clip(max=len(weight) - 1)
    return chosen
