"""A level whose corridor is a rectangular loop between rooms: the plan of two replicas (sources.md, F1 and L1)."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from pdrbench.building import WALL, Building, FloorPolygon
from pdrbench.errors import PdrbenchError
from pdrbench.geometry import FloatArray, IntArray, wrap_rad
from pdrbench_sim.buildings.assembly import Cell, Draft, Opening, Span, mm, rectangle

CORRIDOR_ID: Final = "corridor"  # id of its polygon


@dataclass(frozen=True, slots=True)
class RingFloor:
    """Sizes of a level with a corridor round a block of rooms, and rooms all around it.

    The level's south-west corner is at (0, 0), the long sides lie along x.
    """

    long_m: float  # of the middle line of the corridor, along x
    short_m: float  # of the middle line, along y
    width_m: float  # of the corridor
    room_depth_m: float = 5.0  # of the rooms around it
    door_m: float = 0.9  # width of the doors, one to each room; open ones have no leaf
    is_open: bool = True  # False where all doors are closed, and walls to a person in the corridor
    rooms_long: int = 8  # number of rooms along each long side, outside
    rooms_short: int = 4  # the same along each short side
    rooms_inside: int = 7  # number of rooms in each of the two rows that fill the block

    def __post_init__(self) -> None:
        if not self.width_m < self.short_m <= self.long_m < math.inf or not 0 < self.door_m < self.width_m:
            raise PdrbenchError(
                f"a ring is longer than it is wide, wider than its corridor, that than a door; got {self}"
            )
        if min(self.rooms_long, self.rooms_short, self.rooms_inside) < 1 or not 0 < self.room_depth_m < math.inf:
            raise PdrbenchError(f"a ring has rooms of some depth on every side; got {self}")

    @property
    def lap_m(self) -> float:
        """Length of the middle line."""
        return 2 * (self.long_m + self.short_m)

    @property
    def corners_m(self) -> FloatArray:
        """(4,) of the middle line along the lap, from the south-west one counter-clockwise."""
        return np.array([0.0, self.long_m, self.long_m + self.short_m, 2 * self.long_m + self.short_m])

    def xy_m(self, along_m: FloatArray) -> FloatArray:
        """(n, 2) places on the middle line, counter-clockwise from its south-west corner.

        Args:
            along_m: (n,) along the lap; a lap later is the same place.

        >>> RingFloor(36.0, 16.0, 2.4).xy_m(np.array([0.0, 36.0, 104.0])).round(3).tolist()
        [[6.2, 6.2], [42.2, 6.2], [6.2, 6.2]]
        """
        corner_m = self.room_depth_m + self.width_m / 2
        knots_m = (*self.corners_m.tolist(), self.lap_m)
        at_m = np.mod(along_m, self.lap_m)
        x_m = np.interp(at_m, knots_m, np.array([0, self.long_m, self.long_m, 0, 0]))
        y_m = np.interp(at_m, knots_m, np.array([0, 0, self.short_m, self.short_m, 0]))
        return corner_m + np.column_stack([x_m, y_m])

    def heading_rad(self, along_m: FloatArray) -> FloatArray:
        """(n,) direction of the middle line, counter-clockwise round the loop."""
        side = np.searchsorted(self.corners_m[1:], np.mod(along_m, self.lap_m), side="right")
        heading_rad: FloatArray = wrap_rad(side * math.pi / 2)
        return heading_rad

    def along_m(self, xy_m: FloatArray) -> FloatArray:
        """(n,) along the lap, of the point of the middle line nearest to each place (n, 2)."""
        long_m, short_m = self.long_m, self.short_m
        x, y = (xy_m - (self.room_depth_m + self.width_m / 2)).T
        x_in, y_in = np.clip(x, 0, long_m), np.clip(y, 0, short_m)
        corner = np.array([[x_in, 0 * y], [0 * x + long_m, y_in], [x_in, 0 * y + short_m], [0 * x, y_in]])
        off_m = np.hypot(x - corner[:, 0], y - corner[:, 1])
        along = np.array([x_in, long_m + y_in, 2 * long_m + short_m - x_in, self.lap_m - y_in])
        nearest_m: FloatArray = along[off_m.argmin(axis=0), np.arange(len(x))]
        return nearest_m

    def way_xy_m(self, first_m: float, length_m: float, *, is_clockwise: bool, lead_m: float = 0.0) -> FloatArray:
        """(n, 2) the start, every corner that is passed and the end of a way round the loop.

        Args:
            first_m: Place along the lap that is passed after `lead_m`.
            length_m: Of the way.
            is_clockwise: Which way round.
            lead_m: Walked before `first_m`.
        """
        turn, laps = (-1.0 if is_clockwise else 1.0), 1 + math.ceil(length_m / self.lap_m)
        ahead_m = np.mod(turn * (self.corners_m - first_m) + lead_m, self.lap_m)
        passed_m = np.sort(np.concatenate([ahead_m + lap * self.lap_m for lap in range(laps)]))
        walked_m = np.concatenate([[0.0], passed_m[(passed_m > 0.5) & (passed_m < length_m - 0.5)], [length_m]])
        return self.xy_m(first_m + turn * (walked_m - lead_m))


def make_ring(plan: RingFloor, name: str) -> Building:
    """The building of a plan: one level, rooms are zones of the kind "office"."""
    near_m, inside_m = plan.room_depth_m, plan.room_depth_m + plan.width_m
    far_x_m, far_y_m = mm(near_m + plan.long_m + plan.width_m), mm(near_m + plan.short_m + plan.width_m)
    back_x_m, back_y_m = mm(far_x_m - plan.width_m), mm(far_y_m - plan.width_m)
    middle_m, depth_m = mm((near_m + far_y_m) / 2), plan.room_depth_m
    void = rectangle(inside_m, inside_m, back_x_m, back_y_m)
    ring = rectangle(near_m, near_m, far_x_m, far_y_m)
    draft = Draft([Cell(CORRIDOR_ID, ring, 0.0, 0, use="corridor", holes=[void[::-1]])])
    around_x, around_y, inner = Span(near_m, far_x_m), Span(near_m, far_y_m), Span(inside_m, back_x_m)
    for row in (
        _RingRow("south", around_x, Span(0.0, near_m), plan.rooms_long, near_m),
        _RingRow("north", around_x, Span(far_y_m, mm(far_y_m + depth_m)), plan.rooms_long, far_y_m),
        _RingRow("inner-south", inner, Span(inside_m, middle_m), plan.rooms_inside, inside_m),
        _RingRow("inner-north", inner, Span(middle_m, back_y_m), plan.rooms_inside, back_y_m),
        _RingRow("west", around_y, Span(0.0, near_m), plan.rooms_short, near_m, is_upright=True),
        _RingRow("east", around_y, Span(far_x_m, mm(far_x_m + depth_m)), plan.rooms_short, far_x_m, is_upright=True),
    ):
        _add_rooms(draft, row, plan.door_m)
    if not plan.is_open:
        draft.openings.clear()
    return draft.building(name, ("office",))


def bare_ring(long_m: float = 31.0, short_m: float = 15.0, width_m: float = 2.0) -> Building:
    """A corridor round a block without doors and rooms; its middle line begins at (0, 0). Default sizes are L1's."""

    def around(out_m: float) -> FloatArray:
        x, y = long_m + out_m, short_m + out_m
        return np.array([[-out_m, -out_m], [x, -out_m], [x, y], [-out_m, y]])

    half_m = width_m / 2
    ring = FloorPolygon(
        id=CORRIDOR_ID,
        outline_xy_m=around(half_m),
        neighbour=np.full(8, WALL),
        height_m=0.0,
        level=0,
        holes=(around(-half_m)[::-1],),
    )
    return Building(name="ring", polygons=(ring,))


def corridor_polygon(building: Building, count: int) -> IntArray:
    """(count,) the floor polygon of the corridor, which is one."""
    number = next(i for i, polygon in enumerate(building.polygons) if polygon.id == CORRIDOR_ID)
    return np.full(count, number)


class _RingRow(NamedTuple):
    """Rooms side by side; `door_m` is the line of their doors, `is_upright` where it runs along y."""

    id: str
    along: Span
    across: Span
    rooms: int
    door_m: float
    is_upright: bool = False


def _add_rooms(draft: Draft, row: _RingRow, door_width_m: float) -> None:
    cuts_m = [mm(cut) for cut in np.linspace(row.along.low, row.along.high, row.rooms + 1)]
    for number, (low_m, high_m) in enumerate(itertools.pairwise(cuts_m)):
        room, at_m = f"{row.id}-{number}", (low_m + high_m) / 2
        corners = (low_m, row.across.low), (high_m, row.across.high)
        jambs = (mm(at_m - door_width_m / 2), row.door_m), (mm(at_m + door_width_m / 2), row.door_m)
        (a, b), (c, d) = ((p[::-1], q[::-1]) if row.is_upright else (p, q) for p, q in (corners, jambs))
        draft.cells.append(Cell(room, rectangle(*a, *b), 0.0, 0, use="office"))
        draft.openings.append(Opening(CORRIDOR_ID, room, c, d))
