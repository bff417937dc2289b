"""The elastic band of a walker's way, compiled: two thirds of the time that a walk takes would go into it."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from pdrbench.geometry import FloatArray, IntArray


@njit(cache=True)
def relax_band(
    xy_m: FloatArray,
    point: IntArray,
    start_xy_m: FloatArray,
    end_xy_m: FloatArray,
    rounds: int,
    clearance_m: float,
    comfort_m: float,
    soft: float,
    hard: float,
) -> None:
    """Smooths a path and lets walls push it sideways, in place; its ends stay.

    Args:
        xy_m: (N, 2) the path.
        point: (K,) which point of it each wall is near to.
        start_xy_m: (2, K) of that wall; one layout whatever K is, so that it is compiled once.
        end_xy_m: (2, K).
        rounds: How often.
        clearance_m: Nearer walls push hard.
        comfort_m: Nearer walls push softly.
        soft: Shift for every metre that a wall is nearer than `comfort_m`.
        hard: The same for `clearance_m`.
    """
    count = len(xy_m)
    # Element by element: an assignment of arrays takes Numba two seconds to compile, mostly the text of its errors.
    old, tangent, push = np.empty((count, 2)), np.empty((count, 2)), np.empty((2, count))
    for _ in range(rounds):
        for i in range(count):
            old[i, 0], old[i, 1] = xy_m[i, 0], xy_m[i, 1]
        for i in range(1, count - 1):
            for k in range(2):
                xy_m[i, k] = (old[i - 1, k] + 2 * old[i, k] + old[i + 1, k]) / 4
        for i in range(count):
            before, after = max(i - 1, 0), min(i + 1, count - 1)
            x = (xy_m[after, 0] - xy_m[before, 0]) / (after - before)
            y = (xy_m[after, 1] - xy_m[before, 1]) / (after - before)
            length = max(math.hypot(x, y), 1e-9)
            tangent[i, 0], tangent[i, 1] = x / length, y / length
        # The strongest push from the right and from the left.
        for i in range(count):
            push[0, i] = push[1, i] = 0.0
        for pair in range(len(point)):
            i = point[pair]
            along_x, along_y = end_xy_m[0, pair] - start_xy_m[0, pair], end_xy_m[1, pair] - start_xy_m[1, pair]
            from_x, from_y = xy_m[i, 0] - start_xy_m[0, pair], xy_m[i, 1] - start_xy_m[1, pair]
            fraction = (from_x * along_x + from_y * along_y) / (along_x * along_x + along_y * along_y)
            fraction = min(max(fraction, 0.0), 1.0)
            off_x = start_xy_m[0, pair] + fraction * along_x - xy_m[i, 0]
            off_y = start_xy_m[1, pair] + fraction * along_y - xy_m[i, 1]
            if abs(off_x) > comfort_m or abs(off_y) > comfort_m:
                continue
            distance = max(math.hypot(off_x, off_y), 1e-9)
            sideways = (off_x * -tangent[i, 1] + off_y * tangent[i, 0]) / distance
            strength = hard * max(clearance_m - distance, 0.0) + soft * max(comfort_m - distance, 0.0)
            from_left = 1 if sideways > 0 else 0
            push[from_left, i] = max(push[from_left, i], strength * abs(sideways))
        for i in range(1, count - 1):
            shift = push[0, i] - push[1, i]
            xy_m[i, 0] += shift * -tangent[i, 1]
            xy_m[i, 1] += shift * tangent[i, 0]
