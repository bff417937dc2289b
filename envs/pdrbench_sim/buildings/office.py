"""Procedural office buildings: corridors, rooms with doors, stairwells with real treads.

Every level has the same corridors and stairwells and its own rooms. Main corridors run along x; rows of rooms lie
between them and along the two long facades; cross corridors join the main ones. Walls have no thickness: neighbours
share a line.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from pdrbench.building import Building
from pdrbench.errors import MapError
from pdrbench_sim.buildings.assembly import Cell, Draft, Opening, Pose, Ring, Span, draw_door, gaps, mm, rectangle
from pdrbench_sim.buildings.stairwell import StairParams, StairPlace, StairSize, add_stairwell, draw_stair

AREA_TOLERANCE: Final = 0.005  # wanted floor area is met this closely; the promise is 0.01
MIN_LEVEL_M2: Final = 350.0  # two stairwells, a corridor and some rooms need about this


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
    hall_fraction: float = 0.16  # of the draws of a width
    door_width_m: float = 0.9
    opening_width_m: tuple[float, float] = (2.4, 3.6)  # of open-plan areas, without a door
    open_fraction: float = 0.5  # of the halls
    through_fraction: float = 0.3  # of the inner blocks hold a room that joins both rows
    side_door_fraction: float = 0.12  # of neighbours in a row have a door between them
    same_fraction: float = 0.4  # of row pieces repeat the level below
    core_fraction: float = 0.6  # of large halls have a core, a hole in the floor polygon
    level_height_m: tuple[float, float] = (3.1, 3.7)
    stairs: StairParams = field(default_factory=StairParams)
    metres_per_stairwell: float = 70.0  # of main corridor: 35 m at most to the next one
    num_corridors: int | None = None  # that run along x; None for as many as suit the area
    has_lifts: bool = False  # one beside every stairwell
    lift_m: tuple[float, float] = (1.7, 2.0)  # width and depth of a cabin; for eight to ten people
    lift_door_m: float = 1.0


@dataclass(frozen=True, slots=True)
class _OfficeRow:
    """A strip of rooms between two cross corridors, along one main corridor."""

    id: str  # unique in a level
    span: Span  # where it lies along x
    wall_y_m: float  # the corridor's wall
    back_y_m: float  # facade, or the wall to the row behind
    corridor: str  # id of the corridor without the level
    behind: str = ""  # id of the row that shares the back wall, or ""
    stairs: Span | None = None  # the part of `span` that a stairwell takes, or None


@dataclass(slots=True)
class _OfficeFrame:
    """What all levels share, as it comes about; `up_left` by row is the side on which its stairwell goes up."""

    length_m: float
    crossings: list[Span]
    stair: StairSize
    level_height_m: float
    corridors: list[tuple[str, Ring]] = field(default_factory=list)
    joints: list[Opening] = field(default_factory=list)
    rows: list[_OfficeRow] = field(default_factory=list)
    up_left: list[bool] = field(default_factory=list)


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
    if not level_m2 >= MIN_LEVEL_M2:
        raise MapError(
            f"an office needs {MIN_LEVEL_M2:g} m2 per level; got {level_m2:.0f} m2: ask for more area or fewer levels"
        )
    for _ in range(8):
        drawn = _fit_length(_draw_brief(rng, level_m2, num_levels, params), area_m2, params)
        if drawn is not None:
            return drawn.building(name, ("room", "hall", "corridor"))
    raise MapError(f"no office of {area_m2:g} m2 on {num_levels} levels found; ask for another area")


def _fit_length(brief: _Brief, area_m2: float, params: OfficeParams) -> Draft | None:
    """The building of the wanted area, or None where the number of rooms jumps to and fro around it."""
    length_m = area_m2 / brief.num_levels / _expected_depth_m(brief.num_corridors, params)
    for attempt in range(16):
        if attempt == 8:  # cores come and go with the length; without them the area follows it smoothly
            params = replace(params, core_fraction=0.0)
        drawn = _draw_cells(brief, length_m, params)
        came_m2 = sum(cell.area_m2 for cell in drawn.cells)
        if abs(came_m2 - area_m2) <= AREA_TOLERANCE * area_m2:
            return drawn
        length_m *= area_m2 / came_m2
    return None


def _expected_depth_m(num_corridors: int, params: OfficeParams) -> float:
    row, inner, corridor = (sum(p) / 2 for p in (params.row_depth_m, params.inner_depth_m, params.corridor_width_m))
    return 2 * row + num_corridors * corridor + (num_corridors - 1) * inner


def _draw_brief(rng: np.random.Generator, level_m2: float, num_levels: int, params: OfficeParams) -> _Brief:
    lengths_m = {count: level_m2 / _expected_depth_m(count, params) for count in (1, 2, 3, 4)}
    fitting = (
        [params.num_corridors]
        if params.num_corridors
        else [
            count
            for count, length_m in lengths_m.items()
            if max(24, 1.2 * _expected_depth_m(count, params)) <= length_m <= 95
        ]
        or [min(lengths_m, key=lambda count: abs(math.log(lengths_m[count] / 50)))]
    )
    num_corridors = int(rng.choice(fitting))
    length_m = lengths_m[num_corridors]
    num_crossings = max(1, round(length_m / rng.uniform(22, 40)))
    if num_corridors > 1 and length_m > 30:
        num_crossings = max(2, num_crossings)
    num_stairwells = max(2, math.ceil(length_m * num_corridors / params.metres_per_stairwell))
    return _Brief(num_corridors, num_crossings, num_stairwells, num_levels, int(rng.integers(2**62)))


def _draw_cells(brief: _Brief, length_m: float, params: OfficeParams) -> Draft:
    """All cells of a building of this length; the same draws whatever the length, as far as numbers of rooms allow."""
    frame_rng, *level_rngs = (np.random.default_rng([brief.seed, i]) for i in range(brief.num_levels + 1))
    frame = _draw_frame(frame_rng, brief, length_m, params)
    draft, split = Draft(), dict[str, list[Span]]()
    for level, rng in enumerate(level_rngs):
        height_m = level * frame.level_height_m
        draft.cells.extend(
            Cell(f"{level}/{name}", ring, height_m, level, use="corridor") for name, ring in frame.corridors
        )
        draft.openings.extend(Opening(f"{level}/{one}", f"{level}/{other}", a, b) for one, other, a, b in frame.joints)
        split = {row.id: _split_row(rng, row, split.get(row.id), params) for row in frame.rows}
        _add_rooms(rng, draft, frame.rows, split, level, height_m, params)
        for row, up_left in zip(frame.rows, frame.up_left, strict=True):
            if row.stairs is not None:
                _add_stairwell(draft, frame, row, up_left, level, brief.num_levels, params)
    return draft


# The frame: corridors, rows, stairwells.


def _draw_frame(rng: np.random.Generator, brief: _Brief, length_m: float, params: OfficeParams) -> _OfficeFrame:
    level_height_m = mm(rng.uniform(*params.level_height_m))
    stair = draw_stair(rng, level_height_m, params.stairs)
    crossings = _draw_crossings(rng, brief.num_crossings, length_m, params)
    frame = _OfficeFrame(length_m, crossings, stair, level_height_m)
    _add_rows(rng, frame, brief.num_corridors, params)
    if params.has_lifts:
        wider = replace(stair, width_m=mm(stair.width_m + params.lift_m[0]))
        min_room_m = params.room_width_m[0]
        frame.rows = _place_stairs(rng, frame.rows, brief.num_stairwells, wider, length_m, min_room_m)
    else:
        frame.rows = _place_stairs(rng, frame.rows, brief.num_stairwells, stair, length_m)
    frame.up_left = [bool(rng.random() < 0.5) for _ in frame.rows]
    return frame


def _draw_crossings(rng: np.random.Generator, count: int, length_m: float, params: OfficeParams) -> list[Span]:
    """Where cross corridors lie: spread evenly, then shifted by up to a quarter of their distance."""
    pitch_m = length_m / count
    spans = []
    for crossing in range(count):
        centre_m = pitch_m * (crossing + 0.5 + rng.uniform(-0.25, 0.25))
        width_m = rng.uniform(*params.corridor_width_m)
        spans.append(Span(mm(centre_m - width_m / 2), mm(centre_m + width_m / 2)))
    return spans


def _add_rows(rng: np.random.Generator, frame: _OfficeFrame, num_corridors: int, params: OfficeParams) -> None:
    """Main corridors upwards from y = 0, the rows beside them and the cross corridors between them."""
    sides: list[tuple[float, float]] = []
    y_m = 0.0
    for index in range(num_corridors):
        top_m = mm(y_m + rng.uniform(*params.corridor_width_m))
        frame.corridors.append((f"corridor-{index + 1}", rectangle(0.0, y_m, mm(frame.length_m), top_m)))
        sides.append((y_m, top_m))
        y_m = mm(top_m + max(rng.uniform(*params.inner_depth_m), frame.stair.depth_m + params.row_depth_m[0] - 0.6))
    for index in range(num_corridors - 1):
        _add_inner_block(rng, frame, index, sides)
    for corridor, side_m, outward in ((1, sides[0][0], -1.0), (num_corridors, sides[-1][1], 1.0)):
        _add_outer_block(rng, frame, corridor, side_m, outward, params)


def _add_inner_block(
    rng: np.random.Generator, frame: _OfficeFrame, index: int, sides: Sequence[tuple[float, float]]
) -> None:
    """Two rows back to back between main corridors `index` and `index + 1`, and the cross corridors through them."""
    low_m, high_m = sides[index][1], sides[index + 1][0]
    below, above = f"corridor-{index + 1}", f"corridor-{index + 2}"
    for number, cross in enumerate(frame.crossings):
        name = f"cross-{index + 1}{number + 1}"
        frame.corridors.append((name, rectangle(cross.low, low_m, cross.high, high_m)))
        frame.joints.append(Opening(below, name, (cross.low, low_m), (cross.high, low_m)))
        frame.joints.append(Opening(above, name, (cross.low, high_m), (cross.high, high_m)))
    for number, span in enumerate(gaps(frame.crossings, mm(frame.length_m))):
        # One of the two rows is deep enough for a stairwell.
        deep_m = max(frame.stair.depth_m + 0.1, (high_m - low_m) * rng.uniform(0.5, 0.6))
        split_m = mm(low_m + deep_m if rng.random() < 0.5 else high_m - deep_m)
        south, north = f"inner-{index + 1}{number + 1}s", f"inner-{index + 1}{number + 1}n"
        frame.rows.append(_OfficeRow(south, span, low_m, split_m, below, behind=north))
        frame.rows.append(_OfficeRow(north, span, high_m, split_m, above, behind=south))


def _add_outer_block(
    rng: np.random.Generator, frame: _OfficeFrame, corridor: int, side_m: float, outward: float, params: OfficeParams
) -> None:
    """Rows of different depth along a facade; some cross corridors reach it."""
    facing = "s" if outward < 0 else "n"
    through = [cross for cross in frame.crossings if rng.random() < 0.5]
    for number, cross in enumerate(through):
        name = f"exit-{facing}{number + 1}"
        depth_m = rng.uniform(*params.row_depth_m)
        frame.corridors.append((name, rectangle(cross.low, side_m, cross.high, mm(side_m + outward * depth_m))))
        frame.joints.append(Opening(f"corridor-{corridor}", name, (cross.low, side_m), (cross.high, side_m)))
    for number, span in enumerate(gaps(through, mm(frame.length_m))):
        depth_m = rng.uniform(*params.row_depth_m)
        back_m = mm(side_m + outward * depth_m)
        frame.rows.append(_OfficeRow(f"outer-{facing}{number + 1}", span, side_m, back_m, f"corridor-{corridor}"))


def _place_stairs(
    rng: np.random.Generator,
    rows: Sequence[_OfficeRow],
    count: int,
    stair: StairSize,
    length_m: float,
    min_room_m: float = 0.0,
) -> list[_OfficeRow]:
    """Gives `count` rows a stairwell, spread along x; an outer row that is too shallow gets deeper.

    Rows in which it would leave less than `min_room_m`, but not nothing, get none.
    """
    placed = list(rows)
    for number in range(count):
        wanted_m = length_m * (number + rng.uniform(0.25, 0.75)) / count
        free = [
            i
            for i in rng.permutation(len(placed))
            if placed[i].stairs is None
            and placed[i].span.length >= stair.width_m
            and not 0 < mm(placed[i].span.length - stair.width_m) < min_room_m
            and (not placed[i].behind or abs(placed[i].back_y_m - placed[i].wall_y_m) >= stair.depth_m)
        ]
        if not free:
            raise MapError(f"an office {length_m:.0f} m long has no place for {count} stairwells; ask for more area")
        best = min(free, key=lambda i: _distance_m(placed[i].span, wanted_m))
        placed[best] = _with_stairs(rng, placed[best], wanted_m, stair)
    return placed


def _with_stairs(rng: np.random.Generator, row: _OfficeRow, wanted_m: float, stair: StairSize) -> _OfficeRow:
    low_m = min(max(wanted_m - stair.width_m / 2, row.span.low), row.span.high - stair.width_m)
    # No sliver beside the stairwell: a room there is at least 2.7 m wide.
    if low_m - row.span.low < 2.7:
        low_m = row.span.low
    elif row.span.high - stair.width_m - low_m < 2.7:
        low_m = row.span.high - stair.width_m
    back_y_m = row.back_y_m
    if abs(back_y_m - row.wall_y_m) < stair.depth_m:
        back_y_m = mm(row.wall_y_m + math.copysign(stair.depth_m + rng.uniform(0, 0.6), back_y_m - row.wall_y_m))
    return replace(row, back_y_m=back_y_m, stairs=Span(mm(low_m), mm(low_m + stair.width_m)))


def _distance_m(span: Span, x_m: float) -> float:
    return max(span.low - x_m, x_m - span.high, 0.0)


# One level: corridors, rooms, doors, stairs.


def _split_row(rng: np.random.Generator, row: _OfficeRow, below: list[Span] | None, params: OfficeParams) -> list[Span]:
    """Cuts what a stairwell leaves of a row into rooms, or repeats the level below."""
    if below is not None and rng.random() < params.same_fraction:
        return below
    pieces = [row.span]
    if row.stairs is not None:
        pieces = [Span(row.span.low, row.stairs.low), Span(row.stairs.high, row.span.high)]
    return [room for piece in pieces if piece.length > 0 for room in split_span(rng, piece, params)]


def split_span(rng: np.random.Generator, span: Span, params: OfficeParams) -> list[Span]:
    """Rooms and halls side by side."""
    rooms = []
    low_m = span.low
    while span.high - low_m > params.room_width_m[1]:
        is_hall = rng.random() < params.hall_fraction
        width_m = rng.uniform(*(params.hall_width_m if is_hall else params.room_width_m))
        if span.high - low_m - width_m < params.room_width_m[0]:
            break
        rooms.append(Span(low_m, mm(low_m + width_m)))
        low_m = rooms[-1].high
    return [*rooms, Span(low_m, span.high)]


def _add_rooms(
    rng: np.random.Generator,
    draft: Draft,
    rows: Sequence[_OfficeRow],
    split: dict[str, list[Span]],
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
            joined = next((cell for cell in draft.cells if cell.id == ids[-1]), None)
            ring = rectangle(span.low, row.wall_y_m, span.high, row.back_y_m)
            if joined is None:
                use = "hall" if is_hall or (row.id, index) in through else "room"
                draft.cells.append(Cell(ids[-1], ring, height_m, level, use=use))
            else:
                joined.ring = _join_rings(joined.ring, ring)
            if is_hall and (row.id, index) not in through:
                draft.cells[-1].holes = _draw_core(rng, span, row, params)
            _add_doors(rng, draft, ids[-1], span, row, level, params)
        _add_side_doors(rng, draft, dict(zip(ids, split[row.id], strict=True)), row, params)


def _draw_through_rooms(
    rng: np.random.Generator, rows: Sequence[_OfficeRow], split: dict[str, list[Span]], params: OfficeParams
) -> dict[tuple[str, int], str]:
    """Names by (row, index) of rooms that join two rows back to back."""
    names: dict[tuple[str, int], str] = {}
    for row in rows:
        if not row.id.endswith("s") or not row.behind or rng.random() >= params.through_fraction:
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


def _draw_core(rng: np.random.Generator, span: Span, row: _OfficeRow, params: OfficeParams) -> list[Ring]:
    """A core (lift shaft, copy room) in the middle of a large hall, with 1.3 m or more around it."""
    depth_m = abs(row.back_y_m - row.wall_y_m)
    if depth_m < 4.4 or rng.random() >= params.core_fraction:
        return []
    half_x_m = rng.uniform(0.8, min(2.2, span.length / 2 - 1.6))
    half_y_m = rng.uniform(0.5, depth_m / 2 - 1.6)
    x_m = (span.low + span.high) / 2 + rng.uniform(-0.3, 0.3)
    y_m = (row.wall_y_m + row.back_y_m) / 2
    ring = rectangle(mm(x_m - half_x_m), mm(y_m - half_y_m), mm(x_m + half_x_m), mm(y_m + half_y_m))
    return [ring[::-1]]


def _add_doors(
    rng: np.random.Generator, draft: Draft, room: str, span: Span, row: _OfficeRow, level: int, params: OfficeParams
) -> None:
    """One door to the corridor; halls have two, or a wide opening."""
    corridor = f"{level}/{row.corridor}"
    parts = [(span, params.door_width_m)]
    if span.length >= params.hall_width_m[0]:
        middle_m = (span.low + span.high) / 2
        parts = [(Span(span.low, middle_m), params.door_width_m), (Span(middle_m, span.high), params.door_width_m)]
        if rng.random() < params.open_fraction:
            parts = [(span, rng.uniform(*params.opening_width_m))]
    for part, width_m in parts:
        low_m = draw_door(rng, part, width_m)
        a, b = (low_m, row.wall_y_m), (mm(low_m + width_m), row.wall_y_m)
        draft.openings.append(Opening(corridor, room, a, b))


def _add_side_doors(
    rng: np.random.Generator, draft: Draft, rooms: Mapping[str, Span], row: _OfficeRow, params: OfficeParams
) -> None:
    """Doors between some neighbours in a row."""
    low_y, high_y = sorted((row.wall_y_m, row.back_y_m))
    for (one, left), (other, right) in itertools.pairwise(rooms.items()):
        if rng.random() >= params.side_door_fraction or left.high != right.low:
            continue
        y_m = mm(rng.uniform(low_y + 0.6, high_y - 0.6 - params.door_width_m))
        draft.openings.append(Opening(one, other, (left.high, y_m), (left.high, mm(y_m + params.door_width_m))))


def _add_stairwell(
    draft: Draft, frame: _OfficeFrame, row: _OfficeRow, up_left: bool, level: int, num_levels: int, params: OfficeParams
) -> None:
    """The stairwell of a row with its door to the corridor, and the lift beside it, where there are lifts."""
    assert row.stairs is not None
    outward = math.copysign(1.0, row.back_y_m - row.wall_y_m)
    pose = Pose((0.0, row.wall_y_m), across=(0.0, outward))
    name = f"stairwell-{row.id}"
    span = Span(row.stairs.low, mm(row.stairs.high - params.lift_m[0])) if params.has_lifts else row.stairs
    place = StairPlace(name, pose, span, abs(row.back_y_m - row.wall_y_m), up_left)
    add_stairwell(draft, frame.stair, place, level, num_levels, frame.level_height_m)
    draft.join(f"{level}/{row.corridor}", f"{level}/{name}", pose, span.middle(params.door_width_m), 0.0)
    if params.has_lifts:
        lift, cabin = f"{level}/lift-{row.id}", Span(span.high, row.stairs.high)
        ring = pose.rectangle(cabin, Span(0.0, params.lift_m[1]))
        draft.cells.append(Cell(lift, ring, level * frame.level_height_m, level, "lift", "lift"))
        draft.join(f"{level}/{row.corridor}", lift, pose, cabin.middle(params.lift_door_m), 0.0)
