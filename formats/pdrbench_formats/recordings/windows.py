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
_ROWS_AT_A_TIME: Final = 64


def extremes(rows: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(C,) least and (C,) greatest of each column of rows (T, C); NumPy is slow along short rows: many at a time."""
    num, width = len(rows) // _ROWS_AT_A_TIME, rows.shape[1]
    blocks = rows[: num * _ROWS_AT_A_TIME].reshape(num, _ROWS_AT_A_TIME * width)
    rest = rows[num * _ROWS_AT_A_TIME :]
    low, high = (
        np.concatenate([least(blocks, axis=0).reshape(-1, width) if num else rest, rest]) for least in (np.min, np.max)
    )
    return low.min(axis=0), high.max(axis=0)


def is_constant(rows: FloatArray) -> bool:
    """True where rows (T, C) hold one value from end to end but for their times."""
    return bool((rows[-1, 1:] == rows[0, 1:]).all() and (rows[:, 1:] == rows[0, 1:]).all())


def lengths(vectors: FloatArray) -> FloatArray:
    """(T,) length of each vector; what a damaged file holds must not overflow."""
    with np.errstate(over="ignore"):
        lengths: FloatArray = np.minimum(np.sqrt(np.einsum("...i,...i", vectors, vectors)), 1e100)
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
