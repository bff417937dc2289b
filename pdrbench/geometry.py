"""Arrays and angles that everything else is written in."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


def read_only(values: ArrayLike, dtype: DTypeLike = np.float64) -> NDArray[Any]:
    """A contiguous copy of `values` that nobody can change; what is read-only already is not copied again."""
    array = np.asarray(values, dtype=dtype)
    if array.flags.writeable or not array.flags.c_contiguous:
        array = np.array(array, dtype=dtype, order="C", copy=True)
        array.flags.writeable = False
    return array


def wrap_rad(angle_rad: ArrayLike) -> FloatArray:
    """Angles wrapped to [-pi, pi).

    >>> float(wrap_rad(3 * np.pi / 2)) == -np.pi / 2
    True
    """
    return (np.asarray(angle_rad, dtype=np.float64) + np.pi) % (2 * np.pi) - np.pi
