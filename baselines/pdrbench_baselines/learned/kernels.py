"""Compiled: attitudes between samples, and signals on a grid."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from pdrbench.compiled import compiled


@compiled
def attitudes_at(rotation: Any, at_s: Any) -> Any:
    """(n, 4) unit quaternions at times (n,) between rows (k, 5), linear; the first and the last one outside."""
    sign, out, after = np.ones(len(rotation)), np.empty((len(at_s), 4)), 1
    for i in range(1, len(rotation)):
        same = 0.0
        for c in range(1, 5):
            same += rotation[i, c] * rotation[i - 1, c]
        sign[i] = -sign[i - 1] if same < 0.0 else sign[i - 1]
    for n in range(len(at_s)):
        after, part = _between(rotation, at_s[n], after)
        square = 0.0
        for c in range(4):
            before = sign[after - 1] * rotation[after - 1, c + 1]
            out[n, c] = before * (1.0 - part) + sign[after] * rotation[after, c + 1] * part
            square += out[n, c] ** 2
        for c in range(4):
            out[n, c] /= max(math.sqrt(square), 1e-9)
    return out


@compiled
def cell_means(rows: Any, rotation: Any, at_s: Any, rate_hz: float) -> Any:
    """(n, 3) means over 1 / rate around times (n,), linear between vectors (k, 4) that attitudes (r, 5) turn."""
    attitude, world, area = attitudes_at(rotation, rows[:, 0]), np.empty((len(rows), 3)), np.zeros((len(rows), 3))
    for i in range(len(rows)):
        q = attitude[i]
        world[i, 0], world[i, 1], world[i, 2] = _rotated(q[0], q[1], q[2], q[3], rows[i, 1], rows[i, 2], rows[i, 3])
        for c in range(3 if i else 0):
            area[i, c] = area[i - 1, c] + (rows[i, 0] - rows[i - 1, 0]) * (world[i - 1, c] + world[i, c]) / 2
    means, after = np.zeros((len(at_s), 3)), 1
    for n in range(len(at_s)):
        for side in (-1.0, 1.0):
            edge_s = at_s[n] + 0.5 * side / rate_hz
            after, part = _between(rows, edge_s, after)
            low = after if part == 1.0 else after - 1
            for c in range(3):
                value = world[after - 1, c] * (1.0 - part) + world[after, c] * part
                until = area[low, c] + (edge_s - rows[low, 0]) * (world[low, c] + value) / 2
                means[n, c] += side * rate_hz * until
    return means


@compiled
def _between(rows: Any, at_s: float, after: int) -> Any:
    """The row after a time, looked for from `after` on, and how far the time is from the one before to it, 0 to 1."""
    while after < len(rows) - 1 and rows[after, 0] <= at_s:
        after += 1
    while after > 1 and rows[after - 1, 0] > at_s:
        after -= 1
    step_s = rows[after, 0] - rows[after - 1, 0]
    part = (at_s - rows[after - 1, 0]) / (step_s if step_s > 0.0 else 1.0)
    return after, min(max(part, 0.0), 1.0)


@compiled
def _rotated(w: float, x: float, y: float, z: float, a: float, b: float, c: float) -> Any:
    """A vector (a, b, c) turned by a unit quaternion."""
    twice_x, twice_y, twice_z = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
    return (
        a + w * twice_x + (y * twice_z - z * twice_y),
        b + w * twice_y + (z * twice_x - x * twice_z),
        c + w * twice_z + (x * twice_y - y * twice_x),
    )
