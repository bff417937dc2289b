"""Doors that a plan lacks: one in the wall that a room shares with the corridor beside it, marked as guessed.

A building is made of floor polygons, so nothing is laid over anything: the wall is an edge of the room and one of the
corridor, each gets two vertices more, and the door is the rectangle between them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import shapely

from pdrbench.building import WALL, Building, FloorPolygon
from pdrbench.building.connectivity import labels_of, reachable_parts
from pdrbench.building.polygons import shapely_polygons
from pdrbench.errors import PdrbenchError
from pdrbench.geometry import FloatArray, IntArray
from pdrbench_formats.maps.assembly.shapes import is_sound
from pdrbench_formats.maps.plan import Plan, Repair, unreachable

DOORS: Final = ("none", "rooms", "nearest", "wide")
DOOR_M: Final = 0.9  # width of a usual door
MIN_DOOR_M: Final = 0.6  # a wall that is shorter takes no door that people pass
JAMB_M: Final = 0.1  # of wall that is left beside a wide opening
THIN_M: Final = 0.5  # walls up to this thick are opened first
MAX_WALL_M: Final = 1.2  # thicker ones are left: what lies behind them is another house
DEPTH_M: Final = 0.1  # of a door in a wall that is drawn as a line: it is taken from the floor behind
FREE_M: Final = 0.3  # of floor behind such a door
CORNER_M: Final = 0.02  # of wall between a door and the corner of a room
FACING: Final = -0.9  # cosine of the directions of two edges with a wall between them
GUESSED: Final = "door-guessed"  # begins the id of such a door


@dataclass(frozen=True, slots=True)
class _Facing:
    """A wall between two polygons: edges `one` and `other`, and from where to where along `one` they face (m)."""

    one: int
    other: int
    from_m: float
    to_m: float
    gap_m: float


def with_doors(plan: Plan, doors: str) -> Plan:
    """The plan with a door for each part that no way leads to, as far as it shares a wall with another.

    Args:
        plan: As it was read.
        doors: "none" leaves it; "rooms" opens 0.9 m; "nearest" does so for what the plan holds as closed too; "wide"
            opens all of them by the whole wall.
    """
    if doors not in DOORS:
        raise PdrbenchError(f"doors are one of {', '.join(DOORS)}; got {doors!r}")
    building, closed = plan.building, plan.closed
    if doors in DOORS[2:]:
        building, closed = Building(building.name, (*building.polygons, *closed), building.zones), ()
    opened: tuple[Repair, ...] = ()
    if doors != "none" and unreachable(building).any():
        made = _Opened(building, is_wide=doors == "wide")
        building, opened = made.building(), tuple(made.repairs)
    notes = [f"{len(opened)} doors are guessed: the plan shows no way into rooms"] if opened else []
    if closed:
        notes.append(f"{len(closed)} shops or shafts are closed: --doors nearest opens a door to each")
    is_lost = unreachable(building)
    rooms = [k for k, polygon in enumerate(building.polygons) if polygon.kind == "floor" and not _is_door(polygon)]
    if is_lost[rooms].any():
        remedy = {"none": "--doors nearest (in a task file: doors = 'nearest' below [plan]) opens a door to each"}
        why = remedy.get(doors, "no other room lies beside them")
        notes.append(f"{int(is_lost[rooms].sum())} of {len(rooms)} rooms have no way in, no walk enters them: {why}")
    repairs, warnings = (*plan.repairs, *opened), (*notes, *plan.warnings)
    return replace(plan, building=building, repairs=repairs, warnings=warnings, closed=closed)


def is_guessed(polygon: FloorPolygon) -> bool:
    """Whether a floor polygon is a door that the plan does not show."""
    return polygon.id.partition("/")[2].startswith(GUESSED)


def _is_door(polygon: FloorPolygon) -> bool:
    return "/door" in polygon.id


class _Opened:
    """A building whose walls are opened one by one, those of the corridors first."""

    def __init__(self, building: Building, *, is_wide: bool) -> None:
        self._building, self._is_wide = building, is_wide
        self._shapes = shapely_polygons(building.polygons)
        self._tree = shapely.STRtree(self._shapes)
        self._doors: list[FloorPolygon] = []
        self._door_shapes: dict[int, list[shapely.Polygon]] = {level: [] for level in building.levels}
        self._inserted: dict[int, list[tuple[float, list[FloatArray], list[int]]]] = {}
        self.repairs: list[Repair] = []
        part = reachable_parts(building)
        for wall in self._walls(part):
            a, b = building.edge_polygon[[wall.one, wall.other]]
            if part[a] != part[b] and self._open(wall):
                part[part == part[a]] = part[b]

    def building(self) -> Building:
        """With the doors at its end."""
        if not self._doors:
            return self._building
        polygons = [self._redrawn(number) for number in range(len(self._building.polygons))]
        return Building(self._building.name, (*polygons, *self._doors), self._building.zones)

    def _walls(self, part: IntArray) -> list[_Facing]:
        """Walls between parts: thin ones first, of these those of the polygon that most others lie beside."""
        building = self._building
        walls = _facing(building)
        group = _groups(building)
        beside = {tuple(group[building.edge_polygon[[wall.one, wall.other]]]) for wall in walls}
        rooms_beside = np.zeros(len(part), dtype=np.int64)
        for own in (own for own, other in beside if own != other):
            rooms_beside[own] += 1

        def order(wall: _Facing) -> tuple[bool, int, float, int, int]:
            score = rooms_beside[group[building.edge_polygon[[wall.one, wall.other]]]].max()
            width_m = min(wall.to_m - wall.from_m, 2 * DOOR_M)
            return wall.gap_m > THIN_M, -int(score), wall.gap_m - width_m, wall.one, wall.other

        between = [wall for wall in walls if len(set(part[building.edge_polygon[[wall.one, wall.other]]])) > 1]
        return sorted(between, key=order)

    def _open(self, wall: _Facing) -> bool:
        """Puts a door into a wall; False where there is no room for it."""
        building, number = self._building, len(self._building.polygons) + len(self._doors)
        start, end = building.edge_start_xy_m[[wall.one, wall.other]], building.edge_end_xy_m[[wall.one, wall.other]]
        a, b = (int(k) for k in building.edge_polygon[[wall.one, wall.other]])
        along = (end[0] - start[0]) / np.hypot(*(end[0] - start[0]))
        out = np.array([along[1], -along[0]])
        length_m = wall.to_m - wall.from_m
        width_m = max(length_m - 2 * JAMB_M, MIN_DOOR_M) if self._is_wide else min(DOOR_M, length_m)
        middle_m = (wall.from_m + wall.to_m) / 2
        at_m = np.array([middle_m - width_m / 2, middle_m + width_m / 2])
        here = start[0] + at_m[:, None] * along
        behind, there_m = _across(here, out, start[1], end[1])
        is_notch = there_m.max() < DEPTH_M
        far = here + (there_m.max() + DEPTH_M) * out if is_notch else behind
        polygon = building.polygons[a]
        ring = np.array([here[1], here[0], far[0], far[1]])
        name = f"{polygon.level}/{GUESSED}-{len(self._doors)}"
        if not is_sound([ring]) or self._is_taken(ring, (a, b), is_notch=is_notch, out=out):
            return False
        door = FloorPolygon(name, ring, np.array([a, WALL, b, WALL]), polygon.height_m, polygon.level)
        cuts = [(wall.one, [here[0], here[1]], [number, WALL])]
        points = [behind[1], far[1], far[0], behind[0]] if is_notch else [far[1], far[0]]
        cuts.append((wall.other, points, [WALL, number, WALL, WALL] if is_notch else [number, WALL]))
        before = {edge: list(self._inserted.get(edge, [])) for edge, _, _ in cuts}
        for edge, points, neighbours in cuts:
            from_m = float(np.hypot(*(points[0] - building.edge_start_xy_m[edge])))
            self._inserted[edge] = sorted([*before[edge], (from_m, points, neighbours)], key=lambda cut: cut[0])
        if not all(is_sound(self._rings(k)[0]) for k in (a, b)):
            self._inserted.update(before)
            return False
        self._doors.append(door)
        self._door_shapes[door.level].append(shapely.Polygon(ring))
        rooms = f"{building.polygons[a].id!r} and {building.polygons[b].id!r}"
        what = f"no door leads there: {width_m:.2g} m opened between {rooms}, a guess"
        place = shapely.Polygon(ring).centroid
        self.repairs.append(Repair("door guessed", f"level {door.level}", what, (place.x, place.y), door.level))
        return True

    def _is_taken(self, ring: FloatArray, sides: tuple[int, int], *, is_notch: bool, out: FloatArray) -> bool:
        """Whether floor of others is in the way of a door, or too little floor behind one that is cut into it."""
        shape = shapely.Polygon(ring).buffer(-1e-3)
        level = self._building.polygons[sides[0]].level
        others = [int(k) for k in self._tree.query(shape, predicate="intersects") if int(k) not in sides]
        if any(self._building.polygons[k].level == level for k in others):
            return True
        if shapely.intersects(shape, self._door_shapes[level]).any():
            return True
        if not is_notch:
            return False
        behind = shapely.Polygon(np.array([ring[3], ring[2], ring[2] + FREE_M * out, ring[3] + FREE_M * out]))
        return bool(shapely.intersection(behind, self._shapes[sides[1]]).area < 0.999 * behind.area)

    def _rings(self, number: int) -> tuple[list[FloatArray], IntArray]:
        """Rings and neighbours of a polygon with what was inserted into its edges."""
        building, polygon = self._building, self._building.polygons[number]
        edges = slice(first := int(building.first_edge[number]), first + len(polygon.neighbour))
        cuts = [(k, cut) for k in range(edges.start, edges.stop) for cut in self._inserted.get(k, [])]
        at = [k - first + 1 for k, (_, points, _) in cuts for _ in points]
        points = np.array([place for _, (_, points, _) in cuts for place in points]).reshape(-1, 2)
        ends = np.cumsum([len(ring) for ring in polygon.rings])
        ends += np.searchsorted(at, ends, side="right")
        places = np.insert(building.edge_start_xy_m[edges], at, points, axis=0)
        neighbours = np.insert(building.edge_neighbour[edges], at, [one for _, cut in cuts for one in cut[2]])
        return np.split(places, ends[:-1]), neighbours

    def _redrawn(self, number: int) -> FloorPolygon:
        polygon = self._building.polygons[number]
        rings, neighbours = self._rings(number)
        if len(neighbours) == len(polygon.neighbour):
            return polygon
        return replace(polygon, outline_xy_m=rings[0], neighbour=neighbours, holes=tuple(rings[1:]))


def _groups(building: Building) -> IntArray:
    """(P,) number of the open area that each polygon is a part of: a corridor drawn in pieces is one."""
    is_room = np.array([p.kind == "floor" and not _is_door(p) for p in building.polygons])
    edges = np.flatnonzero(building.edge_neighbour != WALL)
    pairs = np.column_stack([building.edge_polygon[edges], building.edge_neighbour[edges]])
    return labels_of(len(building.polygons), pairs[is_room[pairs].all(axis=1)])


def _facing(building: Building) -> list[_Facing]:
    """Pairs of walls of two polygons on one level that face each other for the width of a door, both ways round."""
    kind = np.array([polygon.kind for polygon in building.polygons])
    owner = building.edge_polygon
    start, end = building.edge_start_xy_m, building.edge_end_xy_m
    long = np.hypot(*(end - start).T) >= MIN_DOOR_M
    walls = np.flatnonzero((building.edge_neighbour == WALL) & (kind[owner] != "stairs") & long)
    if not len(walls):
        return []
    lines = shapely.linestrings(np.stack([start[walls], end[walls]], axis=1))
    one, other = walls[shapely.STRtree(lines).query(lines, predicate="dwithin", distance=MAX_WALL_M)]
    along = (end - start) / np.hypot(*(end - start).T)[:, None]
    is_near = (owner[one] != owner[other]) & (building.level(owner[one]) == building.level(owner[other]))
    is_near &= np.abs(building.height(owner[one]) - building.height(owner[other])) < 0.3
    is_near &= (along[one] * along[other]).sum(axis=1) < FACING
    return list(_long_enough(building, one[is_near], other[is_near]))


def _long_enough(building: Building, one: IntArray, other: IntArray) -> Iterator[_Facing]:
    start, end = building.edge_start_xy_m, building.edge_end_xy_m
    along = end[one] - start[one]
    length_m = np.hypot(*along.T)
    along /= length_m[:, None]
    out = np.column_stack([along[:, 1], -along[:, 0]])
    ends_m = [((place[other] - start[one]) * along).sum(axis=1) for place in (end, start)]
    gaps_m = [((place[other] - start[one]) * out).sum(axis=1) for place in (end, start)]
    from_m, to_m = np.maximum(ends_m[0], 0.0), np.minimum(ends_m[1], length_m)
    gap_m = np.maximum(*gaps_m)
    from_m, to_m = from_m + CORNER_M, to_m - CORNER_M
    keep = (to_m - from_m >= MIN_DOOR_M) & (np.minimum(*gaps_m) > -1e-3) & (gap_m <= MAX_WALL_M)
    for k in np.flatnonzero(keep):
        yield _Facing(int(one[k]), int(other[k]), float(from_m[k]), float(to_m[k]), float(gap_m[k]))


def _across(places: FloatArray, out: FloatArray, start: FloatArray, end: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(2, 2) places on an edge that lie across from others, and (2,) how far."""
    along = end - start
    normal = np.array([-along[1], along[0]])
    far_m = ((start - places) @ normal) / (out @ normal)
    return places + far_m[:, None] * out, far_m
