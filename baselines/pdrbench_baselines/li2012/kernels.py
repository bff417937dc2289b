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
    weigh(xy, one > 0, one, np.ones((1, 1), dtype=np.bool_), xy[0], 1.0, 2.0, one)


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
