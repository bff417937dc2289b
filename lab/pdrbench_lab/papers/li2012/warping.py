"""Warped distances of every two of many waves, eight at a time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numba import njit

from pdrbench.errors import PdrbenchError
from pdrbench.geometry import FloatArray

LANES: Final = 8  # doubles that a processor of today works on at once


def warped_distances(waves: Sequence[FloatArray], band: int | None = None) -> FloatArray:
    """(n, n) `warped_distance` of every two of n waves, eight at a time; bounds and errors as there."""
    if not waves or any(not len(wave) for wave in waves) or (band is not None and band < 0):
        raise PdrbenchError("give waves with samples in them and a band of 0 or more")
    lengths = np.array([len(wave) for wave in waves])
    groups = [
        np.resize(same[first : first + LANES], LANES)  # the last of a length are filled up with themselves
        for same in (np.flatnonzero(lengths == length) for length in np.unique(lengths))
        for first in range(0, len(same), LANES)
    ]
    whole = np.concatenate([np.asarray(wave, dtype=np.float64) for wave in waves])
    squares = np.zeros((len(waves), len(waves)))
    _all_warped(whole, np.cumsum(lengths), np.array(groups), -1 if band is None else band, squares)
    upper = np.triu(squares, 1)
    return np.sqrt(upper + upper.T)


@njit(cache=True, nogil=True)
def _all_warped(whole, ends, groups, band, squares):  # type: ignore[no-untyped-def]
    """Least sum of squares of every wave with those of higher number.

    Args:
        whole: Waves, one after the other.
        ends: (n,) where each ends.
        groups: (g, `LANES`) numbers of waves of one length.
        band: As in `warped_distances`; below 0 for no limit.
        squares: (n, n), written above the diagonal, and some of it below.
    """
    longest = ends[0]
    for i in range(1, len(ends)):
        longest = max(longest, ends[i] - ends[i - 1])
    rows, others = np.empty((2, (longest + 2) * LANES)), np.empty(longest * LANES)
    for g in range(len(groups)):
        group = groups[g]
        length = 0
        for k in range(LANES):
            begin = 0 if group[k] == 0 else ends[group[k] - 1]
            length = ends[group[k]] - begin
            for j in range(length):
                others[j * LANES + k] = whole[begin + j]
        for i in range(group.max()):
            one = whole[(0 if i == 0 else ends[i - 1]) : ends[i]]
            width = len(one) + length if band < 0 else band
            found = _warped_lanes(one, others[: length * LANES], width, rows)
            for k in range(LANES):
                squares[i, group[k]] = found[k]


@njit(cache=True, nogil=True, fastmath={"nnan", "nsz"})
def _warped_lanes(a, others, band, rows):  # type: ignore[no-untyped-def]
    """(`LANES`,) as `warping._warped`, of a with several waves of one length at once, sample by sample interleaved.

    A cell needs the one to its left, so that one table is computed cell by cell; of eight tables a processor computes
    the same cell at once.
    """
    n, m = len(a), len(others) // LANES
    below, above = band + max(0, n - m), band + max(0, m - n)
    rows[:, : (m + 2) * LANES] = np.inf
    last, new = rows[0], rows[1]
    last[:LANES] = 0.0
    for i in range(n):
        low, high = max(0, i - below), min(m - 1, i + above)
        new[low * LANES : (low + 1) * LANES] = np.inf
        for j in range(low, high + 1):
            at = j * LANES
            for k in range(LANES):
                apart = a[i] - others[at + k]
                above_it, corner, left = last[at + LANES + k], last[at + k], new[at + k]
                least = above_it if above_it < corner else corner
                least = least if least < left else left
                new[at + LANES + k] = apart * apart + least
        new[(high + 2) * LANES : (high + 3) * LANES] = np.inf
        last, new = new, last
    return last[m * LANES : (m + 1) * LANES]
