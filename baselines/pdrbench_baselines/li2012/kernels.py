"""Compiled parts of a step of `StepModelFilter`; the map walk between them is that of `pdrbench.filters`."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from pdrbench.compiled import compiled


def warm_up() -> None:
    """Compiles them, or loads them from the cache."""
    xy, one = np.zeros((1, 2)), np.ones(1)
    propagate(xy, one, one, one, one, one, 0.1, 1.9, 0.0)
    inside = np.ones((1, 1), dtype=np.bool_)
    weigh(xy, one > 0, one, inside, xy[0], 1.0, 2.0, one)
    approach(xy, xy, xy[0], 1.0, xy[None], inside, 1.0, one[None])


@compiled
def propagate(
    xy: Any, a: Any, b: Any, bias: Any, off: Any, noise: Any, length_sigma: float, frequency: float, heading: float
) -> Any:
    """(N, 2) where a step ends, eq. (3) and (7); `off` and `noise` (N,) are those of heading and length."""
    end = np.empty_like(xy)
    for i in range(len(xy)):
        length = (a[i] * frequency + b[i]) * (1.0 + length_sigma * noise[i])
        towards = heading + bias[i] + off[i]
        end[i, 0] = xy[i, 0] + length * math.cos(towards)
        end[i, 1] = xy[i, 1] + length * math.sin(towards)
    return end


@compiled
def weigh(xy: Any, alive: Any, off: Any, is_middle: Any, corner: Any, tile: float, factor: float, weight: Any) -> Any:
    """Sets weights (L19): 0 where a particle hit a wall, `factor` in the middle of a pathway, else 1.

    Returns:
        How many hit no wall, and the sum of their heading noise.
    """
    rows, columns = is_middle.shape
    count, total = 0, 0.0
    for i in range(len(xy)):
        weight[i] = 0.0
        if alive[i]:
            column = min(max(int((xy[i, 0] - corner[0]) / tile), 0), columns - 1)
            row = min(max(int((xy[i, 1] - corner[1]) / tile), 0), rows - 1)
            weight[i] = factor if is_middle[row, column] else 1.0
            count += 1
            total += off[i]
    return count, total


@compiled
def approach(
    start: Any, end: Any, corner: Any, tile: float, middle: Any, inside: Any, most: float, square: Any
) -> None:
    """Lowers `square` (rows, columns) to squared distances from walls (W, 2) to (W, 2), where these are `most` at most.

    Of larger ones some walls may have been left out. `middle` (rows, columns, 2) are places in the tiles.
    """
    rows, columns = square.shape
    for w in range(len(start)):
        x, y = start[w, 0], start[w, 1]
        along_x, along_y = end[w, 0] - x, end[w, 1] - y
        over = 1.0 / (along_x * along_x + along_y * along_y)
        left, low = min(x, end[w, 0]) - most - corner[0], min(y, end[w, 1]) - most - corner[1]
        right, high = max(x, end[w, 0]) + most - corner[0], max(y, end[w, 1]) + most - corner[1]
        for r in range(max(int(low / tile), 0), min(int(high / tile) + 1, rows)):
            for c in range(max(int(left / tile), 0), min(int(right / tile) + 1, columns)):
                if inside[r, c]:
                    off_x, off_y = middle[r, c, 0] - x, middle[r, c, 1] - y
                    part = min(max((off_x * along_x + off_y * along_y) * over, 0.0), 1.0)
                    off_x, off_y = off_x - part * along_x, off_y - part * along_y
                    square[r, c] = min(square[r, c], off_x * off_x + off_y * off_y)
