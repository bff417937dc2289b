"""Compiles the kernels of filters and of the map walk, or loads them from the cache."""

from __future__ import annotations

import numpy as np

from pdrbench.building import WALL, Building, FloorPolygon
from pdrbench.building.convex import compile_map
from pdrbench.filters.map_filter import centre
from pdrbench.filters.map_walk import walk
from pdrbench.filters.resampling import systematic

WARM_UPS = dict.fromkeys(("pdrbench.building", "pdrbench.filters"), "pdrbench.filters.warm:warm_up") | {
    "pdrbench.radio": "pdrbench.radio.kernels:warm_up"
}


def warm_up() -> None:
    """Runs every kernel that is called from outside once, on one particle in two rooms."""
    building = two_rooms()
    place, target = np.array([[0.5, 0.5]]), np.array([[1.5, 0.5]])
    building.move([0], place, target)
    convex = compile_map(building)
    walk(convex, place - convex.origin_xy_m, target - convex.origin_xy_m, np.zeros(1, dtype=np.int32))
    centre(place)
    systematic(np.ones(2), 0.5)


def two_rooms() -> Building:
    """Two square metres with a step between them."""
    low = FloorPolygon("a", np.array([[0, 0], [1, 0], [1, 1], [0, 1]]), np.array([WALL, 1, WALL, WALL]), 0.0, 0)
    high = FloorPolygon("b", np.array([[1, 0], [2, 0], [2, 1], [1, 1]]), np.array([WALL, WALL, WALL, 0]), 0.17, 0)
    return Building("two rooms", (low, high))
