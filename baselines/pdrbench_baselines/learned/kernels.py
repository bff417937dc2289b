"""Compiled: attitudes between samples, and signals on a grid."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from pdrbench.compiled import compiled

FIRST: Final[Any] = np.int64(1)  # for a literal, functions that take it would be compiled again


@compiled
def attitudes_at(rotation: Any, at_s: Any) -> Any:
    """(n, 4) unit quaternions at times (n,) between rows (k, 5), linear; the first and the last one outside."""
    sign, out, after = np.ones(len(rotation)), np.empty((len(at_s), 4)), FIRST
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
def cell_means(rows: Any, attitude: Any, at_s: Any, rate_hz: float) -> Any:
    """(n, 3) means over 1 / rate around times (n,), linear between vectors (k, 4) that attitudes (k, 4) turn."""
    world, area = np.empty((len(rows), 3)), np.zeros((len(rows), 3))
    for i in range(len(rows)):
        q = attitude[i]
        world[i, 0], world[i, 1], world[i, 2] = _rotated(q[0], q[1], q[2], q[3], rows[i, 1], rows[i, 2], rows[i, 3])
        for c in range(3 if i else 0):
            area[i, c] = area[i - 1, c] + (rows[i, 0] - rows[i - 1, 0]) * (world[i - 1, c] + world[i, c]) / 2
    means, after = np.zeros((len(at_s), 3)), FIRST
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
def yaw_means(rotation: Any, gyro: Any, max_gap_s: float, settles_s: float, mean_s: float, state: Any) -> Any:
    """(r - 1,) mean of how far the reported yaw has run away, (r - 1,) how far, in rad, and the state after that.

    The state is: till when the yaw settles after a gap, how long the mean is over, how far it has run away, the mean.
    """
    settled_s, since_s, run_away_rad, mean_rad = state
    runs_rad, is_gap = _yaw_runs(rotation, gyro, max_gap_s)
    means_rad = np.empty(len(runs_rad))
    for i in range(len(runs_rad)):
        end_s, step_s = rotation[i + 1, 0], rotation[i + 1, 0] - rotation[i, 0]
        if is_gap[i]:
            settled_s = end_s + settles_s
        since_s += step_s
        run_away_rad += runs_rad[i] if end_s >= settled_s else 0.0
        gain = min(max(step_s / mean_s, step_s / max(since_s, 1e-9)), 1.0)
        mean_rad += gain * (run_away_rad - mean_rad)
        means_rad[i], runs_rad[i] = mean_rad, run_away_rad
    return means_rad, runs_rad, (settled_s, since_s, run_away_rad, mean_rad)


@compiled
def _yaw_runs(rotation: Any, gyro: Any, max_gap_s: float) -> Any:
    """(r - 1,) turn of the reported yaw from one row (r, 5) to the next, less that by the rates (m, 4), in rad.

    It is 0 over gaps; (r - 1,) says where these are.
    """
    runs_rad, is_gap = np.zeros(len(rotation) - 1), np.zeros(len(rotation) - 1, dtype=np.bool_)
    turned = np.zeros((len(gyro), 4))  # integrated rates, and how many seconds of them are missing
    for i in range(1, len(gyro)):
        step_s = gyro[i, 0] - gyro[i - 1, 0]
        for c in range(3):
            turned[i, c] = turned[i - 1, c] + (gyro[i, c + 1] + gyro[i - 1, c + 1]) / 2 * step_s
        turned[i, 3] = turned[i - 1, 3] + (step_s if step_s > max_gap_s else 0.0)
    own, last, after = np.zeros(4), np.zeros(4), FIRST
    for row in range(len(rotation)):
        if len(gyro) > 1:
            after, part = _between(gyro, rotation[row, 0], after)
            for c in range(4):
                last[c], own[c] = own[c], turned[after - 1, c] + part * (turned[after, c] - turned[after - 1, c])
        if row == 0:
            continue
        i = row - 1
        is_gap[i] = own[3] > last[3] or rotation[row, 0] - rotation[i, 0] > max_gap_s
        if is_gap[i] or rotation[i, 0] < gyro[0, 0]:
            continue
        w, x, y, z = rotation[row, 1], rotation[row, 2], rotation[row, 3], rotation[row, 4]
        a, b, c, d = rotation[i, 1], -rotation[i, 2], -rotation[i, 3], -rotation[i, 4]
        turn_w, turn_x = w * a - x * b - y * c - z * d, w * b + x * a + y * d - z * c
        turn_y, turn_z = w * c - x * d + y * a + z * b, w * d + x * c - y * b + z * a
        half_sine = math.sqrt(turn_x**2 + turn_y**2 + turn_z**2)
        angle_rad = 2 * math.atan2(half_sine, abs(turn_w))
        reported_rad = angle_rad * (turn_z if turn_w >= 0 else -turn_z) / max(half_sine, 1e-12)
        sign = 1.0 if turn_w > 0 else (-1.0 if turn_w < 0 else 0.0)
        w, x, y, z = w + sign * a, x - sign * b, y - sign * c, z - sign * d
        norm = max(math.sqrt(w**2 + x**2 + y**2 + z**2), 1e-12)
        by_rates = _rotated(
            w / norm, x / norm, y / norm, z / norm, own[0] - last[0], own[1] - last[1], own[2] - last[2]
        )
        runs_rad[i] = reported_rad - by_rates[2]
    return runs_rad, is_gap


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
