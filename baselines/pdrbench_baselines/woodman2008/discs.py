"""The floor around a place, to start a filter on."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from pdrbench.building import Building, FloorRegion
from pdrbench.building.polygons import shapely_polygons, triangulated
from pdrbench.filters import FilterError
from pdrbench.geometry import IntArray
from pdrbench_baselines.woodman2008.clusters import near_polygons

if TYPE_CHECKING:
    from shapely import Polygon

_FACETS = 8  # of a quarter of the circle: the area of the disc is 0.6 % short


def floor_around(building: Building, xy_m: ArrayLike, level: int, radius_m: float) -> FloorRegion:
    """The floor of a level within `radius_m`, and of what adjoins it there, such as the first treads of a flight.

    Raises:
        FilterError: No floor polygon of that level comes that near.
    """
    import shapely

    disc = _disc(xy_m, radius_m)
    on_level = building.level(np.arange(len(building.polygons))) == level
    in_disc_m2 = shapely.area(shapely.intersection(shapely_polygons(building.polygons), disc))
    touched = np.flatnonzero(on_level & (in_disc_m2 > 0))
    if not len(touched):
        levels = ", ".join(map(str, building.levels))
        x_m, y_m = np.asarray(xy_m, dtype=np.float64).tolist()
        raise FilterError(
            f"no floor polygon of level {level} of building {building.name!r} lies within {radius_m:g} m of "
            f"({x_m:.2f}, {y_m:.2f}); check the frame of the start and its level (the building has {levels})"
        )
    first, near = near_polygons(building, radius_m)
    adjoining = np.concatenate([near[first[polygon] : first[polygon + 1]] for polygon in touched])
    return _within(building, np.unique(adjoining), disc)


def floor_from(building: Building, polygon: int, xy_m: ArrayLike, radius_m: float) -> FloorRegion:
    """The floor within `radius_m` of a place that is reached from its floor polygon by walking at most that far."""
    disc = _disc(xy_m, radius_m)
    first, near = near_polygons(building, radius_m)
    return _within(building, near[first[polygon] : first[polygon + 1]], disc)


def _disc(xy_m: ArrayLike, radius_m: float) -> Polygon:
    import shapely

    if not 0 < radius_m < np.inf:
        raise FilterError(f"a disc of floor has a radius above 0 m; got {radius_m!r}")
    return shapely.Point(np.asarray(xy_m, dtype=np.float64)).buffer(radius_m, quad_segs=_FACETS)


def _within(building: Building, polygons: IntArray, disc: Polygon) -> FloorRegion:
    """Triangles of what lies of some floor polygons in a disc."""
    import shapely

    pieces = shapely.intersection(shapely_polygons([building.polygons[polygon] for polygon in polygons]), disc)
    pieces, owner = shapely.get_parts(pieces, return_index=True)
    keep = shapely.area(pieces) > 0  # touching leaves points and lines
    pieces, owner = pieces[keep], owner[keep]
    corners, piece = triangulated(pieces)
    return FloorRegion(corners, polygons[owner[piece]])
