"""Which parts of a building one can walk to, and which lifts stand above one another."""

from __future__ import annotations

import numpy as np

from pdrbench.building.building import Building
from pdrbench.building.polygons import WALL, shapely_polygons
from pdrbench.geometry import IntArray

MIN_SHAFT_OVERLAP = 0.5  # of the smaller cabin


def lift_shafts(building: Building) -> tuple[tuple[int, ...], ...]:
    """Polygons of kind "lift" that stand above one another, by rising height: the stops of each lift.

    No edge joins the stops of a lift, since no pedestrian walks from one to the next:
    who enters the polygon on one level may leave it on another.
    """
    import shapely

    lifts = [i for i, polygon in enumerate(building.polygons) if polygon.kind == "lift"]
    if not lifts:
        return ()
    shapes = shapely_polygons([building.polygons[i] for i in lifts])
    pairs = []
    for one, other in shapely.STRtree(shapes).query(shapes, predicate="intersects").T:
        least_m2 = min(shapes[one].area, shapes[other].area)
        on_one_level = building.polygons[lifts[one]].level == building.polygons[lifts[other]].level
        if not on_one_level and shapely.intersection(shapes[one], shapes[other]).area >= MIN_SHAFT_OVERLAP * least_m2:
            pairs.append((int(one), int(other)))
    labels = labels_of(len(lifts), np.array(pairs, dtype=np.int64).reshape(-1, 2))
    shafts = [[lifts[i] for i in np.flatnonzero(labels == label)] for label in range(labels.max() + 1)]
    return tuple(tuple(sorted(shaft, key=lambda i: building.polygons[i].height_m)) for shaft in shafts)


def reachable_parts(building: Building, *, by_lift: bool = True) -> IntArray:
    """(P,) number of the part that each floor polygon belongs to, 0 the largest: no way leads from one to another.

    Args:
        building: The map.
        by_lift: Whether lifts count as ways.
    """
    edges = np.flatnonzero(building.edge_neighbour != WALL)
    pairs = [np.column_stack([building.edge_polygon[edges], building.edge_neighbour[edges]])]
    if by_lift:
        pairs += [np.array([stops[:-1], stops[1:]]).T.reshape(-1, 2) for stops in lift_shafts(building)]
    labels = labels_of(len(building.polygons), np.concatenate(pairs).astype(np.int64))
    area_m2 = np.bincount(labels, weights=[polygon.area_m2 for polygon in building.polygons])
    rank = np.empty_like(labels[: len(area_m2)])
    rank[np.argsort(-area_m2, kind="stable")] = np.arange(len(area_m2))
    parts: IntArray = rank[labels]
    return parts


def labels_of(count: int, pairs: IntArray) -> IntArray:
    """(count,) number of the connected part of each of so many nodes; `pairs` (K, 2) are joined."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(len(pairs), dtype=np.int8), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    labels: IntArray = connected_components(graph, directed=False)[1].astype(np.int64)
    return labels


def unconnected_levels(building: Building) -> tuple[int, ...]:
    """Levels that no stair and no lift joins to another one; none of a building with one level."""
    edges = np.flatnonzero(building.edge_neighbour != WALL)
    one, other = (building.level(polygons[edges]) for polygons in (building.edge_polygon, building.edge_neighbour))
    joined = set(one[one != other].tolist())
    joined |= {building.polygons[i].level for shaft in lift_shafts(building) if len(shaft) > 1 for i in shaft}
    return tuple(level for level in building.levels if level not in joined) if len(building.levels) > 1 else ()
