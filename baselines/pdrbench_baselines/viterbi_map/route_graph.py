"""A graph of the ways through a building: the medial axis of its floor, without spurs, and rings in wide halls.

Densely sampled points of the walls of a level have a Voronoi diagram, of which the edges that cross no wall are the
medial axis. Where floor polygons of a level overlap, as flights of stairs do, each has a sheet of its own, and
sheets and levels are joined at the connections between their polygons. In halls, where the medial axis is far from most
of the floor, lines at multiples of a distance from the walls are ways too.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import Voronoi, cKDTree

from pdrbench.building import Building
from pdrbench.building.polygons import WALL, shapely_polygons
from pdrbench.errors import MapError
from pdrbench.geometry import BoolArray, FloatArray, IntArray, read_only

MIN_OVERLAP_M2: Final = 1e-3  # polygons of a level that share less than this lie side by side
SAME_M: Final = 1e-4  # samples of walls nearer than this are one
DOOR: Final = 0.8  # of the clearance within the spacing on either side: a door is narrower
NEAR: Final = 1.6  # points of wide halls are joined up to so many times their spacing


@dataclass(frozen=True, slots=True)
class RouteGraphParams:
    """How a route graph is made; ours.

    Attributes:
        sample_m: Between samples of walls; a narrower passage may be closed.
        spur_m: A spur is cut where its discs of clearance stick out of what is left by less than this.
        spacing_m: Between points along a way.
        ring_m: Between rings in halls; walls nearer than that to both sides make a corridor.
    """

    sample_m: float = 0.2
    spur_m: float = 0.5
    spacing_m: float = 1.0
    ring_m: float = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class RouteGraph:
    """Points and the ways between neighbours, each a straight walk on the floor.

    Attributes:
        xy_m: (N, 2).
        polygon: (N,) int, floor polygon of each.
        clearance_m: (N,) distance to the nearest wall.
        pair: (E, 2) int, neighbours.
        way_m: (E,) between them.
        is_ring: (N,) whether a point is of a ring, not of the medial axis.
    """

    xy_m: FloatArray
    polygon: IntArray
    clearance_m: FloatArray
    pair: IntArray
    way_m: FloatArray
    is_ring: BoolArray

    def __len__(self) -> int:
        return len(self.polygon)


@dataclass(frozen=True, slots=True, eq=False)
class _Net:
    """(N, 2) places, (N,) floor polygons of theirs, (E, 2) pairs joined."""

    xy_m: FloatArray
    polygon: IntArray
    pair: IntArray


def route_graph(building: Building, level: int, params: RouteGraphParams | None = None) -> RouteGraph:
    """Of a level and all levels that stairs join it to; parts of the floor that nothing joins stay apart.

    Raises:
        MapError: The building has no such level.
    """
    params = params or RouteGraphParams()
    own = _levels_with(building, level)
    sheet = _sheets(building, own)
    walls = [_wall_lines(building, sheet == k) for k in range(int(sheet.max()) + 1)]
    net = _joined([_medial_axis(building, sheet, k, params.sample_m) for k in range(len(walls))], building, sheet)
    clearance_m = _clearance_m(net.xy_m, sheet[net.polygon], walls)
    kept = _without_spurs(net, clearance_m, params.spur_m)
    net = _thinned(building, _taken(net, kept), clearance_m[kept], params.spacing_m)
    num_axis = len(net.polygon)
    rings = [_rings(building, sheet, k, walls[k], params.ring_m) for k in range(len(walls))]
    net = _with_rings(building, net, rings, params.ring_m)
    clearance_m = _clearance_m(net.xy_m, sheet[net.polygon], walls)
    way_m = np.hypot(*(net.xy_m[net.pair[:, 0]] - net.xy_m[net.pair[:, 1]]).T)
    return RouteGraph(
        read_only(net.xy_m),
        read_only(net.polygon, np.int64),
        read_only(clearance_m),
        read_only(net.pair, np.int64),
        read_only(way_m),
        np.arange(len(net.polygon)) >= num_axis,
    )


def _levels_with(building: Building, level: int) -> BoolArray:
    """(P,) whether a polygon is on a level, or on one that connections join it to."""
    if level not in building.levels:
        raise MapError(f"building {building.name!r} has no level {level}; it has {building.levels}")
    edges = np.flatnonzero(building.edge_neighbour != WALL)
    levels = building.level(np.arange(len(building.polygons)))
    number = np.searchsorted(building.levels, levels)
    one, other = number[building.edge_polygon[edges]], number[building.edge_neighbour[edges]]
    part = _labels(len(building.levels), np.column_stack([one, other]))
    own: BoolArray = part[number] == part[building.levels.index(level)]
    return own


def _sheets(building: Building, own: BoolArray) -> IntArray:
    """(P,) a number for each own polygon, else -1; those of one number are on one level and do not overlap."""
    import shapely

    shapes = shapely_polygons(building.polygons)
    level = building.level(np.arange(len(shapes)))
    sheet = np.full(len(shapes), -1)
    one, other = shapely.STRtree(shapes).query(shapes, predicate="intersects")
    near = (one < other) & (level[one] == level[other]) & own[one]
    one, other = one[near], other[near]
    over = shapely.area(shapely.intersection(shapes[one], shapes[other])) > MIN_OVERLAP_M2
    overlaps: dict[int, set[int]] = {}
    for a, b in zip(one[over].tolist(), other[over].tolist(), strict=True):
        overlaps.setdefault(b, set()).add(a)
    found: dict[tuple[int, int], int] = {}
    for polygon in np.flatnonzero(own).tolist():
        layer, taken = 0, {int(sheet[a]) for a in overlaps.get(polygon, ())}
        while (number := found.setdefault((int(level[polygon]), layer), len(found))) in taken:
            layer += 1
        sheet[polygon] = number
    return sheet


def _wall_lines(building: Building, own: BoolArray) -> Any:
    """Shapely lines of the walls of some polygons (P,)."""
    import shapely

    edge = np.flatnonzero((building.edge_neighbour == WALL) & own[building.edge_polygon])
    return shapely.linestrings(np.stack([building.edge_start_xy_m[edge], building.edge_end_xy_m[edge]], axis=1))


def _gates(building: Building, sheet: IntArray) -> IntArray:
    """Edges that join two sheets, one of each pair of twins."""
    edge = np.flatnonzero(building.edge_twin > np.arange(len(building.edge_twin)))
    edge = edge[sheet[building.edge_polygon[edge]] >= 0]
    gates: IntArray = edge[sheet[building.edge_polygon[edge]] != sheet[building.edge_neighbour[edge]]]
    return gates


def _medial_axis(building: Building, sheet: IntArray, number: int, every_m: float) -> tuple[_Net, IntArray]:
    """Of a sheet, and (G,) for each gate the point of it that a straight walk leads to; -1: none."""
    own = sheet == number
    gates = _gates(building, sheet)
    sides = np.where(sheet[building.edge_polygon[gates]] == number, gates, building.edge_twin[gates])
    mine = np.flatnonzero(own[building.edge_polygon[sides]])
    wall = np.flatnonzero((building.edge_neighbour == WALL) & own[building.edge_polygon])
    around_m, middle = _samples(building, np.concatenate([wall, sides[mine]]), every_m)
    origin_m = around_m.mean(axis=0)  # far from it digits are lost
    diagram = Voronoi(around_m - origin_m)
    xy_m = diagram.vertices + origin_m
    polygon = _located(building, own, xy_m)
    ridge = np.array(diagram.ridge_vertices)
    ridge = ridge[(ridge >= 0).all(axis=1)]
    ridge = ridge[(polygon[ridge] >= 0).all(axis=1)]
    reached, alive = building.move(polygon[ridge[:, 0]], xy_m[ridge[:, 0]], xy_m[ridge[:, 1]])
    ridge = ridge[alive & own[reached]]
    used = np.unique(ridge)
    index = np.full(len(xy_m), -1)
    index[used] = np.arange(len(used))
    to = np.full(len(gates), -1)
    for gate, sample in zip(mine.tolist(), middle[len(wall) :].tolist(), strict=True):
        # The cell of the middle of a gate is a strip to the axis: its far end is on it.
        corner = np.array([k for k in diagram.regions[diagram.point_region[sample]] if k >= 0 and index[k] >= 0])
        if len(corner):
            start_m = np.tile(around_m[sample], (len(corner), 1))
            polygons = np.full(len(corner), building.edge_polygon[sides[gate]])
            reached, alive = building.move(polygons, start_m, xy_m[corner])
            away_m = np.where(alive & own[reached], np.hypot(*(xy_m[corner] - start_m).T), -1.0)
            if away_m.max() >= 0:
                to[gate] = index[corner[int(away_m.argmax())]]
    return _cut_up(building, _Net(xy_m[used], polygon[used], index[ridge]), 2 * every_m), to


def _samples(building: Building, edge: IntArray, every_m: float) -> tuple[FloatArray, IntArray]:
    """Places (S, 2) along edges (E,), the middles of these among them, and which sample (E,) each middle is."""
    start_m, end_m = building.edge_start_xy_m[edge], building.edge_end_xy_m[edge]
    count = np.maximum(np.ceil(np.hypot(*(end_m - start_m).T) / every_m).astype(np.int64), 1)
    count += count % 2
    first = np.cumsum(count + 1) - count - 1
    which = np.repeat(np.arange(len(count)), count + 1)
    step = np.arange(len(which)) - first[which]
    xy_m = start_m[which] + (step / count[which])[:, None] * (end_m - start_m)[which]
    _, one, back = np.unique(np.rint(xy_m / SAME_M), axis=0, return_index=True, return_inverse=True)
    return xy_m[one], back.ravel()[first + count // 2]


def _cut_up(building: Building, net: _Net, longest_m: float) -> _Net:
    """The same with points on ways that are longer."""
    one, other = net.pair.T
    count = np.maximum(np.ceil(np.hypot(*(net.xy_m[one] - net.xy_m[other]).T) / longest_m).astype(np.int64), 1)
    way = np.repeat(np.arange(len(count)), count - 1)
    step = np.arange(len(way)) - np.repeat(np.cumsum(count - 1) - count + 1, count - 1) + 1
    xy_m = net.xy_m[one[way]] + (step / count[way])[:, None] * (net.xy_m[other] - net.xy_m[one])[way]
    polygon, _ = building.move(net.polygon[one[way]], net.xy_m[one[way]], xy_m)
    new = len(net.polygon) + np.arange(len(way))
    is_last = step == count[way] - 1
    pair = np.concatenate(
        [
            net.pair[count == 1],
            np.column_stack([np.where(step == 1, one[way], new - 1), new]),
            np.column_stack([new[is_last], other[way[is_last]]]),
        ]
    )
    return _Net(np.concatenate([net.xy_m, xy_m]), np.concatenate([net.polygon, polygon]), pair)


def _located(building: Building, own: BoolArray, xy_m: FloatArray) -> IntArray:
    """(N,) which of some polygons (P,) each place (N, 2) lies in; -1: none."""
    import shapely

    polygons = np.flatnonzero(own)
    shapes = shapely_polygons([building.polygons[k] for k in polygons])
    shapely.prepare(shapes)
    found = np.full(len(xy_m), -1)
    place, shape = shapely.STRtree(shapes).query(shapely.points(xy_m), predicate="intersects")
    found[place] = polygons[shape]
    return found


def _joined(parts: list[tuple[_Net, IntArray]], building: Building, sheet: IntArray) -> _Net:
    """All sheets as one net, with a point in the middle of every gate; floor without any point gets one."""
    import shapely

    first = np.concatenate([[0], np.cumsum([len(net.polygon) for net, _ in parts])])
    xy_m, polygon = (np.concatenate([getattr(net, name) for net, _ in parts]) for name in ("xy_m", "polygon"))
    pair = np.concatenate([net.pair + offset for (net, _), offset in zip(parts, first, strict=False)])
    gates = _gates(building, sheet)
    middle_m = (building.edge_start_xy_m[gates] + building.edge_end_xy_m[gates]) / 2
    joins = [pair]
    for (_, to), offset in zip(parts, first, strict=False):
        has = np.flatnonzero(to >= 0)
        joins.append(np.column_stack([len(xy_m) + has, to[has] + offset]))
    xy_m, polygon = np.concatenate([xy_m, middle_m]), np.concatenate([polygon, building.edge_polygon[gates]])
    edges = np.flatnonzero(building.edge_neighbour != WALL)
    part = _labels(len(sheet), np.column_stack([building.edge_polygon[edges], building.edge_neighbour[edges]]))
    for empty in np.setdiff1d(part[sheet >= 0], part[polygon]):
        own = np.flatnonzero(part == empty)
        largest = own[int(np.argmax([building.polygons[k].area_m2 for k in own]))]
        (shape,) = shapely_polygons([building.polygons[largest]])
        xy_m = np.concatenate([xy_m, shapely.get_coordinates(shapely.point_on_surface(shape))])
        polygon = np.append(polygon, largest)
    return _Net(xy_m, polygon, np.concatenate(joins))


def _clearance_m(xy_m: FloatArray, sheet: IntArray, walls: list[Any]) -> FloatArray:
    """(N,) distance of places (N, 2) from the walls of their sheets (N,)."""
    import shapely

    found = np.full(len(xy_m), np.inf)
    for number in np.unique(sheet).tolist():
        here = np.flatnonzero(sheet == number)
        if len(walls[number]):
            tree = shapely.STRtree(walls[number])
            (place, _), away_m = tree.query_nearest(shapely.points(xy_m[here]), return_distance=True, all_matches=False)
            found[here[place]] = away_m
    return found


def _without_spurs(net: _Net, clearance_m: FloatArray, spur_m: float) -> BoolArray:
    """(N,) False on spurs: from the end of each to the junction, the discs on it stick out of that one's by less."""
    count = len(net.polygon)
    neighbours: list[set[int]] = [set() for _ in range(count)]
    for a, b in net.pair.tolist():
        if a != b:
            neighbours[a].add(b)
            neighbours[b].add(a)
    alive = np.ones(count, dtype=np.bool_)
    xy, clear = net.xy_m, clearance_m
    waiting = [k for k in range(count) if len(neighbours[k]) == 1]
    while waiting:
        spurs = []
        for leaf in waiting:
            if len(neighbours[leaf]) != 1:
                continue
            spur, at = [leaf], next(iter(neighbours[leaf]))
            while len(neighbours[at]) == 2:
                spur.append(at)
                (at,) = neighbours[at] - {spur[-2]}
            if len(neighbours[at]) > 2:
                line = [*spur, at]
                away_m = np.cumsum(np.hypot(*np.diff(xy[line[::-1]], axis=0).T))[::-1]
                sticks_out_m = float((np.hypot(*(xy[spur] - xy[at]).T) + clear[spur]).max()) - clear[at]
                if sticks_out_m < spur_m:
                    spurs.append((float(away_m[0]), spur, at))
        waiting = []
        for _, spur, at in sorted(spurs):
            if len(neighbours[at]) < 2:  # what is left here is the way itself
                continue
            alive[spur] = False
            neighbours[at].discard(spur[-1])
            for k in spur:
                neighbours[k] = set()
            if len(neighbours[at]) == 1:
                waiting.append(at)
            elif len(neighbours[at]) == 2:
                waiting += _ends(neighbours, at)
    return alive


def _taken(net: _Net, kept: BoolArray) -> _Net:
    """Some points (N,) of a net and the ways between them."""
    index = np.cumsum(kept) - 1
    pair = net.pair[kept[net.pair].all(axis=1) & (net.pair[:, 0] != net.pair[:, 1])]
    return _Net(net.xy_m[kept], net.polygon[kept], index[pair])


def _ends(neighbours: list[set[int]], at: int) -> list[int]:
    """The ends of the chain through a point, where they are ends of the net."""
    found = []
    for to in neighbours[at]:
        before, now = at, to
        while len(neighbours[now]) == 2 and now != at:
            (following,) = neighbours[now] - {before}
            before, now = now, following
        if len(neighbours[now]) == 1:
            found.append(now)
    return found


def _thinned(building: Building, net: _Net, clearance_m: FloatArray, spacing_m: float) -> _Net:
    """With points about `spacing_m` apart on chains and at doors; as before where a straight walk would meet a wall."""
    kept_pairs: list[tuple[int, int]] = []
    tries: list[tuple[int, int, list[int]]] = []
    for chain in _chains(len(net.polygon), net.pair):
        away_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(net.xy_m[chain], axis=0).T))])
        least = 3 if chain[0] == chain[-1] else 1
        parts = max(int(np.ceil(away_m[-1] / spacing_m)), least)
        stops = np.unique(np.searchsorted(away_m, np.linspace(0.0, away_m[-1], parts + 1) - 1e-9))
        stops[-1] = len(chain) - 1
        stops = np.union1d(stops, _doors(away_m, clearance_m[chain], spacing_m))
        tries += [(chain[a], chain[b], chain[a : b + 1]) for a, b in pairwise(stops)]
    if tries:
        ends = np.array([(a, b) for a, b, _ in tries])
        reached, alive = building.move(net.polygon[ends[:, 0]], net.xy_m[ends[:, 0]], net.xy_m[ends[:, 1]])
        alive &= _is_there(building, reached, net, ends[:, 1])
        for is_free, (a, b, way) in zip(alive, tries, strict=True):
            kept_pairs += [(a, b)] if is_free else list(pairwise(way))
    pair = np.unique(np.sort(np.array(kept_pairs, dtype=np.int64).reshape(-1, 2), axis=1), axis=0)
    degree = np.bincount(net.pair.ravel(), minlength=len(net.polygon))
    used = np.union1d(pair.ravel(), np.flatnonzero(degree == 0))
    index = np.full(len(net.polygon), -1)
    index[used] = np.arange(len(used))
    return _Net(net.xy_m[used], net.polygon[used], index[pair])


def _doors(away_m: FloatArray, clearance_m: FloatArray, around_m: float) -> IntArray:
    """Where a chain is narrow: places (K,) along it where it is the narrowest and gets wider soon on both sides."""
    inner = clearance_m[1:-1]
    found = []
    for k in (np.flatnonzero((inner <= clearance_m[:-2]) & (inner < clearance_m[2:])) + 1).tolist():
        low, high = np.searchsorted(away_m, [away_m[k] - around_m, away_m[k] + around_m])
        before_m, after_m = clearance_m[low : k + 1], clearance_m[k:high]
        is_narrowest = min(before_m.min(), after_m.min()) >= clearance_m[k]
        if is_narrowest and min(before_m.max(), after_m.max()) * DOOR > clearance_m[k]:
            found.append(k)
    return np.array(found, dtype=np.int64)


def _is_there(building: Building, reached: IntArray, net: _Net, end: IntArray) -> BoolArray:
    """Whether a walk that ended in polygons (K,) is at points (K,) of a net, not above or below them."""
    same: BoolArray = np.abs(building.height(reached) - building.height(net.polygon[end])) < 1.0
    return same


def _chains(count: int, pair: IntArray) -> list[list[int]]:
    """Lines of points between junctions, ends and, on loops, one of their points."""
    neighbours: list[list[int]] = [[] for _ in range(count)]
    for a, b in np.unique(np.sort(pair, axis=1), axis=0).tolist():
        neighbours[a].append(b)
        neighbours[b].append(a)
    seen: set[tuple[int, int]] = set()
    chains = []
    keys = [k for k in range(count) if len(neighbours[k]) not in (0, 2)]
    for start in [*keys, *(k for k in range(count) if len(neighbours[k]) == 2)]:
        for to in neighbours[start]:
            if (start, to) in seen:
                continue
            chain = [start, to]
            while len(neighbours[chain[-1]]) == 2 and chain[-1] != start:
                a, b = neighbours[chain[-1]]
                chain.append(b if a == chain[-2] else a)
            seen.update(pairwise(chain))
            seen.update(pairwise(chain[::-1]))
            chains.append(chain)
    return chains


def _rings(building: Building, sheet: IntArray, number: int, walls: Any, ring_m: float) -> tuple[FloatArray, IntArray]:
    """Places (N, 2) along lines at multiples of `ring_m` from the walls of a sheet, and their polygons (N,)."""
    import shapely

    own = sheet == number
    left = shapely.union_all(shapely_polygons([building.polygons[k] for k in np.flatnonzero(own)]))
    left = shapely.difference(left, shapely.buffer(shapely.multilinestrings(walls), ring_m, quad_segs=4))
    places_m = [np.zeros((0, 2))]
    while len(walls) and not left.is_empty:
        for line in shapely.get_parts(shapely.get_rings(shapely.get_parts(left))):
            if line.length > 2 * ring_m:
                parts = max(round(float(line.length) / ring_m), 3)
                points = shapely.line_interpolate_point(line, np.arange(parts) / parts, normalized=True)
                places_m.append(shapely.get_coordinates(points))
        left = shapely.buffer(left, -ring_m, quad_segs=4)
    xy_m = np.concatenate(places_m)
    polygon = _located(building, own, xy_m)
    return xy_m[polygon >= 0], polygon[polygon >= 0]


def _with_rings(building: Building, net: _Net, rings: list[tuple[FloatArray, IntArray]], ring_m: float) -> _Net:
    """Rings joined to all that is near and straight ahead."""
    xy_m = np.concatenate([net.xy_m, *(places_m for places_m, _ in rings)])
    polygon = np.concatenate([net.polygon, *(own for _, own in rings)])
    near = cKDTree(xy_m).query_pairs(NEAR * ring_m, output_type="ndarray")
    near = near[(near >= len(net.polygon)).any(axis=1)]
    whole = _Net(xy_m, polygon, near)
    reached, alive = building.move(polygon[near[:, 0]], xy_m[near[:, 0]], xy_m[near[:, 1]])
    near = near[alive & _is_there(building, reached, whole, near[:, 1])]
    return _Net(xy_m, polygon, np.unique(np.sort(np.concatenate([net.pair, near]), axis=1), axis=0))


def _labels(count: int, pair: IntArray) -> IntArray:
    """(count,) number of the part that each of `count` nodes belongs to, joined by (K, 2) pairs."""
    graph = coo_array((np.ones(len(pair), dtype=np.int8), (pair[:, 0], pair[:, 1])), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)
