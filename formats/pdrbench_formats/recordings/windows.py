"""What the checks of recordings share: lengths of vectors, means over windows, how much is looked at."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from pdrbench.geometry import FloatArray

Rows = Mapping[str, FloatArray]  # (T, C) by sensor name, columns as in `pdrbench.sensors`

MIN_ROWS: Final = 20  # fewer say nothing on units
MAX_ROWS: Final = 60_000  # that units and axes are judged by: ten minutes at 100 Hz
SAMPLED: Final = ("accel", "gyro", "mag", "rotation", "baro")
WINDOW_S: Final = 0.5


def lengths(vectors: FloatArray) -> FloatArray:
    """(T,) length of each vector; what a damaged file holds must not overflow."""
    with np.errstate(over="ignore"):
        lengths: FloatArray = np.sqrt(np.einsum("...i,...i", vectors, vectors))
    return lengths


def windows(rows: FloatArray, window_s: float) -> tuple[FloatArray, FloatArray]:
    """(K, C - 1) means over equal windows, NaN where one is empty, and (K,) rows in each."""
    if not len(rows) or rows[-1, 0] > (50 * len(rows) + 1000) * window_s:  # another unit of time: a finding of its own
        return np.zeros((0, rows.shape[1] - 1)), np.zeros(0)
    at = (rows[:, 0] // window_s).astype(np.int64)
    counts = np.bincount(at).astype(np.float64)
    sums = np.stack([np.bincount(at, weights=column) for column in rows[:, 1:].T], axis=1)
    with np.errstate(invalid="ignore"):
        return sums / counts[:, None], counts
