"""The plane in hexagons of equal size: where a place is, and which edges a way crosses.

Hexagon (q, r) of circumradius R has its centre at x = sqrt(3) R (q + r / 2), y = 3 R r / 2, so that two of its edges
are parallel to the y axis. Edges are numbered as in `pdrbench_lab.footslam.kernels`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from pdrbench.geometry import FloatArray, IntArray
from pdrbench_lab.footslam import kernels


def centre_m(hexagon: ArrayLike, radius_m: float) -> FloatArray:
    """(..., 2) centres of hexagons (..., 2).

    >>> centre_m([[1, 0], [0, 2]], 2.0).round(3).tolist()
    [[3.464, 0.0], [3.464, 6.0]]
    """
    q, r = np.moveaxis(np.asarray(hexagon, dtype=np.float64), -1, 0)
    return np.stack([np.sqrt(3.0) * radius_m * (q + r / 2), 1.5 * radius_m * r], axis=-1)


def hexagon_of(xy_m: ArrayLike, radius_m: float) -> IntArray:
    """(..., 2) the hexagon (q, r) of each place (..., 2), the one whose centre is nearest."""
    x, y = np.moveaxis(np.asarray(xy_m, dtype=np.float64), -1, 0)
    r = y / (1.5 * radius_m)
    q = x / (np.sqrt(3.0) * radius_m) - r / 2
    cube = np.stack([q, r, -q - r], axis=-1)  # sums to 0; where the rounded one does not, the worst is set right
    rounded = np.rint(cube)
    worst = np.argmax(np.abs(rounded - cube), axis=-1)[..., None]
    mended = np.take_along_axis(rounded, worst, axis=-1) - rounded.sum(axis=-1, keepdims=True)
    np.put_along_axis(rounded, worst, mended, axis=-1)
    found: IntArray = rounded[..., :2].astype(np.int64)
    return found


def neighbour(hexagon: ArrayLike, edge: ArrayLike) -> IntArray:
    """(..., 2) the hexagons beyond edges (...) of hexagons (..., 2)."""
    steps = np.column_stack([kernels.STEP_Q, kernels.STEP_R])
    beyond: IntArray = np.asarray(hexagon, dtype=np.int64) + steps[np.asarray(edge, dtype=np.int64)]
    return beyond


def corners_m(hexagon: ArrayLike, radius_m: float) -> FloatArray:
    """(..., 6, 2) corners of hexagons (..., 2); edge e is between corners e and e + 1."""
    angle_rad = np.pi / 3 * np.arange(6) - np.pi / 6
    around_m = radius_m * np.column_stack([np.cos(angle_rad), np.sin(angle_rad)])
    return centre_m(hexagon, radius_m)[..., None, :] + around_m


def crossings(start_m: FloatArray, end_m: FloatArray, radius_m: float) -> list[IntArray]:
    """Of each segment (N, 2) to (N, 2) the edges that it crosses, in order, from the hexagon of its start.

    Exact: hexagon by hexagon, the edge that the line meets first. Through a corner it goes by way of the edge with the
    smaller number.
    """
    start_m, end_m = np.asarray(start_m, dtype=np.float64), np.asarray(end_m, dtype=np.float64)
    cell = hexagon_of(start_m, radius_m)
    longest_m = float(np.hypot(*(end_m - start_m).T).max(initial=0.0))
    edges = np.empty((len(start_m), 8 + int(2 * longest_m / radius_m)), dtype=np.int64)
    counts = np.empty(len(start_m), dtype=np.int64)
    kernels.trace_each(cell[:, 0], cell[:, 1], start_m, end_m, radius_m, edges, counts)
    return [row[:count] for row, count in zip(edges, counts.tolist(), strict=True)]
