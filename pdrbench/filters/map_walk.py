"""Compiled map walk in float32: particles move along straight lines through the cells of a map, and walls stop them.

Every filter on a map walks here, on the `World` of a compiled building. Particles that start in the same cell are
walked together, so filters keep theirs in the order of their cells. No scratch array is allocated per particle.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pdrbench.building.convex import ConvexMap
from pdrbench.compiled import compiled, inner
from pdrbench.geometry import BoolArray, FloatArray

TILE: Final = 1024  # particles whose scratch arrays stay in the innermost cache
MAX_CROSSINGS: Final = 64  # claim W6: more cells than that in one stride are no walk
MAX_EXPONENT: Final = 80.0  # beyond 12.6 sigma the weight of a height falls no further: only walls give weight 0

ZERO, TWO = np.float32(0.0), np.float32(2.0)
MIN_RUN: Final = 16  # fewer particles of a cell in a row are not worth loops of their own
FREE, WALL = np.int32(-1), np.int32(-2)  # instead of the number of a line
START: Any = np.int64(0)  # of a count that is handed on: for a literal 0 Numba compiles what it is handed to once more


class Scratch(NamedTuple):
    """Arrays for one tile: f (12, TILE) float32; bits, its row 2 as int32; words (4, TILE) uint32; index (7, TILE)
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
    walk_sorted(convex.world, x, y, x_end, y_end, cells, weight)
    cell[order] = cells
    is_free = np.empty(len(order), dtype=np.bool_)
    is_free[order] = weight > 0
    return is_free


@compiled
def walk_sorted(world: Any, x: Any, y: Any, xe: Any, ye: Any, cells: Any, weight: Any) -> None:
    """Walks from (x, y) to (xe, ye), (N,) float32 each.

    Sets `cells` (N,) int32 to where the lines end and `weight` (N,) float32 to 1, or to 0 where they hit a wall. Fast
    where particles of the same cell follow one another.
    """
    scratch = new_scratch()
    for a in range(0, len(x), TILE):
        b = min(a + TILE, len(x))
        walk_tile(world, 0.0, np.inf, x[a:b], y[a:b], xe[a:b], ye[a:b], cells[a:b], weight[a:b], scratch)


@compiled
def new_scratch() -> Any:
    f = np.empty((12, TILE), np.float32)
    return Scratch(f, f[2].view(np.int32), np.empty((4, TILE), np.uint32), np.empty((7, TILE), np.int32))


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


@inner
def walk_tile(
    world: Any, rise: float, sigma: float, x: Any, y: Any, xe: Any, ye: Any, cells: Any, weight: Any, scratch: Any
) -> None:
    """Walks and weighs up to `TILE` particles from (x, y) to (xe, ye).

    A particle that hits no wall has the weight exp(-d^2 / (2 sigma^2)), where d is what the floor rises less than
    `rise` (eq. 14 to 16 of Woodman & Harle 2008 without the constant factor); others have weight 0.
    """
    # Arrays taken out of a tuple count their owners, so they are taken out once a tile. Loops vectorise only in
    # functions of their own. These have no branch that depends on a particle: wrong guesses cost more than the work.
    line, first_line, first_portal, portal, neighbour, box, height = world
    at, cx, cy, index = scratch.f[5], scratch.f[6], scratch.f[7], scratch.index
    through, which, met, behind = index[0], index[1], index[2], index[3]
    alone, passed, reached = index[4], index[5], index[6]
    same = _height_weight(rise, sigma)
    stop, count, few = START, START, START
    while stop < len(x):
        begin, cell, low = stop, cells[stop], count
        while stop < len(x) and cells[np.uint64(stop)] == cell:
            stop += 1
        if stop - begin < MIN_RUN:
            few = _leave_box(box[cell], begin, stop, xe, ye, alone, few)
            for i in range(begin, stop):
                reached[i], through[i], at[i] = cell, FREE, ZERO
            continue
        run, first, last = slice(begin, stop), first_line[cell], first_line[cell + 1]
        _first_crossed(line, first_portal, first, last, x[run], y[run], xe[run], ye[run], at[run], through[run])
        count = _keep(through[run], begin, count, which)
        if count > low:
            new = slice(low, count)
            _meet(which[new], x, y, xe, ye, at, through, cx[new], cy[new], met[new])
            _pass_portals(line, first_portal, portal, first, last, cx[new], cy[new], met[new], behind[new])
    _weigh(through[: len(x)], same, weight)
    others = _next_crossed(line, first_line, x, y, xe, ye, same, alone[:few], reached, at, through, weight)
    begin, count = count, count + others
    _copy(alone[:others], which[begin:count])
    total = 0
    for crossing in range(MAX_CROSSINGS):
        if count == 0:
            break
        rest = slice(begin, count)
        _meet(which[rest], x, y, xe, ye, at, through, cx[rest], cy[rest], met[rest])
        _pass_portal(line, first_portal, portal, cx[rest], cy[rest], met[rest], behind[rest])
        count = _enter(neighbour, behind[:count], which, reached, through)
        if crossing == 0:
            total = count
            for k in range(count):
                passed[k] = which[k]
        count = _next_crossed(line, first_line, x, y, xe, ye, same, which[:count], reached, at, through, weight)
        begin = 0
    for k in range(total):
        i = passed[k]
        climbed = float(height[reached[i]]) - float(height[cells[i]])
        cells[i] = reached[i]
        if climbed != 0.0 and weight[i] > ZERO:
            weight[i] = _height_weight(rise - climbed, sigma)


@inner
def _copy(number: Any, which: Any) -> None:
    for k in range(len(number)):  # an assignment of arrays takes Numba seconds to compile
        which[k] = number[k]


@inner
def _leave_box(box: Any, begin: int, stop: int, xe: Any, ye: Any, which: Any, count: int) -> Any:
    """Appends to the first `count` of `which` the particles that end outside a box in their cell."""
    at = np.uint64(count)
    x0, y0, x1, y1 = box[0], box[1], box[2], box[3]
    for i in range(begin, stop):
        which[at] = np.int32(i)
        at += np.uint64((xe[i] < x0) | (xe[i] > x1) | (ye[i] < y0) | (ye[i] > y1))
    return np.int64(at)


@inner
def _sooner(line: Any, this: Any, x: Any, y: Any, xe: Any, ye: Any, least: Any, best: Any, number: Any) -> Any:
    """`best` and `number`, or where a line is passed outwards sooner, the fraction of the way there and `this`."""
    after = line[0] * xe + line[1] * ye - line[2]
    before = line[0] * x + line[1] * y - line[2]
    fraction = -before / (after - before)
    fraction = fraction if before < after else least
    fraction = fraction if after > ZERO else TWO
    return (fraction if fraction < best else best), (this if fraction < best else number)


@inner
def _first_crossed(
    line: Any, first_portal: Any, low: int, high: int, x: Any, y: Any, xe: Any, ye: Any, at: Any, through: Any
) -> None:
    """Per particle the fraction of the way to the first of the lines `low` to `high`, and which one: `FREE`, `WALL`, or
    the line where it has portals. Four lines at a time stay in registers: the last one again where fewer are left.
    """
    for k in range(len(x)):
        at[k], through[k] = TWO, FREE
    for a in range(low, high, 4):
        b, c, d = min(a + 1, high - 1), min(a + 2, high - 1), min(a + 3, high - 1)
        one, two = (line[a, 0], line[a, 1], line[a, 2]), (line[b, 0], line[b, 1], line[b, 2])
        three, four = (line[c, 0], line[c, 1], line[c, 2]), (line[d, 0], line[d, 1], line[d, 2])
        first, second = _with_portals(first_portal, a), _with_portals(first_portal, b)
        third, fourth = _with_portals(first_portal, c), _with_portals(first_portal, d)
        for k in range(len(x)):
            best, number = _sooner(one, first, x[k], y[k], xe[k], ye[k], ZERO, at[k], through[k])
            best, number = _sooner(two, second, x[k], y[k], xe[k], ye[k], ZERO, best, number)
            best, number = _sooner(three, third, x[k], y[k], xe[k], ye[k], ZERO, best, number)
            at[k], through[k] = _sooner(four, fourth, x[k], y[k], xe[k], ye[k], ZERO, best, number)


@inner
def _with_portals(first_portal: Any, line: int) -> Any:
    return np.int32(line) if first_portal[line] < first_portal[line + 1] else WALL


@inner
def _weigh(through: Any, same: Any, weight: Any) -> None:
    for i in range(len(through)):
        weight[i] = same if through[i] == FREE else ZERO


@inner
def _keep(number: Any, begin: int, count: int, which: Any) -> Any:
    """Appends `begin` + k to the first `count` of `which` wherever a number is not negative; how many there are now."""
    at = np.uint64(count)
    for k in range(len(number)):
        which[at] = np.int32(begin + k)
        at += np.uint64(number[k] >= 0)
    return np.int64(at)


@inner
def _meet(which: Any, x: Any, y: Any, xe: Any, ye: Any, at: Any, through: Any, cx: Any, cy: Any, met: Any) -> None:
    """Where each of some particles meets the line that it passes, and which one that is."""
    for k in range(len(which)):
        i = np.uint32(which[k])
        done = max(at[i], ZERO)
        at[i], met[k] = done, through[i]
        cx[k], cy[k] = x[i] + done * (xe[i] - x[i]), y[i] + done * (ye[i] - y[i])


@inner
def _pass_portals(
    line: Any, first_portal: Any, portal: Any, low: int, high: int, cx: Any, cy: Any, met: Any, behind: Any
) -> None:
    """Sets `behind` to the portal that each particle passes, all of the same cell; -1 where there is wall."""
    for k in range(len(met)):
        behind[k] = -1
    for number in range(low, high):
        n_x, n_y = line[number, 0], line[number, 1]
        for p in range(first_portal[number], first_portal[number + 1]):
            begin, end, this = portal[p, 0], portal[p, 1], np.int32(p)
            for k in range(len(met)):
                along = -n_y * cx[k] + n_x * cy[k]
                behind[k] = this if (met[k] == number) & (begin <= along) & (along <= end) else behind[k]


@inner
def _pass_portal(line: Any, first_portal: Any, portal: Any, cx: Any, cy: Any, met: Any, behind: Any) -> None:
    """The same for particles of different cells: the last portal that begins before the place, if it ends after it."""
    for k in range(len(behind)):
        number = np.uint32(met[k])
        along = -line[number, 1] * cx[k] + line[number, 0] * cy[k]
        low, high = first_portal[number], first_portal[number + np.uint32(1)]
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (middle, high) if portal[middle, 0] <= along else (low, middle)
        behind[k] = low if low < high and portal[low, 0] <= along <= portal[low, 1] else -1


@inner
def _enter(neighbour: Any, behind: Any, which: Any, reached: Any, through: Any) -> Any:
    """Takes particles through their portals: how many are left in `which`; `through` is the line that they came by."""
    count = np.uint64(0)
    for k in range(len(behind)):
        i, has_passed = np.uint32(which[k]), behind[k] >= 0
        portal = np.uint32(behind[k]) if has_passed else np.uint32(0)
        reached[i] = neighbour[portal, 0] if has_passed else reached[i]
        through[i] = neighbour[portal, 1] if has_passed else through[i]
        which[count] = np.int32(i)
        count += np.uint64(has_passed)
    return np.int64(count)


@inner
def _next_crossed(
    line: Any, first_line: Any, x: Any, y: Any, xe: Any, ye: Any, same: Any, which: Any, reached: Any, at: Any,
    through: Any, weight: Any,
) -> Any:  # fmt: skip
    """As `_first_crossed`, for particles in different cells, and weighs them; how many are left in `which`."""
    count = np.uint64(0)
    for k in range(len(which)):
        i = np.uint32(which[k])
        cell, entered, best, number = np.uint32(reached[i]), through[i], TWO, FREE
        for other in range(np.uint32(first_line[cell]), np.uint32(first_line[cell + np.uint32(1)])):
            this = line[other, 0], line[other, 1], line[other, 2]
            sooner, found = _sooner(this, np.int32(other), x[i], y[i], xe[i], ye[i], at[i], best, number)
            best, number = (sooner, found) if other != entered else (best, number)
        at[i], through[i] = max(best, at[i]), number
        weight[i] = same if number == FREE else ZERO
        which[count] = np.int32(i)
        count += np.uint64(number >= 0)
    return np.int64(count)


@compiled
def exp_minus(a: float) -> float:
    """exp(-a) for 0 <= a <= `MAX_EXPONENT`, the same on every machine: series of a / 1024, squared ten times."""
    q = -a / 1024.0
    result = 1.0 + q * (1.0 + q / 2 * (1.0 + q / 3 * (1.0 + q / 4 * (1.0 + q / 5 * (1.0 + q / 6)))))
    for _ in range(10):
        result *= result
    return result


@inner
def _height_weight(difference_m: float, sigma_m: float) -> Any:
    """exp(-d^2 / (2 sigma^2)), eq. (16) without its constant factor."""
    return np.float32(exp_minus(min(difference_m * difference_m / (2 * sigma_m * sigma_m), MAX_EXPONENT)))
