"""Compiled parts of a step of `StrideFilter`; the map walk between them is that of `pdrbench.filters.kernels`."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit


@njit(cache=True)
def by_piece(piece: Any, num_pieces: int) -> Any:
    """(N,) particles in the order of their pieces: neighbours in memory walk through the same half planes."""
    first = np.zeros(num_pieces + 1, np.int64)
    for i in range(len(piece)):
        first[piece[i] + 1] += 1
    for k in range(num_pieces):
        first[k + 1] += first[k]
    order = np.empty(len(piece), np.int64)
    for i in range(len(piece)):
        order[first[piece[i]]] = i
        first[piece[i]] += 1
    return order


@njit(cache=True)
def propagate(
    xy: Any, a: Any, b: Any, bias: Any, off: Any, noise: Any, share: float, frequency: float, heading: float
) -> Any:
    """(N, 2) where a step ends, eq. (3) and (7); `off` and `noise` (N,) are those of heading and length."""
    end = np.empty_like(xy)
    for i in range(len(xy)):
        length = (a[i] * frequency + b[i]) * (1.0 + share * noise[i])
        course = heading + bias[i] + off[i]
        end[i, 0] = xy[i, 0] + length * math.cos(course)
        end[i, 1] = xy[i, 1] + length * math.sin(course)
    return end


@njit(cache=True)
def weigh(
    xy: Any, alive: Any, off: Any, is_middle: Any, x0: float, y0: float, tile: float, factor: float, weight: Any
) -> Any:
    """Sets weights (L19): 0 for the dead, `factor` in the middle of a pathway, else 1.

    Returns:
        How many live, and the sum of their heading noise.
    """
    rows, columns = is_middle.shape
    count, total = 0, 0.0
    for i in range(len(xy)):
        weight[i] = 0.0
        if alive[i]:
            column = min(max(int((xy[i, 0] - x0) / tile), 0), columns - 1)
            row = min(max(int((xy[i, 1] - y0) / tile), 0), rows - 1)
            weight[i] = factor if is_middle[row, column] else 1.0
            count += 1
            total += off[i]
    return count, total


@njit(cache=True)
def choose(weight: Any, draw: Any) -> Any:
    """(n,) particles drawn by weight, one for each of `draw` (n,), uniform in [0, 1)."""
    total = 0.0
    cumulative = np.empty(len(weight))
    for i in range(len(weight)):
        total += weight[i]
        cumulative[i] = total
    chosen = np.empty(len(draw), np.int64)
    for k in range(len(draw)):
        chosen[k] = min(np.searchsorted(cumulative, draw[k] * total, side="right"), len(weight) - 1)
    return chosen


@njit(cache=True)
def centre(xy: Any) -> Any:
    """Mean x and y, and the standard deviation per axis."""
    x, y = 0.0, 0.0
    for i in range(len(xy)):
        x += xy[i, 0]
        y += xy[i, 1]
    x, y = x / len(xy), y / len(xy)
    squares = 0.0
    for i in range(len(xy)):
        squares += (xy[i, 0] - x) ** 2 + (xy[i, 1] - y) ** 2
    return x, y, math.sqrt(squares / (2 * len(xy)))
