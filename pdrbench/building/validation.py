"""What can be wrong with a building as a whole; every message names polygon and edge."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Final

import numpy as np

from pdrbench.building.polygons import WALL, FloorPolygon, Zone, check_text, shapely_polygons
from pdrbench.errors import MapError
from pdrbench.geometry import FloatArray, IntArray

if TYPE_CHECKING:
    from pdrbench.building.building import Building

COINCIDENCE_M: Final = 1e-6  # connected edges come from one drawing: what differs more is another place
MIN_WIDTH_M: Final = 1e-3  # mean width, 2 area / perimeter: a person does not stand on a millimetre of floor


def check_pieces(name: str, polygons: tuple[FloorPolygon, ...], zones: tuple[Zone, ...]) -> None:
    """Raises `MapError` unless there are floor polygons and nothing else, and zones and nothing else."""
    check_text(name, "a building", "name", may_be_empty=True)
    if not polygons:
        raise MapError(f"building {name!r} has no floor polygon")
    for kind, pieces in ((FloorPolygon, polygons), (Zone, zones)):
        for i, piece in enumerate(pieces):
            if not isinstance(piece, kind):
                raise MapError(f"building {name!r}: expected a {kind.__name__} at {i}, got {type(piece).__name__}")


def check_building(building: Building) -> IntArray:
    """Raises `MapError` with the first defect found.

    Returns:
        (E,) the edge that leads back across every connection, -1 for a wall.
    """
    _check_ids(building)
    _check_simple(building)
    return _match_connections(building)


def _check_ids(building: Building) -> None:
    for what, ids in (("polygon", [p.id for p in building.polygons]), ("zone", [z.id for z in building.zones])):
        twice = [name for name, count in Counter(ids).items() if count > 1]
        if twice:
            raise MapError(f"building {building.name!r}: {what} id {twice[0]!r} stands {ids.count(twice[0])} times")


def _check_simple(building: Building) -> None:
    """Every polygon is simple and its holes lie inside, apart from one another."""
    import shapely

    geometries = shapely_polygons(building.polygons)
    wrong = np.flatnonzero(~shapely.is_valid(geometries))
    if not len(wrong):
        _check_thin(building, shapely.area(geometries), shapely.length(geometries))
        return
    polygon = building.polygons[int(wrong[0])]
    reason = shapely.is_valid_reason(geometries[wrong[0]])
    _, _, place = reason.partition("[")
    where = ""
    if place:
        xy_m = np.array(place.rstrip("]").split(), dtype=np.float64)
        own = building.edge_polygon == wrong[0]
        lines = shapely.linestrings(np.stack([building.edge_start_xy_m[own], building.edge_end_xy_m[own]], axis=1))
        where = f" at edge {int(np.argmin(shapely.distance(lines, shapely.Point(xy_m))))}"
    raise MapError(f"polygon {polygon.id!r} is not simple{where}: {reason}; redraw it without crossing itself")


def _check_thin(building: Building, area_m2: FloatArray, perimeter_m: FloatArray) -> None:
    width_m = 2 * area_m2 / perimeter_m
    thin = np.flatnonzero(width_m < MIN_WIDTH_M)
    if not len(thin):
        return
    own = building.edge_polygon == thin[0]
    length_m = np.hypot(*(building.edge_end_xy_m[own] - building.edge_start_xy_m[own]).T)
    raise MapError(
        f"polygon {building.polygons[thin[0]].id!r} is a sliver: {width_m[thin[0]]:.2g} m wide along edge "
        f"{length_m.argmax()} of {length_m.max():.3g} m; drop or merge it, and give metres, not degrees"
    )


def _match_connections(building: Building) -> IntArray:
    """Every connection leads to a polygon that leads back along the same edge: which edge that is."""
    neighbour, owner = building.edge_neighbour, building.edge_polygon
    bad = np.flatnonzero((neighbour < WALL) | (neighbour >= len(building.polygons)))
    if len(bad):
        raise MapError(
            f"{_edge(building, bad[0])} leads to polygon {neighbour[bad[0]]}, and there are {len(building.polygons)}"
        )
    bad = np.flatnonzero(neighbour == owner)
    if len(bad):
        raise MapError(f"{_edge(building, bad[0])} leads to its own polygon; make it a wall or leave it out")
    edges = np.flatnonzero(neighbour != WALL)
    twin = np.full(len(neighbour), -1)
    if len(edges):
        twin[edges] = _twins(building, edges)
    return twin


def _twins(building: Building, edges: IntArray) -> IntArray:
    start, end = building.edge_start_xy_m, building.edge_end_xy_m
    neighbour, owner = building.edge_neighbour, building.edge_polygon
    # A connection and its twin are the same point of (x, y, x', y', from, to); polygons are kept apart by a gap.
    gap = 1.0
    forward = np.column_stack([start[edges], end[edges], gap * owner[edges], gap * neighbour[edges]])
    backward = np.column_stack([end[edges], start[edges], gap * neighbour[edges], gap * owner[edges]])
    # Bit-equal twins, the rule, are found by sorting: a tree of a million edges on a grid takes minutes.
    order, backward_order = np.lexsort(forward.T), np.lexsort(backward.T)
    if (forward[order] == backward[backward_order]).all():
        twin = np.empty_like(edges)
        twin[order] = edges[backward_order]
        return twin
    from scipy.spatial import KDTree  # a quarter of a second to import, in the process of every walk

    distance, nearest = KDTree(backward).query(forward, p=np.inf, distance_upper_bound=COINCIDENCE_M)
    lonely = edges[~np.isfinite(distance)]
    if not len(lonely):
        return edges[nearest]
    edge = int(lonely[0])
    other = building.polygons[neighbour[edge]].id
    back = np.flatnonzero((owner == neighbour[edge]) & (neighbour == owner[edge]))
    if not len(back):
        raise MapError(f"{_edge(building, edge)} leads to {other!r}, but no edge of {other!r} leads back")
    gaps = np.hypot(*(start[back] - end[edge]).T) + np.hypot(*(end[back] - start[edge]).T)
    raise MapError(
        f"{_edge(building, edge)} leads to {other!r}, but the edge of {other!r} that leads back lies elsewhere "
        f"({gaps.min() / 2:.3g} m off); connected edges coincide within {COINCIDENCE_M:g} m, reversed"
    )


def _edge(building: Building, edge: int) -> str:
    """Names an edge by polygon and number within it."""
    polygon = int(building.edge_polygon[edge])
    return f"edge {edge - building.first_edge[polygon]} of polygon {building.polygons[polygon].id!r}"
