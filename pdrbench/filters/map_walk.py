"""Compiled map walk in float32: particles move along straight lines through the cells of a map, and walls stop them.

Every filter on a map walks here, on the `World` of a compiled building. Particles that start in the same cell are
walked together, so filters keep theirs in the order of their cells. No scratch array is allocated per particle.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numba
import numpy as np
from numba import prange
from numpy.typing import NDArray

from pdrbench.building.convex import ConvexMap
from pdrbench.compiled import compiled, compiled_parallel
from pdrbench.geometry import BoolArray, FloatArray

CHUNK: Final = 16_384  # particles that one thread takes at a time; fixed, so that results do not depend on threads
TILE: Final = 1024  # particles whose scratch arrays stay in the innermost cache
MAX_CROSSINGS: Final = 64  # claim W6: more cells than that in one stride are no walk
MAX_EXPONENT: Final = 80.0  # beyond 12.6 sigma the weight of a height falls no further: only walls give weight 0

ZERO, TWO = np.float32(0.0), np.float32(2.0)


class Scratch(NamedTuple):
    """Arrays for one tile: f (12, TILE) float32; bits, its row 2 as int32; words (4, TILE) uint32; index (3, TILE)
    int32.
    """

    f: Any
    bits: Any
    words: Any
    index: Any


def walk(convex: ConvexMap, from_xy_m: FloatArray, to_xy_m: FloatArray, cell: NDArray[np.int32]) -> BoolArray:
    """Walks along straight lines from (N, 2) to (N, 2), both local to the map.

    Args:
        convex: The map.
        from_xy_m: Where each particle is.
        to_xy_m: Where it would end.
        cell: (N,) of the start; becomes that of the end, or the last before the wall.

    Returns:
        (N,) whether no wall is between.
    """
    order = by_cell(cell, len(convex))
    x, y = np.ascontiguousarray(from_xy_m[order].T, dtype=np.float32)
    x_end, y_end = np.ascontiguousarray(to_xy_m[order].T, dtype=np.float32)
    cells, weight = cell[order], np.empty(len(order), dtype=np.float32)
    threads = numba.get_num_threads()
    numba.set_num_threads(1)  # some thousand particles take less time than waking another thread
    try:
        walk_sorted(convex.world, x, y, x_end, y_end, cells, weight)
    finally:
        numba.set_num_threads(threads)
    cell[order] = cells
    is_free = np.empty(len(order), dtype=np.bool_)
    is_free[order] = weight > 0
    return is_free


@compiled_parallel
def walk_sorted(world: Any, x: Any, y: Any, xe: Any, ye: Any, cells: Any, weight: Any) -> None:
    """Walks from (x, y) to (xe, ye), (N,) float32 each.

    Sets `cells` (N,) int32 to where the lines end and `weight` (N,) float32 to 1, or to 0 where they hit a wall. Fast
    where particles of the same cell follow one another.
    """
    for chunk in prange((len(x) + CHUNK - 1) // CHUNK):
        scratch = new_scratch()
        for a in range(chunk * CHUNK, min(chunk * CHUNK + CHUNK, len(x)), TILE):
            b = min(a + TILE, len(x))
            walk_tile(world, 0.0, np.inf, x[a:b], y[a:b], xe[a:b], ye[a:b], cells[a:b], weight[a:b], scratch)


@compiled
def new_scratch() -> Any:
    f = np.empty((12, TILE), np.float32)
    return Scratch(f, f[2].view(np.int32), np.empty((4, TILE), np.uint32), np.empty((3, TILE), np.int32))


@compiled
def by_cell(cell: Any, num_cells: int) -> Any:
    """(N,) indices that sort particles by cell and keep their order within one."""
    first = np.zeros(num_cells + 1, np.int64)
    for i in range(len(cell)):
        first[cell[i] + 1] += 1
    for k in range(num_cells):
        first[k + 1] += first[k]
    order = np.empty(len(cell), np.int64)
    for i in range(len(cell)):
        order[first[cell[i]]] = i
        first[cell[i]] += 1
    return order


@compiled
def walk_tile(
    world: Any, rise: float, sigma: float, x: Any, y: Any, xe: Any, ye: Any, cells: Any, weight: Any, scratch: Any
) -> None:
    """Walks and weighs up to `TILE` particles from (x, y) to (xe, ye).

    A particle that hits no wall has the weight exp(-d^2 / (2 sigma^2)), where d is what the floor rises less than
    `rise` (eq. 14 to 16 of Woodman & Harle 2008 without the constant factor); others have weight 0.
    """
    # Arrays taken out of a tuple count their owners, so they are taken out once a tile. The loop over lines vectorises
    # only in a function of its own.
    line, first_line, first_portal, portal, neighbour, box, height = world
    f, _, _, index = scratch
    lx, ly, lxe, lye, at, through, which = f[5], f[6], f[7], f[8], f[9], index[0], index[1]
    same = _height_weight(rise, sigma)
    stop = 0
    while stop < len(x):
        begin, cell = stop, cells[stop]
        while stop < len(x) and cells[stop] == cell:
            stop += 1
        px, py, pxe, pye = x[begin:stop], y[begin:stop], xe[begin:stop], ye[begin:stop]
        to, result = cells[begin:stop], weight[begin:stop]
        x0, y0, x1, y1 = box[cell, 0], box[cell, 1], box[cell, 2], box[cell, 3]
        count = 0
        for i in range(len(px)):
            result[i] = same
        for i in range(len(px)):
            which[count] = i
            is_outside = (pxe[i] < x0) | (pxe[i] > x1) | (pye[i] < y0) | (pye[i] > y1)
            count += 1 if is_outside else 0
        for k in range(count):
            i = which[k]
            lx[k], ly[k], lxe[k], lye[k] = px[i], py[i], pxe[i], pye[i]
            at[k], through[k] = TWO, -1
        _first_crossed(
            line, first_line[cell], first_line[cell + 1], lx[:count], ly[:count], lxe[:count], lye[:count], at, through
        )
        for k in range(count):
            if through[k] >= 0:
                i = which[k]
                if first_portal[through[k]] == first_portal[through[k] + 1]:
                    result[i] = ZERO
                    continue
                end, number, is_free = cell, through[k], False
                done, fx, fy, tx, ty = max(at[k], ZERO), lx[k], ly[k], lxe[k], lye[k]
                for _ in range(MAX_CROSSINGS):  # from line to line
                    cx, cy = fx + done * (tx - fx), fy + done * (ty - fy)
                    along = -line[number, 1] * cx + line[number, 0] * cy
                    found, high = first_portal[number], first_portal[number + 1]
                    if high - found > 8:  # the last portal that begins before `along`
                        low = found
                        while high - low > 1:
                            middle = (low + high) // 2
                            if portal[middle, 0] <= along:
                                low = middle
                            else:
                                high = middle
                        found, high = low, low + 1
                    while found < high and portal[found, 1] < along:
                        found += 1
                    if found == high or portal[found, 0] > along:
                        break
                    end, entered = neighbour[found, 0], neighbour[found, 1]
                    best, number = TWO, np.int32(-1)
                    for other in range(first_line[end], first_line[end + 1]):
                        after = line[other, 0] * tx + line[other, 1] * ty - line[other, 2]
                        if after > ZERO and other != entered:
                            before = line[other, 0] * fx + line[other, 1] * fy - line[other, 2]
                            left = -before / (after - before) if before < after else done
                            if left < best:
                                best, number = left, np.int32(other)
                    done = max(best, done)
                    if number < 0:
                        is_free = True
                        break
                to[i] = end
                if not is_free:
                    result[i] = ZERO
                elif height[end] != height[cell]:
                    result[i] = _height_weight(rise - (float(height[end]) - float(height[cell])), sigma)


@compiled
def _first_crossed(line: Any, low: int, high: int, lx: Any, ly: Any, lxe: Any, lye: Any, at: Any, through: Any) -> None:
    """Per particle the first of the lines `low` to `high` that it passes, and the fraction of the way there."""
    for number in range(low, high):
        n_x, n_y, c = line[number, 0], line[number, 1], line[number, 2]
        this = np.int32(number)
        for k in range(len(lx)):
            after = n_x * lxe[k] + n_y * lye[k] - c
            before = n_x * lx[k] + n_y * ly[k] - c
            passed = -before / (after - before) if before < after else ZERO
            passed = passed if after > ZERO else TWO
            is_first = passed < at[k]
            at[k] = passed if is_first else at[k]
            through[k] = this if is_first else through[k]


@compiled
def exp_minus(a: float) -> float:
    """exp(-a) for 0 <= a <= `MAX_EXPONENT`, the same on every machine: series of a / 1024, squared ten times."""
    q = -a / 1024.0
    result = 1.0 + q * (1.0 + q / 2 * (1.0 + q / 3 * (1.0 + q / 4 * (1.0 + q / 5 * (1.0 + q / 6)))))
    for _ in range(10):
        result *= result
    return result


@compiled
def _height_weight(difference_m: float, sigma_m: float) -> Any:
    """exp(-d^2 / (2 sigma^2)), eq. (16) without its constant factor."""
    return np.float32(exp_minus(min(difference_m * difference_m / (2 * sigma_m * sigma_m), MAX_EXPONENT)))
