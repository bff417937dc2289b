"""Arrays and angles that everything else is written in."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


def read_only(values: ArrayLike, dtype: DTypeLike = np.float64) -> NDArray[Any]:
    """A contiguous copy of `values` that nobody can change; what is read-only already is not copied again.

    A part of a larger array is copied too: `base` would lead from it to the rest, from a start to the whole walk.
    """
    array = np.asarray(values, dtype=dtype)
    if array.flags.writeable or not array.flags.c_contiguous or _is_part(array):
        array = np.array(array, dtype=dtype, order="C", copy=True)
        array.flags.writeable = False
    return array


def _is_part(array: NDArray[Any]) -> bool:
    base = array.base
    while isinstance(base, np.ndarray):
        if base.nbytes > array.nbytes:
            return True
        base = base.base
    return False


def wrap_rad(angle_rad: ArrayLike) -> FloatArray:
    """Angles wrapped to [-pi, pi).

    >>> float(wrap_rad(3 * np.pi / 2)) == -np.pi / 2
    True
    """
    return (np.asarray(angle_rad, dtype=np.float64) + np.pi) % (2 * np.pi) - np.pi
