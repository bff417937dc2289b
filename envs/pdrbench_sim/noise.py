"""White noise made into a process that remembers."""

from __future__ import annotations

import math

import numpy as np

from pdrbench.geometry import FloatArray


def autoregressive(noise: FloatArray, keep: float | FloatArray) -> FloatArray:
    """(n, ...) a stationary first-order autoregression of unit variance along the first axis.

    Args:
        noise: (n, ...) standard normal.
        keep: Correlation of one row with the next; (n - 1,) where rows are not evenly spaced in time.
    """
    if isinstance(keep, float):
        from scipy.signal import lfilter

        driven = noise.copy()
        driven[1:] *= math.sqrt(1 - keep**2)
        return np.asarray(lfilter([1.0], [1.0, -keep], driven, axis=0))
    values = noise.copy()
    for i, fraction in enumerate(keep.tolist(), start=1):
        values[i] = fraction * values[i - 1] + math.sqrt(1 - fraction**2) * values[i]
    return values
