"""Houses of a plan, and what no way leads to in them."""

from __future__ import annotations

import numpy as np

from pdrbench.building import Building
from pdrbench.building.connectivity import labels_of, reachable_parts, unconnected_levels
from pdrbench.building.polygons import shapely_polygons
from pdrbench.geometry import BoolArray

HOUSE_M = 2.0  # thicker than any wall: what lies further apart is two houses
MIN_HOUSE = 0.1  # of the area of the largest house: what is smaller is a part without a way in


def unreachable(building: Building) -> BoolArray:
    """(P,) True for floor polygons that no way leads to from the largest part of their house or unconnected level.

    Lifts count as ways. What lies further than `HOUSE_M` from all else is a house of its own where it is large.
    """
    import shapely

    parts = reachable_parts(building)
    shapes = shapely_polygons(building.polygons)
    near = shapely.STRtree(shapes).query(shapes, predicate="dwithin", distance=HOUSE_M)
    houses = labels_of(len(parts), parts[near[:, building.level(near[0]) == building.level(near[1])]].T)[parts]
    area_m2 = np.bincount(houses, weights=[polygon.area_m2 for polygon in building.polygons])
    # The largest part is 0, and the largest of a house the least.
    main = {int(parts[houses == house].min()) for house in np.flatnonzero(area_m2 >= MIN_HOUSE * area_m2.max())}
    for level in unconnected_levels(building):
        here = [i for i, polygon in enumerate(building.polygons) if polygon.level == level]
        area_m2 = np.bincount(parts[here], weights=[building.polygons[i].area_m2 for i in here])
        main.add(int(area_m2.argmax()))
    lost: BoolArray = ~np.isin(parts, list(main))
    return lost
