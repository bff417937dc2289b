"""Compiled parts of FootSLAM: from hexagon to hexagon along a segment, counts of transitions, one stride of a cloud.

Hexagons have axial coordinates (q, r) and a level. Edge e faces the neighbour at 60 e degrees, counter-clockwise from
+x, and is edge e + 3 of that neighbour. A table of counts is open addressing with linear probing: `keys` (S,) int32
with -1 where a slot is empty, `counts` (S, 6) uint8, S a power of two.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from pdrbench.compiled import compiled

STEP_Q: Final = (1, 0, -1, -1, 0, 1)
STEP_R: Final = (0, 1, 1, 0, -1, -1)
EMPTY: Final = -1
COORDINATE_BITS: Final = 12  # of q and of r: hexagons 4096 apart share a record, which is 3.5 km at a radius of 0.5 m
MASK: Final = (1 << COORDINATE_BITS) - 1
LEVEL_MASK: Final = 127
MAX_COUNT: Final = 255
HASH: Final = 0x9E3779B1  # 2^32 over the golden ratio; Knuth 1973, section 6.4
MAX_CROSSINGS: Final = 64  # of one segment: 5 m, the longest stride of the sensor, cross 13 edges at 0.5 m


@compiled
def next_edge(q: Any, r: Any, x: float, y: float, dx: float, dy: float, radius: float) -> Any:
    """Edge through which the line (x, y) + t (dx, dy) leaves hexagon (q, r), and t there; 6 and infinity if never."""
    apothem = 0.5 * math.sqrt(3.0) * radius
    from_x, from_y = x - 2.0 * apothem * (q + 0.5 * r), y - 1.5 * radius * r
    best, edge = math.inf, 6
    for e in range(6):
        normal_x, normal_y = math.cos(e * math.pi / 3.0), math.sin(e * math.pi / 3.0)
        towards = normal_x * dx + normal_y * dy
        if towards > 0.0:
            t = (apothem - normal_x * from_x - normal_y * from_y) / towards
            if t < best:
                best, edge = t, e
    return edge, best


@compiled
def trace(q: Any, r: Any, x: float, y: float, dx: float, dy: float, radius: float, edges: Any) -> int:
    """Edges that a segment from (x, y) in hexagon (q, r) to (x + dx, y + dy) crosses, in order; how many."""
    count = 0
    while count < len(edges):
        edge, t = next_edge(q, r, x, y, dx, dy, radius)
        if t >= 1.0:
            break
        edges[count] = edge
        count += 1
        q, r = q + STEP_Q[edge], r + STEP_R[edge]
    return count


@compiled
def trace_each(q: Any, r: Any, start: Any, end: Any, radius: float, edges: Any, counts: Any) -> None:
    """`trace` of segments (N, 2) to (N, 2): edges (N, M) and how many of them (N,)."""
    for i in range(len(start)):
        dx, dy = end[i, 0] - start[i, 0], end[i, 1] - start[i, 1]
        counts[i] = trace(q[i], r[i], start[i, 0], start[i, 1], dx, dy, radius, edges[i])


@compiled
def key_of(q: Any, r: Any, level: Any) -> Any:
    """A hexagon as a number of 31 bits."""
    return (q & MASK) | (r & MASK) << COORDINATE_BITS | (level & LEVEL_MASK) << (2 * COORDINATE_BITS)


@compiled
def neighbour_of(key: int, edge: int) -> Any:
    """The hexagon beyond an edge."""
    q, r, level = key & MASK, key >> COORDINATE_BITS & MASK, key >> (2 * COORDINATE_BITS)
    return key_of(q + STEP_Q[edge], r + STEP_R[edge], level)


@compiled
def slot_of(keys: Any, key: int) -> int:
    """Where a hexagon is in a table (S,), or the empty slot where it would be."""
    mask = len(keys) - 1
    slot = ((key * HASH) & 0xFFFFFFFF) >> 7 & mask
    while keys[slot] != EMPTY and keys[slot] != key:
        slot = (slot + 1) & mask
    return slot


@compiled
def add(keys: Any, counts: Any, used: int, key: int, edge: int) -> int:
    """Counts one transition at a hexagon; the number of slots in use after it. A full table takes no new hexagon."""
    slot = slot_of(keys, key)
    if keys[slot] == EMPTY:
        if 4 * (used + 1) > 3 * len(keys):
            return used
        keys[slot] = key
        used += 1
    if counts[slot, edge] < MAX_COUNT:
        counts[slot, edge] += 1
    return used


@compiled
def add_crossing(keys: Any, counts: Any, used: int, key: int, edge: int) -> int:
    """Counts a transition at both hexagons of an edge."""
    used = add(keys, counts, used, key, edge)
    return add(keys, counts, used, neighbour_of(key, edge), (edge + 3) % 6)


@compiled
def log_gain(keys: Any, counts: Any, key: int, edge: int, alpha: float) -> float:
    """log of 6 (N_e + alpha) / (N_h + 6 alpha)."""
    slot = slot_of(keys, key)
    if keys[slot] == EMPTY:
        return 0.0
    total = 0.0
    for e in range(6):
        total += counts[slot, e]
    return math.log(6.0 * (counts[slot, edge] + alpha) / (total + 6.0 * alpha))


@compiled
def remember(keys: Any, counts: Any, used: int, pending: Any, at: Any, key: int, edge: int) -> int:
    """Counts the oldest of the transitions that wait, and lets a new one wait; `pending` (D, 2) is a ring."""
    if not len(pending):
        return add_crossing(keys, counts, used, key, edge)
    place = at[0] % len(pending)
    if pending[place, 0] != EMPTY:
        used = add_crossing(keys, counts, used, pending[place, 0], pending[place, 1])
    pending[place, 0], pending[place, 1] = key, edge
    at[0] = (place + 1) % len(pending)
    return used


@compiled
def stride(
    state: Any, cell: Any, log_weight: Any, noise: Any, moved: Any, level: int, sigmas: Any, hexagons: Any, tables: Any
) -> None:
    """One stride of every particle: propagate, weigh by the map so far, and let the transitions wait to be counted.

    Args:
        state: (N, 5) x, y, heading of travel without its white part, drift a stride, factor on lengths; changed.
        cell: (N, 2) int64 hexagon; changed.
        log_weight: (N,); changed.
        noise: (N, 4) standard normal: drift, turn, heading, length.
        moved: Length and turn of the stride.
        level: Where the stride ends.
        sigmas: Of the four.
        hexagons: Radius, alpha, and 0 where the map weighs nothing.
        tables: keys (N, S), counts (N, S, 6), used (N,), pending (N, D, 2), at (N, 1); changed.
    """
    keys, counts, used, pending, at = tables
    radius, alpha, gains = hexagons
    edges = np.empty(MAX_CROSSINGS, np.int64)
    for i in range(len(state)):
        state[i, 3] += sigmas[0] * noise[i, 0]
        state[i, 2] += moved[1] - state[i, 3] - sigmas[1] * noise[i, 1]
        towards = state[i, 2] - sigmas[2] * noise[i, 2]
        length = max(state[i, 4] * moved[0] - sigmas[3] * noise[i, 3], 0.0)
        dx, dy = length * math.cos(towards), length * math.sin(towards)
        q, r = cell[i, 0], cell[i, 1]
        for k in range(trace(q, r, state[i, 0], state[i, 1], dx, dy, radius, edges)):
            edge, key = edges[k], key_of(q, r, level)
            log_weight[i] += gains * log_gain(keys[i], counts[i], key, edge, alpha)
            used[i] = remember(keys[i], counts[i], used[i], pending[i], at[i], key, edge)
            q, r = q + STEP_Q[edge], r + STEP_R[edge]
        cell[i, 0], cell[i, 1] = q, r
        state[i, 0] += dx
        state[i, 1] += dy


@compiled
def copy_tables(source: Any, tables: Any) -> None:
    """Gives particle i the map of particle `source[i]`, which keeps its own."""
    keys, counts, used, pending, at = tables
    for i in range(len(source)):
        j = source[i]
        if j != i:
            keys[i], counts[i], used[i], pending[i], at[i] = keys[j], counts[j], used[j], pending[j], at[j]


@compiled
def rehash(keys: Any, counts: Any, larger_keys: Any, larger_counts: Any) -> None:
    """Moves all tables (N, S) into empty ones (N, 2 S)."""
    for i in range(len(keys)):
        for s in range(keys.shape[1]):
            if keys[i, s] != EMPTY:
                slot = slot_of(larger_keys[i], keys[i, s])
                larger_keys[i, slot] = keys[i, s]
                larger_counts[i, slot] = counts[i, s]
