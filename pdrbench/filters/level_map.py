"""The floor as the compiled particle kernels walk it, also where a plan is too fine for them."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any, Final

import numba
import numpy as np
from numpy.typing import NDArray

from pdrbench.building import WALL, Building, FloorPolygon
from pdrbench.building.convex import ConvexMap, compile_map
from pdrbench.building.polygons import shapely_polygons
from pdrbench.errors import MapError
from pdrbench.filters import kernels, stride_kernels
from pdrbench.geometry import BoolArray, FloatArray, IntArray

TIDY_M: Final = 0.02  # by which walls get thicker, and straighter, in a plan that cannot be cut into convex pieces
SMALLEST_PART_M2: Final = 0.25  # nobody stands on less


@dataclass(frozen=True, slots=True)
class LevelMap:
    """Convex pieces of floor to walk on.

    Attributes:
        pieces: See `ConvexMap`.
        level: (K,) of each piece.
        world: The same for the kernels.
        num_levels: How many there are.
    """

    pieces: ConvexMap
    level: IntArray
    world: kernels.World
    num_levels: int

    def walk(self, from_m: FloatArray, to_m: FloatArray, piece: NDArray[np.int32]) -> BoolArray:
        """Straight ways (n, 2) to (n, 2), local to the pieces: (n,) whether no wall is between.

        Args:
            from_m: Where each begins.
            to_m: Where each would end.
            piece: (n,) on which each begins; becomes the one on which it ends.
        """
        order = stride_kernels.by_piece(piece, len(self.pieces))
        x, y = np.ascontiguousarray(from_m[order].T, dtype=np.float32)
        x_end, y_end = np.ascontiguousarray(to_m[order].T, dtype=np.float32)
        pieces, weight = piece[order], np.empty(len(order), dtype=np.float32)
        threads = numba.get_num_threads()
        numba.set_num_threads(1)  # some thousand particles take less time than waking another thread
        try:
            kernels.walk(self.world, x, y, x_end, y_end, pieces, weight)
        finally:
            numba.set_num_threads(threads)
        piece[order] = pieces
        alive = np.empty(len(order), dtype=np.bool_)
        alive[order] = weight > 0
        return alive

    def nearest(self, xy_m: FloatArray, level: int) -> tuple[FloatArray, int]:
        """The floor of a level nearest to a place (2,): (2,) that place or the nearest inside, and its piece.

        Raises:
            MapError: There is no floor on that level.
        """
        on_level = np.flatnonzero(self.level == level)
        if not len(on_level):
            raise MapError(f"no floor on level {level}; the map has {sorted(set(self.level.tolist()))}")
        local = self.pieces.local(np.tile(xy_m, (len(on_level), 1)))
        outside_m = self.pieces.outside_m(on_level, local)
        inside = np.flatnonzero(outside_m <= 0)
        if len(inside):
            return np.asarray(xy_m, dtype=np.float64), int(on_level[inside[0]])
        import shapely

        first = self.pieces.first_corner
        rings = [self.pieces.corner_xy_m[first[k] : first[k + 1]] for k in on_level]
        floor = np.array([shapely.Polygon(ring) for ring in rings])
        place = shapely.Point(*(xy_m - self.pieces.origin_xy_m))
        best = int(np.argmin(shapely.distance(floor, place)))
        edge = shapely.get_coordinates(shapely.shortest_line(floor[best], place))[0]
        middle = rings[best].mean(axis=0)
        away_m = max(float(np.hypot(*(middle - edge))), 1e-9)
        inward = edge + (middle - edge) * min(0.1 / away_m, 0.5)  # off the wall, which nothing can start on
        return inward + self.pieces.origin_xy_m, int(on_level[best])


@functools.lru_cache(maxsize=32)
def level_map(building: Building, level: int) -> LevelMap:
    """The whole building, compiled; or one level of it, walls 2 cm thicker, where it cannot be.

    Plans drawn from recorded outlines have rings that touch one another, and slivers; no convex pieces come of them.
    Thicker walls close what touches and straighten the rest. Connections between polygons would be closed as well, so
    a plan with connections has to compile as it is.
    """
    import shapely

    try:
        pieces = compile_map(building)
    except (MapError, ValueError, ZeroDivisionError, shapely.errors.GEOSException) as error:
        own = [polygon for polygon in building.polygons if polygon.level == level]
        if not own:
            raise MapError(f"building {building.name!r} has no level {level}") from error
        if any((polygon.neighbour != WALL).any() for polygon in own):
            raise MapError(f"level {level} of building {building.name!r} has no convex pieces: {error}") from error
        tidied = _tidied(building.name, own)
        pieces = compile_map(tidied)
        building = tidied
    bins: Any = np.zeros(len(pieces), dtype=np.int32)
    world = kernels.World(
        pieces.line, pieces.first_line, pieces.first_gate, pieces.gate, pieces.gate_to, pieces.box_m, pieces.height_m,
        bins,
    )  # fmt: skip
    level_of = building.level(pieces.polygon)
    return LevelMap(pieces, level_of, world, len(np.unique(level_of)))


def _tidied(name: str, polygons: list[FloorPolygon]) -> Building:
    """The same floor without its last centimetres."""
    import shapely

    kept = []
    for polygon, shape in zip(polygons, shapely_polygons(polygons), strict=True):
        inner = shape.buffer(-TIDY_M, join_style="mitre", mitre_limit=2.0).simplify(TIDY_M)
        parts = shapely.orient_polygons(shapely.get_parts(shapely.set_precision(inner, 1e-3)))
        for number, part in enumerate(part for part in parts if part.area >= SMALLEST_PART_M2):
            rings = [shapely.get_coordinates(ring)[:-1] for ring in (part.exterior, *part.interiors)]
            walls = np.full(sum(map(len, rings)), WALL)
            kept.append(
                FloorPolygon(
                    f"{polygon.id}.{number}", rings[0], walls, polygon.height_m, polygon.level, holes=tuple(rings[1:])
                )
            )
    if not kept:
        raise MapError(f"no floor is left of building {name!r}; its polygons are slivers")
    return Building(name, tuple(kept))
