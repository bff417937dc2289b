"""Procedural buildings of rows of rooms in any direction: a corridor round a block or a court, wings round a hall.

Levels share corridors, halls, stairwells and lifts, and have rooms of their own. Walls have no thickness: neighbours
share a line. Sizes of rooms, doors and stairs are those of offices.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from pdrbench.building import Building
from pdrbench_sim.buildings.assembly import Cell, Draft, Opening, Point, Pose, Ring, Span, draw_door, mm, rectangle
from pdrbench_sim.buildings.office import OfficeParams, split_span
from pdrbench_sim.buildings.stairwell import StairPlace, StairSize, add_stairwell, draw_stair

MIN_ROOM_M: Final = 2.7  # beside a stairwell; as `OfficeParams.room_width_m`
USES: Final = ("room", "hall", "corridor")


@dataclass(frozen=True, slots=True)
class RingParams:
    """Sizes of a ring floor; ranges of a uniform draw, ours."""

    long_m: tuple[float, float] = (30.0, 50.0)  # of what the corridor encloses
    block_m: tuple[float, float] = (13.0, 18.0)  # across, of two rows of rooms back to back, or of a court
    court_fraction: float = 0.4  # of the buildings enclose a court
    office: OfficeParams = field(default_factory=OfficeParams)


@dataclass(frozen=True, slots=True)
class WingParams:
    """Sizes of wings round a hall; ranges of a uniform draw, ours."""

    hall_m: tuple[tuple[float, float], tuple[float, float]] = ((18.0, 30.0), (16.0, 24.0))
    wing_m: tuple[float, float] = (20.0, 36.0)  # length
    third_fraction: float = 0.5  # of the buildings have a wing to the north besides those to the west and east
    atrium_fraction: float = 0.6  # of the halls are open up to the roof: galleries round a void on upper levels
    gallery_m: float = 3.0  # width
    kiosk_m: tuple[float, float] = (1.0, 3.5)  # a side: pillars, desks, a lift shaft of glass
    max_kiosks: int = 3
    office: OfficeParams = field(default_factory=OfficeParams)


@dataclass(frozen=True, slots=True)
class _Row:
    """A strip of rooms along a corridor."""

    id: str  # unique in a level
    pose: Pose  # u runs along the fronts, v away from the corridor
    span: Span  # of the u axis
    front: Span  # part of it that faces the corridor
    depth_m: float
    space: str  # id of the corridor without the level
    stairs: Span | None = None  # what a stairwell and its lift take
    up_left: bool = False


@dataclass(frozen=True, slots=True)
class _Space:
    """A corridor or a hall."""

    id: str
    ring: Ring
    use: str
    holes: tuple[Ring, ...] = ()  # on every level
    void: Ring | None = None  # on upper levels


@dataclass(slots=True)
class _Frame:
    """What all levels share, as it comes about."""

    stair: StairSize
    level_height_m: float
    spaces: list[_Space] = field(default_factory=list)
    joints: list[Opening] = field(default_factory=list)  # of spaces, ids without the level
    rows: list[_Row] = field(default_factory=list)


def make_ring_floors(rng: np.random.Generator, *, num_levels: int = 3, name: str = "ring") -> Building:
    """Draws a building whose corridors are loops.

    Args:
        rng: Two buildings from generators in the same state are equal byte for byte.
        num_levels: Levels 0 to num_levels - 1.
        name: Name of the building.
    """
    params = RingParams()
    frame_rng, *level_rngs = rng.spawn(num_levels + 1)
    return _built(_ring_frame(frame_rng, params), level_rngs, name, params.office)


def make_wings(rng: np.random.Generator, *, num_levels: int = 3, name: str = "wings") -> Building:
    """Draws a building of two or three wings round a hall; arguments as for `make_ring_floors`."""
    params = WingParams()
    frame_rng, *level_rngs = rng.spawn(num_levels + 1)
    return _built(_wing_frame(frame_rng, params), level_rngs, name, params.office)


def _new_frame(rng: np.random.Generator, office: OfficeParams) -> _Frame:
    level_height_m = mm(rng.uniform(*office.level_height_m))
    return _Frame(draw_stair(rng, level_height_m, office.stairs), level_height_m)


# A corridor round a block.


def _ring_frame(rng: np.random.Generator, params: RingParams) -> _Frame:
    office = params.office
    frame = _new_frame(rng, office)
    west_m, east_m, south_m, north_m = (mm(rng.uniform(*office.row_depth_m)) for _ in range(4))
    south_m, north_m = (max(depth_m, mm(frame.stair.depth_m)) for depth_m in (south_m, north_m))
    way_m = mm(rng.uniform(*office.corridor_width_m))
    loop_x = Span(west_m, mm(west_m + rng.uniform(*params.long_m) + 2 * way_m))
    loop_y = Span(south_m, mm(south_m + rng.uniform(*params.block_m) + 2 * way_m))
    inner_x, inner_y = (Span(mm(span.low + way_m), mm(span.high - way_m)) for span in (loop_x, loop_y))
    loop = rectangle(loop_x.low, loop_y.low, loop_x.high, loop_y.high)
    block = rectangle(inner_x.low, inner_y.low, inner_x.high, inner_y.high)
    frame.spaces.append(_Space("corridor", loop, "corridor", holes=(block[::-1],)))
    whole_x = Span(0.0, mm(loop_x.high + east_m))
    south, north = Pose((0.0, loop_y.low), across=(0.0, -1.0)), Pose((0.0, loop_y.high))
    west, east = Pose((loop_x.low, 0.0), (0.0, 1.0), (-1.0, 0.0)), Pose((loop_x.high, 0.0), (0.0, 1.0), (1.0, 0.0))
    frame.rows += [
        _with_stairs(rng, frame, _Row("south", south, whole_x, loop_x, south_m, "corridor"), office),
        _with_stairs(rng, frame, _Row("north", north, whole_x, loop_x, north_m, "corridor"), office),
        _Row("west", west, loop_y, loop_y, west_m, "corridor"),
        _Row("east", east, loop_y, loop_y, east_m, "corridor"),
    ]
    if rng.random() >= params.court_fraction:
        back_m = mm(inner_y.low + inner_y.length * rng.uniform(0.4, 0.6))
        below, above = Pose((0.0, inner_y.low)), Pose((0.0, inner_y.high), across=(0.0, -1.0))
        frame.rows += [
            _Row("inner-s", below, inner_x, inner_x, mm(back_m - inner_y.low), "corridor"),
            _Row("inner-n", above, inner_x, inner_x, mm(inner_y.high - back_m), "corridor"),
        ]
    return frame


# Wings round a hall.


def _wing_frame(rng: np.random.Generator, params: WingParams) -> _Frame:
    frame = _new_frame(rng, params.office)
    long_m, wide_m = (mm(rng.uniform(*side)) for side in params.hall_m)
    is_atrium = bool(rng.random() < params.atrium_fraction)
    rail_m = params.gallery_m
    void = rectangle(rail_m, rail_m, mm(long_m - rail_m), mm(wide_m - rail_m))
    holes = () if is_atrium else tuple(_kiosks(rng, long_m, wide_m, params))
    hall = rectangle(0.0, 0.0, long_m, wide_m)
    frame.spaces.append(_Space("hall", hall, "hall", holes, void[::-1] if is_atrium else None))
    sides: list[tuple[str, Point, Point, Point, float]] = [
        ("west", (0.0, 0.0), (-1.0, 0.0), (0.0, 1.0), wide_m),
        ("east", (long_m, 0.0), (1.0, 0.0), (0.0, 1.0), wide_m),
    ]
    if rng.random() < params.third_fraction:
        sides.append(("north", (0.0, wide_m), (0.0, 1.0), (1.0, 0.0), long_m))
    for name, corner, away, along, side_m in sides:
        _add_wing(rng, frame, name, Pose(corner, away, along), side_m, params)
    return frame


def _kiosks(rng: np.random.Generator, long_m: float, wide_m: float, params: WingParams) -> list[Ring]:
    """What stands in a hall, in places of its own along it."""
    count = int(rng.integers(params.max_kiosks + 1))
    pitch_m = long_m / (count + 1)
    found = []
    for number in range(count):
        x_m, y_m = pitch_m * (number + 1), wide_m * rng.uniform(0.3, 0.7)
        half_x_m, half_y_m = rng.uniform(*params.kiosk_m, size=2) / 2
        found.append(rectangle(mm(x_m - half_x_m), mm(y_m - half_y_m), mm(x_m + half_x_m), mm(y_m + half_y_m))[::-1])
    return found


def _add_wing(
    rng: np.random.Generator, frame: _Frame, name: str, pose: Pose, side_m: float, params: WingParams
) -> None:
    """A corridor away from the hall, whose side lies along v, with rows of rooms on both sides; one has stairs."""
    office = params.office
    length_m, way_m = mm(rng.uniform(*params.wing_m)), mm(rng.uniform(*office.corridor_width_m))
    low_m = mm((side_m - way_m) * rng.uniform(0.4, 0.6))
    way = Span(low_m, mm(low_m + way_m))
    frame.spaces.append(_Space(name, pose.rectangle(Span(0.0, length_m), way), "corridor"))
    frame.joints.append(Opening("hall", name, pose.point(0.0, way.low), pose.point(0.0, way.high)))
    span = Span(0.0, length_m)
    has_stairs = int(rng.integers(2))
    for number, (edge_m, sign) in enumerate(((way.low, -1.0), (way.high, 1.0))):
        across = (sign * pose.across[0], sign * pose.across[1])
        depth_m = mm(rng.uniform(*office.row_depth_m))
        row = _Row(f"{name}-{number}", Pose(pose.point(0.0, edge_m), pose.along, across), span, span, depth_m, name)
        frame.rows.append(_with_stairs(rng, frame, row, office) if number == has_stairs else row)


# Rows: stairwells, rooms, doors.


def _with_stairs(rng: np.random.Generator, frame: _Frame, row: _Row, office: OfficeParams) -> _Row:
    """The row with a stairwell and a lift somewhere in its front, and deep enough for them."""
    wide_m = mm(frame.stair.width_m + office.lift_m[0])
    low_m = mm(row.front.low + rng.uniform(MIN_ROOM_M, row.front.length - wide_m - MIN_ROOM_M))
    depth_m = max(row.depth_m, mm(frame.stair.depth_m))
    return replace(row, depth_m=depth_m, stairs=Span(low_m, mm(low_m + wide_m)), up_left=bool(rng.random() < 0.5))


def _built(frame: _Frame, level_rngs: list[np.random.Generator], name: str, office: OfficeParams) -> Building:
    draft = Draft()
    for level, rng in enumerate(level_rngs):
        height_m = level * frame.level_height_m
        for space in frame.spaces:
            holes = [*space.holes, *([space.void] if space.void and level else [])]
            draft.cells.append(Cell(f"{level}/{space.id}", space.ring, height_m, level, use=space.use, holes=holes))
        draft.openings.extend(Opening(f"{level}/{one}", f"{level}/{other}", a, b) for one, other, a, b in frame.joints)
        for row in frame.rows:
            _add_rooms(rng, draft, row, level, height_m, office)
            if row.stairs is not None:
                _add_stairs(draft, frame, row, level, len(level_rngs), office)
    return draft.building(name, USES)


def _add_rooms(
    rng: np.random.Generator, draft: Draft, row: _Row, level: int, height_m: float, office: OfficeParams
) -> None:
    pieces = [row.front]
    if row.stairs is not None:
        pieces = [Span(row.front.low, row.stairs.low), Span(row.stairs.high, row.front.high)]
    fronts = [front for piece in pieces for front in split_span(rng, piece, office)]
    for number, front in enumerate(fronts):
        room, is_hall = f"{level}/{row.id}-{number:02d}", front.length >= office.hall_width_m[0]
        # The rooms at the ends reach past the corners of the corridor.
        span = Span(row.span.low if not number else front.low, row.span.high if front is fronts[-1] else front.high)
        ring = row.pose.rectangle(span, Span(0.0, row.depth_m))
        draft.cells.append(Cell(room, ring, height_m, level, use="hall" if is_hall else "room"))
        is_open = is_hall and rng.random() < office.open_fraction
        width_m = mm(rng.uniform(*office.opening_width_m)) if is_open else office.door_width_m
        low_m = draw_door(rng, front, width_m)
        draft.join(f"{level}/{row.space}", room, row.pose, Span(low_m, mm(low_m + width_m)), 0.0)


def _add_stairs(draft: Draft, frame: _Frame, row: _Row, level: int, num_levels: int, office: OfficeParams) -> None:
    """The stairwell of a row with its door, and the lift beside it."""
    assert row.stairs is not None
    name, lift = f"stairwell-{row.id}", f"{level}/lift-{row.id}"
    span = Span(row.stairs.low, mm(row.stairs.high - office.lift_m[0]))
    place = StairPlace(name, row.pose, span, row.depth_m, row.up_left)
    add_stairwell(draft, frame.stair, place, level, num_levels, frame.level_height_m)
    draft.join(f"{level}/{row.space}", f"{level}/{name}", row.pose, span.middle(office.door_width_m), 0.0)
    cabin = Span(span.high, row.stairs.high)
    ring = row.pose.rectangle(cabin, Span(0.0, office.lift_m[1]))
    draft.cells.append(Cell(lift, ring, level * frame.level_height_m, level, "lift", "lift"))
    draft.join(f"{level}/{row.space}", lift, row.pose, cabin.middle(office.lift_door_m), 0.0)
