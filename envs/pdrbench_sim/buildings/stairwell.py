"""U-shaped stairs, one floor polygon a tread, in a stairwell that all levels share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pdrbench_sim.buildings.assembly import Cell, Draft, Kind, Pose, Span, mm


@dataclass(frozen=True, slots=True)
class StairParams:
    """Sizes of stairs; ranges of a uniform draw, after sources.md 1.3 where they say."""

    riser_height_m: tuple[float, float] = (0.155, 0.175)  # sources.md 1.3: 0.15 to 0.18
    tread_depth_m: tuple[float, float] = (0.28, 0.30)  # sources.md 1.3
    flight_width_m: tuple[float, float] = (1.15, 1.35)
    gap_m: tuple[float, float] = (0.10, 0.20)  # between the flights
    landing_depth_m: tuple[float, float] = (1.3, 1.5)  # sources.md 1.3: 1.2 to 1.5


@dataclass(frozen=True, slots=True)
class StairSize:
    """A U-shaped stair, the same in every stairwell: one flight up to a landing at half height, one back."""

    num_treads: int  # of one flight; its last riser leads to a landing
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
class StairPlace:
    """Where a stairwell lies."""

    name: str  # its id without the level
    pose: Pose  # v = 0 is the wall with the door, v points away from it
    span: Span  # the part of the u axis that it takes
    depth_m: float  # of the stairwell; what the stair leaves of it goes to the landing at the door
    up_left: bool  # whether the flight up starts at the lower end of the span


def draw_stair(rng: np.random.Generator, level_height_m: float, params: StairParams) -> StairSize:
    """A stair for levels so far apart: an even number of risers of equal height."""
    num_risers = 2 * round(level_height_m / rng.uniform(*params.riser_height_m) / 2)
    flight_width_m = mm(rng.uniform(*params.flight_width_m))
    return StairSize(
        num_treads=num_risers // 2 - 1,
        tread_depth_m=mm(rng.uniform(*params.tread_depth_m)),
        riser_height_m=level_height_m / num_risers,
        flight_width_m=flight_width_m,
        landing_depth_m=mm(rng.uniform(*params.landing_depth_m)),
        width_m=mm(2 * flight_width_m + rng.uniform(*params.gap_m)),
    )


def add_stairwell(
    draft: Draft, stair: StairSize, place: StairPlace, level: int, num_levels: int, level_height_m: float
) -> None:
    """The landing of one level, the treads of that level, and the landing half way up; the door is the caller's.

    A tread belongs to the level nearer in height, the landing half way up to the lower one, so that the polygons of one
    level never overlap: the flight that leaves a level and the one that arrives lie side by side.
    """
    span = place.span
    landing_m = place.depth_m - stair.landing_depth_m - stair.num_treads * stair.tread_depth_m
    v_m = [landing_m + i * stair.tread_depth_m for i in range(stair.num_treads + 1)]
    lanes = (Span(span.low, mm(span.low + stair.flight_width_m)), Span(mm(span.high - stair.flight_width_m), span.high))
    up, down = lanes if place.up_left else lanes[::-1]
    base_m = level * level_height_m
    name = f"{level}/{place.name}"

    def add(cell: str, u: Span, v: Span, risers: int, kind: Kind, use: str) -> None:
        height_m = base_m + risers * stair.riser_height_m
        draft.cells.append(Cell(cell, place.pose.rectangle(u, v), height_m, level, kind, use))

    def add_flight(flight: str, lane: Span, sign: int) -> str:
        treads = [f"{name}-{flight}-{i + 1:02d}" for i in range(stair.num_treads)]
        for i, tread in enumerate(treads):
            add(tread, lane, Span(v_m[i], v_m[i + 1]), sign * (i + 1), "stairs", "stairs")
            draft.join(treads[i - 1] if i else name, tread, place.pose, lane, v_m[i])
        return treads[-1]

    add(name, span, Span(0.0, v_m[0]), 0, "floor", "landing")
    if level < num_levels - 1:
        last = add_flight("up", up, 1)
        half = f"{name}-half"
        add(half, span, Span(v_m[-1], place.depth_m), stair.num_treads + 1, "stairs", "stairs")
        draft.join(last, half, place.pose, up, v_m[-1])
    if level > 0:
        last = add_flight("down", down, -1)
        draft.join(last, f"{level - 1}/{place.name}-half", place.pose, down, v_m[-1])
