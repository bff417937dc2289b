"""Compiled: attitudes between samples, signals on a grid, and densities of scans."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from pdrbench.compiled import compiled

FAR = 36.0  # half a squared deviation: 2e-16 of what is near


@compiled
def mixture(
    xy_m: Any, level: Any, at_m: Any, at_level: Any, weight: Any, spread_m: float, everywhere: float
) -> Any:
    """(N,) sum of K normal densities without their constant factor, and of what is everywhere, at places (N, 2).

    Args:
        xy_m: (N, 2).
        level: (N,).
        at_m: (K, 2) middles of the densities.
        at_level: (K,) on which they count.
        weight: (K,).
        spread_m: Standard deviation per axis of each.
        everywhere: Is added.
    """
    density, half = np.empty(len(xy_m)), 0.5 / spread_m**2
    for n in range(len(xy_m)):
        x, y, here, total = xy_m[n, 0], xy_m[n, 1], level[n], everywhere
        for k in range(len(weight)):
            off = ((x - at_m[k, 0]) ** 2 + (y - at_m[k, 1]) ** 2) * half
            if off < FAR and at_level[k] == here:
                total += weight[k] * math.exp(-off)
        density[n] = total
    return density


@compiled
def mixtures(distance: Any, asked: Any, xy_m: Any, level: Any, softness: Any, spread_m: Any) -> Any:
    """(A, B, Q) the same at the places of Q scans, of all S scans by their distances from these.

    Args:
        distance: (Q, S) infinite for what does not count.
        asked: (Q,) int, of S.
        xy_m: (S, 2).
        level: (S,).
        softness: (A,) distances over which a scan loses 1 / e.
        spread_m: (B,).
    """
    found = np.zeros((len(softness), len(spread_m), len(asked)))
    soft, near = np.empty(len(softness)), np.empty(len(spread_m))
    total = np.empty(len(softness))
    for q in range(len(asked)):
        nearest, own = distance[q].min(), asked[q]
        for a in range(len(soft)):
            total[a] = 0.0
        for s in range(len(xy_m)):
            if distance[q, s] == np.inf:
                continue
            for a in range(len(soft)):
                off = (distance[q, s] - nearest) / softness[a]
                soft[a] = math.exp(-off) if off < FAR else 0.0
                total[a] += soft[a]
            if level[s] != level[own]:
                continue
            away_m2 = (xy_m[s, 0] - xy_m[own, 0]) ** 2 + (xy_m[s, 1] - xy_m[own, 1]) ** 2
            for b in range(len(near)):
                off = 0.5 * away_m2 / spread_m[b] ** 2
                near[b] = math.exp(-off) if off < FAR else 0.0
            for a in range(len(soft)):
                for b in range(len(near) if soft[a] > 0.0 else 0):
                    found[a, b, q] += soft[a] * near[b]
        for a in range(len(soft)):
            for b in range(len(near)):
                found[a, b, q] /= total[a]
    return found


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
def are_in_order(rows: Any) -> bool:
    """Whether rows (k, c) are two or more, finite, and their times do not go back."""
    for i in range(len(rows)):
        for c in range(rows.shape[1]):
            if not math.isfinite(rows[i, c]):
                return False
        if i > 0 and rows[i, 0] < rows[i - 1, 0]:
            return False
    return len(rows) >= 2


@compiled
def are_sampled(t_s: Any, at_s: Any, max_gap_s: float) -> Any:
    """(n,) whether times lie between two of the times (k,) that are no further apart, or as near to the last or first.
    """
    near, after = np.empty(len(at_s), dtype=np.bool_), 1
    for n in range(len(at_s)):
        while after < len(t_s) - 1 and t_s[after] < at_s[n]:
            after += 1
        near[n] = t_s[after] - t_s[after - 1] <= max_gap_s
        near[n] &= t_s[0] - max_gap_s <= at_s[n] <= t_s[-1] + max_gap_s
    return near


@compiled
def verticals(attitude: Any) -> Any:
    """(n, 3) the vertical in the frame of the phone, and (n, 2) the square of w + iz, of attitudes (n, 4)."""
    up, twist = np.empty((len(attitude), 3)), np.empty((len(attitude), 2))
    for n in range(len(attitude)):
        w, x, y, z = attitude[n]
        up[n, 0], up[n, 1], up[n, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)
        twist[n, 0], twist[n, 1] = w * w - z * z, 2 * w * z
    return up, twist


@compiled
def yaw_run_away(rotation: Any, gyro: Any, max_gap_s: float) -> Any:
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
    own, last, after = np.zeros(4), np.zeros(4), 1
    for n in range(len(rotation)):
        if len(gyro) > 1:
            after, part = _between(gyro, rotation[n, 0], after)
            for c in range(4):
                last[c], own[c] = own[c], turned[after - 1, c] + part * (turned[after, c] - turned[after - 1, c])
        if n == 0:
            continue
        i = n - 1
        is_gap[i] = own[3] > last[3] or rotation[n, 0] - rotation[i, 0] > max_gap_s
        if is_gap[i] or rotation[i, 0] < gyro[0, 0]:
            continue
        w, x, y, z = rotation[n, 1], rotation[n, 2], rotation[n, 3], rotation[n, 4]
        a, b, c, d = rotation[i, 1], -rotation[i, 2], -rotation[i, 3], -rotation[i, 4]
        turn_w, turn_x = w * a - x * b - y * c - z * d, w * b + x * a + y * d - z * c
        turn_y, turn_z = w * c - x * d + y * a + z * b, w * d + x * c - y * b + z * a
        half_sine = math.sqrt(turn_x**2 + turn_y**2 + turn_z**2)
        angle_rad = 2 * math.atan2(half_sine, abs(turn_w))
        reported_rad = angle_rad * (turn_z if turn_w >= 0 else -turn_z) / max(half_sine, 1e-12)
        sign = 1.0 if turn_w > 0 else (-1.0 if turn_w < 0 else 0.0)
        w, x, y, z = w + sign * a, x - sign * b, y - sign * c, z - sign * d
        norm = max(math.sqrt(w**2 + x**2 + y**2 + z**2), 1e-12)
        by_rates = _rotated(w / norm, x / norm, y / norm, z / norm, own[0] - last[0], own[1] - last[1], own[2] - last[2])
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
