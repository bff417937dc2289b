"""Compiled particle kernels in float32: random numbers, prior, resampling, motion, map walk, weights, bins.

They allocate nothing per particle and give the same bytes whatever the number of threads: work is cut into fixed
chunks, random numbers count by particle, and no floating-point expression is reordered. All of them live in this one
module because numba's cache does not notice changes in functions of other modules.

A generation is written in batches: KLD sampling asks for more particles as bins fill. Within a batch particles are
sorted by piece of the map, so that neighbours in memory walk through the same half planes.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np
from numba import get_thread_id, njit, prange  # type: ignore[attr-defined]

from pdrbench.filters.kld import kld_bound

CHUNK: Final = 16_384  # particles that one thread takes at a time; fixed, so that results do not depend on threads
TILE: Final = 1024  # particles whose scratch arrays stay in the innermost cache
MAX_CROSSINGS: Final = 64  # claim W6: more pieces than that in one stride are no walk
FIRST_SHARE: Final = 0.6  # of the few particles that a generation is expected to need come in its first batch
FLATTEST: Final = 80.0  # beyond 12.6 sigma the weight of a height falls no further: only walls kill

# Philox4x32-10 (Salmon et al. 2011): multipliers and key increments.
_M0, _M1 = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)
_W0, _W1 = np.uint64(0x9E3779B9), np.uint64(0xBB67AE85)
_LOW, _32 = np.uint64(0xFFFFFFFF), np.uint64(32)
_8 = np.uint32(8)

_MOTION, _OFFSET, _PRIOR = np.uint64(0), np.uint64(1), np.uint64(2)  # streams of random numbers

_ZERO, _ONE, _TWO = np.float32(0.0), np.float32(1.0), np.float32(2.0)
_HALF, _QUARTER = np.float32(0.5), np.float32(0.25)
_UNIT = np.float32(2.0**-24)
_LN2 = np.float32(math.log(2.0))
_SQRT_HALF = np.float32(math.sqrt(0.5))
_L1, _L3, _L5, _L7, _L9 = (np.float32(2.0 / k) for k in (1, 3, 5, 7, 9))
# sin(2 pi r) as a power series, r in [-1/4, 1/4]: the next term is below 6e-8
_S1, _S3, _S5, _S7, _S9, _S11 = (
    np.float32((-1.0) ** (k // 2) * (2 * math.pi) ** k / math.factorial(k)) for k in (1, 3, 5, 7, 9, 11)
)
_EXPONENT, _MANTISSA, _ONE_BITS = np.int32(23), np.int32(0x7FFFFF), np.int32(0x3F800000)
_BIAS = np.int32(127)


_kld_bound = njit(cache=True)(kld_bound)


class World(NamedTuple):
    """The map as `pdrbench.building.convex.ConvexMap` describes it, and (K,) int32 the first bin of each piece."""

    line: Any
    first_line: Any
    first_gate: Any
    gate: Any
    gate_to: Any
    box_m: Any
    height_m: Any
    bin_base: Any


class Motion(NamedTuple):
    """One stride: float32 lengths in metres and turns in turns; the change of height and its sigma as float."""

    length: Any
    length_sigma: Any
    turn: Any
    turn_sigma: Any
    least_length: Any
    rise: float
    rise_sigma: float


class Grid(NamedTuple):
    """Bins of one height: least x and y and bins per metre as float32, the numbers of bins as int32."""

    x: Any
    y: Any
    per_m: Any
    turn_bins: Any
    last_column: Any
    last_row: Any
    columns: Any


class Scratch(NamedTuple):
    """Room for one tile: f (12, TILE) float32; bits, its row 2 as int32; words (4, TILE) uint32;
    index (3, TILE) int32.
    """

    f: Any
    bits: Any
    words: Any
    index: Any


# Random numbers.


@njit(cache=True, error_model="numpy")
def _philox(first: Any, step: Any, stream: Any, key0: Any, key1: Any, w0: Any, w1: Any, w2: Any, w3: Any) -> None:
    """Four words for each of the counters `first`, `first` + 1, ... of a stream at a step."""
    for i in range(len(w0)):
        count = np.uint64(first) + np.uint64(i)
        c0, c1, c2, c3 = count & _LOW, count >> _32, step, stream
        k0, k1 = key0, key1
        for _ in range(10):
            p0, p1 = _M0 * c0, _M1 * c2
            c0, c1, c2, c3 = (p1 >> _32) ^ c1 ^ k0, p1 & _LOW, (p0 >> _32) ^ c3 ^ k1, p0 & _LOW
            k0, k1 = (k0 + _W0) & _LOW, (k1 + _W1) & _LOW
        w0[i], w1[i], w2[i], w3[i] = np.uint32(c0), np.uint32(c1), np.uint32(c2), np.uint32(c3)


@njit(cache=True, error_model="numpy")
def _unit(word: Any) -> Any:
    """A word as float32 in (0, 1)."""
    return np.float32(np.int32(word >> _8)) * _UNIT + _HALF * _UNIT


@njit(cache=True, error_model="numpy")
def _sine_of_turns(r: Any) -> Any:
    """sin(2 pi r) for r in [-1/4, 1/4]."""
    q = r * r
    return r * (_S1 + q * (_S3 + q * (_S5 + q * (_S7 + q * (_S9 + q * _S11)))))


@njit(cache=True, error_model="numpy")
def _cos_turns(t: Any) -> Any:
    """cos(2 pi t) for t in [-1/2, 1/2]."""
    return _sine_of_turns(_QUARTER - abs(t))


@njit(cache=True, error_model="numpy")
def _wrap_turns(t: Any) -> Any:
    """Into [-1/2, 1/2)."""
    return t - np.floor(t + _HALF)


@njit(cache=True, error_model="numpy")
def _box_muller(words_u: Any, words_v: Any, unit: Any, bits: Any, a: Any, b: Any) -> None:
    """Two independent standard normals from two words each; `bits` is `unit` seen as integers."""
    for i in range(len(a)):
        unit[i] = _unit(words_u[i])
    for i in range(len(a)):
        # ln u = e ln 2 + ln m with m in [1/sqrt 2, sqrt 2), ln m = 2 artanh((m - 1) / (m + 1))
        exponent = np.float32((bits[i] >> _EXPONENT) - _BIAS)
        a[i] = exponent
        bits[i] = (bits[i] & _MANTISSA) | _ONE_BITS
    for i in range(len(a)):
        m = unit[i]
        high = m * _SQRT_HALF > _ONE - _ZERO
        exponent = a[i] + (_ONE if high else _ZERO)
        m = m * (_HALF if high else _ONE)
        s = (m - _ONE) / (m + _ONE)
        q = s * s
        log = exponent * _LN2 + s * (_L1 + q * (_L3 + q * (_L5 + q * (_L7 + q * _L9))))
        radius = np.sqrt(-_TWO * log)
        turns = _unit(words_v[i]) - _HALF
        a[i] = radius * _cos_turns(turns)
        b[i] = radius * _cos_turns(_wrap_turns(turns - _QUARTER))


@njit(cache=True, error_model="numpy")
def random_offset(generation: int, batch: int, key0: int, key1: int) -> float:
    """Uniform in (0, 1): where a systematic comb begins."""
    words = np.empty((4, 1), np.uint32)
    _philox(
        np.uint64(batch),
        np.uint64(generation),
        _OFFSET,
        np.uint64(key0),
        np.uint64(key1),
        words[0],
        words[1],
        words[2],
        words[3],
    )
    return (float(words[0, 0]) * 2.0**20 + float(words[1, 0] >> np.uint32(12)) + 0.5) * 2.0**-52


# The map walk.


@njit(cache=True, error_model="numpy")
def _exit(lines: Any, low: int, high: int, entered: int, x: Any, y: Any, xe: Any, ye: Any, done: Any) -> Any:
    """Share of the way from (x, y) to (xe, ye) at which a piece is left, and through which line; -1: it is not."""
    best, through = _TWO, -1
    for line in range(low, high):
        after = lines[line, 0] * xe + lines[line, 1] * ye - lines[line, 2]
        if after > _ZERO and line != entered:
            before = lines[line, 0] * x + lines[line, 1] * y - lines[line, 2]
            at = -before / (after - before) if before < after else done
            if at < best:
                best, through = at, line
    return max(best, done), through


@njit(cache=True, error_model="numpy")
def _walk_on(
    line: Any,
    first_line: Any,
    first_gate: Any,
    gate: Any,
    gate_to: Any,
    piece: int,
    through: int,
    done: Any,
    x: Any,
    y: Any,
    xe: Any,
    ye: Any,
) -> Any:
    """From the first line that is passed to the piece where the way ends, or to a wall."""
    for _ in range(MAX_CROSSINGS):
        cx, cy = x + done * (xe - x), y + done * (ye - y)
        at = -line[through, 1] * cx + line[through, 0] * cy
        found, high = first_gate[through], first_gate[through + 1]
        if high - found > 8:  # the last gate that begins before `at`
            low = found
            while high - low > 1:
                middle = (low + high) // 2
                if gate[middle, 0] <= at:
                    low = middle
                else:
                    high = middle
            found, high = low, low + 1
        while found < high and gate[found, 1] < at:
            found += 1
        if found == high or gate[found, 0] > at:
            return piece, False
        piece, entered = gate_to[found, 0], gate_to[found, 1]
        done, through = _exit(line, first_line[piece], first_line[piece + 1], entered, x, y, xe, ye, done)
        if through < 0:
            return piece, True
    return piece, False


@njit(cache=True, error_model="numpy")
def exp_minus(a: float) -> float:
    """exp(-a) for 0 <= a <= `FLATTEST`, the same on every machine: power series of a / 1024, squared ten times."""
    q = -a / 1024.0
    result = 1.0 + q * (1.0 + q / 2 * (1.0 + q / 3 * (1.0 + q / 4 * (1.0 + q / 5 * (1.0 + q / 6)))))
    for _ in range(10):
        result *= result
    return result


@njit(cache=True, error_model="numpy")
def _height_weight(difference_m: float, sigma_m: float) -> Any:
    """exp(-d^2 / (2 sigma^2)), eq. (16) without its constant factor."""
    return np.float32(exp_minus(min(difference_m * difference_m / (2 * sigma_m * sigma_m), FLATTEST)))


@njit(cache=True, error_model="numpy")
def _walk_run(
    line: Any,
    first_line: Any,
    first_gate: Any,
    gate: Any,
    gate_to: Any,
    box: Any,
    height: Any,
    piece: int,
    rise: float,
    sigma: float,
    x: Any,
    y: Any,
    xe: Any,
    ye: Any,
    pieces: Any,
    weight: Any,
    lx: Any,
    ly: Any,
    lxe: Any,
    lye: Any,
    at: Any,
    through: Any,
    which: Any,
) -> None:
    """Walks and weighs particles that all start in one piece; (x, y) to (xe, ye)."""
    same = _height_weight(rise, sigma)
    x0, y0, x1, y1 = box[piece, 0], box[piece, 1], box[piece, 2], box[piece, 3]
    count = 0
    for i in range(len(x)):
        weight[i] = same
    for i in range(len(x)):
        which[count] = i
        is_outside = (xe[i] < x0) | (xe[i] > x1) | (ye[i] < y0) | (ye[i] > y1)
        count += 1 if is_outside else 0
    for k in range(count):
        i = which[k]
        lx[k], ly[k], lxe[k], lye[k] = x[i], y[i], xe[i], ye[i]
        at[k], through[k] = _TWO, -1
    for number in range(first_line[piece], first_line[piece + 1]):
        n_x, n_y, c = line[number, 0], line[number, 1], line[number, 2]
        this = np.int32(number)
        for k in range(count):
            after = n_x * lxe[k] + n_y * lye[k] - c
            before = n_x * lx[k] + n_y * ly[k] - c
            passed = -before / (after - before) if before < after else _ZERO
            passed = passed if after > _ZERO else _TWO
            is_first = passed < at[k]
            at[k] = passed if is_first else at[k]
            through[k] = this if is_first else through[k]
    for k in range(count):
        if through[k] >= 0:
            i = which[k]
            if first_gate[through[k]] == first_gate[through[k] + 1]:
                weight[i] = _ZERO
                continue
            done = max(at[k], _ZERO)
            end, alive = _walk_on(
                line, first_line, first_gate, gate, gate_to, piece, through[k], done, lx[k], ly[k], lxe[k], lye[k]
            )
            pieces[i] = end
            if not alive:
                weight[i] = _ZERO
            elif height[end] != height[piece]:
                weight[i] = _height_weight(rise - (float(height[end]) - float(height[piece])), sigma)


# Generations.


@njit(cache=True, error_model="numpy")
def new_scratch() -> Any:
    f = np.empty((12, TILE), np.float32)
    return Scratch(f, f[2].view(np.int32), np.empty((4, TILE), np.uint32), np.empty((3, TILE), np.int32))


@njit(cache=True, error_model="numpy")
def _move_tile(motion: Any, first: int, keys: Any, x: Any, y: Any, xe: Any, ye: Any, turns: Any, scratch: Any) -> None:
    """Perturbs the stride, turns, and moves (x, y) to (xe, ye): eq. (7) to (11).

    Particle `first` + i draws from counters of its own.
    """
    f, bits, words, _ = scratch
    count = len(x)
    half = (count + 1) // 2
    w0, w1, w2, w3 = words[0, :half], words[1, :half], words[2, :half], words[3, :half]
    _philox(first, keys[2], _MOTION, keys[0], keys[1], w0, w1, w2, w3)
    z_turn, z_length, unit = f[0], f[1], f[2, :half]
    _box_muller(w0, w1, unit, bits[:half], z_turn[:half], z_length[:half])
    _box_muller(w2, w3, unit, bits[:half], z_turn[half : 2 * half], z_length[half : 2 * half])
    length, length_sigma, least = motion.length, motion.length_sigma, motion.least_length
    turn, turn_sigma = motion.turn, motion.turn_sigma
    for i in range(count):
        t = _wrap_turns(turns[i] + (turn + turn_sigma * z_turn[i]))
        step = max(length + length_sigma * z_length[i], least)
        turns[i] = t
        xe[i] = x[i] + step * _cos_turns(t)
        ye[i] = y[i] + step * _cos_turns(_wrap_turns(t - _QUARTER))


@njit(cache=True, error_model="numpy")
def _walk_tile(
    world: Any, rise: float, sigma: float, x: Any, y: Any, xe: Any, ye: Any, pieces: Any, weight: Any, scratch: Any
) -> None:
    """Walks and weighs up to `TILE` particles from (x, y) to (xe, ye), run by run of the same piece."""
    # Taken apart here: an array taken out of a tuple counts its owners, which two threads would fight over.
    line, first_line, first_gate, gate, gate_to, box, height, _ = world
    f, _, _, index = scratch
    lx, ly, lxe, lye, at, through, which = f[5], f[6], f[7], f[8], f[9], index[0], index[1]
    i = 0
    while i < len(x):
        piece = pieces[i]
        j = i + 1
        while j < len(x) and pieces[j] == piece:
            j += 1
        _walk_run(
            line, first_line, first_gate, gate, gate_to, box, height, piece, rise, sigma,
            x[i:j], y[i:j], xe[i:j], ye[i:j], pieces[i:j], weight[i:j], lx, ly, lxe, lye, at, through, which,
        )  # fmt: skip
        i = j


@njit(cache=True, error_model="numpy")
def _advance_tile(
    world: Any, motion: Any, first: int, keys: Any, x: Any, y: Any, turns: Any, pieces: Any, weight: Any, scratch: Any
) -> None:
    """Propagates and corrects up to `TILE` particles in place; eq. (7) to (16)."""
    from_x, from_y = scratch.f[3, : len(x)], scratch.f[4, : len(x)]
    for i in range(len(x)):
        from_x[i], from_y[i] = x[i], y[i]
    _move_tile(motion, first, keys, from_x, from_y, x, y, turns, scratch)
    _walk_tile(world, motion.rise, motion.rise_sigma, from_x, from_y, x, y, pieces, weight, scratch)


@njit(cache=True, error_model="numpy")
def _breed_tile(
    world: Any, motion: Any, first: int, keys: Any, old_x: Any, old_y: Any, old_turns: Any, old_pieces: Any, x: Any,
    y: Any, turns: Any, pieces: Any, weight: Any, scratch: Any,
) -> None:  # fmt: skip
    """The same for offspring whose `pieces` say, on entry, which old particle each descends from."""
    from_x, from_y = scratch.f[3, : len(x)], scratch.f[4, : len(x)]
    for i in range(len(x)):
        ancestor = pieces[i]
        from_x[i], from_y[i], turns[i] = old_x[ancestor], old_y[ancestor], old_turns[ancestor]
        pieces[i] = old_pieces[ancestor]
    _move_tile(motion, first, keys, from_x, from_y, x, y, turns, scratch)
    _walk_tile(world, motion.rise, motion.rise_sigma, from_x, from_y, x, y, pieces, weight, scratch)


@njit(cache=True, error_model="numpy", parallel=True)
def walk(world: Any, x: Any, y: Any, xe: Any, ye: Any, pieces: Any, weight: Any) -> None:
    """Walks segments (N,): sets `pieces` to where they end and `weight` to 1, or to 0 where they hit a wall."""
    for chunk in prange((len(x) + CHUNK - 1) // CHUNK):
        scratch = new_scratch()
        for a in range(chunk * CHUNK, min(chunk * CHUNK + CHUNK, len(x)), TILE):
            b = min(a + TILE, len(x))
            _walk_tile(world, 0.0, np.inf, x[a:b], y[a:b], xe[a:b], ye[a:b], pieces[a:b], weight[a:b], scratch)


@njit(cache=True, error_model="numpy")
def _bin_tile(
    grid: Any, bin_base: Any, live_only: bool, x: Any, y: Any, turns: Any, pieces: Any, weight: Any, place: Any
) -> None:
    """(count,) the bin of each particle; -1 where it does not count."""
    x0, y0, per_m, turn_bins, last_column, last_row, columns = grid
    zero, last_turn, bins_of_turn = np.int32(0), turn_bins - np.int32(1), np.float32(turn_bins)
    for i in range(len(x)):
        column = min(max(np.int32((x[i] - x0) * per_m), zero), last_column)
        row = min(max(np.int32((y[i] - y0) * per_m), zero), last_row)
        turn = min(max(np.int32((turns[i] + _HALF) * bins_of_turn), zero), last_turn)
        place[i] = (row * columns + column) * turn_bins + turn
    for i in range(len(x)):
        place[i] += bin_base[pieces[i]]
    if live_only:
        for i in range(len(x)):
            if weight[i] == _ZERO:
                place[i] = -1


@njit(cache=True, error_model="numpy")
def _advance_chunk(
    world: Any, motion: Any, keys: Any, grid: Any, live_only: bool, low: int, high: int, old: Any, old_pieces: Any,
    particles: Any, pieces: Any, marks: Any,
) -> None:  # fmt: skip
    scratch = new_scratch()
    bin_base = world.bin_base
    old_x, old_y, old_turns = old[0], old[1], old[2]
    for a in range(low, high, TILE):
        b = min(a + TILE, high)
        x, y, turns, weight = particles[0, a:b], particles[1, a:b], particles[2, a:b], particles[3, a:b]
        if len(old_pieces):
            _breed_tile(
                world, motion, a, keys, old_x, old_y, old_turns, old_pieces, x, y, turns, pieces[a:b], weight, scratch
            )
        else:
            _advance_tile(world, motion, a, keys, x, y, turns, pieces[a:b], weight, scratch)
        place = scratch.index[2, : b - a]
        _bin_tile(grid, bin_base, live_only, x, y, turns, pieces[a:b], weight, place)
        _mark(marks, place)


@njit(cache=True, error_model="numpy")
def _mark(marks: Any, place: Any) -> None:
    for i in range(len(place)):
        if place[i] >= 0:
            marks[place[i]] = 1


@njit(cache=True, error_model="numpy", parallel=True)
def advance(
    world: Any, motion: Any, keys: Any, grid: Any, live_only: bool, first: int, count: int, old: Any, old_pieces: Any,
    particles: Any, pieces: Any, marks: Any,
) -> None:  # fmt: skip
    """Propagates and corrects the particles `first` to `first` + `count`, and marks their bins.

    Args:
        world: `World`.
        motion: `Motion`.
        keys: (3,) uint64: two of the generator, number of the generation.
        grid: `Grid`.
        live_only: Dead particles mark no bin.
        first: First particle.
        count: Number of particles.
        old: (4, N) float32: x, y, turns, weight of those they descend from.
        old_pieces: (N,) int32; empty where the particles are moved in place.
        particles: (4, capacity) float32.
        pieces: (capacity,) int32; on entry the ancestor of each, in place its piece.
        marks: (threads, bins) uint8.
    """
    for chunk in prange((count + CHUNK - 1) // CHUNK):
        low = first + chunk * CHUNK
        high = min(low + CHUNK, first + count)
        own = marks[get_thread_id()]
        _advance_chunk(
            world, motion, keys, grid, live_only, low, high, old, old_pieces, particles, pieces, own
        )  # fmt: skip


@njit(cache=True, error_model="numpy")
def count_marks(marks: Any) -> int:
    """Bins that any thread has marked."""
    for thread in range(1, marks.shape[0]):
        for i in range(marks.shape[1]):
            marks[0, i] |= marks[thread, i]
    count = 0
    for i in range(marks.shape[1]):
        count += marks[0, i]
    return count


# Resampling: a comb of evenly spaced teeth over the running sum of the weights, in fixed chunks.


@njit(cache=True, error_model="numpy")
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


@njit(cache=True, error_model="numpy")
def _teeth(sums: Any, before: float, scale: float, offset: float, below: Any) -> None:
    """(count,) teeth below each running sum: those j with (j + offset) / scale < before + sum."""
    for i in range(len(sums)):
        below[i] = np.int32(np.ceil((before + sums[i]) * scale - offset))


@njit(cache=True, error_model="numpy")
def _first_tooth(before: float, scale: float, offset: float) -> Any:
    return np.int32(np.ceil(before * scale - offset))


@njit(cache=True, error_model="numpy", parallel=True)
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


@njit(cache=True, error_model="numpy", parallel=True)
def count_offspring(
    weight: Any, pieces: Any, count: int, before: Any, scale: float, offset: float, offspring: Any
) -> None:
    """(chunks, K) int32: how many teeth fall on the particles of each chunk in each piece; zeros on entry."""
    for chunk in prange((count + CHUNK - 1) // CHUNK):
        sums, below = np.empty(TILE, np.float64), np.empty(TILE, np.int32)
        own = offspring[chunk]
        total, taken = 0.0, _first_tooth(before[chunk], scale, offset)
        low, high = chunk * CHUNK, min(chunk * CHUNK + CHUNK, count)
        for a in range(low, high, TILE):
            b = min(a + TILE, high)
            total = _running_sum(weight[a:b], total, sums)
            _teeth(sums[: b - a], before[chunk], scale, offset, below)
            for i in range(a, b):
                if i + 1 == b or pieces[i + 1] != pieces[i]:
                    own[pieces[i]] += below[i - a] - taken
                    taken = below[i - a]


@njit(cache=True, error_model="numpy")
def place_offspring(offspring: Any, first: int) -> None:
    """Turns numbers of offspring into places of the first of each: by piece, then by chunk, from `first` on."""
    place = first
    for piece in range(offspring.shape[1]):
        for chunk in range(offspring.shape[0]):
            number = offspring[chunk, piece]
            offspring[chunk, piece] = place
            place += number


@njit(cache=True, error_model="numpy", parallel=True)
def choose_ancestors(
    weight: Any, pieces: Any, count: int, before: Any, scale: float, offset: float, place: Any, ancestor: Any
) -> None:
    """Writes every particle's number as often as teeth fall on it, from the place of its chunk and piece on."""
    for chunk in prange((count + CHUNK - 1) // CHUNK):
        low, high = chunk * CHUNK, min(chunk * CHUNK + CHUNK, count)
        _choose_in_chunk(weight, pieces, low, high, before[chunk], scale, offset, place[chunk], ancestor)


@njit(cache=True, error_model="numpy")
def _choose_in_chunk(
    weight: Any, pieces: Any, low: int, high: int, before: float, scale: float, offset: float, place: Any, ancestor: Any
) -> None:
    chosen = np.empty(2 * TILE + 2, np.int32)
    sums, below = np.empty(TILE, np.float64), np.empty(TILE, np.int32)
    total, taken = 0.0, _first_tooth(before, scale, offset)
    for a in range(low, high, TILE):
        b = min(a + TILE, high)
        total = _running_sum(weight[a:b], total, sums)
        _teeth(sums[: b - a], before, scale, offset, below)
        picked = 0
        for i in range(a, b):
            number = below[i - a] - taken
            taken = below[i - a]
            chosen[picked], chosen[picked + 1] = i, i  # no branch where 0, 1 or 2 copies are wanted
            picked += min(number, 2)
            while number > 2:
                at = place[pieces[i]]
                place[pieces[i]] = at + 1
                ancestor[at] = i
                number -= 1
        for k in range(picked):
            piece = pieces[chosen[k]]
            at = place[piece]
            place[piece] = at + 1
            ancestor[at] = chosen[k]


# The prior.


@njit(cache=True, error_model="numpy", parallel=True)
def draw_prior(
    region: Any,
    heading: Any,
    offset: float,
    keys: Any,
    grid: Any,
    bin_base: Any,
    first: int,
    count: int,
    particles: Any,
    pieces: Any,
    marks: Any,
) -> None:
    """Particles evenly over triangles, by a comb over their area, at random inside each; sorted by piece.

    Args:
        region: corners (T, 3, 2) float32, piece (T,) int32 ascending, running sum of areas (T,) float64.
        heading: (2,) float32: least, width, in turns.
        offset: Of the comb.
        keys: (3,) uint64.
        grid: `Grid`.
        bin_base: (K,) int32.
        first: First particle.
        count: Number of particles.
        particles: (4, capacity) float32.
        pieces: (capacity,) int32.
        marks: (threads, bins) uint8.
    """
    for chunk in prange((count + CHUNK - 1) // CHUNK):
        low = chunk * CHUNK
        high = min(low + CHUNK, count)
        own = marks[get_thread_id()]
        _prior_chunk(region, heading, offset, keys, grid, bin_base, first, low, high, count, particles, pieces, own)


@njit(cache=True, error_model="numpy")
def _prior_chunk(
    region: Any,
    heading: Any,
    offset: float,
    keys: Any,
    grid: Any,
    bin_base: Any,
    first: int,
    low: int,
    high: int,
    count: int,
    particles: Any,
    pieces: Any,
    marks: Any,
) -> None:
    corners, owner, area = region
    words = np.empty((4, TILE), np.uint32)
    place = np.empty(TILE, np.int32)
    tooth = area[-1] / count
    triangle = np.searchsorted(area, (low + offset) * tooth)
    for a in range(low, high, TILE):
        b = min(a + TILE, high)
        number = b - a
        _philox(
            np.uint64(first + a),
            keys[2],
            _PRIOR,
            keys[0],
            keys[1],
            words[0, :number],
            words[1, :number],
            words[2, :number],
            words[3, :number],
        )
        x, y = particles[0, first + a : first + b], particles[1, first + a : first + b]
        turns, weight = particles[2, first + a : first + b], particles[3, first + a : first + b]
        piece = pieces[first + a : first + b]
        for i in range(number):
            while triangle < len(area) - 1 and area[triangle] < (a + i + offset) * tooth:
                triangle += 1
            u, v = _unit(words[0, i]), _unit(words[1, i])
            if u + v > _ONE:
                u, v = _ONE - u, _ONE - v
            x0, y0 = corners[triangle, 0, 0], corners[triangle, 0, 1]
            x[i] = x0 + u * (corners[triangle, 1, 0] - x0) + v * (corners[triangle, 2, 0] - x0)
            y[i] = y0 + u * (corners[triangle, 1, 1] - y0) + v * (corners[triangle, 2, 1] - y0)
            turns[i] = _wrap_turns(heading[0] + heading[1] * _unit(words[2, i]))
            weight[i] = _ONE
            piece[i] = owner[triangle]
        _bin_tile(grid, bin_base, False, x, y, turns, piece, weight, place[:number])
        _mark(marks, place[:number])


# A whole generation of few particles, in one call.


@njit(cache=True, error_model="numpy")
def expected_need(num_bins: float, count: int, total: float, squares: float, epsilon: float, z: float) -> int:
    """Particles that a generation is likely to need.

    Bins of the old generation empty as weights concentrate; the share of effective particles, (sum w)^2 / sum w^2 over
    their number, tells by how much.
    """
    expected = num_bins * (total * total / squares) / count
    return int(_kld_bound(max(2, int(expected)), epsilon, z))


@njit(cache=True, error_model="numpy")
def step_few(
    world: Any, motion: Any, keys: Any, grid: Any, live_only: bool, bound: Any, old: Any, old_pieces: Any, count: int,
    new: Any, new_pieces: Any, stamps: Any, stamp: int, scratch: Any,
) -> Any:  # fmt: skip
    """Resamples, propagates and corrects in batches until there are enough particles for their bins.

    Args:
        world, motion, keys, grid, live_only: As in `advance`.
        bound: (5,) float64: epsilon, z, least and most particles, bins of `old`.
        old: (4, N) float32: x, y, turns, weight.
        old_pieces: (N,) int32.
        count: Particles of `old`.
        new: (4, capacity) float32, filled.
        new_pieces: (capacity,) int32, filled.
        stamps: (bins,) int32; a bin is occupied where it holds `stamp`.
        stamp: Different in every generation.
        scratch: `Scratch`.

    Returns:
        Particles, bins, and the bound for that many bins; more particles than the capacity means that there was no
        room, no particles that all weights were zero.
    """
    bin_base = world.bin_base
    old_x, old_y, old_turns = old[0], old[1], old[2]
    epsilon, z, least, most = bound[0], bound[1], int(bound[2]), int(bound[3])
    total, squares = 0.0, 0.0
    for i in range(count):
        value = np.float64(old[3, i])
        total += value
        squares += value * value
    if not total > 0.0:
        return 0, 0, 0
    expected = expected_need(bound[4], count, total, squares, epsilon, z)
    wanted = min(max(int(FIRST_SHARE * expected), least), most)
    filled, num_bins, batch, enough = 0, 0, 0, least
    while filled < wanted:
        if wanted > new.shape[1]:
            return wanted, num_bins, wanted
        number = wanted - filled
        offset = random_offset(int(keys[2]), batch, int(keys[0]), int(keys[1]))
        scale = number / total
        running, taken = 0.0, 0
        for i in range(count):
            running += np.float64(old[3, i])
            below = int(np.ceil(running * scale - offset))
            while taken < below:
                new_pieces[filled + taken] = i
                taken += 1
        for a in range(filled, wanted, TILE):
            b = min(a + TILE, wanted)
            x, y, turns, weight = new[0, a:b], new[1, a:b], new[2, a:b], new[3, a:b]
            _breed_tile(
                world, motion, a, keys, old_x, old_y, old_turns, old_pieces, x, y, turns, new_pieces[a:b], weight,
                scratch,
            )  # fmt: skip
            place = scratch.index[2, : b - a]
            _bin_tile(grid, bin_base, live_only, x, y, turns, new_pieces[a:b], weight, place)
            for i in range(b - a):
                if place[i] >= 0 and stamps[place[i]] != stamp:
                    stamps[place[i]] = stamp
                    num_bins += 1
        filled = wanted
        enough = min(max(_kld_bound(num_bins, epsilon, z), least), most)
        wanted = max(filled, enough)
        batch += 1
    return filled, num_bins, enough
