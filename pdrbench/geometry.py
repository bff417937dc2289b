"""Arrays and angles that everything else is written in."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


def read_only(values: ArrayLike, dtype: DTypeLike = np.float64) -> NDArray[Any]:
    """A contiguous copy of `values` that cannot be changed; what is read-only already is not copied again.

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


def path_heading_rad(xy_m: FloatArray, away_m: float) -> float | None:
    """Direction in which a path leaves a circle about its first point; None where it stays inside.

    Small errors of the path change it little: neither where points lie on the path nor how many there are matters.

    Args:
        xy_m: (n, 2) points joined by straight lines.
        away_m: Radius of the circle.

    >>> round(path_heading_rad(np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 4.0]]), 2.0), 6) == round(np.pi / 3, 6)
    True
    """
    from_start_m = np.asarray(xy_m, dtype=np.float64) - xy_m[:1]
    outside = np.flatnonzero(np.hypot(from_start_m[:, 0], from_start_m[:, 1]) >= away_m)
    if not len(outside):
        return None
    inner, along = from_start_m[outside[0] - 1], from_start_m[outside[0]] - from_start_m[outside[0] - 1]
    # |inner + s along| = away, s from 0 to 1: the larger root, since inner lies inside
    a, b, c = along @ along, inner @ along, inner @ inner - away_m**2
    x_m, y_m = inner + along * ((-b + np.sqrt(b * b - a * c)) / a)
    return float(np.arctan2(y_m, x_m))
