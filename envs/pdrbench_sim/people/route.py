"""Shortest ways through a building: navigation mesh, search, string pulling.

Works on any `Building`: every floor polygon is triangulated (constrained Delaunay, holes included), triangles are
joined inside polygons and across connections, so that doors, treads and overlapping flights need no special case. A
search over points on the shared sides picks the sequence of triangles; the funnel algorithm pulls a string taut through
it, kept a body's clearance away from the ends of every side it passes.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from pdrbench.building import WALL, Building
from pdrbench.errors import PdrbenchError
from pdrbench.geometry import BoolArray, FloatArray, IntArray, read_only

BODY_WIDTH_M: Final = 0.5  # shoulder breadth of most adults; a narrower gap is taken only where there is no other way
NARROW_COST_M: Final = 100.0  # detour that is preferred to squeezing through such a gap
STAIRS_COST: Final = 2.5  # a metre on stairs takes as long as this many on the flat (sources.md 1.3: 1/0.35 to 1/0.69)
SAMPLE_SPACING_M: Final = 1.5  # of the search's points on a side
MAX_SAMPLES: Final = 8  # on one side
ON_EDGE_M: Final = 1e-6  # a place this close to its polygon counts as inside
_SIDES: Final = ((0, 1), (1, 2), (2, 0))


class RouteError(PdrbenchError):
    """No way leads from one place to the other; names both."""


@dataclass(frozen=True, slots=True)
class Place:
    """Somewhere on the floor."""

    polygon: int  # index of the floor polygon; stairs overlap, so (x, y) alone is ambiguous
    xy_m: FloatArray  # (2,) inside it

    def __post_init__(self) -> None:
        object.__setattr__(self, "polygon", int(self.polygon))
        object.__setattr__(self, "xy_m", read_only(self.xy_m))


@dataclass(frozen=True, slots=True)
class Route:
    """A polyline through a building."""

    xy_m: FloatArray  # (M, 2) start, corners and crossings of connections, goal
    polygon: IntArray  # (M - 1,) int, floor polygon that each leg lies in

    @property
    def length_m(self) -> float:
        """Horizontal length."""
        return float(np.hypot(*np.diff(self.xy_m, axis=0).T).sum())


@dataclass(frozen=True, slots=True, eq=False)
class NavigationMesh:
    """Triangles of a building and the sides through which one gets from one to the next."""

    building: Building  # what it was made from
    corners_xy_m: FloatArray  # (T, 3, 2) counter-clockwise
    owner: IntArray  # (T,) floor polygon of each triangle
    portal: IntArray  # (T, 3) portal on side k (from corner k to the next), or -1 for a wall
    portal_triangles: IntArray  # (G, 2) the triangles on both sides of a portal
    portal_ends_xy_m: FloatArray  # (G, 2, 2) its ends, seen from the first triangle: right, left
    is_connection: BoolArray  # (G,) True where it joins two floor polygons
    first_node: IntArray  # (G + 1,) portal g owns the search points `first_node[g]:first_node[g + 1]`
    node_xy_m: FloatArray  # (K, 2) the search points
    graph: Any  # (K, K) scipy CSR, cost of the way between search points of one triangle

    def route(self, start: Place, goal: Place, clearance_m: float = 0.4) -> Route:
        """The shortest way for a body.

        Args:
            start: Where it begins.
            goal: Where it ends.
            clearance_m: Distance kept from corners and jambs; 0.45 of the gap where that is less.

        Raises:
            RouteError: A place is not in its polygon, or nothing connects the two.
        """
        from_triangle, to_triangle = self._triangle(start), self._triangle(goal)
        portals = self._search(start, from_triangle, goal, to_triangle)
        return self._pull(start, from_triangle, goal, portals, clearance_m)

    def _triangle(self, place: Place) -> int:
        """The triangle of its polygon that a place lies in."""
        if not 0 <= place.polygon < len(self.building.polygons):
            raise RouteError(f"no polygon {place.polygon}; a place needs 0..{len(self.building.polygons) - 1}")
        triangles = np.flatnonzero(self.owner == place.polygon)
        corners = self.corners_xy_m[triangles]
        inward_m = np.stack([_left_of(corners[:, a], corners[:, b], place.xy_m) for a, b in _SIDES]).min(axis=0)
        if not inward_m.max() >= -ON_EDGE_M:
            raise RouteError(f"{self._name(place)} lies outside its polygon; take the polygon from Building.locate")
        return int(triangles[inward_m.argmax()])

    def _name(self, place: Place) -> str:
        polygon = self.building.polygons[place.polygon]
        return f"({place.xy_m[0]:.2f}, {place.xy_m[1]:.2f}) in polygon {polygon.id!r} on level {polygon.level}"

    def _search(self, start: Place, from_triangle: int, goal: Place, to_triangle: int) -> list[int]:
        """Portals on the cheapest way, in order."""
        from scipy.sparse import csr_array
        from scipy.sparse.csgraph import dijkstra

        if from_triangle == to_triangle:
            return []
        first, last = self._nodes(from_triangle), self._nodes(to_triangle)
        count = len(self.node_xy_m)
        out_m = self._cost(from_triangle) * np.hypot(*(self.node_xy_m[first] - start.xy_m).T) + ON_EDGE_M
        graph = csr_array(
            (
                np.concatenate([self.graph.data, out_m]),
                np.concatenate([self.graph.indices, first]),
                np.concatenate([self.graph.indptr, [self.graph.nnz + len(first)]]),
            ),
            shape=(count + 1, count + 1),
        )
        costs, befores = dijkstra(graph, directed=True, indices=np.array([count]), return_predecessors=True)
        cost_m, before = costs[0], befores[0]
        total_m = cost_m[last] + self._cost(to_triangle) * np.hypot(*(self.node_xy_m[last] - goal.xy_m).T)
        if not len(total_m) or not np.isfinite(total_m).any():
            remedy = "check `neighbour` of the doors and stairs between them"
            if not self.is_connection.any():
                remedy = f"building {self.building.name!r} has no door at all; give its polygons a `neighbour` each"
            raise RouteError(f"no way leads from {self._name(start)} to {self._name(goal)}: {remedy}")
        nodes = [int(last[total_m.argmin()])]
        while before[nodes[-1]] != count:
            nodes.append(int(before[nodes[-1]]))
        portals = np.searchsorted(self.first_node, nodes[::-1], side="right") - 1
        return [int(portal) for portal in portals]

    def _nodes(self, triangle: int) -> IntArray:
        portals = [portal for portal in self.portal[triangle] if portal >= 0]
        spans = [np.arange(self.first_node[portal], self.first_node[portal + 1]) for portal in portals]
        return np.concatenate([np.zeros(0, dtype=np.int64), *spans])

    def _cost(self, triangle: int) -> float:
        return STAIRS_COST if self.building.polygons[self.owner[triangle]].kind == "stairs" else 1.0

    def _pull(self, start: Place, from_triangle: int, goal: Place, portals: Sequence[int], clearance_m: float) -> Route:
        """String pulling through the portals, then the crossing of every connection."""
        triangles = [from_triangle]
        rights, lefts = np.zeros((len(portals), 2)), np.zeros((len(portals), 2))
        for i, portal in enumerate(portals):
            right, left = self.portal_ends_xy_m[portal]
            one, other = self.portal_triangles[portal]
            if triangles[-1] != one:
                right, left, other = left, right, one
            triangles.append(int(other))
            width_m = math.hypot(*(left - right))
            inset = min(clearance_m / width_m, 0.45)
            rights[i], lefts[i] = right + inset * (left - right), left + inset * (right - left)
        corners = _funnel(start.xy_m, goal.xy_m, rights, lefts)
        crossings = _crossings(corners, rights, lefts)
        is_corner = np.zeros(len(portals), dtype=np.bool_)
        is_corner[[portal for portal, _ in corners if 0 <= portal < len(portals)]] = True
        keep = is_corner | self.is_connection[np.asarray(portals, dtype=np.int64)]
        polygons = self.owner[triangles]
        return Route(
            xy_m=read_only(np.vstack([start.xy_m, crossings[keep], goal.xy_m])),
            polygon=read_only(np.concatenate([polygons[:1], polygons[1:][keep]]), np.int64),
        )


def _left_of(a: FloatArray, b: FloatArray, point: FloatArray) -> FloatArray:
    """Distance of points (..., 2) to the left of lines from a to b (..., 2)."""
    along = b - a
    offset = point - a
    distance: FloatArray = (along[..., 0] * offset[..., 1] - along[..., 1] * offset[..., 0]) / np.hypot(
        along[..., 0], along[..., 1]
    )
    return distance


def _funnel(
    start: FloatArray, goal: FloatArray, rights: FloatArray, lefts: FloatArray
) -> list[tuple[int, tuple[float, float]]]:
    """Corners of the shortest line through portals, first and last point included (Mononen's form of the funnel).

    Args:
        start: (2,).
        goal: (2,).
        rights: (G, 2) right ends of the portals, as seen on the way.
        lefts: (G, 2).

    Returns:
        Portal and place of each corner; portal -1 is the start, portal G the goal.
    """
    count = len(rights)
    right_ends = [(float(x), float(y)) for x, y in (*rights, goal)]
    left_ends = [(float(x), float(y)) for x, y in (*lefts, goal)]
    apex, apex_portal = (float(start[0]), float(start[1])), -1
    corners = [(apex_portal, apex)]
    right, left, right_portal, left_portal = apex, apex, -1, -1
    portal = 0
    while portal <= count:
        new_right, new_left = right_ends[portal], left_ends[portal]
        if _turn(apex, right, new_right) >= 0:
            if apex == right or _turn(apex, left, new_right) < 0:
                right, right_portal = new_right, portal
            else:
                apex, apex_portal = left, left_portal
                corners.append((apex_portal, apex))
                right, left, right_portal, portal = apex, apex, apex_portal, apex_portal + 1
                continue
        if _turn(apex, left, new_left) <= 0:
            if apex == left or _turn(apex, right, new_left) > 0:
                left, left_portal = new_left, portal
            else:
                apex, apex_portal = right, right_portal
                corners.append((apex_portal, apex))
                right, left, left_portal, portal = apex, apex, apex_portal, apex_portal + 1
                continue
        portal += 1
    if corners[-1][0] != count:
        corners.append((count, right_ends[-1]))
    return corners


def _turn(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> float:
    """Twice the area of the triangle, positive where c lies to the left of a to b."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _crossings(corners: Sequence[tuple[int, tuple[float, float]]], rights: FloatArray, lefts: FloatArray) -> FloatArray:
    """(G, 2) where the line through the corners passes each portal."""
    places = np.zeros((len(rights), 2))
    for (portal, a), (next_portal, b) in itertools.pairwise(corners):
        for i in range(portal + 1, min(next_portal, len(rights))):
            before, after = _turn(tuple(rights[i]), tuple(lefts[i]), a), _turn(tuple(rights[i]), tuple(lefts[i]), b)
            fraction = before / (before - after) if before != after else 0.0
            fraction = min(max(fraction, 0.0), 1.0)
            places[i] = (1 - fraction) * np.array(a) + fraction * np.array(b)
        if next_portal < len(rights):
            places[next_portal] = b
    return places


# The mesh.


@functools.lru_cache(maxsize=16)
def navigation_mesh(building: Building) -> NavigationMesh:
    """The mesh of a building; kept for the last few buildings."""
    corners, owner = building.triangles()
    clockwise = _left_of(corners[:, 0], corners[:, 1], corners[:, 2]) < 0
    corners = read_only(np.where(clockwise[:, None, None], corners[:, ::-1], corners))
    portal, portal_triangles, portal_ends, is_connection = _find_portals(building, corners, owner)
    first_node, node_xy_m = _place_nodes(portal_ends)
    return NavigationMesh(
        building=building,
        corners_xy_m=corners,
        owner=owner,
        portal=portal,
        portal_triangles=portal_triangles,
        portal_ends_xy_m=portal_ends,
        is_connection=is_connection,
        first_node=first_node,
        node_xy_m=node_xy_m,
        graph=_join_nodes(building, corners, owner, portal, first_node, node_xy_m),
    )


def _find_portals(
    building: Building, corners: FloatArray, owner: IntArray
) -> tuple[IntArray, IntArray, FloatArray, BoolArray]:
    """Sides that two triangles share, inside polygons by their corners, across connections by the map."""
    # Corners get a number each, per polygon, so that sides compare exactly.
    edge_polygon = building.edge_polygon[:, None].astype(np.float64)
    points = np.vstack(
        [
            np.column_stack([np.repeat(owner, 3), corners.reshape(-1, 2)]),
            np.hstack([edge_polygon, building.edge_start_xy_m]),
            np.hstack([edge_polygon, building.edge_end_xy_m]),
        ]
    )
    _, number = np.unique(points, axis=0, return_inverse=True)
    number = number.reshape(-1)
    triangle_corner = number[: 3 * len(owner)].reshape(-1, 3)
    edge_start, edge_end = number[3 * len(owner) :].reshape(2, -1)
    side_of = {(int(c[a]), int(c[b])): (t, k) for t, c in enumerate(triangle_corner) for k, (a, b) in enumerate(_SIDES)}
    joined: list[tuple[tuple[int, int], tuple[int, int], bool]] = []
    for (a, b), side in side_of.items():
        if a < b and (b, a) in side_of:
            joined.append((side, side_of[b, a], False))
    for one, other in _connections(building):
        keys = [(int(edge_start[edge]), int(edge_end[edge])) for edge in (one, other)]
        if not all(key in side_of for key in keys):
            polygon = building.polygons[building.edge_polygon[one]].id
            raise RouteError(f"the triangles of polygon {polygon!r} miss one of its connections; check its outline")
        joined.append((side_of[keys[0]], side_of[keys[1]], True))
    portal = np.full((len(owner), 3), -1)
    for index, (one_side, other_side, _) in enumerate(joined):
        portal[one_side] = portal[other_side] = index
    triangles = np.array([[one[0], other[0]] for one, other, _ in joined], dtype=np.int64).reshape(-1, 2)
    # Out of a counter-clockwise triangle the side's first corner lies to the right.
    ends = np.array([[corners[t, _SIDES[k][0]], corners[t, _SIDES[k][1]]] for (t, k), _, _ in joined])
    is_connection = np.array([connects for _, _, connects in joined], dtype=np.bool_)
    return read_only(portal, np.int64), triangles, read_only(ends.reshape(-1, 2, 2)), is_connection


def _connections(building: Building) -> list[tuple[int, int]]:
    """Pairs of edges that are the two sides of one connection."""
    by_polygons: dict[tuple[int, int], list[int]] = {}
    doors = np.flatnonzero(building.edge_neighbour != WALL)
    owners, others = building.edge_polygon[doors].tolist(), building.edge_neighbour[doors].tolist()
    for edge, owner, neighbour in zip(doors.tolist(), owners, others, strict=True):
        by_polygons.setdefault((owner, neighbour), []).append(edge)
    pairs = []
    for (one, other), own in by_polygons.items():
        twins = by_polygons[other, one]
        for edge in own if one < other else ():
            gap = building.edge_start_xy_m[twins] - building.edge_end_xy_m[edge]
            gap_back = building.edge_end_xy_m[twins] - building.edge_start_xy_m[edge]
            pairs.append((edge, twins[int((np.hypot(*gap.T) + np.hypot(*gap_back.T)).argmin())]))
    return pairs


def _place_nodes(portal_ends: FloatArray) -> tuple[IntArray, FloatArray]:
    """Search points, spread evenly over every portal."""
    width_m = np.hypot(*(portal_ends[:, 1] - portal_ends[:, 0]).T)
    counts = np.clip(np.ceil(width_m / SAMPLE_SPACING_M), 1, MAX_SAMPLES).astype(np.int64)
    first = np.concatenate([[0], np.cumsum(counts)])
    owner = np.repeat(np.arange(len(portal_ends)), counts)
    fraction = (np.arange(first[-1]) - first[owner] + 0.5) / counts[owner]
    return first, portal_ends[owner, 0] + fraction[:, None] * (portal_ends[owner, 1] - portal_ends[owner, 0])


def _join_nodes(
    building: Building,
    corners: FloatArray,
    owner: IntArray,
    portal: IntArray,
    first_node: IntArray,
    node_xy_m: FloatArray,
) -> Any:
    """Costs between the search points on different sides of one triangle."""
    from scipy.sparse import csr_array

    rows, columns, costs = [], [], []
    is_stairs = np.array([p.kind == "stairs" for p in building.polygons])[owner]
    narrow = _is_narrow(corners, portal)
    nodes = np.diff(first_node)
    for side in range(3):
        after = (side + 1) % 3
        triangle = np.flatnonzero((portal[:, side] >= 0) & (portal[:, after] >= 0))
        one, other = portal[triangle, side], portal[triangle, after]
        pair = np.repeat(np.arange(len(triangle)), nodes[one] * nodes[other])
        nth = np.arange(len(pair)) - np.searchsorted(pair, pair)
        from_all = first_node[one][pair] + nth // nodes[other][pair]
        to_all = first_node[other][pair] + nth % nodes[other][pair]
        way = node_xy_m[from_all] - node_xy_m[to_all]
        cost = np.hypot(way[:, 0], way[:, 1]) * np.where(is_stairs[triangle], STAIRS_COST, 1.0)[pair]
        cost += (ON_EDGE_M + NARROW_COST_M * narrow[triangle, side])[pair]
        rows += [from_all, to_all]
        columns += [to_all, from_all]
        costs += [cost, cost]
    count = len(node_xy_m)
    return csr_array((np.concatenate(costs), (np.concatenate(rows), np.concatenate(columns))), shape=(count, count))


def _is_narrow(corners: FloatArray, portal: IntArray) -> BoolArray:
    """(T, 3) True where the way from side k to the next one, around the corner they share, is too narrow for a body.

    Its width is that of the narrower side, and the distance of the corner from the third side where that is a wall.
    """
    narrow = np.zeros(portal.shape, dtype=np.bool_)
    for side, (a, b) in enumerate(_SIDES):
        pivot, far, near = corners[:, b], corners[:, (b + 1) % 3], corners[:, a]
        width_m = np.minimum(np.hypot(*(pivot - near).T), np.hypot(*(pivot - far).T))
        third = near - far
        fraction = ((pivot - far) * third).sum(axis=1) / (third**2).sum(axis=1)
        faces_wall = (portal[:, (side + 2) % 3] < 0) & (fraction > 0) & (fraction < 1)
        height_m = np.abs(_left_of(far, near, pivot))
        narrow[:, side] = np.where(faces_wall, np.minimum(width_m, height_m), width_m) < BODY_WIDTH_M
    return narrow
