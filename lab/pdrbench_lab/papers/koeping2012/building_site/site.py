"""The replica of the floor of Köping et al. 2012: about 16 m x 30 m, a corridor and rooms on both sides (K7).

The paper shows its floor in a figure only. Here a corridor leads through the whole length, which is y; rooms of drawn
widths lie along it, each with a door, some with a second one to the next room. Walls have no thickness.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Final

import numpy as np

from pdrbench.building import Building
from pdrbench.errors import MapError
from pdrbench_sim.buildings.assembly import Cell, Draft, Opening, mm, rectangle
from pdrbench_sim.people.route import NavigationMesh, Place
from pdrbench_sim.people.walker import draw_place

CORRIDOR: Final = "corridor"
JAMB_M: Final = 0.4  # between a door and the next corner, at least; ours


@dataclass(frozen=True, slots=True)
class SiteParams:
    """Sizes of the floor; pairs are ranges of a uniform draw."""

    size_m: tuple[float, float] = (16.0, 30.0)  # along x and y; [P] K7
    level: int = 2  # IMDF ordinal; [P] "in the 2nd floor"
    level_height_m: float = 3.5  # from one level to the next; ours
    corridor_m: tuple[float, float] = (2.0, 2.6)  # width of the corridor; ours
    corridor_shift_m: float = 1.0  # its middle lies that far off the middle of the floor, to either side; ours
    room_m: tuple[float, float] = (3.2, 6.4)  # width of a room along the corridor; ours: offices and seminar rooms
    door_m: float = 0.9  # width of a door; ours
    side_door_fraction: float = 0.25  # of neighbouring rooms have a door between them; ours

    def __post_init__(self) -> None:
        if not 0 < self.room_m[0] <= self.room_m[1] or self.room_m[0] < self.door_m + 2 * JAMB_M:
            raise MapError(f"a room has space for a door of {self.door_m:g} m and its jambs; got room_m {self.room_m}")
        room_m = (self.size_m[0] - self.corridor_m[1]) / 2 - self.corridor_shift_m
        if not 0 < self.corridor_m[0] <= self.corridor_m[1] or room_m < self.door_m + 2 * JAMB_M:
            raise MapError(f"a floor {self.size_m[0]:g} m wide has no rooms beside a corridor; make it wider")
        if self.size_m[1] < self.room_m[0]:
            raise MapError(f"a floor {self.size_m[1]:g} m long has no room for a room; make it longer")


def make_site(rng: np.random.Generator, *, name: str = "site", params: SiteParams | None = None) -> Building:
    """Draws a floor with a corridor and rooms.

    Args:
        rng: Two floors from generators in the same state are equal byte for byte.
        name: Name of the building.
        params: Sizes; None for the defaults.
    """
    params = params or SiteParams()
    wide_m, long_m = params.size_m
    middle_m = wide_m / 2 + rng.uniform(-1, 1) * params.corridor_shift_m
    half_m = rng.uniform(*params.corridor_m) / 2
    left_m, right_m = mm(middle_m - half_m), mm(middle_m + half_m)
    height_m = params.level * params.level_height_m
    corridor = Cell(CORRIDOR, rectangle(left_m, 0.0, right_m, long_m), height_m, params.level, use=CORRIDOR)
    draft = Draft([corridor])
    for side, wall_m, facade_m in (("west", left_m, 0.0), ("east", right_m, wide_m)):
        walls_m = _split(rng, long_m, params)
        for i, (low_m, high_m) in enumerate(itertools.pairwise(walls_m)):
            room = f"{side}-{i}"
            draft.cells.append(Cell(room, rectangle(facade_m, low_m, wall_m, high_m), height_m, params.level))
            door_m = _door(rng, low_m, high_m, params)
            draft.openings.append(Opening(CORRIDOR, room, (wall_m, door_m), (wall_m, mm(door_m + params.door_m))))
            if i and rng.random() < params.side_door_fraction:
                near_m = _door(rng, min(wall_m, facade_m), max(wall_m, facade_m), params)
                ends = (near_m, low_m), (mm(near_m + params.door_m), low_m)
                draft.openings.append(Opening(f"{side}-{i - 1}", room, *ends))
    return draft.building(name, (CORRIDOR, "room"))


def draw_visits(rng: np.random.Generator, mesh: NavigationMesh, count: int = 24) -> list[Place]:
    """Places to visit, in order: another room each time, now and then the corridor, as a photographer's round (K7)."""
    places: list[Place] = []
    while len(places) < count:
        place = draw_place(rng, mesh)
        if not places or place.polygon != places[-1].polygon:
            places.append(place)
    return places


def _split(rng: np.random.Generator, long_m: float, params: SiteParams) -> list[float]:
    """Walls across a row of rooms, the facades among them: drawn widths, stretched to fill the row."""
    widths_m: list[float] = []
    while sum(widths_m) < long_m - params.room_m[0] / 2 or not widths_m:
        widths_m.append(float(rng.uniform(*params.room_m)))
    walls_m = np.concatenate([[0.0], np.cumsum(widths_m)]) * long_m / sum(widths_m)
    return [mm(wall) for wall in walls_m]


def _door(rng: np.random.Generator, low_m: float, high_m: float, params: SiteParams) -> float:
    """Where a door begins in a wall from `low_m` to `high_m`."""
    return mm(rng.uniform(low_m + JAMB_M, high_m - JAMB_M - params.door_m))
