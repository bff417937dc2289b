"""Geometry that is given to the builder: simple parts, valid polygons, ids that are unique."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable
from typing import Any, Final

import numpy as np
import shapely

from pdrbench.building.validation import MIN_WIDTH_M
from pdrbench.errors import MapError
from pdrbench.geometry import FloatArray
from pdrbench_formats.maps.assembly.drawing import RepairLog

GRID_M: Final = 1e-6  # finer than any drawing, coarser than what is left of a coordinate in degrees
SLIT_M: Final = 0.01  # narrower ones are no gap that anyone drew
MAX_CROSSED: Final = 100  # vertices of a line that crosses itself; more are thickened edge by edge
MAX_LOST_M2: Final = 1e-3  # smaller differences of an overlay are those of the grid


def simple_parts(geometry: Any, *, ring: bool = True) -> list[Any]:
    """Points, lines and polygons of a shapely geometry or of vertices (K, 2), in the plane.

    Args:
        geometry: Metres.
        ring: Whether three vertices or more are a polygon.

    Raises:
        MapError: Neither of both, or not finite.
    """
    is_made = isinstance(geometry, shapely.Geometry)
    try:
        points = shapely.get_coordinates(geometry) if is_made else np.asarray(geometry, dtype=np.float64)
    except (TypeError, ValueError):
        raise MapError(f"expected a shapely geometry or vertices (K, 2); got {type(geometry).__name__}") from None
    if not is_made and (points.ndim != 2 or points.shape[1] != 2 or not len(points)):
        raise MapError(f"expected a shapely geometry or vertices (K, 2); got shape {points.shape}")
    if not is_made and ring and len(points) < 3:
        raise MapError(f"an area needs three vertices; got {len(points)}")
    if not np.isfinite(points).all():
        raise MapError("a vertex is not finite; give metres")
    make = shapely.Polygon if ring else shapely.Point if len(points) == 1 else shapely.LineString
    geometry = geometry if is_made else make(points)
    return list(_flat([shapely.force_2d(geometry)]))


def _flat(parts: Any) -> Any:
    """Simple geometries of collections, also of those in one another."""
    while len(parts) and any(part.geom_type.startswith(("Multi", "Geometry")) for part in parts):
        parts = shapely.get_parts(parts)
    return parts


def valid_polygons(parts: Iterable[Any], where: str, level: int, repairs: RepairLog) -> list[Any]:
    """Valid polygons of simple parts; what is no polygon raises `MapError`, what is empty or thin is left out."""
    found = []
    for part in parts:
        if part.is_empty:
            repairs.add("empty", where, "an empty geometry was left out", level=level)
            continue
        if part.geom_type != "Polygon":
            raise MapError(f"{where}: expected a polygon, got a {part.geom_type}; close it to a ring")
        if not part.is_valid:
            reason = shapely.is_valid_reason(part)
            middle = shapely.get_coordinates(part).mean(axis=0)
            repairs.add("self-intersection", where, f"{reason}: mended", middle, level)
            part = shapely.make_valid(part, method="structure", keep_collapsed=False)
        for piece in shapely.get_parts(part):
            if piece.geom_type != "Polygon":
                continue
            if piece.is_empty or 2 * piece.area < 1e-3 * piece.length:
                place = shapely.get_coordinates(piece)[0] if not piece.is_empty else None
                repairs.add("sliver", where, f"{piece.area:.2g} m² of {piece.length:.2g} m left out", place, level)
                continue
            found.append(shapely.remove_repeated_points(piece, 1e-6))
    return found


def sound(shape: Any, *, slit_m: float = 0.0) -> Any:
    """A valid polygon of what we have made: on a grid, mended, slits closed, and of several parts the largest.

    Args:
        shape: shapely geometry, metres.
        slit_m: Slits and touching rings narrower than this are filled.

    Returns:
        A polygon, which is empty where nothing of an area is left.
    """
    mended = shapely.make_valid(shape, method="structure", keep_collapsed=False)
    if slit_m:
        mended = mended.buffer(slit_m, join_style="mitre").buffer(-slit_m, join_style="mitre")
    mended = shapely.set_precision(mended, GRID_M)
    return max(large_parts(mended, 0.0), key=shapely.area, default=shapely.Polygon())


def thickened(line: Any, by_m: float, cap: str) -> Any:
    """What lies within so much of a line; of a long one that crosses itself edge by edge: a buffer takes seconds."""
    if shapely.get_num_coordinates(line) > MAX_CROSSED and not line.is_simple:
        edges = [edge for part in shapely.get_parts(line) for edge in itertools.pairwise(shapely.get_coordinates(part))]
        return shapely.union_all(shapely.buffer(shapely.linestrings(edges), by_m, cap_style="square"))
    return shapely.buffer(line, by_m, cap_style=cap, join_style="mitre")


def is_sound(rings: Iterable[FloatArray]) -> bool:
    """Whether rings (K, 2), the outline first, are a floor polygon: simple, holes inside, wider than a millimetre."""
    outline, *holes = rings
    if len(outline) < 3 or not all(np.isfinite(ring).all() for ring in (outline, *holes)):
        return False
    polygon = shapely.Polygon(outline, holes)
    return bool(polygon.is_valid and 2 * polygon.area > MIN_WIDTH_M * polygon.length)


def common(one: Any, other: Any) -> Any:
    """What two geometries share, also where edges almost coincide."""
    return _overlay(shapely.intersection, one, other)


def without(one: Any, other: Any) -> Any:
    """The first geometry without the second, also where edges almost coincide."""
    return _overlay(shapely.difference, one, other)


def _overlay(operation: Callable[..., Any], one: Any, other: Any) -> Any:
    """An overlay; where edges 1e-10 m apart have spoilt it, as GEOS lets happen silently, the same on a fine grid."""
    # Lines and points that an overlay before this one left beside polygons: GEOS takes no mixture.
    one, other = (
        shapely.union_all(large_parts(shape, 0.0)) if shape.geom_type == "GeometryCollection" else shape
        for shape in (one, other)
    )
    snapped = operation(one, other, grid_size=GRID_M)
    try:
        exact = operation(one, other)
    except shapely.GEOSException:  # of edges that cross at one point only as far as numbers are exact
        return snapped
    return exact if abs(exact.area - snapped.area) < MAX_LOST_M2 else snapped


def large_parts(shape: Any, min_m2: float) -> list[Any]:
    """Polygons of a geometry that are larger than so much."""
    return [part for part in _flat(shapely.get_parts(shape)) if part.geom_type == "Polygon" and part.area > min_m2]


def eroded(shape: Any, by_m: float) -> Any:
    """What a disc of radius `by_m` inside of a geometry reaches with its middle.

    Every hole is grown by itself: thousands that run into one another take a buffer of the whole minutes. The outline
    shrinks a little first, which leaves nothing ragged: curves about all that is take twenty times as long.
    """
    found = []
    for part in large_parts(shape, 0.0):
        holes = shapely.buffer([shapely.Polygon(hole) for hole in part.interiors], by_m)
        outline = shapely.Polygon(part.exterior).buffer(-by_m / 6).buffer(-5 * by_m / 6)
        found.append(shapely.difference(outline, shapely.union_all(holes)))
    return shapely.union_all(found)


def touching_vertices(shape: Any) -> FloatArray:
    """(N, 2) vertices that occur twice: rings that touch cannot be cut into convex cells."""
    found = [np.zeros((0, 2))]
    for part in large_parts(shape, 0.0):
        rings = [shapely.get_coordinates(ring)[:-1] for ring in (part.exterior, *part.interiors)]
        points = np.concatenate(rings)
        points = points[np.lexsort(points.T)]
        twice = points[1:][(points[1:] == points[:-1]).all(axis=1)]
        found.append(np.unique(twice, axis=0) if len(twice) else twice)  # of all points it takes ten times as long
    return np.concatenate(found)


def unique_id(id: str, taken: set[str]) -> str:
    """The id, or with a number behind it where it is taken; taken from now on."""
    names = itertools.chain([id], (f"{id}#{number}" for number in itertools.count(2)))
    own = next(name for name in names if name not in taken)
    taken.add(own)
    return own
