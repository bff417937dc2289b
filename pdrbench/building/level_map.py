"""A map to walk on, also where a plan is drawn so finely that it cannot be cut into convex cells."""

from __future__ import annotations

import functools
from typing import Final

import numpy as np

from pdrbench.building.building import Building
from pdrbench.building.convex import ConvexMap, compile_map
from pdrbench.building.polygons import WALL, FloorPolygon, shapely_polygons
from pdrbench.errors import MapError

TIDY_M: Final = 0.02  # by which walls get thicker, and straighter, in a plan that cannot be cut into convex cells
MIN_PART_M2: Final = 0.25  # smaller parts of a tidied floor are left out


@functools.lru_cache(maxsize=8)
def _whole(building: Building) -> ConvexMap | Exception:
    """The whole building, compiled, or why it cannot be: to try takes long, and each level asks."""
    import shapely

    try:
        return compile_map(building)
    except (MapError, ValueError, ZeroDivisionError, shapely.errors.GEOSException) as error:
        return error.with_traceback(None)  # which would keep all that was tried


@functools.lru_cache(maxsize=32)
def level_map(building: Building, level: int) -> ConvexMap:
    """The whole building, compiled; or one level of it, with walls 2 cm thicker, where it cannot be.

    Plans drawn from recorded outlines have rings that touch one another, and slivers, which no triangulation cuts into
    convex cells. Thicker walls close what touches and straighten the rest. Connections between polygons would be closed
    as well, so a plan with connections has to compile as it is.

    Raises:
        MapError: It has no such level, or a plan that does not compile has connections on that level.
    """
    whole = _whole(building)
    if isinstance(whole, ConvexMap):
        return whole
    own = [polygon for polygon in building.polygons if polygon.level == level]
    if not own:
        raise MapError(f"building {building.name!r} has no level {level}") from whole
    if any((polygon.neighbour != WALL).any() for polygon in own):
        raise MapError(f"level {level} of building {building.name!r} has no convex cells: {whole}") from whole
    return compile_map(_tidied(building.name, own))


def _tidied(name: str, polygons: list[FloorPolygon]) -> Building:
    """The same floor without its last centimetres."""
    import shapely

    kept = []
    for polygon, shape in zip(polygons, shapely_polygons(polygons), strict=True):
        inner = shape.buffer(-TIDY_M, join_style="mitre", mitre_limit=2.0).simplify(TIDY_M)
        parts = shapely.orient_polygons(shapely.get_parts(shapely.set_precision(inner, 1e-3)))
        for number, part in enumerate(part for part in parts if part.area >= MIN_PART_M2):
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
