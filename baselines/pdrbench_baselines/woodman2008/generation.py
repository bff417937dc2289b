"""Compiled generations of the particle filter: prior, motion, weights, bins (eq. 3 to 16; claims W4 to W11).

A generation is written in batches: KLD sampling asks for more particles as bins fill. Within a batch particles are
sorted by cell of the map, so that neighbours in memory walk through the same half planes. Nothing is allocated per
particle, and the bytes are the same whatever the number of threads: work is cut into fixed chunks, random numbers count
by particle, and no floating-point expression is reordered.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from numba import types
from numba.experimental import structref

from pdrbench.compiled import compiled, inner
from pdrbench.filters import kld
from pdrbench.filters.map_walk import START, TILE, new_scratch, walk_tile
from pdrbench_baselines.woodman2008.random_numbers import (
    HALF,
    MOTION,
    ONE,
    PRIOR,
    QUARTER,
    ZERO,
    box_muller,
    cos_turns,
    philox,
    random_offset,
    uniform,
    wrap_turns,
)
from pdrbench_baselines.woodman2008.resampling import CHUNK

FIRST_BATCH: Final = 0.6  # of the particles that a generation is expected to need come in its first batch

kld_bound = compiled(kld.kld_bound)


class Motion(NamedTuple):
    """One stride: float32 lengths in metres and turns in turns; the change of height and its sigma as float."""

    length: Any
    length_sigma: Any
    turn: Any
    turn_sigma: Any
    min_length: Any
    rise: float
    rise_sigma: float


class Bins(NamedTuple):
    """Bins over x, y, floor height and heading: edges and bins per metre as float32, the numbers of bins as int32.

    Attributes:
        first: (K,) int32 first bin of each cell's height.
        live_only: Particles that hit a wall count in no bin.
    """

    x: Any
    y: Any
    per_m: Any
    turn_bins: Any
    last_column: Any
    last_row: Any
    columns: Any
    first: Any
    live_only: bool


class Bound(NamedTuple):
    """When a generation is complete; see `WoodmanFilterParams`."""

    epsilon: float
    z: float
    min_particles: int
    max_particles: int


class Prior(NamedTuple):
    """Where a prior is uniform: triangles and headings.

    Attributes:
        corners: (T, 3, 2) float32.
        cell: (T,) int32 ascending.
        area: (T,) float64, running sum of the areas.
        first_turn: float32, least heading in turns.
        turns: float32, width of the headings in turns.
    """

    corners: Any
    cell: Any
    area: Any
    first_turn: Any
    turns: Any


class Particles(NamedTuple):
    """Room for N particles.

    Attributes:
        state: (4, N) float32: x and y in metres, heading in turns, weight.
        cell: (N,) int32, of the map.
    """

    state: Any
    cell: Any


@structref.register
class FewType(types.StructRef):
    """Numba's type of `Few`."""


class Few(structref.StructRefProxy):
    """What `next_generation` works on, handed over once: each array of an argument takes Numba 0.2 to 0.4 us a call.

    Made by `few_of`, which says what it holds.
    """


structref.define_boxing(FewType, Few)  # type: ignore[no-untyped-call]
structref.define_attributes(FewType)  # type: ignore[no-untyped-call]
_FIELDS: Final = ("world", "motion", "keys", "bins", "bound", "present", "following", "stamps", "slot", "scratch")
structref.define_constructor(Few, FewType, _FIELDS)  # type: ignore[no-untyped-call]


class Tile(NamedTuple):
    """Some particles one after the other: (n,) each, as in `Particles`."""

    x: Any
    y: Any
    turns: Any
    weight: Any
    cell: Any


@compiled
def enough(num_bins: int, bound: Any) -> int:
    """How many particles complete a generation that occupies so many bins."""
    needed: int = min(max(kld_bound(num_bins, bound.epsilon, bound.z), bound.min_particles), bound.max_particles)
    return needed


@compiled
def expected_need(num_bins: float, count: int, total: float, squares: float, bound: Any) -> int:
    """Particles that a generation is likely to need.

    Bins of the old generation empty as weights concentrate; by how much follows from the fraction of effective
    particles, (sum w)^2 / sum w^2 over their number.
    """
    expected = num_bins * (total * total / squares) / count
    return int(kld_bound(max(2, int(expected)), bound.epsilon, bound.z))


@inner
def _part(particles: Any, a: int, b: int) -> Any:
    state, cell = particles
    return Tile(state[0, a:b], state[1, a:b], state[2, a:b], state[3, a:b], cell[a:b])


@inner
def _move(motion: Any, first: int, keys: Any, from_x: Any, from_y: Any, new: Any, scratch: Any) -> None:
    """Perturbs the stride, turns, and moves up to `TILE` particles: eq. (7) to (11).

    Particle `first` + i draws from counters of its own.
    """
    f, bits, words, _ = scratch
    xe, ye, turns = new.x, new.y, new.turns
    count = len(turns)
    half = (count + 1) // 2
    w0, w1, w2, w3 = words[0, :half], words[1, :half], words[2, :half], words[3, :half]
    philox(np.uint64(first), MOTION, keys, w0, w1, w2, w3)
    z_turn, z_length, unit = f[0], f[1], f[2, :half]
    box_muller(w0, w1, unit, bits[:half], z_turn[:half], z_length[:half])
    box_muller(w2, w3, unit, bits[:half], z_turn[half : 2 * half], z_length[half : 2 * half])
    length, length_sigma, least = motion.length, motion.length_sigma, motion.min_length
    turn, turn_sigma = motion.turn, motion.turn_sigma
    for i in range(count):
        t = wrap_turns(turns[i] + (turn + turn_sigma * z_turn[i]))
        step = max(length + length_sigma * z_length[i], least)
        turns[i] = t
        xe[i] = from_x[i] + step * cos_turns(t)
        ye[i] = from_y[i] + step * cos_turns(wrap_turns(t - QUARTER))


@inner
def _propagate_tile(motion: Any, first: int, keys: Any, old: Any, new: Any, scratch: Any) -> Any:
    """Moves up to `TILE` particles; eq. (7) to (11). Returns where they came from.

    On entry `new.cell` has the index in `old` of the particle that each descends from; where `old` is empty, particles
    are moved in place.
    """
    x, y, turns, _, cell = new
    from_x, from_y = scratch.f[3, : len(x)], scratch.f[4, : len(x)]
    if len(old.cell):
        old_x, old_y, old_turns, old_cell = old.state[0], old.state[1], old.state[2], old.cell
        for i in range(len(x)):
            ancestor = np.uint32(cell[i])
            from_x[i], from_y[i], turns[i] = old_x[ancestor], old_y[ancestor], old_turns[ancestor]
            cell[i] = old_cell[ancestor]
    else:
        for i in range(len(x)):
            from_x[i], from_y[i] = x[i], y[i]
    _move(motion, first, keys, from_x, from_y, new, scratch)
    return from_x, from_y


@inner
def _walk_by_cell(world: Any, motion: Any, from_x: Any, from_y: Any, tile: Any, slot: Any, scratch: Any) -> None:
    """`walk_tile` for particles in any order: those of a cell are walked together, so that few have loops of their own.

    Args:
        world, motion, tile, scratch: As in `advance`.
        from_x, from_y: (n,) where the particles of the tile come from.
        slot: (K,) int32 zeros, on entry and after.
    """
    x, y, _, weight, cell = tile
    count, f, bits, order = len(x), scratch.f, scratch.bits, scratch.words[0]  # of `_move`, no longer needed
    by_x, by_y, by_xe, by_ye, by_weight = f[0, :count], f[1, :count], f[8, :count], f[9, :count], f[10, :count]
    _order_by_cell(cell, slot, bits, order)
    for k in range(count):
        i = order[k]
        by_x[k], by_y[k], by_xe[k], by_ye[k], bits[k] = from_x[i], from_y[i], x[i], y[i], cell[i]
    walk_tile(world, motion.rise, motion.rise_sigma, by_x, by_y, by_xe, by_ye, bits[:count], by_weight, scratch)
    for k in range(count):
        i = order[k]
        cell[i], weight[i] = bits[k], by_weight[k]


@inner
def _order_by_cell(cell: Any, slot: Any, found: Any, order: Any) -> None:
    """Sorts particles by cell, cells as they first appear; `slot` is as in `_walk_by_cell`, `found` has room for n."""
    num_found = 0
    for i in range(len(cell)):
        if slot[cell[i]] == 0:
            found[num_found] = cell[i]
            num_found += 1
        slot[cell[i]] += 1
    first = np.int32(0)
    for k in range(num_found):
        number = slot[found[k]]
        slot[found[k]] = first
        first += number
    for i in range(len(cell)):
        order[slot[cell[i]]] = i
        slot[cell[i]] += 1
    for k in range(num_found):
        slot[found[k]] = 0


@inner
def _bin_tile(bins: Any, particles: Any, place: Any) -> None:
    """(count,) the bin of each particle; -1 where it does not count."""
    x, y, turns, weight, cell = particles
    x0, y0, per_m, turn_bins, last_column, last_row, columns, first, live_only = bins
    zero, last_turn, bins_of_turn = np.int32(0), turn_bins - np.int32(1), np.float32(turn_bins)
    for i in range(len(x)):
        column = min(max(np.int32((x[i] - x0) * per_m), zero), last_column)
        row = min(max(np.int32((y[i] - y0) * per_m), zero), last_row)
        turn = min(max(np.int32((turns[i] + HALF) * bins_of_turn), zero), last_turn)
        place[i] = (row * columns + column) * turn_bins + turn
    for i in range(len(x)):
        place[i] += first[np.uint32(cell[i])]
    if live_only:
        for i in range(len(x)):
            if weight[i] == ZERO:
                place[i] = -1


@inner
def _mark(marks: Any, place: Any) -> None:
    for i in range(len(place)):
        if place[i] >= 0:
            marks[np.uint32(place[i])] = 1


@compiled
def count_marks(marks: Any) -> int:
    """Bins that any thread has marked."""
    for thread in range(1, marks.shape[0]):
        for i in range(marks.shape[1]):
            marks[0, i] |= marks[thread, i]
    count = 0
    for i in range(marks.shape[1]):
        count += marks[0, i]
    return count


@compiled
def advance(
    part: Any, world: Any, motion: Any, keys: Any, bins: Any, first: int, count: int, old: Any, new: Any, marks: Any
) -> None:
    """Propagates and corrects the particles `first` to `first` + `count`, and marks their bins.

    Args:
        part: First chunk, end and thread (`in_threads`).
        world: `World`.
        motion: `Motion`.
        keys: (3,) uint64: two of the generator, number of the generation.
        bins: `Bins`.
        first: First particle.
        count: Number of particles.
        old: `Particles` that they descend from; empty where the particles are moved in place.
        new: `Particles`; on entry `cell` has the ancestor of each, in place its cell.
        marks: (threads, bins) uint8.
    """
    begin, end, thread = part
    scratch, high = new_scratch(), first + min(end * CHUNK, count)
    for a in range(first + begin * CHUNK, high, TILE):
        tile = _part(new, a, min(a + TILE, high))
        x, y, _, weight, cell = tile
        from_x, from_y = _propagate_tile(motion, a, keys, old, tile, scratch)
        walk_tile(world, motion.rise, motion.rise_sigma, from_x, from_y, x, y, cell, weight, scratch)
        place = scratch.index[2, : len(x)]
        _bin_tile(bins, tile, place)
        _mark(marks[thread], place)


@compiled
def draw_prior(
    part: Any, prior: Any, offset: float, keys: Any, bins: Any, first: int, count: int, new: Any, marks: Any
) -> None:
    """Particles evenly over triangles, systematically over their area, at random inside each; sorted by cell.

    Args:
        part: First chunk, end and thread (`in_threads`).
        prior: `Prior`.
        offset: Of the systematic draw.
        keys: (3,) uint64.
        bins: `Bins`.
        first: First particle.
        count: Number of particles.
        new: `Particles`.
        marks: (threads, bins) uint8.
    """
    corners, owner, area, first_turn, all_turns = prior
    begin, end, thread = part
    words = np.empty((4, TILE), np.uint32)
    place = np.empty(TILE, np.int32)
    spacing = area[-1] / count
    low, high = begin * CHUNK, min(end * CHUNK, count)
    triangle = 0
    for a in range(low, high, TILE):
        number = min(TILE, high - a)
        w0, w1, w2, w3 = words[0, :number], words[1, :number], words[2, :number], words[3, :number]
        philox(np.uint64(first + a), PRIOR, keys, w0, w1, w2, w3)
        tile = _part(new, first + a, first + a + number)
        x, y, turns, weight, cell = tile
        for i in range(number):
            while triangle < len(area) - 1 and area[triangle] < (a + i + offset) * spacing:
                triangle += 1
            u, v = uniform(w0[i]), uniform(w1[i])
            if u + v > ONE:
                u, v = ONE - u, ONE - v
            x0, y0 = corners[triangle, 0, 0], corners[triangle, 0, 1]
            x[i] = x0 + u * (corners[triangle, 1, 0] - x0) + v * (corners[triangle, 2, 0] - x0)
            y[i] = y0 + u * (corners[triangle, 1, 1] - y0) + v * (corners[triangle, 2, 1] - y0)
            turns[i] = wrap_turns(first_turn + all_turns * uniform(w2[i]))
            weight[i] = ONE
            cell[i] = owner[triangle]
        _bin_tile(bins, tile, place[:number])
        _mark(marks[thread], place[:number])


@compiled
def few_of(world: Any, still: Any, keys: Any, bins: Any, bound: Any, old: Any, new: Any, stamps: Any, slot: Any) -> Few:
    """What `next_generation` works on.

    Args:
        world, keys, bins: As in `advance`.
        still: `Motion` of a stride of length 0.
        bound: `Bound`.
        old: `Particles` of the old generation.
        new: `Particles` with room for more.
        stamps: (bins,) int32; a bin is occupied where it holds the number of a generation.
        slot: (K,) int32 zeros.
    """
    return Few(world, still, keys, bins, bound, old, new, stamps, slot, new_scratch())  # type: ignore[no-untyped-call]


@compiled
def next_generation(few: Any, count: int, num_bins: int, length: float, rise: float, turn: float) -> Any:
    """A whole generation of few particles in one call: resamples, propagates and corrects until there are enough.

    Counts `keys` up; the generations change places in `few` where there is one.

    Args:
        few: `Few`.
        count: How many particles the old generation has.
        num_bins: How many bins it occupies.
        length, rise, turn: The stride in metres and turns.

    Returns:
        Particles, bins, and the bound for that many bins; more particles than the capacity means that there was no
        room, no particles that all weights were zero.
    """
    world, still, keys, bins, bound = few.world, few.motion, few.keys, few.bins, few.bound
    old, new, stamps, slot, scratch = few.present, few.following, few.stamps, few.slot, few.scratch
    _, length_sigma, _, turn_sigma, least, _, rise_sigma = still
    motion = Motion(np.float32(length), length_sigma, np.float32(turn), turn_sigma, least, rise, rise_sigma)
    keys[2] += np.uint64(1)
    weight, stamp, capacity = old.state[3, :count], np.int32(keys[2]), len(new.cell)
    total, squares = 0.0, 0.0
    for i in range(len(weight)):
        value = np.float64(weight[i])
        total += value
        squares += value * value
    if not total > 0.0:
        return 0, 0, 0
    expected = expected_need(num_bins, count, total, squares, bound)
    wanted = min(max(int(FIRST_BATCH * expected), bound.min_particles), bound.max_particles)
    filled, num_bins, batch, needed = START, START, START, bound.min_particles
    while filled < wanted:
        if wanted > capacity:
            return wanted, num_bins, wanted
        offset = random_offset(keys, batch)
        scale = (wanted - filled) / total
        running, taken = 0.0, 0
        for i in range(len(weight)):
            running += np.float64(weight[i])
            below = int(np.ceil(running * scale - offset))
            while taken < below:
                new.cell[filled + taken] = i
                taken += 1
        for a in range(filled, wanted, TILE):
            tile = _part(new, a, min(a + TILE, wanted))
            from_x, from_y = _propagate_tile(motion, a, keys, old, tile, scratch)
            _walk_by_cell(world, motion, from_x, from_y, tile, slot, scratch)
            place = scratch.index[2, : len(tile.x)]
            _bin_tile(bins, tile, place)
            for i in range(len(place)):
                if place[i] >= 0 and stamps[place[i]] != stamp:
                    stamps[place[i]] = stamp
                    num_bins += 1
        filled = wanted
        needed = enough(num_bins, bound)
        wanted = max(filled, needed)
        batch += 1
    few.present, few.following = new, old
    return filled, num_bins, needed
