"""Resampling: particles are drawn by weight, at evenly spaced offsets (systematic) or independently (multinomial).

The compiled kernels draw millions of particles systematically, in fixed chunks, sorted by cell, and give the same bytes
whatever the number of threads.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import prange

from pdrbench.compiled import compiled, compiled_parallel
from pdrbench.filters.map_walk import CHUNK, TILE
from pdrbench.geometry import FloatArray, IntArray


def systematic(weight: FloatArray, offset: float) -> IntArray:
    """(N,) ascending indices of particles, each N w / sum(w) times, rounded up or down.

    Args:
        weight: (N,) at least one of them above 0.
        offset: In [0, 1), of the first draw; draws are 1 / N apart.
    """
    cumulative = np.cumsum(weight)
    at = (offset + np.arange(len(weight))) / len(weight)
    chosen: IntArray = np.searchsorted(cumulative / cumulative[-1], at, side="right").clip(max=len(weight) - 1)
    return chosen


def multinomial(weight: FloatArray, draw: FloatArray) -> IntArray:
    """(n,) indices of particles drawn by weight (N,), one for each of `draw` (n,), uniform in [0, 1)."""
    cumulative = np.cumsum(weight)
    chosen: IntArray = np.searchsorted(cumulative, draw * cumulative[-1], side="right").clip(max=len(weight) - 1)
    return chosen


@compiled
def _running_sum(weight: Any, total: float, sums: Any) -> float:
    """(count,) `total` and all weights so far, four at a time: additions that need not wait for one another."""
    whole = len(weight) // 4 * 4
    for i in range(0, whole, 4):
        first = np.float64(weight[i])
        second = first + np.float64(weight[i + 1])
        third = second + np.float64(weight[i + 2])
        fourth = third + np.float64(weight[i + 3])
        sums[i], sums[i + 1], sums[i + 2] = total + first, total + second, total + third
        total += fourth
        sums[i + 3] = total
    for i in range(whole, len(weight)):
        total += np.float64(weight[i])
        sums[i] = total
    return total


@compiled
def _draws_below(sums: Any, before: float, scale: float, offset: float, below: Any) -> None:
    """(count,) draws below each running sum: those j with (j + offset) / scale < before + sum."""
    for i in range(len(sums)):
        below[i] = np.int32(np.ceil((before + sums[i]) * scale - offset))


@compiled
def _first_draw(before: float, scale: float, offset: float) -> Any:
    return np.int32(np.ceil(before * scale - offset))


@compiled_parallel
def sum_weights(weight: Any, count: int) -> Any:
    """Per chunk the sum of the weights and of their squares, (chunks, 2) float64."""
    chunks = (count + CHUNK - 1) // CHUNK
    totals = np.empty((chunks, 2), np.float64)
    for chunk in prange(chunks):
        sums = np.empty(TILE, np.float64)
        total, squares = 0.0, 0.0
        low, high = chunk * CHUNK, min(chunk * CHUNK + CHUNK, count)
        for a in range(low, high, TILE):
            b = min(a + TILE, high)
            total = _running_sum(weight[a:b], total, sums)
            for i in range(a, b):
                squares += np.float64(weight[i]) * np.float64(weight[i])
        totals[chunk, 0], totals[chunk, 1] = total, squares
    return totals


@compiled_parallel
def count_offspring(
    weight: Any, cells: Any, count: int, before: Any, scale: float, offset: float, offspring: Any
) -> None:
    """Systematic resampling, first part: how many draws fall on the particles of each chunk in each cell.

    Draw j falls on the particle at which the running sum of the weights passes (j + offset) / scale.

    Args:
        weight: (N,) float32.
        cells: (N,) int32, ascending.
        count: Number of particles.
        before: (chunks + 1,) float64, sum of the weights before each chunk.
        scale: Number of draws over the sum of the weights.
        offset: In (0, 1).
        offspring: (chunks, K) int32, zeros on entry, filled.
    """
    for chunk in prange((count + CHUNK - 1) // CHUNK):
        sums, below = np.empty(TILE, np.float64), np.empty(TILE, np.int32)
        own = offspring[chunk]
        total, taken = 0.0, _first_draw(before[chunk], scale, offset)
        low, high = chunk * CHUNK, min(chunk * CHUNK + CHUNK, count)
        for a in range(low, high, TILE):
            b = min(a + TILE, high)
            total = _running_sum(weight[a:b], total, sums)
            _draws_below(sums[: b - a], before[chunk], scale, offset, below)
            for i in range(a, b):
                if i + 1 == b or cells[i + 1] != cells[i]:
                    own[cells[i]] += below[i - a] - taken
                    taken = below[i - a]


@compiled
def place_offspring(offspring: Any, first: int) -> None:
    """Turns numbers of offspring into places of the first of each: by cell, then by chunk, from `first` on."""
    place = first
    for cell in range(offspring.shape[1]):
        for chunk in range(offspring.shape[0]):
            number = offspring[chunk, cell]
            offspring[chunk, cell] = place
            place += number


@compiled_parallel
def choose_ancestors(
    weight: Any, cells: Any, count: int, before: Any, scale: float, offset: float, place: Any, ancestor: Any
) -> None:
    """Systematic resampling, last part: the ancestor of every offspring, sorted by cell.

    Args:
        weight, cells, count, before, scale, offset: As in `count_offspring`.
        place: (chunks, K) int32 of `place_offspring`; used up.
        ancestor: (n,) int32, each particle's number as often as draws fall on it.
    """
    for chunk in prange((count + CHUNK - 1) // CHUNK):
        low, high = chunk * CHUNK, min(chunk * CHUNK + CHUNK, count)
        _choose_in_chunk(weight, cells, low, high, before[chunk], scale, offset, place[chunk], ancestor)


@compiled
def _choose_in_chunk(
    weight: Any, cells: Any, low: int, high: int, before: float, scale: float, offset: float, place: Any, ancestor: Any
) -> None:
    chosen = np.empty(2 * TILE + 2, np.int32)
    sums, below = np.empty(TILE, np.float64), np.empty(TILE, np.int32)
    total, taken = 0.0, _first_draw(before, scale, offset)
    for a in range(low, high, TILE):
        b = min(a + TILE, high)
        total = _running_sum(weight[a:b], total, sums)
        _draws_below(sums[: b - a], before, scale, offset, below)
        picked = 0
        for i in range(a, b):
            number = below[i - a] - taken
            taken = below[i - a]
            chosen[picked], chosen[picked + 1] = i, i  # no branch where 0, 1 or 2 copies are wanted
            picked += min(number, 2)
            while number > 2:
                at = place[cells[i]]
                place[cells[i]] = at + 1
                ancestor[at] = i
                number -= 1
        for k in range(picked):
            cell = cells[chosen[k]]
            at = place[cell]
            place[cell] = at + 1
            ancestor[at] = chosen[k]
