"""The place from which particles are least far away in the mean: scores are means of distances."""

from __future__ import annotations

from typing import Final

import numpy as np

from pdrbench.geometry import FloatArray

MAX_PLACES: Final = 1000  # more say the same: every so many-th is taken
TURNS: Final = 12
NEAR_M: Final = 0.05  # added to every distance in square, so that a place among those given is no pole


def geometric_median(xy_m: FloatArray) -> FloatArray:
    """(2,) place with the least mean distance from places (N, 2).

    The iteration of E. Weiszfeld (1937) on sqrt(d^2 + 0.05^2 m^2), begun at the median of each axis.

    >>> geometric_median(np.array([[0.0, 0.0], [0.0, 1.0], [0.0, 100.0]])).round(1).tolist()
    [0.0, 1.0]
    """
    x_m, y_m = np.ascontiguousarray(xy_m[:: max(1, -(-len(xy_m) // MAX_PLACES))].T)
    at_x_m, at_y_m = np.median(x_m), np.median(y_m)
    for _ in range(TURNS):
        nearness = 1.0 / np.sqrt((x_m - at_x_m) ** 2 + (y_m - at_y_m) ** 2 + NEAR_M**2)
        nearness /= nearness.sum()
        at_x_m, at_y_m = nearness @ x_m, nearness @ y_m
    return np.array([at_x_m, at_y_m])
