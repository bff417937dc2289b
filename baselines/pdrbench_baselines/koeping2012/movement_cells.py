"""The floor of a building cut into cells by a square grid, and the ways between neighbouring cells.

A cell is what hangs together of the floor in one square of the grid: treads that follow one another are one cell, the
two sides of a wall are two, and so are flights that cross above one another. No floor falls out, however narrow.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from pdrbench.building import Building
from pdrbench.building.connectivity import labels_of
from pdrbench.building.polygons import shapely_polygons
from pdrbench.geometry import FloatArray, IntArray, read_only

REACH: Final = 2  # squares between neighbours, along each axis: ways have 16 directions and are up to 2.75 % too long
CLEAR_M: Final = 1e-3  # the point of a cell is that far off the edges of its polygon, where there is room
NUDGES_M: Final = ((0.0, 0.0), (0.002, 0.003), (-0.003, 0.002), (-0.002, -0.003), (0.003, -0.002))
MIN_AREA_M2: Final = 1e-6  # less floor than a square millimetre is rounding
TOUCH_M: Final = 1e-5  # connected edges are at most a tenth of that apart
MIN_PASSAGE_M: Final = 1e-3  # pieces that touch along less do not hang together


@dataclass(frozen=True, slots=True, eq=False)
class GridCells:
    """Cells and the ways between neighbours.

    Attributes:
        xy_m: (C, 2) the point of each: the middle of its square where that is floor, else a place on its floor.
        polygon: (C,) int, floor polygon of that point.
        area_m2: (C,) floor of each.
        pair: (E, 2) int, neighbours.
        way_m: (E,) between their points.
    """

    xy_m: FloatArray
    polygon: IntArray
    area_m2: FloatArray
    pair: IntArray
    way_m: FloatArray

    def __post_init__(self) -> None:
        for name in ("xy_m", "area_m2", "way_m"):
            object.__setattr__(self, name, read_only(getattr(self, name)))
        for name in ("polygon", "pair"):
            object.__setattr__(self, name, read_only(getattr(self, name), np.int64))

    def __len__(self) -> int:
        return len(self.polygon)


def cut_floor(building: Building, cell_m: float) -> GridCells:
    """Cells of a building; neighbours are those at most `REACH` squares away that `Building.move` reaches straight on.

    Where cells are wider than a corridor, a bend may hide neighbours from each other. Those are joined by a way over
    the middle of the line along which they touch, so that cells hang together exactly where the floor does.

    Args:
        building: Any; parts that nothing connects stay apart.
        cell_m: Edge of a square.
    """
    pieces = _cut(building, cell_m)
    gates = _gates(building, pieces)
    square = _number(pieces.square)
    inside = square[gates.pair[:, 0]] == square[gates.pair[:, 1]]
    cell = labels_of(len(pieces), gates.pair[inside])
    xy_m, polygon = _points(pieces, cell, cell_m)
    area_m2 = np.asarray(np.bincount(cell, weights=pieces.area_m2), dtype=np.float64)
    square_of_cell = np.empty((len(polygon), 2), dtype=np.int64)
    square_of_cell[cell] = pieces.square
    pair = _straight(building, xy_m, polygon, square_of_cell)
    way_m = np.hypot(*(xy_m[pair[:, 0]] - xy_m[pair[:, 1]]).T)
    hidden = _around_bends(pieces, gates, cell, pair)
    detour_m = sum(np.hypot(*(hidden.middle_m - xy_m[hidden.pair[:, end]]).T) for end in (0, 1))
    pair = np.concatenate([pair, hidden.pair])
    return GridCells(xy_m, polygon, area_m2, pair, np.concatenate([way_m, np.asarray(detour_m)]))


@dataclass(frozen=True, slots=True, eq=False)
class _Pieces:
    """Floor polygons cut along the grid: (N, 2) squares and their lower left corners, (N,) polygons, areas, shapes."""

    square: IntArray
    polygon: IntArray
    area_m2: FloatArray
    shape: Any
    corner_m: FloatArray

    def __len__(self) -> int:
        return len(self.polygon)


@dataclass(frozen=True, slots=True, eq=False)
class _Passages:
    """(K, 2) pairs of what touches, and the (K, 2) middle of the line along which it does."""

    pair: IntArray
    middle_m: FloatArray


def _cut(building: Building, cell_m: float) -> _Pieces:
    import shapely

    outlines = shapely_polygons(building.polygons)
    shapely.prepare(outlines)
    x0, y0, x1, y1 = building.bounds_m()
    x_m, y_m = (
        low + cell_m * np.arange(max(math.ceil((high - low) / cell_m - 1e-9), 1) + 1)
        for low, high in ((x0, x1), (y0, y1))
    )
    column, row = (axis.ravel() for axis in np.meshgrid(np.arange(len(x_m) - 1), np.arange(len(y_m) - 1)))
    squares = shapely.box(x_m[column], y_m[row], x_m[column + 1], y_m[row + 1])
    polygon, square = shapely.STRtree(squares).query(outlines, predicate="intersects")
    shape = squares[square]
    is_cut = ~shapely.contains_properly(outlines[polygon], shape)
    shape[is_cut] = shapely.intersection(outlines[polygon[is_cut]], shape[is_cut])
    shape, source = shapely.get_parts(shape, return_index=True)
    area_m2 = shapely.area(shape)
    kept = area_m2 > MIN_AREA_M2
    source = source[kept]
    grid = np.column_stack([column, row])[square[source]]
    corner_m = np.column_stack([x_m[grid[:, 0]], y_m[grid[:, 1]]])
    return _Pieces(grid, polygon[source].astype(np.int64), area_m2[kept], shape[kept], corner_m)


def _number(square: IntArray) -> IntArray:
    """(N,) one number for each (N, 2) square."""
    numbers: IntArray = square[:, 0] * (int(square[:, 1].max()) + 1) + square[:, 1]
    return numbers


def _gates(building: Building, pieces: _Pieces) -> _Passages:
    """Pieces of connected polygons that lie along the same part of the connection."""
    import shapely

    edge = np.flatnonzero(building.edge_twin > np.arange(len(building.edge_twin)))
    begin_m, end_m = building.edge_start_xy_m[edge], building.edge_end_xy_m[edge]
    lines = shapely.linestrings(np.stack([begin_m, end_m], axis=1))
    gate, piece = shapely.STRtree(pieces.shape).query(lines, predicate="dwithin", distance=TOUCH_M)
    side = np.where(pieces.polygon[piece] == building.edge_neighbour[edge][gate], 1, -1)
    side[pieces.polygon[piece] == building.edge_polygon[edge][gate]] = 0
    gate, piece, side = gate[side >= 0], piece[side >= 0], side[side >= 0]
    along = (end_m - begin_m) / np.hypot(*(end_m - begin_m).T)[:, None]
    near = shapely.intersection(lines[gate], shapely.buffer(pieces.shape[piece], TOUCH_M))
    xy_m, source = shapely.get_coordinates(near, return_index=True)
    at_m = ((xy_m - begin_m[gate[source]]) * along[gate[source]]).sum(axis=1)
    low_m, high_m = np.full(len(gate), np.inf), np.full(len(gate), -np.inf)
    np.minimum.at(low_m, source, at_m)
    np.maximum.at(high_m, source, at_m)
    left, right = np.flatnonzero(side == 0), np.flatnonzero(side == 1)
    right = right[np.argsort(gate[right], kind="stable")]
    facing, of_left = _matches(gate[right], gate[left])
    one, other = left[of_left], right[facing]
    low_m, high_m = np.maximum(low_m[one], low_m[other]), np.minimum(high_m[one], high_m[other])
    wide = high_m - low_m > MIN_PASSAGE_M
    one, other = one[wide], other[wide]
    middle_m = begin_m[gate[one]] + ((low_m + high_m)[wide] / 2)[:, None] * along[gate[one]]
    return _Passages(np.column_stack([piece[one], piece[other]]), middle_m)


def _matches(keys: IntArray, wanted: IntArray) -> tuple[IntArray, IntArray]:
    """Every row of sorted `keys` (N,) that equals each of `wanted` (M,): rows of `keys`, rows of `wanted`."""
    first = np.searchsorted(keys, wanted, side="left")
    count = np.searchsorted(keys, wanted, side="right") - first
    within = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    return np.repeat(first, count) + within, np.repeat(np.arange(len(wanted)), count)


def _points(pieces: _Pieces, cell: IntArray, cell_m: float) -> tuple[FloatArray, IntArray]:
    """The point of each cell and its polygon: nearest to the middle of the square of what is clear of edges."""
    import shapely

    count = int(cell.max()) + 1
    largest = np.argsort(pieces.area_m2, kind="stable")
    piece = np.empty(count, dtype=np.int64)
    piece[cell[largest]] = largest  # the last one written is the largest
    xy_m = shapely.get_coordinates(shapely.point_on_surface(pieces.shape[piece]))
    is_open = np.ones(count, dtype=np.bool_)
    for nudge_m in NUDGES_M:
        at_m = pieces.corner_m + cell_m / 2 + np.asarray(nudge_m)
        points = shapely.points(at_m)
        fits = is_open[cell] & shapely.contains_xy(pieces.shape, at_m)
        fits[fits] = shapely.distance(shapely.boundary(pieces.shape[fits]), points[fits]) >= CLEAR_M
        found = np.flatnonzero(fits)
        xy_m[cell[found]], piece[cell[found]], is_open[cell[found]] = at_m[found], found, False
    return xy_m, pieces.polygon[piece]


def _straight(building: Building, xy_m: FloatArray, polygon: IntArray, square: IntArray) -> IntArray:
    """(E, 2) pairs of cells in squares near each other that a straight walk joins."""
    tall = int(square[:, 1].max()) + 1
    numbers = _number(square)
    by_square = np.argsort(numbers, kind="stable")
    found = []
    for right, up in itertools.product(range(REACH + 1), range(-REACH, REACH + 1)):
        if right == 0 and up < 0:
            continue  # looked at from the other side
        beyond = square[:, 1] + up
        wanted = np.where((beyond >= 0) & (beyond < tall), numbers + right * tall + up, -1)
        row, one = _matches(numbers[by_square], wanted)
        other = by_square[row]
        if right == up == 0:
            one, other = one[one < other], other[one < other]
        reached, alive = building.move(polygon[one], xy_m[one], xy_m[other])
        found.append(np.column_stack([one, other])[alive & (reached == polygon[other])])
    return np.concatenate(found)


def _around_bends(pieces: _Pieces, gates: _Passages, cell: IntArray, pair: IntArray) -> _Passages:
    """Pairs of cells that touch although no straight ways lead from one to the other."""
    part = labels_of(int(cell.max()) + 1, pair)[cell]
    borders = _borders(pieces, part)
    touching = np.concatenate([gates.pair, borders.pair])
    middle_m = np.concatenate([gates.middle_m, borders.middle_m])
    hidden = part[touching[:, 0]] != part[touching[:, 1]]
    return _Passages(cell[touching[hidden]], middle_m[hidden])


def _borders(pieces: _Pieces, part: IntArray) -> _Passages:
    """Pieces of one polygon in squares side by side that touch along the line between, and lie in different parts."""
    import shapely

    columns, rows = pieces.square.max(axis=0) + 2
    keys = (pieces.polygon * columns + pieces.square[:, 0]) * rows + pieces.square[:, 1]
    order = np.argsort(keys, kind="stable")
    found = []
    for step in (1, rows):  # to the square above, to the one on the right
        row, one = _matches(keys[order], keys + step)
        found.append(np.column_stack([one, order[row]]))
    pair = np.concatenate(found)
    pair = pair[part[pair[:, 0]] != part[pair[:, 1]]]
    line = shapely.intersection(pieces.shape[pair[:, 0]], pieces.shape[pair[:, 1]])
    wide = shapely.length(line) > MIN_PASSAGE_M
    return _Passages(pair[wide], shapely.get_coordinates(shapely.point_on_surface(line[wide])).reshape(-1, 2))
