"""Compiled kernels of the movement table: making it, moving particles, drawing them anew.

Random numbers are passed in, one for each particle, and no sum is split: the same bytes whatever the number of threads.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from pdrbench.geometry import FloatArray, IntArray


@njit(cache=True, nogil=True)
def probabilities(
    first: IntArray, ring: IntArray, fraction: FloatArray, log_density: FloatArray, prune: float
) -> FloatArray:
    """(M,) probability of each way of the walks that begin in the same cell; 0 where it is pruned (K4).

    Args:
        first: (C + 1,) ways `first[c]:first[c + 1]` begin in cell c.
        ring: (M,) distance in widths of a cell, rounded: what the speed gives to a ring is divided among its ways.
        fraction: (M,) floor of the cell at the end over that of a full cell.
        log_density: (M,) of the speed that the way needs.
        prune: Ways of a smaller probability are left out.
    """
    found = np.zeros(len(ring))
    if not len(ring):
        return found
    in_ring = np.zeros(ring.max() + 1)
    for cell in range(len(first) - 1):
        low, high = first[cell], first[cell + 1]
        most = -np.inf
        for i in range(low, high):
            in_ring[ring[i]] += fraction[i]
            most = max(most, log_density[i])
        total = 0.0
        for i in range(low, high):
            found[i] = math.exp(log_density[i] - most) * fraction[i] / in_ring[ring[i]]
            total += found[i]
        largest = 0.0
        for i in range(low, high):
            found[i] /= total
            largest = max(largest, found[i])
        kept = 0.0
        for i in range(low, high):
            in_ring[ring[i]] = 0.0
            if found[i] < prune and found[i] < largest:
                found[i] = 0.0
            kept += found[i]
        for i in range(low, high):
            found[i] /= kept
    return found


@njit(cache=True, nogil=True)
def alias_rows(first: IntArray, to: IntArray, probability: FloatArray, threshold: Any, alias: Any) -> None:
    """Fills the alias tables of every cell (Walker 1977, in the order of Vose 1991).

    Args:
        first: (C + 1,) entries `first[c]:first[c + 1]` belong to cell c.
        to: (M,) where each entry leads.
        probability: (M,) of each, 1 in total for each cell.
        threshold: (M,) float32, written: the fraction of an entry's slot that is its own.
        alias: (M,) int32, written: where the rest of the slot leads.
    """
    longest = 0
    for cell in range(len(first) - 1):
        longest = max(longest, first[cell + 1] - first[cell])
    small, large, scaled = np.empty(longest, np.int64), np.empty(longest, np.int64), np.empty(longest)
    for cell in range(len(first) - 1):
        low, count = first[cell], first[cell + 1] - first[cell]
        num_small, num_large = 0, 0
        for i in range(count):
            scaled[i] = probability[low + i] * count
            threshold[low + i], alias[low + i] = 1.0, to[low + i]
            if scaled[i] < 1.0:
                small[num_small] = i
                num_small += 1
            else:
                large[num_large] = i
                num_large += 1
        while num_small and num_large:
            num_small -= 1
            under, over = small[num_small], large[num_large - 1]
            threshold[low + under], alias[low + under] = scaled[under], to[low + over]
            scaled[over] -= 1.0 - scaled[under]
            if scaled[over] < 1.0:
                num_large -= 1
                small[num_small] = over
                num_small += 1


@njit(cache=True, nogil=True)
def move(
    cell: IntArray, uniform: FloatArray, first: IntArray, to: IntArray, threshold: FloatArray, alias: IntArray
) -> IntArray:
    """(N,) cell of each particle one update later; one random number in [0, 1) for each, O(1) particle by particle."""
    moved = np.empty_like(cell)
    for i in range(len(cell)):
        low = first[cell[i]]
        at = uniform[i] * (first[cell[i] + 1] - low)
        slot = int(at)
        entry = low + slot
        moved[i] = to[entry] if at - slot < threshold[entry] else alias[entry]
    return moved


@njit(cache=True, nogil=True)
def draw_sorted(weight: FloatArray, spacing: FloatArray) -> IntArray:
    """(N,) indices drawn with replacement in proportion to `weight` (M,), in increasing order: multinomial, linear.

    N sorted uniform numbers are the running sums of N + 1 exponential spacings over their total.

    Args:
        weight: At least 0, not all 0.
        spacing: (N + 1,) standard exponential random numbers.
    """
    count = len(spacing) - 1
    drawn = np.empty(count, np.int64)
    scale = weight.sum() / spacing.sum()
    last = len(weight) - 1
    while weight[last] == 0.0:  # what rounding leaves over belongs to the last one that has a weight
        last -= 1
    at, reached, wanted = 0, weight[0], 0.0
    for i in range(count):
        wanted += spacing[i] * scale
        while reached <= wanted and at < last:
            at += 1
            reached += weight[at]
        drawn[i] = at
    return drawn
