"""From rectangles and the openings between them to floor polygons: what the generators of buildings share."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from pdrbench.building import WALL, Building, FloorPolygon, Zone

WALL_BESIDE_DOOR_M: Final = 0.15

Kind = Literal["floor", "stairs", "lift"]
Point = tuple[float, float]
Ring = list[Point]


class Span(NamedTuple):
    """A piece of an axis."""

    low: float
    high: float

    @property
    def length(self) -> float:
        return self.high - self.low

    def middle(self, length_m: float) -> Span:
        """A piece of that length in the middle, to the millimetre."""
        low_m = mm((self.low + self.high - length_m) / 2)
        return Span(low_m, mm(low_m + length_m))


class Opening(NamedTuple):
    """The line from `a` to `b` that cells `one` and `other` share and that people pass."""

    one: str
    other: str
    a: Point
    b: Point


@dataclass(slots=True)
class Cell:
    """A floor polygon before its edges are cut at the openings; `use` is what it is there for."""

    id: str
    ring: Ring
    height_m: float
    level: int
    kind: Kind = "floor"
    use: str = "room"
    holes: list[Ring] = field(default_factory=list)

    @property
    def area_m2(self) -> float:
        return _ring_area_m2(self.ring) - sum(_ring_area_m2(hole) for hole in self.holes)


@dataclass(frozen=True, slots=True)
class Pose:
    """Where a part drawn in its own frame (u, v) lies in the plan: moved, turned by right angles or mirrored."""

    origin: Point  # of the part in the plan
    along: Point = (1.0, 0.0)  # direction of u, a unit vector along an axis of the plan
    across: Point = (0.0, 1.0)  # direction of v, along the other axis

    def point(self, u_m: float, v_m: float) -> Point:
        """A place of the part in the plan, to the millimetre."""
        return (
            mm(self.origin[0] + self.along[0] * u_m + self.across[0] * v_m),
            mm(self.origin[1] + self.along[1] * u_m + self.across[1] * v_m),
        )

    def rectangle(self, u: Span, v: Span) -> Ring:
        """A rectangle of the part as a counter-clockwise ring in the plan."""
        return rectangle(*self.point(u.low, v.low), *self.point(u.high, v.high))


@dataclass(frozen=True, slots=True)
class Draft:
    """Cells of a building and the openings between them, as they come about."""

    cells: list[Cell] = field(default_factory=list)
    openings: list[Opening] = field(default_factory=list)

    def join(self, one: str, other: str, pose: Pose, u: Span, v_m: float) -> None:
        """An opening along u, at one v, of a part of the plan."""
        self.openings.append(Opening(one, other, pose.point(u.low, v_m), pose.point(u.high, v_m)))

    def building(self, name: str, uses: Collection[str], zones: Sequence[Zone] = ()) -> Building:
        """The building, with a zone for every cell of some uses, of the kind of its use, and with further zones."""
        of_cells = (
            Zone(id=cell.id, name=cell.id, outline_xy_m=np.array(cell.ring), level=cell.level, kind=cell.use)
            for cell in self.cells
            if cell.use in uses
        )
        return Building(name=name, polygons=assemble(self.cells, self.openings), zones=(*of_cells, *zones))


def mm(value_m: float) -> float:
    """To the millimetre: both sides of a wall then get the same float."""
    return round(float(value_m), 3)


def rectangle(x0: float, y0: float, x1: float, y1: float) -> Ring:
    """The counter-clockwise ring with these corners, given in any order."""
    (x0, x1), (y0, y1) = sorted((x0, x1)), sorted((y0, y1))
    return [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]


def gaps(spans: Sequence[Span], length_m: float) -> list[Span]:
    """What spans in order leave of an axis from 0 to a length."""
    ends = [0.0, *(end for span in spans for end in span), length_m]
    return [Span(low, high) for low, high in zip(ends[::2], ends[1::2], strict=True)]


def _ring_area_m2(ring: Sequence[Point]) -> float:
    x, y = np.array(ring).T
    return abs(float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))) / 2


def one_room(name: str, outline_xy_m: ArrayLike) -> Building:
    """A building that is one floor polygon with walls all around: (K, 2) corners, counter-clockwise."""
    outline = np.array(outline_xy_m, dtype=np.float64)
    return Building(name, (FloorPolygon(name, outline, np.full(len(outline), WALL), height_m=0.0, level=0),))


def draw_door(rng: np.random.Generator, span: Span, width_m: float) -> float:
    """Lower end of a door in the wall of a room: mostly near a corner, at least `WALL_BESIDE_DOOR_M` from it."""
    slack_m = span.length - width_m - 2 * WALL_BESIDE_DOOR_M
    fraction = rng.uniform(0.0, 0.25) if rng.random() < 0.8 else 0.5
    if rng.random() < 0.5:
        fraction = 1 - fraction
    return mm(span.low + WALL_BESIDE_DOOR_M + fraction * slack_m)


def assemble(cells: Sequence[Cell], openings: Sequence[Opening]) -> tuple[FloorPolygon, ...]:
    """Floor polygons in the order of the cells: every edge is cut where an opening begins or ends.

    Edges with openings are parallel to an axis, and both cells have the line of the opening on an edge, float by float.
    """
    index = {cell.id: i for i, cell in enumerate(cells)}
    doors: dict[str, list[tuple[Point, Point, int]]] = {cell.id: [] for cell in cells}
    for one, other, a, b in openings:
        doors[one].append((a, b, index[other]))
        doors[other].append((a, b, index[one]))
    return tuple(_polygon(cell, doors[cell.id]) for cell in cells)


def _polygon(cell: Cell, doors: Sequence[tuple[Point, Point, int]]) -> FloorPolygon:
    rings = [_cut_ring(ring, doors) for ring in (cell.ring, *cell.holes)]
    return FloorPolygon(
        id=cell.id,
        outline_xy_m=np.array(rings[0][0]),
        neighbour=np.array([leads for _, ring_leads in rings for leads in ring_leads]),
        height_m=mm(cell.height_m),
        level=cell.level,
        kind=cell.kind,
        holes=tuple(np.array(points) for points, _ in rings[1:]),
    )


def _cut_ring(ring: Ring, doors: Sequence[tuple[Point, Point, int]]) -> tuple[Ring, list[int]]:
    """Vertices of a ring with the ends of its doors, and what each edge leads to."""
    points: Ring = []
    leads: list[int] = []
    for start, end in zip(ring, [*ring[1:], ring[0]], strict=True):
        at = start
        for near, far, neighbour in _doors_on(start, end, doors):
            if near != at:
                points.append(at)
                leads.append(WALL)
            points.append(near)
            leads.append(neighbour)
            at = far
        if at != end:
            points.append(at)
            leads.append(WALL)
    return points, leads


def _doors_on(start: Point, end: Point, doors: Sequence[tuple[Point, Point, int]]) -> list[tuple[Point, Point, int]]:
    """Doors on an axis-parallel edge, directed and ordered along it."""
    along = 0 if start[1] == end[1] else 1
    low, high = sorted((start[along], end[along]))
    found = []
    for a, b, neighbour in doors:
        on_line = a[1 - along] == b[1 - along] == start[1 - along]
        if on_line and low <= min(a[along], b[along]) and max(a[along], b[along]) <= high:
            forward = (b[along] - a[along]) * (end[along] - start[along]) > 0
            found.append((a, b, neighbour) if forward else (b, a, neighbour))
    return sorted(found, key=lambda door: abs(door[0][along] - start[along]))
