"""What the plans of the malls get wrong, by the walks that cross them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import shapely

from pdrbench.building import Building
from pdrbench.geometry import FloatArray
from pdrbench_envs.malls.environment import building
from pdrbench_envs.malls.splits import Walk
from pdrbench_lab.malls.draw import scans_of_site
from pdrbench_sim.readers.ilc20_map import level_of_floor

CROSSED_M: Final = 0.5  # of obstacle on a straight line between waypoints: more than a corner that was cut
BLOCKED_M: Final = 2.0  # a wall of a shop, or the shop itself


@dataclass(frozen=True, slots=True)
class PlanFaults:
    """Legs, the straight lines between successive waypoints, of some walks on one floor.

    Attributes:
        site, floor: Names.
        walks, legs: How many.
        crossed: Legs with more than `CROSSED_M` of obstacle.
        blocked: Walks with a leg of more than `BLOCKED_M` of obstacle, by path.
        outside: Waypoints where the plan has an obstacle or nothing.
    """

    site: str
    floor: str
    walks: int
    legs: int
    crossed: int
    blocked: tuple[str, ...]
    outside: int


def plan_faults(of_floor: Iterable[Walk]) -> PlanFaults:
    """Faults of the plan of the floor that some walks share."""
    shared = list(of_floor)
    site, floor = shared[0].site, shared[0].floor
    walkable = _walkable(building(site), level_of_floor(floor))
    legs = crossed = outside = 0
    blocked = []
    for walk in shared:
        xy_m = scans_of_site(site).waypoint_xy_m([walk.path])
        obstacle_m = obstacles_m(walkable, xy_m)
        legs += len(obstacle_m)
        crossed += int((obstacle_m > CROSSED_M).sum())
        outside += int((~shapely.covers(walkable, shapely.points(xy_m))).sum())
        if (obstacle_m > BLOCKED_M).any():
            blocked.append(walk.path)
    return PlanFaults(site, floor, len(shared), legs, crossed, tuple(blocked), outside)


def obstacles_m(walkable: Any, xy_m: FloatArray) -> FloatArray:
    """(P - 1,) length of each leg between waypoints (P, 2) that lies outside a walkable area."""
    legs = shapely.linestrings(np.stack([xy_m[:-1], xy_m[1:]], axis=1))
    return np.asarray(shapely.length(shapely.difference(legs, walkable)))


def _walkable(whole: Building, level: int) -> Any:
    parts = [shapely.Polygon(p.outline_xy_m, p.holes) for p in whole.polygons if p.level == level]
    area = shapely.union_all(parts)
    shapely.prepare(area)
    return area
