"""Procedural office buildings: corridors, rooms with doors, stairwells with real treads.

Every level has the same corridors and stairwells and its own rooms. Main corridors run along x; rows of rooms lie
between them and along the two long facades; cross corridors join the main ones. Walls have no thickness: neighbours
share a line.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Final, Literal, NamedTuple

import numpy as np

from pdrbench.building import WALL, Building, FloorPolygon, Zone
from pdrbench.errors import MapError

Kind = Literal["floor", "stairs"]
Point = tuple[float, float]
Ring = list[Point]

AREA_TOLERANCE: Final = 0.005  # wanted floor area is met this closely; the promise is 0.01
SMALLEST_LEVEL_M2: Final = 350.0  # two stairwells, a corridor and some rooms need about this


@dataclass(frozen=True, slots=True)
class OfficeParams:
    """Sizes of what an office is made of; pairs are ranges of a uniform draw. Ours unless a line says otherwise.

    Building codes allow what these ranges span; treads, landings and corridors follow sources.md 1.3.
    """

    corridor_width_m: tuple[float, float] = (1.8, 2.4)
    row_depth_m: tuple[float, float] = (4.4, 6.6)  # rooms lit from the facade
    inner_depth_m: tuple[float, float] = (9.6, 12.0)  # two rows back to back
    room_width_m: tuple[float, float] = (2.7, 5.6)
    hall_width_m: tuple[float, float] = (7.0, 13.0)  # meeting rooms and open-plan areas
    hall_share: float = 0.16  # of the draws of a width
    door_width_m: float = 0.9
    opening_width_m: tuple[float, float] = (2.4, 3.6)  # of open-plan areas, without a door
    open_share: float = 0.5  # of the halls
    through_share: float = 0.3  # of the inner blocks hold a room that joins both rows
    side_door_share: float = 0.12  # of neighbours in a row have a door between them
    same_share: float = 0.4  # of row pieces repeat the level below
    core_share: float = 0.6  # of large halls have a core, a hole in the floor polygon
    level_height_m: tuple[float, float] = (3.1, 3.7)
    riser_height_m: tuple[float, float] = (0.155, 0.175)  # sources.md 1.3: 0.15 to 0.18
    tread_depth_m: tuple[float, float] = (0.28, 0.30)  # sources.md 1.3
    flight_width_m: tuple[float, float] = (1.15, 1.35)
    stair_gap_m: tuple[float, float] = (0.10, 0.20)
    landing_depth_m: tuple[float, float] = (1.3, 1.5)  # sources.md 1.3: 1.2 to 1.5
    metres_per_stairwell: float = 70.0  # of main corridor: 35 m at most to the next one


class _Span(NamedTuple):
    """A piece of the x axis."""

    low: float
    high: float

    @property
    def length(self) -> float:
        return self.high - self.low


class _Opening(NamedTuple):
    """The line from `a` to `b` that cells `one` and `other` share and that people pass."""

    one: str
    other: str
    a: Point
    b: Point


@dataclass(slots=True)
class _Cell:
    """A floor polygon before its edges are cut at the openings."""

    id: str
    ring: Ring
    height_m: float
    level: int
    kind: Kind = "floor"
    use: str = "room"
    holes: list[Ring] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class _Row:
    """A strip of rooms between two cross corridors, along one main corridor.

    Attributes:
        id: Unique in a level.
        span: Where it lies along x.
        wall_y_m: The corridor's wall.
        back_y_m: Facade, or the wall to the row behind.
        corridor: Id of the corridor without the level.
        behind: Id of the row that shares the back wall, or "".
        stairs: The part of `span` that a stairwell takes, or None.
    """

    id: str
    span: _Span
    wall_y_m: float
    back_y_m: float
    corridor: str
    behind: str = ""
    stairs: _Span | None = None


@dataclass(frozen=True, slots=True)
class _StairSize:
    """A U-shaped stair, the same in every stairwell: one flight up to a landing at half height, one back.

    Attributes:
        num_treads: Of one flight; its last riser leads to a landing.
    """

    num_treads: int
    tread_depth_m: float
    riser_height_m: float
    flight_width_m: float
    landing_depth_m: float
    width_m: float

    @property
    def depth_m(self) -> float:
        """From the door to the far end of the landing at half height."""
        return self.num_treads * self.tread_depth_m + 2 * self.landing_depth_m


@dataclass(frozen=True, slots=True)
class _Frame:
    """What all levels share; `up_left` by row tells on which side its stairwell goes up."""

    corridors: tuple[tuple[str, Ring], ...]
    joints: tuple[_Opening, ...]
    rows: tuple[_Row, ...]
    up_left: tuple[bool, ...]
    stair: _StairSize
    level_height_m: float


@dataclass(frozen=True, slots=True)
class _Brief:
    """The draws that do not depend on the length of the building."""

    num_corridors: int
    num_crossings: int
    num_stairwells: int
    num_levels: int
    seed: int


def make_office(
    rng: np.random.Generator,
    *,
    num_levels: int = 3,
    area_m2: float = 3000.0,
    name: str = "office",
    params: OfficeParams | None = None,
) -> Building:
    """Draws an office building.

    The draws fix everything but the length along x, which is solved for the wanted area.

    Args:
        rng: Two buildings from generators in the same state are equal byte for byte.
        num_levels: Levels 0 to num_levels - 1, at least 1.
        area_m2: Sum over all floor polygons, treads included, met within 1 %.
        name: Name of the building.
        params: Sizes; None for the defaults.

    Raises:
        MapError: The area is too small for a corridor, rooms and stairwells on so many levels.
    """
    params = params or OfficeParams()
    if num_levels < 1:
        raise MapError(f"an office has at least 1 level; got num_levels={num_levels}")
    level_m2 = area_m2 / num_levels
    if not level_m2 >= SMALLEST_LEVEL_M2:
        raise MapError(
            f"an office needs {SMALLEST_LEVEL_M2:g} m2 per level; got {level_m2:.0f} m2: "
            f"ask for more area or fewer levels"
        )
    for _ in range(8):
        drawn = _fit_length(_draw_brief(rng, level_m2, num_levels, params), area_m2, params)
        if drawn is not None:
            cells, openings, zones = drawn
            return Building(name=name, polygons=_assemble(cells, openings), zones=tuple(zones))
    raise MapError(f"no office of {area_m2:g} m2 on {num_levels} levels found; ask for another area")


def _fit_length(
    brief: _Brief, area_m2: float, params: OfficeParams
) -> tuple[list[_Cell], list[_Opening], list[Zone]] | None:
    """The building of the wanted area, or None where the number of rooms jumps to and fro around it."""
    length_m = area_m2 / brief.num_levels / _expected_depth_m(brief.num_corridors, params)
    for attempt in range(16):
        if attempt == 8:  # cores come and go with the length; without them the area follows it smoothly
            params = replace(params, core_share=0.0)
        drawn = _draw_cells(brief, length_m, params)
        came_m2 = sum(_cell_area_m2(cell) for cell in drawn[0])
        if abs(came_m2 - area_m2) <= AREA_TOLERANCE * area_m2:
            return drawn
        length_m *= area_m2 / came_m2
    return None


def _expected_depth_m(num_corridors: int, params: OfficeParams) -> float:
    row, inner, corridor = (sum(p) / 2 for p in (params.row_depth_m, params.inner_depth_m, params.corridor_width_m))
    return 2 * row + num_corridors * corridor + (num_corridors - 1) * inner


def _draw_brief(rng: np.random.Generator, level_m2: float, num_levels: int, params: OfficeParams) -> _Brief:
    lengths_m = {count: level_m2 / _expected_depth_m(count, params) for count in (1, 2, 3, 4)}
    fitting = [
        count
        for count, length_m in lengths_m.items()
        if max(24, 1.2 * _expected_depth_m(count, params)) <= length_m <= 95
    ] or [min(lengths_m, key=lambda count: abs(math.log(lengths_m[count] / 50)))]
    num_corridors = int(rng.choice(fitting))
    length_m = lengths_m[num_corridors]
    num_crossings = max(1, round(length_m / rng.uniform(22, 40)))
    if num_corridors > 1 and length_m > 30:
        num_crossings = max(2, num_crossings)
    num_stairwells = max(2, math.ceil(length_m * num_corridors / params.metres_per_stairwell))
    return _Brief(num_corridors, num_crossings, num_stairwells, num_levels, int(rng.integers(2**62)))


def _mm(value_m: float) -> float:
    """To the millimetre: both sides of a wall then get the same float."""
    return round(float(value_m), 3)


def _rectangle(x0: float, y0: float, x1: float, y1: float) -> Ring:
    (x0, x1), (y0, y1) = sorted((x0, x1)), sorted((y0, y1))
    return [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]


def _ring_area_m2(ring: Sequence[Point]) -> float:
    x, y = np.array(ring).T
    return abs(float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))) / 2


def _cell_area_m2(cell: _Cell) -> float:
    return _ring_area_m2(cell.ring) - sum(_ring_area_m2(hole) for hole in cell.holes)


def _draw_cells(brief: _Brief, length_m: float, params: OfficeParams) -> tuple[list[_Cell], list[_Opening], list[Zone]]:
    """All cells of a building of this length; the same draws whatever the length, as far as numbers of rooms allow."""
    frame_rng, *level_rngs = (np.random.default_rng([brief.seed, i]) for i in range(brief.num_levels + 1))
    frame = _draw_frame(frame_rng, brief, length_m, params)
    cells: list[_Cell] = []
    openings: list[_Opening] = []
    split: dict[str, list[_Span]] = {}
    for level, rng in enumerate(level_rngs):
        height_m = level * frame.level_height_m
        _add_corridors(cells, openings, frame, level, height_m)
        split = {row.id: _split_row(rng, row, split.get(row.id), params) for row in frame.rows}
        _add_rooms(rng, cells, openings, frame.rows, split, level, height_m, params)
        for row, up_left in zip(frame.rows, frame.up_left, strict=True):
            if row.stairs is not None:
                _add_stairwell(cells, openings, frame, row, up_left, level, brief.num_levels, params)
    zones = [
        Zone(id=c.id, name=c.id, outline_xy_m=np.array(c.ring), level=c.level, kind=c.use)
        for c in cells
        if c.use in ("room", "hall", "corridor")
    ]
    return cells, openings, zones


# The frame: corridors, rows, stairwells.


def _draw_frame(rng: np.random.Generator, brief: _Brief, length_m: float, params: OfficeParams) -> _Frame:
    level_height_m = _mm(rng.uniform(*params.level_height_m))
    stair = _draw_stair(rng, level_height_m, params)
    crossings = _draw_crossings(rng, brief.num_crossings, length_m, params)
    corridors, joints, rows = _draw_rows(rng, brief.num_corridors, crossings, length_m, stair.depth_m, params)
    rows = _place_stairs(rng, rows, brief.num_stairwells, stair, length_m)
    up_left = tuple(bool(rng.random() < 0.5) for _ in rows)
    return _Frame(tuple(corridors), tuple(joints), tuple(rows), up_left, stair, level_height_m)


def _draw_stair(rng: np.random.Generator, level_height_m: float, params: OfficeParams) -> _StairSize:
    num_risers = 2 * round(level_height_m / rng.uniform(*params.riser_height_m) / 2)
    flight_width_m = _mm(rng.uniform(*params.flight_width_m))
    return _StairSize(
        num_treads=num_risers // 2 - 1,
        tread_depth_m=_mm(rng.uniform(*params.tread_depth_m)),
        riser_height_m=level_height_m / num_risers,
        flight_width_m=flight_width_m,
        landing_depth_m=_mm(rng.uniform(*params.landing_depth_m)),
        width_m=_mm(2 * flight_width_m + rng.uniform(*params.stair_gap_m)),
    )


def _draw_crossings(rng: np.random.Generator, count: int, length_m: float, params: OfficeParams) -> list[_Span]:
    """Where cross corridors lie: spread evenly, then shifted by up to a quarter of their distance."""
    pitch_m = length_m / count
    spans = []
    for crossing in range(count):
        centre_m = pitch_m * (crossing + 0.5 + rng.uniform(-0.25, 0.25))
        width_m = rng.uniform(*params.corridor_width_m)
        spans.append(_Span(_mm(centre_m - width_m / 2), _mm(centre_m + width_m / 2)))
    return spans


def _draw_rows(
    rng: np.random.Generator,
    num_corridors: int,
    crossings: Sequence[_Span],
    length_m: float,
    stair_depth_m: float,
    params: OfficeParams,
) -> tuple[list[tuple[str, Ring]], list[_Opening], list[_Row]]:
    """Main corridors upwards from y = 0, the rows beside them and the cross corridors between them."""
    corridors: list[tuple[str, Ring]] = []
    joints: list[_Opening] = []
    rows: list[_Row] = []
    blocks = _blocks(crossings, length_m)
    sides: list[tuple[float, float]] = []
    y_m = 0.0
    for index in range(num_corridors):
        top_m = _mm(y_m + rng.uniform(*params.corridor_width_m))
        corridors.append((f"corridor-{index + 1}", _rectangle(0.0, y_m, _mm(length_m), top_m)))
        sides.append((y_m, top_m))
        y_m = _mm(top_m + max(rng.uniform(*params.inner_depth_m), stair_depth_m + params.row_depth_m[0] - 0.6))
    for index in range(num_corridors - 1):
        _add_inner_block(rng, corridors, joints, rows, index, sides, crossings, blocks, stair_depth_m)
    for corridor, side, outward in ((1, sides[0][0], -1.0), (num_corridors, sides[-1][1], 1.0)):
        _add_outer_block(rng, corridors, joints, rows, corridor, side, outward, crossings, length_m, params)
    return corridors, joints, rows


def _blocks(crossings: Sequence[_Span], length_m: float) -> list[_Span]:
    edges = [0.0, *(x for span in crossings for x in span), _mm(length_m)]
    return [_Span(low, high) for low, high in zip(edges[::2], edges[1::2], strict=True)]


def _add_inner_block(
    rng: np.random.Generator,
    corridors: list[tuple[str, Ring]],
    joints: list[_Opening],
    rows: list[_Row],
    index: int,
    sides: Sequence[tuple[float, float]],
    crossings: Sequence[_Span],
    blocks: Sequence[_Span],
    stair_depth_m: float,
) -> None:
    """Two rows back to back between main corridors `index` and `index + 1`, and the cross corridors through them."""
    low_m, high_m = sides[index][1], sides[index + 1][0]
    below, above = f"corridor-{index + 1}", f"corridor-{index + 2}"
    for number, cross in enumerate(crossings):
        name = f"cross-{index + 1}{number + 1}"
        corridors.append((name, _rectangle(cross.low, low_m, cross.high, high_m)))
        joints.append(_Opening(below, name, (cross.low, low_m), (cross.high, low_m)))
        joints.append(_Opening(above, name, (cross.low, high_m), (cross.high, high_m)))
    for number, span in enumerate(blocks):
        # One of the two rows is deep enough for a stairwell.
        deep_m = max(stair_depth_m + 0.1, (high_m - low_m) * rng.uniform(0.5, 0.6))
        split_m = _mm(low_m + deep_m if rng.random() < 0.5 else high_m - deep_m)
        south, north = f"inner-{index + 1}{number + 1}s", f"inner-{index + 1}{number + 1}n"
        rows.append(_Row(south, span, low_m, split_m, below, behind=north))
        rows.append(_Row(north, span, high_m, split_m, above, behind=south))


def _add_outer_block(
    rng: np.random.Generator,
    corridors: list[tuple[str, Ring]],
    joints: list[_Opening],
    rows: list[_Row],
    corridor: int,
    side_m: float,
    outward: float,
    crossings: Sequence[_Span],
    length_m: float,
    params: OfficeParams,
) -> None:
    """Rows of different depth along a facade; some cross corridors reach it."""
    facing = "s" if outward < 0 else "n"
    through = [cross for cross in crossings if rng.random() < 0.5]
    for number, cross in enumerate(through):
        name = f"exit-{facing}{number + 1}"
        depth_m = rng.uniform(*params.row_depth_m)
        corridors.append((name, _rectangle(cross.low, side_m, cross.high, _mm(side_m + outward * depth_m))))
        joints.append(_Opening(f"corridor-{corridor}", name, (cross.low, side_m), (cross.high, side_m)))
    for number, span in enumerate(_blocks(through, length_m)):
        depth_m = rng.uniform(*params.row_depth_m)
        back_m = _mm(side_m + outward * depth_m)
        rows.append(_Row(f"outer-{facing}{number + 1}", span, side_m, back_m, f"corridor-{corridor}"))


def _place_stairs(
    rng: np.random.Generator, rows: Sequence[_Row], count: int, stair: _StairSize, length_m: float
) -> list[_Row]:
    """Gives `count` rows a stairwell, spread along x; an outer row that is too shallow gets deeper."""
    placed = list(rows)
    for number in range(count):
        wanted_m = length_m * (number + rng.uniform(0.25, 0.75)) / count
        free = [
            i
            for i in rng.permutation(len(placed))
            if placed[i].stairs is None
            and placed[i].span.length >= stair.width_m
            and (not placed[i].behind or abs(placed[i].back_y_m - placed[i].wall_y_m) >= stair.depth_m)
        ]
        if not free:
            raise MapError(f"an office {length_m:.0f} m long has no place for {count} stairwells; ask for more area")
        best = min(free, key=lambda i: _distance_m(placed[i].span, wanted_m))
        placed[best] = _with_stairs(rng, placed[best], wanted_m, stair)
    return placed


def _with_stairs(rng: np.random.Generator, row: _Row, wanted_m: float, stair: _StairSize) -> _Row:
    low_m = min(max(wanted_m - stair.width_m / 2, row.span.low), row.span.high - stair.width_m)
    # No sliver beside the stairwell: a room there is at least 2.7 m wide.
    if low_m - row.span.low < 2.7:
        low_m = row.span.low
    elif row.span.high - stair.width_m - low_m < 2.7:
        low_m = row.span.high - stair.width_m
    back_y_m = row.back_y_m
    if abs(back_y_m - row.wall_y_m) < stair.depth_m:
        back_y_m = _mm(row.wall_y_m + math.copysign(stair.depth_m + rng.uniform(0, 0.6), back_y_m - row.wall_y_m))
    return replace(row, back_y_m=back_y_m, stairs=_Span(_mm(low_m), _mm(low_m + stair.width_m)))


def _distance_m(span: _Span, x_m: float) -> float:
    return max(span.low - x_m, x_m - span.high, 0.0)


# One level: corridors, rooms, doors, stairs.


def _add_corridors(cells: list[_Cell], openings: list[_Opening], frame: _Frame, level: int, height_m: float) -> None:
    for name, ring in frame.corridors:
        cells.append(_Cell(f"{level}/{name}", ring, height_m, level, use="corridor"))
    for one, other, a, b in frame.joints:
        openings.append(_Opening(f"{level}/{one}", f"{level}/{other}", a, b))


def _split_row(rng: np.random.Generator, row: _Row, below: list[_Span] | None, params: OfficeParams) -> list[_Span]:
    """Cuts what a stairwell leaves of a row into rooms, or repeats the level below."""
    if below is not None and rng.random() < params.same_share:
        return below
    pieces = [row.span]
    if row.stairs is not None:
        pieces = [_Span(row.span.low, row.stairs.low), _Span(row.stairs.high, row.span.high)]
    return [room for piece in pieces if piece.length > 0 for room in _split_span(rng, piece, params)]


def _split_span(rng: np.random.Generator, span: _Span, params: OfficeParams) -> list[_Span]:
    rooms = []
    low_m = span.low
    while span.high - low_m > params.room_width_m[1]:
        is_hall = rng.random() < params.hall_share
        width_m = rng.uniform(*(params.hall_width_m if is_hall else params.room_width_m))
        if span.high - low_m - width_m < params.room_width_m[0]:
            break
        rooms.append(_Span(low_m, _mm(low_m + width_m)))
        low_m = rooms[-1].high
    return [*rooms, _Span(low_m, span.high)]


def _add_rooms(
    rng: np.random.Generator,
    cells: list[_Cell],
    openings: list[_Opening],
    rows: Sequence[_Row],
    split: dict[str, list[_Span]],
    level: int,
    height_m: float,
    params: OfficeParams,
) -> None:
    through = _draw_through_rooms(rng, rows, split, params)
    number = 0
    for row in rows:
        ids = []
        for index, span in enumerate(split[row.id]):
            number += 1
            name = through.get((row.id, index), f"room-{number:03d}")
            ids.append(f"{level}/{name}")
            is_hall = span.length >= params.hall_width_m[0]
            joined = next((cell for cell in cells if cell.id == ids[-1]), None)
            ring = _rectangle(span.low, row.wall_y_m, span.high, row.back_y_m)
            if joined is None:
                use = "hall" if is_hall or (row.id, index) in through else "room"
                cells.append(_Cell(ids[-1], ring, height_m, level, use=use))
            else:
                joined.ring = _join_rings(joined.ring, ring)
            if is_hall and (row.id, index) not in through:
                cells[-1].holes = _draw_core(rng, span, row, params)
            _add_doors(rng, openings, ids[-1], span, row, level, params)
        _add_side_doors(rng, openings, ids, split[row.id], row, params)


def _draw_through_rooms(
    rng: np.random.Generator, rows: Sequence[_Row], split: dict[str, list[_Span]], params: OfficeParams
) -> dict[tuple[str, int], str]:
    """Names by (row, index) of rooms that join two rows back to back."""
    names: dict[tuple[str, int], str] = {}
    for row in rows:
        if not row.id.endswith("s") or not row.behind or rng.random() >= params.through_share:
            continue
        pairs = [
            (i, j)
            for i, south in enumerate(split[row.id])
            for j, north in enumerate(split[row.behind])
            if min(south.high, north.high) - max(south.low, north.low) >= 1.5
        ]
        if pairs:
            i, j = pairs[int(rng.integers(len(pairs)))]
            names[row.id, i] = names[row.behind, j] = f"through-{row.id}"
    return names


def _join_rings(south: Ring, north: Ring) -> Ring:
    """Union of two rectangles, the second on top of the first; an L, a T, a Z or a rectangle."""
    (sx0, sy0), (sx1, _), (_, split_y), _ = south
    (nx0, _), (nx1, _), (_, ny1), _ = north
    ring = [
        (sx0, sy0),
        (sx1, sy0),
        (sx1, split_y),
        (nx1, split_y),
        (nx1, ny1),
        (nx0, ny1),
        (nx0, split_y),
        (sx0, split_y),
    ]
    return list(dict.fromkeys(ring))


def _draw_core(rng: np.random.Generator, span: _Span, row: _Row, params: OfficeParams) -> list[Ring]:
    """A core (lift shaft, copy room) in the middle of a large hall, with 1.3 m or more around it."""
    depth_m = abs(row.back_y_m - row.wall_y_m)
    if depth_m < 4.4 or rng.random() >= params.core_share:
        return []
    half_x_m = rng.uniform(0.8, min(2.2, span.length / 2 - 1.6))
    half_y_m = rng.uniform(0.5, depth_m / 2 - 1.6)
    x_m = (span.low + span.high) / 2 + rng.uniform(-0.3, 0.3)
    y_m = (row.wall_y_m + row.back_y_m) / 2
    ring = _rectangle(_mm(x_m - half_x_m), _mm(y_m - half_y_m), _mm(x_m + half_x_m), _mm(y_m + half_y_m))
    return [ring[::-1]]


def _add_doors(
    rng: np.random.Generator,
    openings: list[_Opening],
    room: str,
    span: _Span,
    row: _Row,
    level: int,
    params: OfficeParams,
) -> None:
    """One door to the corridor; halls have two, or a wide opening."""
    corridor = f"{level}/{row.corridor}"
    parts = [(span, params.door_width_m)]
    if span.length >= params.hall_width_m[0]:
        middle_m = (span.low + span.high) / 2
        parts = [(_Span(span.low, middle_m), params.door_width_m), (_Span(middle_m, span.high), params.door_width_m)]
        if rng.random() < params.open_share:
            parts = [(span, rng.uniform(*params.opening_width_m))]
    for part, width_m in parts:
        low_m = _draw_door(rng, part, width_m)
        a, b = (low_m, row.wall_y_m), (_mm(low_m + width_m), row.wall_y_m)
        openings.append(_Opening(corridor, room, a, b))


def _draw_door(rng: np.random.Generator, span: _Span, width_m: float) -> float:
    """Lower end of a door: mostly near a corner of the room, at least 0.15 m from it."""
    slack_m = span.length - width_m - 0.3
    share = rng.uniform(0.0, 0.25) if rng.random() < 0.8 else 0.5
    if rng.random() < 0.5:
        share = 1 - share
    return _mm(span.low + 0.15 + share * slack_m)


def _add_side_doors(
    rng: np.random.Generator,
    openings: list[_Opening],
    ids: Sequence[str],
    spans: Sequence[_Span],
    row: _Row,
    params: OfficeParams,
) -> None:
    """Doors between some neighbours in a row."""
    low_y, high_y = sorted((row.wall_y_m, row.back_y_m))
    for left, right, one, other in zip(spans, spans[1:], ids, ids[1:], strict=False):
        if rng.random() >= params.side_door_share or left.high != right.low:
            continue
        y_m = _mm(rng.uniform(low_y + 0.6, high_y - 0.6 - params.door_width_m))
        openings.append(_Opening(one, other, (left.high, y_m), (left.high, _mm(y_m + params.door_width_m))))


def _add_stairwell(
    cells: list[_Cell],
    openings: list[_Opening],
    frame: _Frame,
    row: _Row,
    up_left: bool,
    level: int,
    num_levels: int,
    params: OfficeParams,
) -> None:
    """The landing of one level with its door, the treads of that level, and the landing half way up.

    A tread belongs to the level nearer in height, the landing half way up to the lower one, so that the polygons of one
    level never overlap: the flight that leaves a level and the one that arrives lie side by side.
    """
    assert row.stairs is not None
    stair, stairs = frame.stair, row.stairs
    outward = math.copysign(1.0, row.back_y_m - row.wall_y_m)
    depth_m = abs(row.back_y_m - row.wall_y_m)
    landing_m = depth_m - stair.landing_depth_m - stair.num_treads * stair.tread_depth_m
    lines = [landing_m + i * stair.tread_depth_m for i in range(stair.num_treads + 1)]
    y_m = [_mm(row.wall_y_m + outward * v_m) for v_m in lines]
    lanes = (
        _Span(stairs.low, _mm(stairs.low + stair.flight_width_m)),
        _Span(_mm(stairs.high - stair.flight_width_m), stairs.high),
    )
    up, down = lanes if up_left else lanes[::-1]
    base_m = level * frame.level_height_m
    name = f"{level}/stairwell-{row.id}"

    def add(cell: str, x: _Span, y0: float, y1: float, risers: int, kind: Kind, use: str) -> None:
        height_m = base_m + risers * stair.riser_height_m
        cells.append(_Cell(cell, _rectangle(x.low, y0, x.high, y1), height_m, level, kind, use))

    def join(one: str, other: str, x: _Span, y: float) -> None:
        openings.append(_Opening(one, other, (x.low, y), (x.high, y)))

    add(name, stairs, row.wall_y_m, y_m[0], 0, "floor", "landing")
    door_m = _mm((stairs.low + stairs.high - params.door_width_m) / 2)
    door = _Span(door_m, _mm(door_m + params.door_width_m))
    join(f"{level}/{row.corridor}", name, door, row.wall_y_m)
    if level < num_levels - 1:
        treads = [f"{name}-up-{i + 1:02d}" for i in range(stair.num_treads)]
        for i, tread in enumerate(treads):
            add(tread, up, y_m[i], y_m[i + 1], i + 1, "stairs", "stairs")
            join(treads[i - 1] if i else name, tread, up, y_m[i])
        half = f"{name}-half"
        add(half, stairs, y_m[-1], row.back_y_m, stair.num_treads + 1, "stairs", "stairs")
        join(treads[-1], half, up, y_m[-1])
    if level > 0:
        treads = [f"{name}-down-{i + 1:02d}" for i in range(stair.num_treads)]
        for i, tread in enumerate(treads):
            add(tread, down, y_m[i], y_m[i + 1], -i - 1, "stairs", "stairs")
            join(treads[i - 1] if i else name, tread, down, y_m[i])
        join(treads[-1], f"{level - 1}/stairwell-{row.id}-half", down, y_m[-1])


# From cells and openings to floor polygons.


def _assemble(cells: Sequence[_Cell], openings: Sequence[_Opening]) -> tuple[FloorPolygon, ...]:
    """Cuts the edges of every cell where an opening begins or ends."""
    index = {cell.id: i for i, cell in enumerate(cells)}
    doors: dict[str, list[tuple[Point, Point, int]]] = {cell.id: [] for cell in cells}
    for one, other, a, b in openings:
        doors[one].append((a, b, index[other]))
        doors[other].append((a, b, index[one]))
    return tuple(_polygon(cell, doors[cell.id]) for cell in cells)


def _polygon(cell: _Cell, doors: Sequence[tuple[Point, Point, int]]) -> FloorPolygon:
    rings = [_cut_ring(ring, doors) for ring in (cell.ring, *cell.holes)]
    return FloorPolygon(
        id=cell.id,
        outline_xy_m=np.array(rings[0][0]),
        leads_to=np.array([leads for _, ring_leads in rings for leads in ring_leads]),
        height_m=cell.height_m,
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
        for near, far, leads_to in _doors_on(start, end, doors):
            if near != at:
                points.append(at)
                leads.append(WALL)
            points.append(near)
            leads.append(leads_to)
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
    for a, b, leads_to in doors:
        on_line = a[1 - along] == b[1 - along] == start[1 - along]
        if on_line and low <= min(a[along], b[along]) and max(a[along], b[along]) <= high:
            forward = (b[along] - a[along]) * (end[along] - start[along]) > 0
            found.append((a, b, leads_to) if forward else (b, a, leads_to))
    return sorted(found, key=lambda door: abs(door[0][along] - start[along]))
