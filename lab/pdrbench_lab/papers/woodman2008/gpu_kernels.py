"""CUDA kernels of the particle filter: weights are summed, ancestors found, particles moved, walked, weighed, counted.

Every launch serves W walks: block (b, w) of a grid takes the b-th part of walk w, whose numbers are row w of `plan`. A
particle draws from the Philox counters that it has on a processor, and is computed from these alone; everything that
particles have in common is a sum or a maximum of whole numbers, or a maximum. So the bytes depend neither on the size
of a block nor on the order in which blocks run.

Scalar functions of the kernels for processors are compiled for the device as they stand.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any, Final, NamedTuple, TypeVar, cast

import numpy as np
from numba import cuda as cuda_of_numba

from pdrbench.filters.map_walk import MAX_CROSSINGS, MAX_EXPONENT, TILE, exp_minus
from pdrbench_baselines.woodman2008.random_numbers import (
    HALF,
    MOTION,
    OFFSET,
    ONE,
    PRIOR,
    QUARTER,
    TWO,
    ZERO,
    cos_turns,
    uniform,
)

cuda: Any = cuda_of_numba  # whose functions have types on the device only

F = TypeVar("F", bound=Callable[..., Any])
THREADS: Final = 256  # of a block
ITEMS: Final = 8  # particles whose weights one thread adds up

# Columns of `plan`, (W, COLUMNS) float64, in which whole numbers are exact.
(SIDE, TARGET, OLD_COUNT, FIRST, NUMBER, BATCH, SPACING, KEY_0, KEY_1, GENERATION) = range(10)
(LENGTH, LENGTH_SIGMA, TURN, TURN_SIGMA, MIN_LENGTH, RISE, RISE_SIGMA, SAME, COLUMNS) = range(10, 19)
FIRST_TURN, TURNS = LENGTH, LENGTH_SIGMA  # of a prior, which has no stride
# Columns of `result`, (W, RESULTS) int64.
NUM_BINS, LIVE, TOTAL, SQUARES, RESULTS = range(5)

WHOLE: Final = 2.0**32  # the largest weight as a whole number: of 2**31 particles the sum fits into 63 bits
SQUARE_SHIFT: Final = 14  # likewise the squares of 2**27 particles

_FACTOR_0, _FACTOR_1 = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)  # Philox4x32-10, as in random_numbers.py
_STEP_0, _STEP_1 = np.uint64(0x9E3779B9), np.uint64(0xBB67AE85)
_LOW, _32, _12 = np.uint64(0xFFFFFFFF), np.uint64(32), np.uint64(12)


class DeviceWorld(NamedTuple):
    """`World` in the memory of the device, and the first bin of each cell's height."""

    line: Any
    first_line: Any
    first_portal: Any
    portal: Any
    neighbour: Any
    box_m: Any
    height_m: Any
    first_bin: Any


class DeviceBins(NamedTuple):
    """`Bins` without the array; `live_only` as a number."""

    x: Any
    y: Any
    per_m: Any
    turn_bins: Any
    last_column: Any
    last_row: Any
    columns: Any
    live_only: Any


class Kernels(NamedTuple):
    """For one size of blocks; each is launched as `kernel[blocks, threads](...)`."""

    clear: Any
    sum_weights: Any
    accumulate: Any
    advance: Any
    draw_prior: Any
    thin: Any
    regrow: Any


def on_device(function: F) -> F:
    """Compiles a function that kernels call."""
    return cast(F, cuda.jit(device=True)(function))


def launched(function: F) -> F:
    """Compiles a kernel."""
    return cast(F, cuda.jit(function))


@on_device
def _philox(count: Any, stream: Any, key0: Any, key1: Any, generation: Any) -> Any:
    """Four words of one counter, each in a uint64: those that `philox` of the processor's kernels gives."""
    c0, c1, c2, c3 = count & _LOW, count >> _32, generation, stream
    for _ in range(10):
        p0, p1 = _FACTOR_0 * c0, _FACTOR_1 * c2
        c0, c1, c2, c3 = (p1 >> _32) ^ c1 ^ key0, p1 & _LOW, (p0 >> _32) ^ c3 ^ key1, p0 & _LOW
        key0, key1 = (key0 + _STEP_0) & _LOW, (key1 + _STEP_1) & _LOW
    return c0, c1, c2, c3


@on_device
def _unit(word: Any) -> Any:
    """A word as float32 in (0, 1)."""
    return uniform(np.uint32(word))


@on_device
def _wrapped(t: Any) -> Any:
    """Turns into [-1/2, 1/2)."""
    return t - np.float32(math.floor(t + HALF))


@on_device
def _whole(weight: Any, scale: Any) -> Any:
    """A weight in units of the largest one over `WHOLE`; only 0 becomes 0."""
    number = np.int64(np.float64(weight) * scale + 0.5)
    return max(number, np.int64(1)) if weight > ZERO else np.int64(0)


@on_device
def _scale(best: Any) -> Any:
    return WHOLE / np.float64(best) if best > ZERO else 0.0


@on_device
def _total(shared: Any, thread: int, threads: int) -> Any:
    """The sum of `shared` (threads,), which may be written again afterwards."""
    half = threads // 2
    while half > 0:
        cuda.syncthreads()
        if thread < half:
            shared[thread] += shared[thread + half]
        half //= 2
    cuda.syncthreads()
    total = shared[0]
    cuda.syncthreads()
    return total


@on_device
def _scan(shared: Any, thread: int, threads: int) -> None:
    """Turns `shared` (threads,) into its running sums."""
    step = 1
    while step < threads:
        cuda.syncthreads()
        before = shared[thread - step] if thread >= step else np.int64(0)
        cuda.syncthreads()
        shared[thread] += before
        step *= 2
    cuda.syncthreads()


@on_device
def _offset(plan: Any, walk: int) -> Any:
    """Of the systematic draw of this batch, uniform in (0, 1): `random_offset`."""
    key0, key1, generation = plan[walk, KEY_0], plan[walk, KEY_1], plan[walk, GENERATION]
    w0, w1, _, _ = _philox(
        np.uint64(plan[walk, BATCH]), OFFSET, np.uint64(key0), np.uint64(key1), np.uint64(generation)
    )
    return (np.float64(w0) * 2.0**20 + np.float64(w1 >> _12) + 0.5) * 2.0**-52


@on_device
def _ancestor(plan: Any, result: Any, cumulative: Any, walk: int, low: Any, high: Any, draw: Any, offset: Any) -> Any:
    """The first particle from `low` to `high` whose running sum is larger than the place of a draw in it."""
    target = np.int64((np.float64(draw) + offset) * plan[walk, SPACING])
    target = min(target, result[walk, TOTAL] - np.int64(1))
    while low < high:
        middle = (low + high) >> 1
        if cumulative[walk, middle] > target:
            high = middle
        else:
            low = middle + 1
    return low


@on_device
def _walk(world: Any, cell: Any, fx: Any, fy: Any, tx: Any, ty: Any) -> Any:
    """From (fx, fy) in a cell to (tx, ty): the cell reached, or the last before the wall, and whether no wall was hit.

    As `walk_tile` of the processor's kernels.
    """
    line, first_line, first_portal, portal, neighbour, box, _, _ = world
    if box[cell, 0] <= tx <= box[cell, 2] and box[cell, 1] <= ty <= box[cell, 3]:
        return cell, True
    done, entered = ZERO, np.int32(-1)
    for crossing in range(MAX_CROSSINGS + 1):
        best, number = TWO, np.int32(-1)
        for other in range(first_line[cell], first_line[cell + 1]):
            n_x, n_y, c = line[other, 0], line[other, 1], line[other, 2]
            after = n_x * tx + n_y * ty - c
            if after > ZERO and other != entered:
                before = n_x * fx + n_y * fy - c
                left = -before / (after - before) if before < after else done
                if left < best:
                    best, number = left, np.int32(other)
        if number < 0:
            return cell, True
        done = max(best, done)
        low, high = first_portal[number], first_portal[number + 1]
        if low == high or crossing == MAX_CROSSINGS:
            return cell, False
        cx, cy = fx + done * (tx - fx), fy + done * (ty - fy)
        along = -line[number, 1] * cx + line[number, 0] * cy
        while high - low > 1:  # the last portal that begins before `along`
            middle = (low + high) >> 1
            if portal[middle, 0] <= along:
                low = middle
            else:
                high = middle
        if portal[low, 0] > along or portal[low, 1] < along:
            return cell, False
        cell, entered = neighbour[low, 0], neighbour[low, 1]
    return cell, False


@on_device
def _weight(plan: Any, walk: int, rise_m: Any) -> Any:
    """exp(-d^2 / (2 sigma^2)), eq. (16) without its constant factor, where the floor rises so much."""
    if rise_m == 0.0:
        return np.float32(plan[walk, SAME])
    off, sigma = plan[walk, RISE] - rise_m, plan[walk, RISE_SIGMA]
    return np.float32(exp_minus(min(off * off / (2.0 * sigma * sigma), MAX_EXPONENT)))


@on_device
def _fills_bin(bins: Any, first_bin: Any, stamps: Any, walk: int, stamp: Any, x: Any, y: Any, turns: Any) -> Any:
    """True for the first particle of a generation in its bin, whichever that is."""
    zero = np.int32(0)
    column = min(max(np.int32((x - bins.x) * bins.per_m), zero), bins.last_column)
    row = min(max(np.int32((y - bins.y) * bins.per_m), zero), bins.last_row)
    turn = min(max(np.int32((turns + HALF) * np.float32(bins.turn_bins)), zero), bins.turn_bins - np.int32(1))
    place = first_bin + (row * bins.columns + column) * bins.turn_bins + turn
    return stamps[walk, place] != stamp and cuda.atomic.exch(stamps, (walk, place), stamp) != stamp


@functools.cache
def kernels(threads: int = THREADS) -> Kernels:
    """Kernels for blocks of so many threads, a power of two; compiled on their first launch."""
    chunk = threads * ITEMS

    @launched
    def clear(plan: Any, result: Any, best: Any) -> None:
        """Nothing is counted yet of the generation to come, of W walks."""
        walk = cuda.grid(1)
        if walk < plan.shape[0] and plan[walk, OLD_COUNT] >= 0.0:
            result[walk, NUM_BINS], result[walk, LIVE] = 0, 0
            best[np.int64(plan[walk, TARGET]), walk] = ZERO

    @launched
    def sum_weights(plan: Any, state: Any, best: Any, sums: Any) -> None:
        """Per chunk the sum of the weights and of their squares, (W, chunks, 2) int64."""
        own = cuda.shared.array(threads, np.int64)
        own_squares = cuda.shared.array(threads, np.int64)
        walk, thread, begin = cuda.blockIdx.y, cuda.threadIdx.x, cuda.blockIdx.x * chunk
        count, side = np.int64(plan[walk, OLD_COUNT]), np.int64(plan[walk, SIDE])
        if begin >= count:
            return
        scale, total, squares = _scale(best[side, walk]), np.int64(0), np.int64(0)
        for i in range(begin + thread, min(begin + chunk, count), threads):
            number = _whole(state[side, walk, 3, i], scale)
            total += number
            squares += (number >> SQUARE_SHIFT) * (number >> SQUARE_SHIFT)
        own[thread], own_squares[thread] = total, squares
        total, squares = _total(own, thread, threads), _total(own_squares, thread, threads)
        if thread == 0:
            sums[walk, cuda.blockIdx.x, 0], sums[walk, cuda.blockIdx.x, 1] = total, squares

    @launched
    def accumulate(plan: Any, state: Any, best: Any, sums: Any, result: Any, cumulative: Any) -> None:
        """(W, N) int64, all weights up to each particle. The last chunk writes the totals, and clears the counts."""
        own = cuda.shared.array(threads, np.int64)
        walk, thread, begin = cuda.blockIdx.y, cuda.threadIdx.x, cuda.blockIdx.x * chunk
        count, side = np.int64(plan[walk, OLD_COUNT]), np.int64(plan[walk, SIDE])
        if begin >= count:
            return
        before = np.int64(0)
        for k in range(thread, cuda.blockIdx.x, threads):
            before += sums[walk, k, 0]
        own[thread] = before
        before = _total(own, thread, threads)
        scale, total = _scale(best[side, walk]), np.int64(0)
        low, high = min(begin + thread * ITEMS, count), min(begin + thread * ITEMS + ITEMS, count)
        for i in range(low, high):
            total += _whole(state[side, walk, 3, i], scale)
        own[thread] = total
        _scan(own, thread, threads)
        running = before + own[thread] - total
        for i in range(low, high):
            running += _whole(state[side, walk, 3, i], scale)
            cumulative[walk, i] = running
        if begin + chunk < count:
            return
        if thread == threads - 1:
            result[walk, TOTAL] = running
        squares = np.int64(0)
        for k in range(thread, cuda.blockIdx.x + 1, threads):
            squares += sums[walk, k, 1]
        cuda.syncthreads()
        own[thread] = squares
        squares = _total(own, thread, threads)
        if thread == 0:
            result[walk, SQUARES], result[walk, NUM_BINS], result[walk, LIVE] = squares, 0, 0
            best[np.int64(plan[walk, TARGET]), walk] = ZERO

    @launched
    def advance(
        plan: Any, world: Any, bins: Any, state: Any, cells: Any, cumulative: Any, stamps: Any,
        result: Any, best: Any,
    ) -> None:  # fmt: skip
        """Draws, propagates, walks and weighs one particle a thread, and counts new bins; eq. (3) to (16).

        Where `TARGET` is `SIDE`, particles are moved where they are.
        """
        heaviest = cuda.shared.array(1, np.float32)
        ends = cuda.shared.array(2, np.int64)  # the ancestors of this block's first draw and of the next block's
        offsets = cuda.shared.array(1, np.float64)
        walk, thread, begin = cuda.blockIdx.y, cuda.threadIdx.x, cuda.blockIdx.x * threads
        number = np.int64(plan[walk, NUMBER])
        if begin >= number:
            return
        side, target = np.int64(plan[walk, SIDE]), np.int64(plan[walk, TARGET])
        if thread < 2:
            heaviest[0], offsets[0] = ZERO, _offset(plan, walk)
            if side != target:
                last, draw = np.int64(plan[walk, OLD_COUNT]) - 1, min(np.int64(begin + thread * threads), number - 1)
                ends[thread] = _ancestor(plan, result, cumulative, walk, np.int64(0), last, draw, offsets[0])
        cuda.syncthreads()
        draw, is_free, is_new = np.int64(begin + thread), False, False
        if draw < number:
            first = np.int64(plan[walk, FIRST])
            ancestor = first + draw
            if side != target:
                ancestor = _ancestor(plan, result, cumulative, walk, ends[0], ends[1], draw, offsets[0])
            fx, fy = state[side, walk, 0, ancestor], state[side, walk, 1, ancestor]
            turns, cell = state[side, walk, 2, ancestor], cells[side, walk, ancestor]
            # Two particles share a counter: one of the first half of a tile of the processor's, one of the second.
            tile = draw // TILE * TILE
            half = (min(np.int64(TILE), number - tile) + 1) // 2
            within = draw - tile
            is_second = within >= half
            counter = np.uint64(first + tile + (within - half if is_second else within))
            key0, key1 = np.uint64(plan[walk, KEY_0]), np.uint64(plan[walk, KEY_1])
            w0, w1, w2, w3 = _philox(counter, MOTION, key0, key1, np.uint64(plan[walk, GENERATION]))
            unit, angle = _unit(w2 if is_second else w0), _unit(w3 if is_second else w1) - HALF
            radius = np.float32(math.sqrt(-TWO * np.float32(math.log(unit))))
            turn_noise = np.float32(plan[walk, TURN_SIGMA]) * (radius * cos_turns(angle))
            length_noise = np.float32(plan[walk, LENGTH_SIGMA]) * (radius * cos_turns(_wrapped(angle - QUARTER)))
            turns = _wrapped(turns + (np.float32(plan[walk, TURN]) + turn_noise))
            step = max(np.float32(plan[walk, LENGTH]) + length_noise, np.float32(plan[walk, MIN_LENGTH]))
            tx = fx + step * cos_turns(turns)
            ty = fy + step * cos_turns(_wrapped(turns - QUARTER))
            end, is_free = _walk(world, cell, fx, fy, tx, ty)
            weight = ZERO
            if is_free:
                weight = _weight(plan, walk, np.float64(world.height_m[end]) - np.float64(world.height_m[cell]))
                if weight > heaviest[0]:
                    cuda.atomic.max(heaviest, 0, weight)
            at = first + draw
            state[target, walk, 0, at], state[target, walk, 1, at] = tx, ty
            state[target, walk, 2, at], state[target, walk, 3, at] = turns, weight
            cells[target, walk, at] = end
            if is_free or bins.live_only == 0:
                stamp = np.int32(plan[walk, GENERATION])
                is_new = _fills_bin(bins, world.first_bin[end], stamps, walk, stamp, tx, ty, turns)
        live = cuda.syncthreads_count(np.int32(is_free))
        new = cuda.syncthreads_count(np.int32(is_new))
        if thread == 0:
            cuda.atomic.add(result, (walk, LIVE), np.int64(live))
            cuda.atomic.add(result, (walk, NUM_BINS), np.int64(new))
            cuda.atomic.max(best, (target, walk), heaviest[0])

    @launched
    def draw_prior(
        plan: Any, corners: Any, owner: Any, area: Any, world: Any, bins: Any, state: Any, cells: Any, stamps: Any,
        result: Any, best: Any,
    ) -> None:  # fmt: skip
        """Particles evenly over triangles, systematically over their area, at random inside each."""
        offsets = cuda.shared.array(1, np.float64)
        walk, thread, begin = cuda.blockIdx.y, cuda.threadIdx.x, cuda.blockIdx.x * threads
        number, target = np.int64(plan[walk, NUMBER]), np.int64(plan[walk, TARGET])
        if begin >= number:
            return
        if thread == 0:
            offsets[0] = _offset(plan, walk)
        cuda.syncthreads()
        draw, first, is_new = np.int64(begin + thread), np.int64(plan[walk, FIRST]), False
        if draw < number:
            last = len(area) - 1
            wanted = (np.float64(draw) + offsets[0]) * plan[walk, SPACING]
            low, high = 0, last
            while low < high:
                middle = (low + high) >> 1
                if area[middle] < wanted:
                    low = middle + 1
                else:
                    high = middle
            key0, key1 = np.uint64(plan[walk, KEY_0]), np.uint64(plan[walk, KEY_1])
            w0, w1, w2, _ = _philox(np.uint64(first + draw), PRIOR, key0, key1, np.uint64(plan[walk, GENERATION]))
            u, v = _unit(w0), _unit(w1)
            if u + v > ONE:
                u, v = ONE - u, ONE - v
            x0, y0 = corners[low, 0, 0], corners[low, 0, 1]
            x = x0 + u * (corners[low, 1, 0] - x0) + v * (corners[low, 2, 0] - x0)
            y = y0 + u * (corners[low, 1, 1] - y0) + v * (corners[low, 2, 1] - y0)
            turns = _wrapped(np.float32(plan[walk, FIRST_TURN]) + np.float32(plan[walk, TURNS]) * _unit(w2))
            at, cell = first + draw, owner[low]
            state[target, walk, 0, at], state[target, walk, 1, at] = x, y
            state[target, walk, 2, at], state[target, walk, 3, at] = turns, ONE
            cells[target, walk, at] = cell
            stamp = np.int32(plan[walk, GENERATION])
            is_new = _fills_bin(bins, world.first_bin[cell], stamps, walk, stamp, x, y, turns)
        new = cuda.syncthreads_count(np.int32(is_new))
        if thread == 0:
            cuda.atomic.add(result, (walk, NUM_BINS), np.int64(new))
            cuda.atomic.add(result, (walk, LIVE), np.int64(min(np.int64(threads), number - begin)))
            cuda.atomic.max(best, (target, walk), ONE)

    @launched
    def thin(state: Any, cells: Any, side: int, walk: int, every: int, some: Any, some_cells: Any) -> None:
        """Copies every so many-th particle of a walk, into (4, n) and (n,)."""
        i = cuda.grid(1)
        if i < len(some_cells):
            for row in range(4):
                some[row, i] = state[side, walk, row, i * every]
            some_cells[i] = cells[side, walk, i * every]

    @launched
    def regrow(state: Any, cells: Any, cumulative: Any, larger: Any, larger_cells: Any, larger_sums: Any) -> None:
        """Copies all particles, and the running sums of their weights, into larger arrays."""
        i, walk = cuda.grid(1), cuda.blockIdx.y
        if i < state.shape[3]:
            larger_sums[walk, i] = cumulative[walk, i]
            for side in range(2):
                for row in range(4):
                    larger[side, walk, row, i] = state[side, walk, row, i]
                larger_cells[side, walk, i] = cells[side, walk, i]

    return Kernels(clear, sum_weights, accumulate, advance, draw_prior, thin, regrow)
