"""Compiled parts of step detection: even sampling, low-pass filter, peaks and valleys.

Each carries its state in an array and gives the same numbers whatever the pieces that a recording comes in.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit

# State of `even_samples`: next cell, sum of the begun one, last row, and whether there was one.
CELL, SUM, LAST_T, LAST_VALUE, BEGUN, NUM_EVEN = range(6)

# State of `turning_points`: what is sought, samples so far, the extremes since the last turning point, the last valley,
# the last sample, the first crossing of gravity after the peak.
SEEKS_VALLEY, COUNT, HIGH, HIGH_AT, LOW, LOW_AT, VALLEY, VALLEY_AT, PEAK, PEAK_AT, LAST, CROSSED, NUM_TURNING = range(
    13
)
# Columns of what it finds; indices are of filtered samples, `CROSSING_AT` lies between two of them.
BEGIN_AT, END_AT, PEAKED_AT, CROSSING_AT, SWING, FOUND_AT, NUM_COLUMNS = range(7)
NEVER: Final = -1.0


@njit(cache=True, nogil=True)
def even_samples(t_s, value, start_s, rate_hz, state, out):  # type: ignore[no-untyped-def]
    """Means over cells of 1 / rate_hz of the line through the rows; returns how many cells were completed.

    Args:
        t_s: (n,) non-decreasing, from `start_s` on.
        value: (n,).
        start_s: Where the first cell begins.
        rate_hz: Of the cells.
        state: (`NUM_EVEN`,) carried from call to call.
        out: (at least as many as cells are completed,) written.
    """
    count = 0
    for i in range(len(t_s)):
        at, now = (t_s[i] - start_s) * rate_hz, value[i]  # time in cells
        if state[BEGUN] == 0.0:
            state[BEGUN], state[LAST_T], state[LAST_VALUE] = 1.0, at, now
            continue
        since, before = state[LAST_T], state[LAST_VALUE]
        slope = (now - before) / (at - since) if at > since else 0.0
        while at >= state[CELL] + 1.0:
            edge = state[CELL] + 1.0
            at_edge = before + slope * (edge - since)
            out[count] = state[SUM] + 0.5 * (before + at_edge) * (edge - since)
            count += 1
            state[SUM], state[CELL] = 0.0, edge
            since, before = edge, at_edge
        state[SUM] += 0.5 * (before + now) * (at - since)
        state[LAST_T], state[LAST_VALUE] = at, now
    return count


@njit(cache=True, nogil=True)
def filtered(value, taps, memory):  # type: ignore[no-untyped-def]
    """(n,) values through a filter of finite length.

    Args:
        value: (n,).
        taps: (k,) symmetric.
        memory: (k - 1,) values before, carried from call to call.
    """
    before = len(memory)
    whole = np.concatenate((memory, value))
    out = np.empty(len(value))
    for i in range(len(value)):
        total = 0.0
        for k in range(before + 1):
            total += taps[k] * whole[i + k]
        out[i] = total
    for k in range(before):  # an assignment of arrays takes Numba two seconds to compile
        memory[k] = whole[len(value) + k]
    return out


@njit(cache=True, nogil=True)
def turning_points(smooth, gravity, least, apart, longest, state, found):  # type: ignore[no-untyped-def]
    """Waves from valley to valley; returns how many were found.

    A peak is one when the curve has fallen `least` below it, a valley when it has risen `least` above it (Delta_a). A
    valley nearer than `apart` to the one before (Delta_t) is one with it: the deeper of both stays, and the peak
    between is none. A valley above which the curve has not risen within `longest` ends the wave all
    the same: the walk is over.

    Args:
        smooth: (n,) the next samples.
        gravity: Whose crossing after the peak is the inference point (L11).
        least: Delta_a, in the unit of the samples.
        apart: Delta_t, in samples.
        longest: In samples.
        state: (`NUM_TURNING`,) carried from call to call; `COUNT` 0 at the beginning.
        found: (n // 2 + 1, `NUM_COLUMNS`) written.
    """
    count = 0
    for i in range(len(smooth)):
        now, at = smooth[i], state[COUNT]
        if at == 0.0:
            state[:] = 0.0
            state[SEEKS_VALLEY] = 1.0  # the beginning is no valley of a wave before
            state[HIGH] = state[LOW] = state[LAST] = now
            state[VALLEY_AT] = state[CROSSED] = state[PEAK_AT] = NEVER
        if state[LAST] >= gravity > now and state[CROSSED] == NEVER:
            state[CROSSED] = at - 1.0 + (state[LAST] - gravity) / (state[LAST] - now)
        if state[SEEKS_VALLEY] == 0.0:
            if now > state[HIGH]:
                state[HIGH], state[HIGH_AT], state[CROSSED] = now, at, NEVER
            if now < state[HIGH] - least:
                state[SEEKS_VALLEY], state[LOW], state[LOW_AT] = 1.0, now, at
                state[PEAK], state[PEAK_AT] = state[HIGH], state[HIGH_AT]
        else:
            if now < state[LOW]:
                state[LOW], state[LOW_AT] = now, at
            if now > state[LOW] + least or at - state[LOW_AT] >= longest:
                is_new = state[VALLEY_AT] == NEVER or state[LOW_AT] - state[VALLEY_AT] >= apart
                if is_new and state[VALLEY_AT] != NEVER and state[PEAK_AT] != NEVER:
                    row = found[count]
                    row[BEGIN_AT], row[END_AT], row[PEAKED_AT] = state[VALLEY_AT], state[LOW_AT], state[PEAK_AT]
                    row[SWING] = state[PEAK] - min(state[VALLEY], state[LOW])
                    row[CROSSING_AT] = state[CROSSED]
                    if not state[PEAK_AT] <= state[CROSSED] <= state[LOW_AT]:  # all of it on one side of gravity
                        row[CROSSING_AT] = 0.5 * (state[PEAK_AT] + state[LOW_AT])
                    row[FOUND_AT] = at
                    count += 1
                if is_new or state[LOW] < state[VALLEY]:
                    state[VALLEY], state[VALLEY_AT] = state[LOW], state[LOW_AT]
                state[SEEKS_VALLEY], state[HIGH], state[HIGH_AT], state[CROSSED] = 0.0, now, at, NEVER
        state[LAST] = now
        state[COUNT] = at + 1.0
    return count
