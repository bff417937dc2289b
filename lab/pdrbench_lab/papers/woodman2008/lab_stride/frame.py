"""Draws the plan of a laboratory building: a street, wings on both sides of it, stairwells, a theatre at one end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np

from pdrbench_lab.papers.woodman2008.lab_stride.plan import (
    ALL_LEVELS,
    TOP_LEVEL,
    Corridor,
    Hall,
    Joint,
    LabParams,
    Plan,
    RoomRow,
    Stairwell,
    Theatre,
)
from pdrbench_sim.buildings.assembly import Pose, Span, gaps, mm, rectangle
from pdrbench_sim.buildings.stairwell import StairPlace, StairSize, draw_stair

TRACKED_M: Final = (15.0, 20.0)  # length of what the ultrasonic system of the paper covers, as Fig. 9 shows it
FLOOR_FRACTION: Final = 0.75  # of a wing within its facades, roughly; a wrong one takes more rounds to the wanted area

End = Literal["open", "hall", "link"]


@dataclass(frozen=True, slots=True)
class _Section:
    """Across a wing: rooms a, strip, corridor, strip, rooms b."""

    corridor_m: float
    strips_m: tuple[float, float]
    depths_m: tuple[float, float]

    @property
    def halves_m(self) -> tuple[float, float]:
        """From the middle of the corridor to the outer faces of the rooms a and b."""
        a, b = (self.corridor_m / 2 + s + d for s, d in zip(self.strips_m, self.depths_m, strict=True))
        return mm(a), mm(b)


@dataclass(frozen=True, slots=True)
class _StreetSide:
    """One side of the street; `outward` is the direction of its wings along y, `length_m` that of a whole wing."""

    name: str
    outward: float
    section: _Section
    num_wings: int
    length_m: float
    end: End


@dataclass(frozen=True, slots=True)
class _Wing:
    """A wing. In its frame u = 0 is the edge of the street and v = 0 the middle of the corridor; rooms a have v > 0."""

    id: str  # without the level
    side: _StreetSide  # of the street
    pose: Pose  # of the frame
    outer: Span  # what it takes of the street, facades included
    length_m: float  # of its corridor, or of corridor and hall
    end: End  # what its corridor leads to
    stairs: bool = False  # whether a stairwell stands behind its end
    top: int = TOP_LEVEL  # highest level


def draw_plan(rng: np.random.Generator, length_m: float, params: LabParams) -> Plan:
    """A plan with wings about so long; the same draws whatever the length."""
    level_height_m = mm(rng.uniform(*params.level_height_m))
    plan = Plan(level_height_m, draw_stair(rng, level_height_m, params.stairs))
    street_m = 2 * mm(rng.uniform(*params.street_m) / 2)
    sides = _draw_sides(rng, length_m, params)
    margin_m, court_m = rng.uniform(*params.margin_m), rng.uniform(*params.court_m)
    total_m = mm(max(_side_m(side, court_m, params) for side in sides) + 2 * margin_m)
    wings = [wing for side in sides for wing in _draw_wings(rng, side, total_m, street_m, margin_m, params)]
    wings = _vary(rng, wings, params)
    for wing in wings:
        _add_wing(rng, plan, wing, params)
    for side in sides:
        if side.end == "link":
            _add_link(rng, plan, side, [wing for wing in wings if wing.side is side], params)
    _add_street(rng, plan, wings, total_m, street_m, params)
    _add_ends(rng, plan, total_m, params)
    _add_tracked(rng, plan, wings)
    return plan


# Wings.


def _draw_sides(rng: np.random.Generator, length_m: float, params: LabParams) -> tuple[_StreetSide, _StreetSide]:
    """Two sides: often equal, so that the building is symmetric; else another number, section or length of wings."""
    section = _draw_section(rng, params)
    counts = [(4, 4), (4, 5), (5, 4), (5, 5)][int(rng.integers(4))]
    ends: list[End] = ["hall" if rng.random() < params.end_hall_fraction else "open" for _ in range(2)]
    if rng.random() < params.link_fraction:
        ends[int(rng.integers(2))] = "link"
    elif rng.random() < 0.5:
        ends[1] = ends[0]
    other, ratio = section, 1.0
    if rng.random() < params.unequal_fraction:
        other, ratio = _draw_section(rng, params), float(rng.uniform(*params.length_ratio))
    return (
        _StreetSide("n", 1.0, section, counts[0], length_m, ends[0]),
        _StreetSide("s", -1.0, other, counts[1], length_m * ratio, ends[1]),
    )


def _draw_section(rng: np.random.Generator, params: LabParams) -> _Section:
    strip_m = mm(rng.uniform(*params.strip_m))
    return _Section(
        corridor_m=2 * mm(rng.uniform(*params.corridor_m) / 2),
        strips_m=(strip_m, strip_m if rng.random() < 0.6 else mm(rng.uniform(*params.strip_m))),
        depths_m=(mm(rng.uniform(*params.depth_m)), mm(rng.uniform(*params.depth_m))),
    )


def _wing_m(side: _StreetSide, params: LabParams) -> float:
    """Width of a wing with its facades."""
    return sum(side.section.halves_m) + 2 * params.wall_m


def _side_m(side: _StreetSide, court_m: float, params: LabParams) -> float:
    return side.num_wings * (_wing_m(side, params) + court_m) - court_m


def _draw_wings(
    rng: np.random.Generator, side: _StreetSide, total_m: float, street_m: float, margin_m: float, params: LabParams
) -> list[_Wing]:
    """Wings spread evenly along the street, all alike or every second one mirrored."""
    width_m = _wing_m(side, params)
    pitch_m = (total_m - 2 * margin_m - width_m) / (side.num_wings - 1)
    is_mirrored, alternates = rng.random() < 0.5, rng.random() < 0.4
    wings = []
    for number in range(side.num_wings):
        flip = is_mirrored ^ (alternates and number % 2 == 1)
        a_m, b_m = side.section.halves_m
        low_m = margin_m + number * pitch_m
        middle_m = mm(low_m + params.wall_m + (a_m if flip else b_m))
        pose = Pose((middle_m, side.outward * street_m / 2), (0.0, side.outward), (-1.0 if flip else 1.0, 0.0))
        outer = Span(mm(low_m), mm(low_m + width_m))
        wings.append(_Wing(f"wing-{side.name}{number + 1}", side, pose, outer, mm(side.length_m), side.end))
    return wings


def _vary(rng: np.random.Generator, wings: list[_Wing], params: LabParams) -> list[_Wing]:
    """Some wings that differ: shorter, lower, or with stairs at their end; one or more stay as they are."""
    _, *free = rng.permutation([wing.id for wing in wings if wing.side.end != "link"])
    short = rng.choice(free) if rng.random() < params.short_fraction else ""
    low = rng.choice(free) if rng.random() < params.low_fraction else ""
    stairs = set(rng.choice(free, 2)) if rng.random() < params.end_stairs_fraction else set()
    varied = []
    for wing in wings:
        length_m = mm(wing.length_m * params.short_length) if wing.id == short else wing.length_m
        has_stairs = wing.id in stairs and wing.id not in (short, low)
        end: End = "open" if has_stairs else wing.end
        top = TOP_LEVEL - 1 if wing.id == low else TOP_LEVEL
        varied.append(replace(wing, length_m=length_m, stairs=has_stairs, end=end, top=top))
    return varied


def _add_wing(rng: np.random.Generator, plan: Plan, wing: _Wing, params: LabParams) -> None:
    """The corridor, the two rows of rooms and what stands at the end."""
    half_m = wing.side.section.corridor_m / 2
    corridor = f"{wing.id}-corridor"
    hall_m, partition_m = mm(rng.uniform(*params.hall_m)), mm(rng.uniform(*params.partition_m))
    end_m = mm(wing.length_m - hall_m - partition_m) if wing.end == "hall" else wing.length_m
    last_m = mm(end_m - params.wall_m) if wing.end == "link" else end_m
    across = Span(-half_m, half_m)
    plan.corridors.append(Corridor(corridor, wing.pose.rectangle(Span(0.0, end_m), across), wing.top))
    plan.joints.append(Joint("street", corridor, _turned(wing.pose), across, 0.0, wing.top))
    for row, sign, strip_m, depth_m in zip(
        "ab", (1.0, -1.0), wing.side.section.strips_m, wing.side.section.depths_m, strict=True
    ):
        outward = (sign * wing.pose.across[0], 0.0)
        pose = Pose(wing.pose.point(0.0, sign * half_m), wing.pose.along, outward)
        span = Span(params.wall_m, last_m)
        plan.rows.append(RoomRow(f"{wing.id}{row}", corridor, pose, span, strip_m, depth_m, top=wing.top))
    a_m, b_m = wing.side.section.halves_m
    end_pose = _turned(replace(wing.pose, origin=wing.pose.point(end_m, 0.0)))
    if wing.end == "hall":
        span, levels = Span(-b_m, a_m), tuple(range(wing.top + 1))
        use = str(rng.choice(["laboratory", "meeting"]))
        plan.halls.append(
            Hall(f"{wing.id}-end", use, corridor, end_pose, span, partition_m, hall_m, params.door_m, levels)
        )
    if wing.stairs:
        stair_pose = replace(end_pose, origin=end_pose.point(0.0, params.wall_m))
        half_m = mm(plan.stair.width_m / 2)
        place = StairPlace(
            f"stairwell-{wing.id}", stair_pose, Span(-half_m, half_m), mm(plan.stair.depth_m), bool(rng.random() < 0.5)
        )
        plan.stairwells.append(Stairwell(corridor, place, params.wall_m))
    plan.wings_m2.append(wing.length_m * (a_m + b_m) * (wing.top + 1) * FLOOR_FRACTION)


def _add_tracked(rng: np.random.Generator, plan: Plan, wings: Sequence[_Wing]) -> None:
    """The first metres of one wing, facade to facade; of a wing that leads nowhere, which no walk passes by chance."""
    fitting = [
        wing
        for wing in wings
        if wing.top == TOP_LEVEL and wing.length_m >= TRACKED_M[1] and wing.end != "link" and not wing.stairs
    ]
    wing = fitting[int(rng.integers(len(fitting)))]
    a_m, b_m = wing.side.section.halves_m
    plan.tracked.append(wing.pose.rectangle(Span(0.0, float(rng.uniform(*TRACKED_M))), Span(-b_m, a_m)))


def _turned(pose: Pose) -> Pose:
    """The same place with u and v exchanged."""
    return Pose(pose.origin, pose.across, pose.along)


def _add_link(
    rng: np.random.Generator, plan: Plan, side: _StreetSide, wings: Sequence[_Wing], params: LabParams
) -> None:
    """A corridor along the far ends of the wings of one side, with rooms on its far side or without."""
    half_m = side.section.corridor_m / 2
    low_m, high_m = wings[0].pose.origin[0] - half_m, wings[-1].pose.origin[0] + half_m
    origin = (mm(low_m), wings[0].pose.point(wings[0].length_m, 0.0)[1])
    pose = Pose(origin, (1.0, 0.0), (0.0, side.outward))
    length_m, name = mm(high_m - low_m), f"link-{side.name}"
    plan.corridors.append(Corridor(name, pose.rectangle(Span(0.0, length_m), Span(0.0, side.section.corridor_m))))
    for wing in wings:
        at_m = mm(wing.pose.origin[0] - origin[0])
        plan.joints.append(Joint(f"{wing.id}-corridor", name, pose, Span(mm(at_m - half_m), mm(at_m + half_m)), 0.0))
    if rng.random() < 0.7:
        outer = replace(pose, origin=pose.point(0.0, side.section.corridor_m))
        depth_m = mm(rng.uniform(*params.depth_m))
        plan.rows.append(RoomRow(f"{name}-rooms", name, outer, Span(0.0, length_m), params.wall_m, depth_m))


# The street.


def _add_street(
    rng: np.random.Generator, plan: Plan, wings: Sequence[_Wing], total_m: float, street_m: float, params: LabParams
) -> None:
    """The street with its voids, and between the wings rooms and stairwells along it."""
    outer = {side: [wing.outer for wing in wings if wing.side.name == side] for side in ("n", "s")}
    spaces = [(side, span) for side, taken in outer.items() for span in gaps(taken, total_m)]
    with_stairs = _choose_spaces(rng, spaces, plan.stair, total_m)
    depth_m, gap_m = mm(rng.uniform(*params.depth_m)), mm(rng.uniform(*params.strip_m))
    for number, (side, span) in enumerate(spaces):
        has_rooms, at_low, up_left = rng.random() < params.block_fraction, rng.random() < 0.5, rng.random() < 0.5
        if number not in with_stairs and not (has_rooms and span.length > params.office_m[0]):
            continue
        outward = 1.0 if side == "n" else -1.0
        pose = Pose((0.0, outward * street_m / 2), across=(0.0, outward))
        stairs = None
        name = f"street-{side}{number + 1}"
        if number in with_stairs:
            width_m = plan.stair.width_m
            low_m = span.low if at_low else mm(span.high - width_m)
            stairs = Span(low_m, mm(low_m + width_m))
            inner = replace(pose, origin=pose.point(0.0, gap_m))
            place = StairPlace(f"stairwell-{name}", inner, stairs, mm(plan.stair.depth_m), bool(up_left))
            plan.stairwells.append(Stairwell("street", place, gap_m))
        plan.rows.append(RoomRow(name, "street", pose, span, gap_m, depth_m, stairs))
    voids = [_void(span, street_m, params) for side, span in spaces if side == "n" and span.length > 6.0]
    kept = tuple(void for void in voids if rng.random() < params.void_fraction)
    street = rectangle(0.0, -street_m / 2, total_m, street_m / 2)
    plan.corridors.insert(0, Corridor("street", street, voids=kept))


def _choose_spaces(
    rng: np.random.Generator, spaces: Sequence[tuple[str, Span]], stair: StairSize, total_m: float
) -> set[int]:
    """Which spaces get one of three stairwells, spread along the street."""
    chosen: set[int] = set()
    for third in range(3):
        wanted_m = total_m * (third + rng.uniform(0.2, 0.8)) / 3
        fitting = [i for i in rng.permutation(len(spaces)) if i not in chosen and spaces[i][1].length >= stair.width_m]
        chosen.add(int(min(fitting, key=lambda i: abs(sum(spaces[i][1]) / 2 - wanted_m))))
    return chosen


def _void(span: Span, street_m: float, params: LabParams) -> list[tuple[float, float]]:
    """A clockwise hole in the street beside a space."""
    half_m = mm(street_m / 2 - params.gallery_m)
    return rectangle(mm(span.low + 1.0), -half_m, mm(span.high - 1.0), half_m)[::-1]


def _add_ends(rng: np.random.Generator, plan: Plan, total_m: float, params: LabParams) -> None:
    """The theatre at one end of the street, two levels high below a reading room, and often a room at the other end."""
    ends = [Pose((total_m, 0.0), (0.0, 1.0), (1.0, 0.0)), Pose((0.0, 0.0), (0.0, -1.0), (-1.0, 0.0))]
    first = int(rng.integers(2))
    half_m = mm(rng.uniform(*params.theatre_width_m) / 2)
    row_m = 2 * mm(rng.uniform(*params.row_m) / 2)
    riser_m = mm(rng.uniform(*params.row_riser_m))
    # The highest row stays below half a level, so that it belongs to level 0, the nearer one.
    num_rows = int((plan.level_height_m / 2 - 0.02) / (2 * riser_m))
    stage_m = mm(rng.uniform(*params.stage_m))
    aisle_m = mm(rng.uniform(*params.aisle_m))
    aisle_low_m = mm(rng.choice([-aisle_m / 2, half_m - aisle_m, -half_m]))
    span, depth_m = Span(-half_m, half_m), mm(stage_m + num_rows * row_m)
    hall = Hall("theatre", "theatre", "street", ends[first], span, params.wall_m, depth_m, params.wide_door_m, (0,))
    aisle = Span(aisle_low_m, mm(aisle_low_m + aisle_m))
    plan.theatres.append(Theatre(hall, stage_m, aisle, num_rows, row_m, riser_m))
    plan.halls.append(replace(hall, id="reading-room", use="hall", door_m=params.door_m, levels=(2,)))
    half_m, depth_m = mm(rng.uniform(*params.common_width_m) / 2), mm(rng.uniform(*params.hall_m))
    levels = tuple(level for level in ALL_LEVELS if rng.random() < 0.5)
    across, end = Span(-half_m, half_m), ends[1 - first]
    room = Hall("common-room", "hall", "street", end, across, params.wall_m, depth_m, params.wide_door_m, levels)
    plan.halls.append(room)
