"""Walls and doors that a straight ray crosses in plan."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

import numpy as np

from pdrbench.building import WALL, Building
from pdrbench.geometry import BoolArray, FloatArray, IntArray, read_only
from pdrbench.radio.cells import DOORWAY_M2

THICKEST_WALL_M: Final = 0.4  # two lines that are nearer are the faces of one wall; ours
LIGHT_WALL_M: Final = 0.1  # a thicker wall is heavy; COST 231 final report, section 4.7
DOOR_WIDTH_M: Final = (0.7, 1.4)  # a narrower or wider connection has no leaf; ours
PARALLEL: Final = 0.1  # sine of the angle between the faces of one wall; ours
_Columns = tuple[FloatArray, FloatArray]  # x and y of points relative to an origin
_SECTORS: Final = 256  # around an origin; a ray is held against the lines of its own


@dataclass(frozen=True, slots=True, eq=False)
class Lines:
    """Lines in plan that rays may cross.

    Attributes:
        start_xy_m: (W, 2).
        end_xy_m: (W, 2).
    """

    start_xy_m: FloatArray
    end_xy_m: FloatArray

    def __len__(self) -> int:
        return len(self.start_xy_m)

    def crossings(self, origin_xy_m: FloatArray, place_xy_m: FloatArray) -> tuple[IntArray, IntArray, FloatArray]:
        """Where the rays from one origin (2,) to places (N, 2) cross the lines.

        A ray through a vertex crosses one of the two lines that go on to its other side, and none or both otherwise.

        Returns:
            place: (K,) int, index of the place, non-decreasing.
            line: (K,) int.
            share: (K,) of the way from the origin, rising for each place.
        """
        (ax, ay), (bx, by) = (self.start_xy_m - origin_xy_m).T, (self.end_xy_m - origin_xy_m).T
        x, y = (place_xy_m - origin_xy_m).T
        place, line = _in_one_sector((ax, ay), (bx, by), (x, y))
        x_of, y_of = x[place], y[place]
        left_a = x_of * ay[line] - y_of * ax[line]
        left_b = x_of * by[line] - y_of * bx[line]
        # Its ends lie on two sides of the ray, and it lies before the place: a x b / ((b - a) x ray) is beyond 0 and 1.
        reach = (ax * by - ay * bx)[line]
        spread = left_b - left_a
        is_cut = ((left_a > 0) != (left_b > 0)) & (reach * spread > 0) & (np.abs(reach) < np.abs(spread))
        place, line, share = place[is_cut], line[is_cut], reach[is_cut] / spread[is_cut]
        order = np.argsort(place + share, kind="stable")
        return place[order], line[order], share[order]


@dataclass(frozen=True, slots=True, eq=False)
class Obstacles:
    """Walls and doors of one level.

    Attributes:
        walls: Both faces of every wall; they coincide where the plan gives it no thickness.
        doorways: Every connection as wide as a door, or both sides of it.
        door: (len(doorways),) int, the door that hangs there, numbered through the whole building.
    """

    walls: Lines
    doorways: Lines
    door: IntArray

    def walls_crossed(self, origin_xy_m: FloatArray, place_xy_m: FloatArray) -> tuple[IntArray, IntArray]:
        """Walls between an origin (2,) and places (N, 2).

        Two faces are one wall where less than `THICKEST_WALL_M` lies between them: along the ray, or across where they
        are parallel. A single face belongs to something larger, such as a shaft or the shell of the building.

        Returns:
            light: (N,) int, walls of two faces up to `LIGHT_WALL_M` from each other.
            heavy: (N,) int, all others.
        """
        place, line, share = self.walls.crossings(origin_xy_m, place_xy_m)
        ray = place_xy_m - origin_xy_m
        reach_m = np.hypot(*ray.T)
        along = self.walls.end_xy_m - self.walls.start_xy_m
        (u, v), (p, q) = (along / np.hypot(*along.T)[:, None])[line].T, (ray[place] / reach_m[place, None]).T
        gap_m = np.diff(share) * reach_m[place[1:]]
        is_parallel = np.abs(u[:-1] * v[1:] - v[:-1] * u[1:]) < PARALLEL
        across_m = np.where(is_parallel, gap_m * np.abs(p * v - q * u)[1:], gap_m)
        is_behind = (place[1:] == place[:-1]) & ((gap_m < THICKEST_WALL_M) | (across_m < THICKEST_WALL_M))
        first = np.flatnonzero(np.concatenate([[True], ~is_behind])[: len(place)])
        thickness_m = np.concatenate([[0.0], np.where(is_behind, across_m, 0.0)])[: len(place)]
        num_faces = np.diff(first, append=len(place))
        is_light = num_faces > 1
        if len(first):
            is_light &= np.maximum.reduceat(thickness_m, first) <= LIGHT_WALL_M
        at, count = place[first], len(place_xy_m)
        return np.bincount(at[is_light], minlength=count), np.bincount(at[~is_light], minlength=count)

    def doors_crossed(self, origin_xy_m: FloatArray, place_xy_m: FloatArray) -> tuple[IntArray, IntArray]:
        """Doors between an origin (2,) and places (N, 2), each once.

        Returns:
            place: (K,) int, index of the place.
            door: (K,) int.
        """
        place, line, _ = self.doorways.crossings(origin_xy_m, place_xy_m)
        num_doors = int(self.door.max(initial=0)) + 1
        return np.divmod(np.unique(place * num_doors + self.door[line]), num_doors)


def obstacles(building: Building) -> Mapping[int, Obstacles]:
    """Walls and doors by level.

    The edge of a void, a hole above the floor of the level below, is a rail and stops no ray.
    """
    return _obstacles(building)


@functools.lru_cache(maxsize=64)
def _obstacles(building: Building) -> Mapping[int, Obstacles]:
    level = building.level(building.edge_polygon)
    is_wall = (building.edge_leads_to == WALL) & ~_is_rail(building)
    is_door = _is_door(building)
    door = _doors(building, is_door)
    start, end = building.edge_start_xy_m, building.edge_end_xy_m
    found = {}
    for number in building.levels:
        walls, doorways = np.flatnonzero(is_wall & (level == number)), np.flatnonzero(is_door & (level == number))
        found[number] = Obstacles(
            Lines(read_only(start[walls]), read_only(end[walls])),
            Lines(read_only(start[doorways]), read_only(end[doorways])),
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
    one, other = building.edge_polygon, building.edge_leads_to
    is_first = (other != WALL) & (np.arange(len(one)) < building.edge_twin)
    is_level = is_floor[one] & is_floor[other] & (height_m[one] == height_m[other])
    is_door: BoolArray = is_first & is_level & (width_m >= DOOR_WIDTH_M[0]) & (width_m <= DOOR_WIDTH_M[1])
    return is_door


def _doors(building: Building, leaf: BoolArray) -> IntArray:
    """(E,) number of the door at each edge that `leaf` marks, 0 elsewhere: both sides of a sill have one.

    Doors are numbered level by level.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    edge = np.flatnonzero(leaf)
    one, other = building.edge_polygon[edge], building.edge_leads_to[edge]
    area_m2 = np.array([polygon.area_m2 for polygon in building.polygons])
    num_polygons = len(area_m2)
    # Doorways hang together by the sills that they lead to.
    ways = np.concatenate([np.arange(len(edge))] * 2) + num_polygons
    sides = np.concatenate([one, other])
    is_sill = area_m2[sides] < DOORWAY_M2
    links = ways[is_sill], sides[is_sill]
    size = num_polygons + len(edge)
    graph = coo_array((np.ones(len(links[0]), dtype=np.int8), links), shape=(size, size))
    _, part = connected_components(graph, directed=False)
    _, first, door = np.unique(part[num_polygons:], return_index=True, return_inverse=True)
    rank = np.empty(len(first), dtype=np.int64)
    rank[np.lexsort([first, building.level(one[first])])] = np.arange(len(first))
    number = np.zeros(len(leaf), dtype=np.int64)
    number[edge] = rank[door]
    return number


def _in_one_sector(start: _Columns, end: _Columns, ray: _Columns) -> tuple[IntArray, IntArray]:
    """Pairs of a ray (N,) and a line (W,) that share a sector around the origin, the ray long enough to reach the line.

    All others never meet.
    """
    width_rad, margin_rad = 2 * math.pi / _SECTORS, 1e-9  # of rounding
    from_rad, until_rad = np.arctan2(start[1], start[0]), np.arctan2(end[1], end[0])
    turn_rad = (until_rad - from_rad + math.pi) % (2 * math.pi) - math.pi
    low_rad = np.where(turn_rad < 0, until_rad, from_rad)
    first = np.floor((low_rad - margin_rad) / width_rad).astype(np.int64)
    count = np.floor((low_rad + np.abs(turn_rad) + margin_rad) / width_rad).astype(np.int64) - first + 1
    line, nth = _expand(count)
    near_m, length_m = _nearest_m(start, end), np.hypot(*ray)
    farthest_m = 1.0 + max(near_m.max(initial=0.0), length_m.max(initial=0.0))
    key = (first[line] + nth) % _SECTORS * farthest_m + near_m[line]
    order = np.argsort(key)
    sector = np.floor(np.arctan2(ray[1], ray[0]) / width_rad).astype(np.int64) % _SECTORS
    begin = np.searchsorted(key[order], sector * farthest_m - margin_rad)
    place, nth = _expand(np.searchsorted(key[order], sector * farthest_m + length_m + margin_rad) - begin)
    return place, line[order[begin[place] + nth]]


def _nearest_m(start: _Columns, end: _Columns) -> FloatArray:
    """(W,) distance of the origin from lines."""
    along = end[0] - start[0], end[1] - start[1]
    share = np.clip(-(start[0] * along[0] + start[1] * along[1]) / (along[0] ** 2 + along[1] ** 2), 0.0, 1.0)
    distance_m: FloatArray = np.hypot(start[0] + share * along[0], start[1] + share * along[1])
    return distance_m


def _expand(count: IntArray) -> tuple[IntArray, IntArray]:
    """Each index as often as its count says, and how often it came before."""
    index = np.repeat(np.arange(len(count)), count)
    return index, np.arange(len(index)) - np.repeat(np.cumsum(count) - count, count)
