"""The route graph of a building as a map to walk on: a place belongs to a point of the graph, and walls are between
points that no short way joins.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from pdrbench.building import Building
from pdrbench.compiled import compiled
from pdrbench.errors import MapError
from pdrbench.geometry import BoolArray, FloatArray, IntArray
from pdrbench_baselines.viterbi_map.route_graph import RouteGraph, RouteGraphParams, route_graph

REACH_M: Final = 5.0  # between the points of two places a second apart
DETOUR: Final = 1.5  # ways between such points are longer than the line by this factor at most,
DETOUR_M: Final = 0.5  # and by so much
SOURCES: Final = 256  # from which ways are looked for at a time


@dataclass(frozen=True, slots=True)
class RouteMapParams:
    """Defaults, ours.

    Attributes:
        graph: Of the graph.
        margin_m: By which the discs around points are larger than the distance to the nearest wall.
    """

    graph: RouteGraphParams = field(default_factory=RouteGraphParams)
    margin_m: float = 0.2


@dataclass(frozen=True, slots=True, eq=False)
class RouteMap:
    """Points of a route graph with what is in reach of each.

    Attributes:
        origin_xy_m: (2,) to which local coordinates are relative.
        local_m: (N, 2) of the points.
        level, polygon: (N,) of them.
        radius_m: (N,) of the disc around each point that is floor.
        first: (N + 1,) from point n the points `to[first[n]:first[n + 1]]` are in reach.
        to: (M,) int32.
        is_open: (M,) whether a short way leads there, or walls are between.
    """

    origin_xy_m: FloatArray
    local_m: FloatArray
    level: IntArray
    polygon: IntArray
    radius_m: FloatArray
    first: IntArray
    to: NDArray[np.int32]
    is_open: BoolArray

    @property
    def convex(self) -> RouteMap:
        """Itself: what `Lattice` has a map of cells for."""
        return self

    def key(self, local_m: FloatArray, cell: NDArray[np.int32]) -> IntArray:
        """(N,) of the point that each place belongs to: given as its cell."""
        del local_m
        key: IntArray = cell.astype(np.int64)
        return key

    def put(self, local_m: FloatArray, cell: NDArray[np.int32]) -> tuple[FloatArray, NDArray[np.int32]]:
        """Places (N, 2) behind a wall, on the level of the points (N,) before it; see `Lattice.put`."""
        found, is_floor = self.walk(local_m, cell, is_open=False)
        is_there = is_floor & (self.level[found] == self.level[cell])
        return local_m, np.where(is_there, found, np.int32(-1))

    def nearest(self, xy_m: FloatArray, level: int) -> tuple[FloatArray, int]:
        """A place (2,) as it is, or drawn into the disc that is nearest to it, and the nearest point of its level.

        Raises:
            MapError: There is no floor on that level.
        """
        own = np.flatnonzero(self.level == level)
        if not len(own):
            raise MapError(f"no floor on level {level}; the map has {sorted(set(self.level.tolist()))}")
        local_m = np.asarray(xy_m, dtype=np.float64) - self.origin_xy_m
        away_m = np.hypot(*(self.local_m[own] - local_m).T)
        sticks_out_m = away_m - self.radius_m[own]
        inside = np.flatnonzero(sticks_out_m <= 0)
        if len(inside):
            return local_m + self.origin_xy_m, int(own[inside[np.argmin(away_m[inside])]])
        best = int(np.argmin(sticks_out_m))
        middle_m = self.local_m[own[best]]
        place_m = middle_m + (local_m - middle_m) * self.radius_m[own[best]] / away_m[best]
        return place_m + self.origin_xy_m, int(own[best])

    def walk(self, to_m: FloatArray, point: NDArray[np.int32], *, is_open: bool) -> tuple[NDArray[np.int32], BoolArray]:
        """Places (N, 2) that are walked to from those of points (N,).

        Args:
            to_m: Local.
            point: Where each walk begins.
            is_open: By ways of the graph, or through walls.

        Returns:
            point: (N,) the nearest in reach; -1: none.
            is_floor: (N,) whether a disc in reach has the place in it.
        """
        return _walk(to_m, point, self.local_m, self.radius_m, self.first, self.to, self.is_open, is_open)


@compiled
def _walk(
    to_m: FloatArray,
    point: NDArray[np.int32],
    local_m: FloatArray,
    radius_m: FloatArray,
    first: IntArray,
    to: NDArray[np.int32],
    is_open: BoolArray,
    wanted: bool,
) -> tuple[NDArray[np.int32], BoolArray]:
    found = np.full(len(point), -1, dtype=np.int32)
    is_floor = np.zeros(len(point), dtype=np.bool_)
    for i in range(len(point)):
        nearest = np.inf
        for k in range(first[point[i]], first[point[i] + 1]):
            if is_open[k] == wanted:
                n = to[k]
                away = (to_m[i, 0] - local_m[n, 0]) ** 2 + (to_m[i, 1] - local_m[n, 1]) ** 2
                if away < nearest:
                    nearest = away
                    found[i] = n
                if away <= radius_m[n] ** 2:
                    is_floor[i] = True
    return found, is_floor


@functools.lru_cache(maxsize=8)
def route_map(building: Building, level: int, params: RouteMapParams) -> RouteMap:
    """Of a level and all that stairs join it to, kept for the last few."""
    graph = route_graph(building, level, params.graph)
    origin_m = graph.xy_m.mean(axis=0)
    near = cKDTree(graph.xy_m).query_pairs(REACH_M, output_type="ndarray")
    height_m = building.height(graph.polygon)
    near = near[np.abs(height_m[near[:, 0]] - height_m[near[:, 1]]) < REACH_M / 2]
    is_open = _short(graph, near) | _in_sight(building, graph, near)
    size = np.arange(len(graph))
    one = np.concatenate([near[:, 0], near[:, 1], size])
    other = np.concatenate([near[:, 1], near[:, 0], size])
    is_open = np.concatenate([is_open, is_open, np.ones(len(size), dtype=np.bool_)])
    order = np.lexsort((other, one))
    first = np.concatenate([[0], np.cumsum(np.bincount(one, minlength=len(graph)))])
    return RouteMap(
        origin_m,
        graph.xy_m - origin_m,
        building.level(graph.polygon),
        graph.polygon,
        graph.clearance_m + params.margin_m,
        first,
        other[order].astype(np.int32),
        is_open[order],
    )


def _in_sight(building: Building, graph: RouteGraph, pair: IntArray) -> BoolArray:
    """(K,) whether a straight walk joins the points of each pair (K, 2)."""
    start, end = pair.T
    reached, alive = building.move(graph.polygon[start], graph.xy_m[start], graph.xy_m[end])
    near: BoolArray = np.abs(building.height(reached) - building.height(graph.polygon[end])) < 1.0
    return alive & near


def _short(graph: RouteGraph, pair: IntArray) -> BoolArray:
    """(K,) whether a way that is not much longer than the line joins the points of each pair (K, 2)."""
    count = len(graph)
    ways: Any = csr_array((graph.way_m, graph.pair.T), shape=(count, count))
    line_m = np.hypot(*(graph.xy_m[pair[:, 0]] - graph.xy_m[pair[:, 1]]).T)
    is_short = np.zeros(len(pair), dtype=np.bool_)
    order = np.argsort(pair[:, 0], kind="stable")
    begin = np.searchsorted(pair[order, 0], np.arange(0, count + SOURCES, SOURCES))
    for part, low in enumerate(range(0, count, SOURCES)):
        own = order[begin[part] : begin[part + 1]]
        if len(own):
            sources = np.arange(low, min(low + SOURCES, count))
            way_m = dijkstra(ways, directed=False, indices=sources, limit=DETOUR * REACH_M + DETOUR_M)
            is_short[own] = way_m[pair[own, 0] - low, pair[own, 1]] <= DETOUR * line_m[own] + DETOUR_M
    return is_short
