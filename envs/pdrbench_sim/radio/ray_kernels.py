"""Compiled search for the lines that rays from one origin cross, and the count of walls among them.

All points are relative to the origin. Directions from it fall into sectors, and a ray is held against the lines of its
own sector only; which of them it cuts follows from signs of cross products alone.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numba import njit

from pdrbench.geometry import FloatArray, IntArray

SECTORS: Final = 256
_MARGIN: Final = 1e-9  # of a sector: what is on its border belongs to both


@njit(cache=True)
def _direction(x: float, y: float) -> float:
    """A number of sectors that rises with the angle of (x, y), from -half to half of them, without its arctangent."""
    reach = abs(x) + abs(y)
    part = y / reach * (SECTORS / 4) if reach > 0 else 0.0
    return part if x >= 0 else math.copysign(SECTORS / 2, y) - part


@njit(cache=True)
def lines_by_sector(a: FloatArray, b: FloatArray) -> tuple[IntArray, IntArray]:
    """Which lines reach into each sector.

    Args:
        a: (W, 2) where lines begin.
        b: (W, 2) where they end.

    Returns:
        first: (SECTORS + 1,) int, those of sector k are `line[first[k]:first[k + 1]]`.
        line: (L,) int, rising within a sector.
    """
    low, reach = np.empty(len(a), dtype=np.int64), np.empty(len(a), dtype=np.int64)
    first = np.zeros(SECTORS + 1, dtype=np.int64)
    for i in range(len(a)):
        begin = _direction(a[i, 0], a[i, 1])
        turn = _direction(b[i, 0], b[i, 1]) - begin
        turn -= SECTORS * round(turn / SECTORS)  # the short way
        low[i] = math.floor(begin + min(turn, 0.0) - _MARGIN)
        reach[i] = math.floor(begin + max(turn, 0.0) + _MARGIN) - low[i] + 1
        for k in range(low[i], low[i] + reach[i]):
            first[k % SECTORS + 1] += 1
    for k in range(SECTORS):
        first[k + 1] += first[k]
    free = first[:-1].copy()
    line = np.empty(first[-1], dtype=np.int64)
    for i in range(len(a)):
        for k in range(low[i], low[i] + reach[i]):
            line[free[k % SECTORS]] = i
            free[k % SECTORS] += 1
    return first, line


@njit(cache=True)
def _cuts(
    x: float,
    y: float,
    a: FloatArray,
    b: FloatArray,
    first: IntArray,
    line: IntArray,
    fraction: FloatArray,
    cut: IntArray,
) -> int:
    """Fills in where the ray to (x, y) is cut, from near to far, and by which line; returns how often."""
    sector = math.floor(_direction(x, y)) % SECTORS
    count = 0
    for nth in range(first[sector], first[sector + 1]):
        i = line[nth]
        left_a = x * a[i, 1] - y * a[i, 0]
        left_b = x * b[i, 1] - y * b[i, 0]
        if (left_a > 0) == (left_b > 0):
            continue
        # It lies before the place: a x b / ((b - a) x ray) is between 0 and 1.
        reach = a[i, 0] * b[i, 1] - a[i, 1] * b[i, 0]
        spread = left_b - left_a
        if not (reach * spread > 0 and abs(reach) < abs(spread)):
            continue
        at = reach / spread
        k = count
        while k > 0 and fraction[k - 1] > at:
            fraction[k] = fraction[k - 1]
            cut[k] = cut[k - 1]
            k -= 1
        fraction[k] = at
        cut[k] = i
        count += 1
    return count


@njit(cache=True)
def find_crossings(
    a: FloatArray, b: FloatArray, first: IntArray, line: IntArray, place: FloatArray
) -> tuple[IntArray, IntArray, FloatArray]:
    """Every crossing of rays to places (N, 2) with lines: place, line, fraction of the way; see `Lines.crossings`."""
    fraction = np.empty(len(a))
    cut = np.empty(len(a), dtype=np.int64)
    ends = np.zeros(len(place) + 1, dtype=np.int64)
    for n in range(len(place)):
        ends[n + 1] = ends[n] + _cuts(place[n, 0], place[n, 1], a, b, first, line, fraction, cut)
    of_place = np.empty(ends[-1], dtype=np.int64)
    of_line = np.empty(ends[-1], dtype=np.int64)
    at = np.empty(ends[-1])
    for n in range(len(place)):
        count = _cuts(place[n, 0], place[n, 1], a, b, first, line, fraction, cut)
        of_place[ends[n] : ends[n + 1]] = n
        of_line[ends[n] : ends[n + 1]] = cut[:count]
        at[ends[n] : ends[n + 1]] = fraction[:count]
    return of_place, of_line, at


@njit(cache=True)
def count_walls(
    a: FloatArray,
    b: FloatArray,
    along: FloatArray,
    place: FloatArray,
    length_m: FloatArray,
    limits: tuple[float, float, float],
) -> tuple[IntArray, IntArray]:
    """Light and heavy walls on rays to places (N, 2); see `Obstacles.walls_crossed`.

    Args:
        a, b: (W, 2) ends of the faces.
        along: (W, 2) from one end to the other.
        place: (N, 2).
        length_m: (N,) of the rays.
        limits: `MAX_WALL_M`, `LIGHT_WALL_M` and `PARALLEL` of `pdrbench_sim.radio.rays`.
    """
    max_wall_m, light_m, parallel = limits
    first, line = lines_by_sector(a, b)
    fraction = np.empty(len(a))
    cut = np.empty(len(a), dtype=np.int64)
    light = np.zeros(len(place), dtype=np.int64)
    heavy = np.zeros(len(place), dtype=np.int64)
    for n in range(len(place)):
        count = _cuts(place[n, 0], place[n, 1], a, b, first, line, fraction, cut)
        num_faces, thickness_m = 0, 0.0
        for k in range(count + 1):  # a wall ends before the next one, or with the ray
            is_behind, across_m = False, 0.0
            if 0 < k < count:
                p, q = place[n, 0] / length_m[n], place[n, 1] / length_m[n]
                u, v = along[cut[k - 1]] / math.hypot(along[cut[k - 1], 0], along[cut[k - 1], 1])
                s, t = along[cut[k]] / math.hypot(along[cut[k], 0], along[cut[k], 1])
                gap_m = (fraction[k] - fraction[k - 1]) * length_m[n]
                across_m = gap_m * abs(p * t - q * s) if abs(u * t - v * s) < parallel else gap_m
                is_behind = gap_m < max_wall_m or across_m < max_wall_m
            if is_behind:
                num_faces += 1
                thickness_m = max(thickness_m, across_m)
                continue
            if num_faces > 1 and thickness_m <= light_m:
                light[n] += 1
            elif num_faces > 0:
                heavy[n] += 1
            num_faces, thickness_m = 1, 0.0
    return light, heavy
