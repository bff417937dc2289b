"""Rooms of a laboratory building: rows cut into rooms, repeated with changes, and the doors through thick walls."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pdrbench_lab.papers.woodman2008.lab_stride.plan import Hall, LabParams, RoomRow
from pdrbench_sim.buildings.assembly import Cell, Draft, Pose, Span, draw_door, mm


@dataclass(frozen=True, slots=True)
class Room:
    """One room of a row."""

    span: Span  # along u
    use: str  # "office", "meeting" or "laboratory"
    doors_m: tuple[float, ...]  # lower ends along u of its doors to the corridor
    side_door_m: float | None = None  # lower end along v, from the front wall, of a door to the next room; None without


Layout = tuple[Room, ...]


def draw_layouts(
    rng: np.random.Generator, rows: Sequence[RoomRow], below: Mapping[str, Layout], params: LabParams
) -> dict[str, Layout]:
    """Rooms by row id. A row repeats the level below, or the first row of its shape on its level, or is new.

    Args:
        rng: One draw for every row whatever its length, so that a longer wing has the same rooms and some more.
        rows: Those of the level.
        below: Rooms of the level below.
        params: Sizes and fractions.
    """
    layouts: dict[str, Layout] = {}
    first_of: dict[tuple[object, ...], str] = {}
    for row in rows:
        own = np.random.default_rng(rng.integers(2**63))
        repeats_below, repeats_twin = own.random(2) < (params.same_fraction, params.twin_fraction)
        twin = first_of.setdefault(row.shape, row.id)
        if repeats_below and row.id in below:
            layouts[row.id] = _change(own, below[row.id], row, params)
        elif repeats_twin and twin != row.id:
            layouts[row.id] = _change(own, layouts[twin], row, params)
        else:
            layouts[row.id] = _draw_layout(own, row, params)
    return layouts


def _draw_layout(rng: np.random.Generator, row: RoomRow, params: LabParams) -> Layout:
    pieces = [row.span]
    if row.stairs is not None:
        wall_m = params.partition_m[1]
        pieces = [Span(row.span.low, mm(row.stairs.low - wall_m)), Span(mm(row.stairs.high + wall_m), row.span.high)]
    rooms: list[Room] = []
    for piece in pieces:
        spans = _split(rng, piece, params) if piece.length >= params.office_m[0] else []
        made = [_draw_room(rng, span, params) for span in spans]
        for i in range(len(made) - 1):
            if rng.random() < params.side_door_fraction:
                made[i] = replace(made[i], side_door_m=mm(rng.uniform(0.6, row.depth_m - 0.6 - params.door_m)))
        rooms += made
    return tuple(rooms)


def _split(rng: np.random.Generator, span: Span, params: LabParams) -> list[Span]:
    """Rooms with partitions between them; what is left for the last two is divided evenly."""
    min_m = params.office_m[0]
    spans: list[Span] = []
    low_m = span.low
    while True:
        draw, is_thick = rng.random(2)
        wall_m = rng.uniform(*(params.cupboard_m if is_thick < params.cupboard_fraction else params.partition_m))
        sizes = (
            params.office_m
            if draw < params.office_fraction
            else params.meeting_m
            if draw < params.office_fraction + params.meeting_fraction
            else params.laboratory_m
        )
        width_m = rng.uniform(*sizes)
        left_m = span.high - low_m
        if left_m < 2 * min_m + wall_m:
            return [*spans, Span(low_m, span.high)]
        if left_m - width_m - wall_m < min_m:
            width_m = (left_m - wall_m) / 2
        spans.append(Span(low_m, mm(low_m + width_m)))
        low_m = mm(low_m + width_m + wall_m)


def _draw_room(rng: np.random.Generator, span: Span, params: LabParams) -> Room:
    use = "office" if span.length <= 3.6 else "meeting" if span.length <= 5.4 else "laboratory"
    doors_m: tuple[float, ...] = (draw_door(rng, span, params.door_m),)
    if use == "laboratory" and rng.random() < params.two_doors_fraction:
        middle_m = (span.low + span.high) / 2
        doors_m = (
            draw_door(rng, Span(span.low, middle_m), params.door_m),
            draw_door(rng, Span(middle_m, span.high), params.door_m),
        )
    return Room(span, use, doors_m)


def _change(rng: np.random.Generator, layout: Layout, row: RoomRow, params: LabParams) -> Layout:
    """The same rooms, some with other doors, some joined with the next."""
    rooms: list[Room] = []
    for room in layout:
        if rng.random() >= params.change_fraction:
            rooms.append(room)
            continue
        last = rooms[-1] if rooms else None
        is_next = last is not None and room.span.low - last.span.high <= params.cupboard_m[1]
        if last is not None and is_next and row.stairs is None and last.use == room.use == "office":
            rooms[-1] = _draw_room(rng, Span(last.span.low, room.span.high), params)
            rooms[-1] = replace(rooms[-1], side_door_m=room.side_door_m)
        else:
            rooms.append(replace(_draw_room(rng, room.span, params), side_door_m=room.side_door_m))
    return tuple(rooms)


def add_rows(
    draft: Draft, rows: Sequence[RoomRow], layouts: Mapping[str, Layout], level: int, height_m: float, params: LabParams
) -> None:
    """The rooms of one level with their doors."""
    for row in rows:
        depth = Span(row.gap_m, mm(row.gap_m + row.depth_m))
        layout = layouts[row.id]
        ids = [f"{level}/{row.id}-{number:02d}" for number in range(1, len(layout) + 1)]
        for room, name in zip(layout, ids, strict=True):
            draft.cells.append(Cell(name, row.pose.rectangle(room.span, depth), height_m, level, use=room.use))
            for number, door_m in enumerate(room.doors_m):
                place = Span(door_m, mm(door_m + params.door_m)), Span(0.0, row.gap_m)
                door = Cell(f"{name}-door-{number + 1}", row.pose.rectangle(*place), height_m, level, use="door")
                add_door(draft, door, f"{level}/{row.corridor}", name, row.pose, *place)
        turned = Pose(row.pose.origin, row.pose.across, row.pose.along)
        for room, after, name, other in zip(layout, layout[1:], ids, ids[1:], strict=False):
            if room.side_door_m is not None:
                low_m = mm(row.gap_m + room.side_door_m)
                place = Span(low_m, mm(low_m + params.door_m)), Span(room.span.high, after.span.low)
                door = Cell(f"{name}-side-door", turned.rectangle(*place), height_m, level, use="door")
                add_door(draft, door, name, other, turned, *place)


def add_hall(draft: Draft, hall: Hall, level: int, height_m: float) -> None:
    """A room at the end of a corridor with its door."""
    name = f"{level}/{hall.id}"
    depth = Span(hall.gap_m, mm(hall.gap_m + hall.depth_m))
    draft.cells.append(Cell(name, hall.pose.rectangle(hall.span, depth), height_m, level, use=hall.use))
    add_end_door(draft, hall, level, height_m)


def add_end_door(draft: Draft, hall: Hall, level: int, height_m: float) -> None:
    """The doorway of a hall."""
    place = Span(-hall.door_m / 2, hall.door_m / 2), Span(0.0, hall.gap_m)
    name = f"{level}/{hall.id}"
    door = Cell(f"{name}-door", hall.pose.rectangle(*place), height_m, level, use="door")
    add_door(draft, door, f"{level}/{hall.corridor}", name, hall.pose, *place)


def add_door(draft: Draft, door: Cell, one: str, other: str, pose: Pose, u: Span, v: Span) -> None:
    """A doorway as deep as the wall, open to `one` at the lower end of v and to `other` at the upper end."""
    draft.cells.append(door)
    draft.join(one, door.id, pose, u, v.low)
    draft.join(door.id, other, pose, u, v.high)
