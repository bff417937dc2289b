"""The floor divided into irregular cells, each of one room (Woodman & Harle 2008, offline phase; claim W13)."""

from __future__ import annotations

import functools
import itertools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import ArrayLike

from pdrbench.building import WALL, Building, FloorRegion
from pdrbench.building.connectivity import labels_of
from pdrbench.building.polygons import shapely_polygons, triangulated
from pdrbench.errors import MapError
from pdrbench.geometry import FloatArray, IntArray, read_only

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

MAX_EDGE_M: Final = 8.0  # the paper
DOORWAY_M2: Final = 1.5  # a smaller piece of floor is the sill of a door, not a room; ours
SLIVER_M2: Final = 1e-9  # what cutting leaves behind by rounding
NO_CELL: Final = -1

# Pieces of a room: each a floor polygon and what of its outline lies in the piece.
_Piece = list[tuple[int, "BaseGeometry"]]


@dataclass(frozen=True, slots=True, eq=False)
class Cells:
    """Cells that cover the floor, as triangles.

    Attributes:
        region: All floor.
        cell: (T,) int, the cell of each triangle of `region`, non-decreasing.
        level: (C,) int, the level of each cell.
    """

    region: FloorRegion
    cell: IntArray
    level: IntArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "cell", read_only(self.cell, np.int64))
        object.__setattr__(self, "level", read_only(self.level, np.int64))
        if self.cell.shape != (len(self.region),) or self.level.ndim != 1:
            raise MapError(f"cells: give one cell per triangle; got {self.cell.shape} for {len(self.region)}")
        if (np.diff(self.cell) < 0).any() or (np.unique(self.cell) != np.arange(len(self.level))).any():
            raise MapError("cells: triangles are sorted by cell, and each cell has one or more")

    @property
    def num_cells(self) -> int:
        """How many there are."""
        return len(self.level)

    def area_m2(self) -> FloatArray:
        """(C,) area of each cell."""
        area_m2: FloatArray = np.bincount(self.cell, weights=self.region.triangle_area_m2()).astype(np.float64)
        return area_m2

    def union(self, chosen: ArrayLike) -> FloorRegion:
        """The region of the cells that `chosen` (C,) marks."""
        mask = np.asarray(chosen)
        if mask.shape != (self.num_cells,) or mask.dtype != np.bool_:
            raise MapError(f"union: give {self.num_cells} booleans, one per cell; got {mask.dtype} {mask.shape}")
        return self.region.restricted(mask[self.cell])

    def locate(self, level: ArrayLike, xy_m: ArrayLike) -> IntArray:
        """The cell that each place lies in; on a shared boundary the lowest counts.

        Args:
            level: (N,) or one for all.
            xy_m: (N, 2).

        Returns:
            (N,) cell, or -1 where the level has no floor there.
        """
        points = np.asarray(xy_m, dtype=np.float64).reshape(-1, 2)
        wanted = np.broadcast_to(np.asarray(level), len(points))
        place, triangle = self.region.triangles_at(points)
        cell = self.cell[triangle]
        on_level = self.level[cell] == wanted[place]
        found = np.full(len(points), self.num_cells, dtype=np.int64)
        np.minimum.at(found, place[on_level], cell[on_level])
        found[found == self.num_cells] = NO_CELL
        return found


def divide(building: Building, max_edge_m: float = MAX_EDGE_M) -> Cells:
    """Divides the floor into cells, each of one room, none longer than `max_edge_m` in x or in y.

    A room is a floor polygon with the sills of its doors. The treads of a flight are one room, and so are rows of seats
    that rise from one to the next. What is too long is cut into equal slabs across its longer side, again and again,
    and falls apart where the room does.

    Args:
        building: Any; its cells are kept for the next call.
        max_edge_m: The paper says 8.
    """
    if not max_edge_m > 0 or not math.isfinite(max_edge_m):
        raise MapError(f"cells need a longest edge above 0 m; got {max_edge_m!r}")
    return _divide(building, float(max_edge_m))


@functools.lru_cache(maxsize=4)  # of 26 MB in a mall, and each replay of a recording has a building of its own
def _divide(building: Building, max_edge_m: float) -> Cells:
    outlines = shapely_polygons(building.polygons)
    room = _rooms(building)
    pieces: list[_Piece] = []
    for members in np.split(np.argsort(room, kind="stable"), np.cumsum(np.bincount(room))[:-1]):
        pieces += _cut([(int(polygon), outlines[polygon]) for polygon in members], max_edge_m)
    owner = np.array([polygon for piece in pieces for polygon, _ in piece])
    cell = np.repeat(np.arange(len(pieces)), [len(piece) for piece in pieces])
    corners, part = triangulated([shape for piece in pieces for _, shape in piece])
    level = building.level([piece[0][0] for piece in pieces])
    return Cells(FloorRegion(corners, owner[part]), cell[part], level)


def _rooms(building: Building) -> IntArray:
    """(P,) number of the room of each polygon."""
    joined = np.flatnonzero(building.edge_neighbour != WALL)
    one, other = building.edge_polygon[joined], building.edge_neighbour[joined]
    polygons = np.arange(len(building.polygons))
    level, height_m = building.level(polygons), building.height(polygons)
    kind = np.array([polygon.kind for polygon in building.polygons])
    area_m2 = np.array([polygon.area_m2 for polygon in building.polygons])
    is_floor, is_flight = kind == "floor", (kind == "stairs") | (kind == "ramp")
    same_level = level[one] == level[other]
    flight = is_flight[one] & (kind[one] == kind[other])
    rows = is_floor[one] & is_floor[other] & (height_m[one] != height_m[other])
    keep = same_level & (flight | rows)
    pairs = [np.column_stack([one[keep], other[keep]])]
    # A sill joins the largest floor that it leads to.
    sill = is_floor & (area_m2 < DOORWAY_M2)
    near = np.flatnonzero(sill[one] & is_floor[other] & same_level)
    near = near[np.lexsort([area_m2[other[near]], one[near]])]
    last = near[np.flatnonzero(np.diff(one[near], append=-1))]
    pairs.append(np.column_stack([one[last], other[last]]))
    return labels_of(len(level), np.concatenate(pairs))


def _cut(piece: _Piece, max_edge_m: float) -> list[_Piece]:
    """A piece of a room, cut until nothing is too long."""
    import shapely

    done: list[_Piece] = []
    waiting = _fall_apart(piece)
    while waiting:
        piece = waiting.pop()
        x0, y0, x1, y1 = shapely.total_bounds([shape for _, shape in piece])
        num_slabs = math.ceil(max(x1 - x0, y1 - y0) / max_edge_m - 1e-9)
        if num_slabs <= 1:
            done.append(piece)
            continue
        is_wide = x1 - x0 >= y1 - y0
        lines = np.linspace(x0, x1, num_slabs + 1) if is_wide else np.linspace(y0, y1, num_slabs + 1)
        for low, high in itertools.pairwise(lines):
            slab = shapely.box(low, y0, high, y1) if is_wide else shapely.box(x0, low, x1, high)
            shapes = shapely.intersection([shape for _, shape in piece], slab)
            waiting += _fall_apart([(p, shape) for (p, _), shape in zip(piece, shapes, strict=True)])
    return done


def _fall_apart(piece: _Piece) -> list[_Piece]:
    """The parts of a piece that hang together, without slivers."""
    import shapely

    owner = np.array([polygon for polygon, _ in piece])
    shapes, index = shapely.get_parts([shape for _, shape in piece], return_index=True)
    is_floor = shapely.area(shapes) > SLIVER_M2
    shapes, owner = shapes[is_floor], owner[index[is_floor]]
    wholes = shapely.get_parts(shapely.union_all(shapes)) if len(shapes) > 1 else shapes
    if len(wholes) < 2:
        return [list(zip(owner.tolist(), shapes, strict=True))] if len(shapes) else []
    shape, home = shapely.STRtree(wholes).query(shapely.point_on_surface(shapes), predicate="within")
    return [[(int(owner[i]), shapes[i]) for i in shape[home == whole]] for whole in range(len(wholes))]
