"""Compiled systematic resampling of millions of particles (Woodman & Harle 2008, Algorithm 1), sorted by cell.

Work is cut into fixed chunks, so that the bytes are the same whatever the number of threads.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from pdrbench.compiled import compiled, inner
from pdrbench.filters.map_walk import TILE

CHUNK: Final = 16_384  # particles of a chunk


@inner
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


@inner
def _draws_below(sums: Any, before: float, scale: float, offset: float, below: Any) -> None:
    """(count,) draws below each running sum: those j with (j + offset) / scale < before + sum."""
    for i in range(len(sums)):
        below[i] = np.int32(np.ceil((before + sums[i]) * scale - offset))


@inner
def _first_draw(before: float, scale: float, offset: float) -> Any:
    return np.int32(np.ceil(before * scale - offset))


def chunks_of(count: int) -> int:
    """How many chunks so many particles are."""
    return (count + CHUNK - 1) // CHUNK


@compiled
def sum_weights(part: Any, weight: Any, count: int, totals: Any) -> None:
    """Sets per chunk the sum of the weights and of their squares, (chunks, 2) float64."""
    sums = np.empty(TILE, np.float64)
    for chunk in range(part[0], part[1]):
        total, squares = 0.0, 0.0
        low, high = chunk * CHUNK, min(chunk * CHUNK + CHUNK, count)
        for a in range(low, high, TILE):
            b = min(a + TILE, high)
            total = _running_sum(weight[a:b], total, sums)
            for i in range(a, b):
                squares += np.float64(weight[i]) * np.float64(weight[i])
        totals[chunk, 0], totals[chunk, 1] = total, squares


@compiled
def count_offspring(
    part: Any, weight: Any, cells: Any, count: int, before: Any, scale: float, offset: float, offspring: Any
) -> None:
    """Systematic resampling, first part: how many draws fall on the particles of each chunk in each cell.

    Draw j falls on the particle at which the running sum of the weights passes (j + offset) / scale.

    Args:
        part: First chunk, end and thread (`in_threads`).
        weight: (N,) float32.
        cells: (N,) int32, ascending.
        count: Number of particles.
        before: (chunks + 1,) float64, sum of the weights before each chunk.
        scale: Number of draws over the sum of the weights.
        offset: In (0, 1).
        offspring: (chunks, K) int32, zeros on entry, filled.
    """
    sums, below = np.empty(TILE, np.float64), np.empty(TILE, np.int32)
    for chunk in range(part[0], part[1]):
        own = offspring[chunk]
        total, taken = 0.0, _first_draw(before[chunk], scale, offset)
        low, high = chunk * CHUNK, min(chunk * CHUNK + CHUNK, count)
        for a in range(low, high, TILE):
            b = min(a + TILE, high)
            total = _running_sum(weight[a:b], total, sums)
            _draws_below(sums[: b - a], before[chunk], scale, offset, below)
            _tally(cells[a:b], below, taken, own)
            taken = below[b - a - 1]


@inner
def _tally(cells: Any, below: Any, taken: Any, own: Any) -> None:
    """Adds the draws on particles in a row in the same cell to those of the cell."""
    cell = cells[0]
    for i in range(1, len(cells)):
        if cells[i] != cell:
            own[np.uint32(cell)] += below[i - 1] - taken
            taken = below[i - 1]
            cell = cells[i]
    own[np.uint32(cell)] += below[len(cells) - 1] - taken


@compiled
def place_offspring(offspring: Any, first: int) -> None:
    """Turns numbers of offspring into places of the first of each: by cell, then by chunk, from `first` on."""
    place = first
    for cell in range(offspring.shape[1]):
        for chunk in range(offspring.shape[0]):
            number = offspring[chunk, cell]
            offspring[chunk, cell] = place
            place += number


@compiled
def choose_ancestors(
    part: Any, weight: Any, cells: Any, count: int, before: Any, scale: float, offset: float, place: Any, ancestor: Any
) -> None:
    """Systematic resampling, last part: the ancestor of every offspring, sorted by cell.

    Args:
        part, weight, cells, count, before, scale, offset: As in `count_offspring`.
        place: (chunks, K) int32 of `place_offspring`; used up.
        ancestor: (n,) int32, each particle's number as often as draws fall on it.
    """
    for chunk in range(part[0], part[1]):
        low, high = chunk * CHUNK, min(chunk * CHUNK + CHUNK, count)
        _choose_in_chunk(weight, cells, low, high, before[chunk], scale, offset, place[chunk], ancestor)


@inner
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
        picked, most = _pick_two(below[: b - a], taken, a, chosen)
        if most > 2:
            _place_rest(below[: b - a], taken, a, cells, place, ancestor)
        _place(chosen[:picked], cells, place, ancestor)
        taken = below[b - a - 1]


@inner
def _pick_two(below: Any, taken: Any, first: int, chosen: Any) -> Any:
    """Each particle, numbered from `first`, up to twice: how many are chosen, and the most draws that fall on one."""
    picked, most = np.uint64(0), np.int32(0)
    for i in range(len(below)):
        number = np.int32(below[i] - taken)
        taken = below[i]
        particle = np.int32(first + i)
        chosen[picked], chosen[picked + np.uint64(1)] = particle, particle  # no branch
        picked += np.uint64(min(number, np.int32(2)))
        most = max(most, number)
    return np.int64(picked), most


@inner
def _place_rest(below: Any, taken: Any, first: int, cells: Any, place: Any, ancestor: Any) -> None:
    """Places each particle as often as more than two draws fall on it."""
    for i in range(len(below)):
        for _ in range(below[i] - taken - 2):
            ancestor[place[cells[first + i]]] = first + i
            place[cells[first + i]] += 1
        taken = below[i]


@inner
def _place(chosen: Any, cells: Any, place: Any, ancestor: Any) -> None:
    """Places particles one by one; the place in a cell stays in a register while the cell is the same."""
    cell = np.int32(0)
    at = np.uint32(place[cell])
    for k in range(len(chosen)):
        particle = np.uint32(chosen[k])
        if cells[particle] != cell:
            place[np.uint32(cell)] = np.int32(at)
            cell = cells[particle]
            at = np.uint32(place[np.uint32(cell)])
        ancestor[at] = np.int32(particle)
        at += np.uint32(1)
    place[np.uint32(cell)] = np.int32(at)
