"""Walls and doors that a straight ray crosses in plan."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

import numpy as np

from pdrbench.building import WALL, Building
from pdrbench.building.connectivity import labels_of
from pdrbench.geometry import BoolArray, FloatArray, IntArray, read_only
from pdrbench.radio.cells import DOORWAY_M2
from pdrbench_sim.radio.ray_kernels import count_walls, find_crossings, lines_by_sector

MAX_WALL_M: Final = 0.4  # two lines that are nearer are the faces of one wall; ours
LIGHT_WALL_M: Final = 0.1  # a thicker wall is heavy; COST 231 final report, section 4.7
DOOR_WIDTH_M: Final = (0.7, 1.4)  # a narrower or wider connection has no leaf; ours
PARALLEL: Final = 0.1  # sine of the angle between the faces of one wall; ours


@dataclass(frozen=True, slots=True, eq=False)
class PlanLines:
    """Lines in plan that rays may cross."""

    start_xy_m: FloatArray  # (W, 2)
    end_xy_m: FloatArray  # (W, 2)

    def __len__(self) -> int:
        return len(self.start_xy_m)

    def crossings(self, origin_xy_m: FloatArray, place_xy_m: FloatArray) -> tuple[IntArray, IntArray, FloatArray]:
        """Where the rays from one origin (2,) to places (N, 2) cross the lines.

        A ray through a vertex crosses one of the two lines that go on to its other side, and none or both otherwise.

        Returns:
            place: (K,) int, index of the place, non-decreasing.
            line: (K,) int.
            fraction: (K,) of the way from the origin, rising for each place.
        """
        a, b = self.start_xy_m - origin_xy_m, self.end_xy_m - origin_xy_m
        return find_crossings(a, b, *lines_by_sector(a, b), place_xy_m - origin_xy_m)


@dataclass(frozen=True, slots=True, eq=False)
class Obstacles:
    """Walls and doors of one level."""

    walls: PlanLines  # both faces of every wall; they coincide where the plan gives it no thickness
    doorways: PlanLines  # every connection as wide as a door, or both sides of it
    door: IntArray  # (len(doorways),) int, the door that hangs there, numbered through the whole building

    def walls_crossed(self, origin_xy_m: FloatArray, place_xy_m: FloatArray) -> tuple[IntArray, IntArray]:
        """Walls between an origin (2,) and places (N, 2).

        Two faces are one wall where less than `MAX_WALL_M` lies between them: along the ray, or across where they
        are parallel. A single face belongs to something larger, such as a shaft or the shell of the building.

        Returns:
            light: (N,) int, walls of two faces up to `LIGHT_WALL_M` from each other.
            heavy: (N,) int, all others.
        """
        a, b = self.walls.start_xy_m - origin_xy_m, self.walls.end_xy_m - origin_xy_m
        ray, along = place_xy_m - origin_xy_m, self.walls.end_xy_m - self.walls.start_xy_m
        return count_walls(a, b, along, ray, np.hypot(*ray.T), (MAX_WALL_M, LIGHT_WALL_M, PARALLEL))

    def doors_crossed(self, origin_xy_m: FloatArray, place_xy_m: FloatArray) -> tuple[IntArray, IntArray]:
        """Doors between an origin (2,) and places (N, 2), each once.

        Returns:
            place: (K,) int, index of the place.
            door: (K,) int.
        """
        place, line, _ = self.doorways.crossings(origin_xy_m, place_xy_m)
        num_doors = int(self.door.max(initial=0)) + 1
        return np.divmod(np.unique(place * num_doors + self.door[line]), num_doors)


@functools.lru_cache(maxsize=64)
def obstacles(building: Building) -> Mapping[int, Obstacles]:
    """Walls and doors by level.

    The edge of a void, a hole above the floor of the level below, is a rail and stops no ray.
    """
    level = building.level(building.edge_polygon)
    is_wall = (building.edge_neighbour == WALL) & ~_is_rail(building)
    is_door = _is_door(building)
    door = _doors(building, is_door)
    start, end = building.edge_start_xy_m, building.edge_end_xy_m
    found = {}
    for number in building.levels:
        walls, doorways = np.flatnonzero(is_wall & (level == number)), np.flatnonzero(is_door & (level == number))
        found[number] = Obstacles(
            PlanLines(read_only(start[walls]), read_only(end[walls])),
            PlanLines(read_only(start[doorways]), read_only(end[doorways])),
            read_only(door[doorways], np.int64),
        )
    return MappingProxyType(found)


def _is_rail(building: Building) -> BoolArray:
    """(E,) edges of the holes above the floor of the level below."""
    import shapely

    rails = np.zeros(len(building.edge_polygon), dtype=np.bool_)
    for polygon, first in zip(building.polygons, building.first_edge, strict=False):
        edge = first + len(polygon.outline_xy_m)
        for hole in polygon.holes:
            middle = shapely.point_on_surface(shapely.Polygon(hole))
            rails[edge : edge + len(hole)] = building.contains([[middle.x, middle.y]], polygon.level - 1)
            edge += len(hole)
    return rails


def _is_door(building: Building) -> BoolArray:
    """(E,) connections of two pieces of floor as high as each other and as wide as a door, each once."""
    polygons = np.arange(len(building.polygons))
    is_floor = np.array([polygon.kind == "floor" for polygon in building.polygons])
    height_m = building.height(polygons)
    width_m = np.hypot(*(building.edge_end_xy_m - building.edge_start_xy_m).T)
    one, other = building.edge_polygon, building.edge_neighbour
    is_first = (other != WALL) & (np.arange(len(one)) < building.edge_twin)
    is_level = is_floor[one] & is_floor[other] & (height_m[one] == height_m[other])
    is_door: BoolArray = is_first & is_level & (width_m >= DOOR_WIDTH_M[0]) & (width_m <= DOOR_WIDTH_M[1])
    return is_door


def _doors(building: Building, leaf: BoolArray) -> IntArray:
    """(E,) number of the door at each edge that `leaf` marks, 0 elsewhere: both sides of a sill have one.

    Doors are numbered level by level.
    """
    edge = np.flatnonzero(leaf)
    one, other = building.edge_polygon[edge], building.edge_neighbour[edge]
    area_m2 = np.array([polygon.area_m2 for polygon in building.polygons])
    num_polygons = len(area_m2)
    # Doorways hang together by the sills that they lead to.
    ways = np.concatenate([np.arange(len(edge))] * 2) + num_polygons
    sides = np.concatenate([one, other])
    is_sill = area_m2[sides] < DOORWAY_M2
    part = labels_of(num_polygons + len(edge), np.column_stack([ways[is_sill], sides[is_sill]]))
    _, first, door = np.unique(part[num_polygons:], return_index=True, return_inverse=True)
    rank = np.empty(len(first), dtype=np.int64)
    rank[np.lexsort([first, building.level(one[first])])] = np.arange(len(first))
    number = np.zeros(len(leaf), dtype=np.int64)
    number[edge] = rank[door]
    return number
