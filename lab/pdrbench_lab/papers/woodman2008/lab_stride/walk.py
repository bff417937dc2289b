"""The walk of Woodman & Harle 2008 through the replica of their building: again and again through one wing (W1)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from pdrbench.building import WALL, Building
from pdrbench.geometry import BoolArray, FloatArray, IntArray
from pdrbench_lab.papers.woodman2008.lab_stride.lab import ROOMS, tracked_outline
from pdrbench_lab.papers.woodman2008.lab_stride.plan import TOP_LEVEL
from pdrbench_sim.people.person import Person, PersonParams
from pdrbench_sim.people.route import NavigationMesh, Place
from pdrbench_sim.people.walker import WalkParams

PASSES: Final = 6  # W1
STRIDES_A_PASS: Final = 28  # W1: 169 positions in six passes
STRIDE_FRACTION: Final = 0.75  # of a free stride, what one is long between doors; ours, from walks of this generator
SPEED_FRACTION: Final = 0.7  # of the free speed, the mean one with turns, doors and stops; ours, likewise
NEAREST: Final = 6  # rooms to draw from when one at a distance is wanted; ours
LEVELS_BETWEEN: Final = (0, 0, 1, 1, 2)  # of the places between passes, in any order
PEOPLE: Final = PersonParams(cadence_hz=(2.1, 0.05))  # W1: a stride in 1.1 s, doors and stairs included
STEADY: Final = WalkParams(pause_every_s=400.0, pause_median_s=1.0)  # W1: one continuous trace; ours


@dataclass(frozen=True, slots=True)
class _Rooms:
    """Rooms that can be visited; `way_m` from the wing, a metre on stairs counted as the search does."""

    polygon: IntArray
    level: IntArray
    way_m: FloatArray


def draw_rounds(rng: np.random.Generator, mesh: NavigationMesh, person: Person, duration_s: float) -> list[Place]:
    """Places to visit, in order: from far away to some rooms of the tracked wing, elsewhere, and back, six times.

    Args:
        rng: Draws the places.
        mesh: Of a building from `make_lab`.
        person: Who walks; decides how far one gets.
        duration_s: When the walk should end, some time after the sixth pass; the places suffice for more.
    """
    building = mesh.building
    rooms = np.array([i for i, p in enumerate(building.polygons) if _uses(building).get(p.id) in ROOMS])
    is_tracked, is_wing = _in_wing(building, rooms)
    wing, others = rooms[is_tracked], rooms[~is_wing]
    way_m = _ways_m(mesh, _draw_place_in(rng, building, int(rng.choice(wing))))[others]
    elsewhere = _Rooms(others[np.isfinite(way_m)], building.level(others), way_m[np.isfinite(way_m)])
    speed_mps = SPEED_FRACTION * person.speed_mps
    inside_m = STRIDES_A_PASS * STRIDE_FRACTION * 2 * person.step_length_m
    start = _pick_far(rng, building, elsewhere)
    round_m = (duration_s * speed_mps - elsewhere.way_m[start] - PASSES * inside_m) / (PASSES - 0.4)
    chosen = [start]
    places = [_draw_place_in(rng, building, int(elsewhere.polygon[start]))]
    levels = [*rng.permutation(LEVELS_BETWEEN), None]
    for level in levels:
        places += _draw_pass(rng, building, wing, inside_m)
        chosen.append(_pick(rng, elsewhere, round_m / 2, range(3) if level is None else (int(level),)))
        places.append(_draw_place_in(rng, building, int(elsewhere.polygon[chosen[-1]])))
    # Where the walk is cut off is not known yet: two places more.
    places += [_draw_place_in(rng, building, int(elsewhere.polygon[i])) for i in (start, chosen[1])]
    return places


def _uses(building: Building) -> dict[str, str]:
    """What each named floor polygon is there for."""
    return {zone.id: zone.kind for zone in building.zones}


def _in_wing(building: Building, rooms: IntArray) -> tuple[BoolArray, BoolArray]:
    """(R,) rooms in the tracked part of a wing, and rooms of that wing anywhere, which is in line with that part."""
    outline = tracked_outline(building)
    centre_xy_m = np.array([building.polygons[room].outline_xy_m.mean(axis=0) for room in rooms])
    low_x_m, high_x_m = outline[:, 0].min(), outline[:, 0].max()
    is_wing = (building.level(rooms) == TOP_LEVEL) & (centre_xy_m[:, 0] > low_x_m) & (centre_xy_m[:, 0] < high_x_m)
    is_wing &= np.sign(centre_xy_m[:, 1]) == np.sign(outline[0, 1])
    far_y_m = np.array([np.abs(building.polygons[room].outline_xy_m[:, 1]).max() for room in rooms])
    return is_wing & (far_y_m <= np.abs(outline[:, 1]).max()), is_wing


def _draw_place_in(rng: np.random.Generator, building: Building, polygon: int) -> Place:
    """A place in a rectangular room, away from its walls."""
    low, high = building.polygons[polygon].outline_xy_m.min(axis=0), building.polygons[polygon].outline_xy_m.max(axis=0)
    margin = np.minimum(0.8, 0.35 * (high - low))
    return Place(polygon, rng.uniform(low + margin, high - margin))


def _ways_m(mesh: NavigationMesh, start: Place) -> FloatArray:
    """(P,) the way from a place to the nearest entrance of every floor polygon; infinite where none leads there."""
    from scipy.sparse.csgraph import dijkstra

    portals = np.unique(mesh.portal[mesh.owner == start.polygon])
    portals = portals[portals >= 0]
    first = np.concatenate([np.arange(mesh.first_node[g], mesh.first_node[g + 1]) for g in portals])
    node_m = dijkstra(mesh.graph, directed=True, indices=first, min_only=True)
    way_m = np.full(len(mesh.building.polygons), np.inf)
    portal_m = np.minimum.reduceat(node_m, mesh.first_node[:-1])
    for side in mesh.portal_triangles.T:
        np.minimum.at(way_m, mesh.owner[side], portal_m)
    return way_m


def _pick(rng: np.random.Generator, rooms: _Rooms, wanted_m: float, levels: Sequence[int]) -> int:
    """Index of a room on one of the levels, one of the few whose way is nearest to the wanted one."""
    off_m = np.where(np.isin(rooms.level, list(levels)), np.abs(rooms.way_m - wanted_m), np.inf)
    nearest = np.argsort(off_m, kind="stable")[:NEAREST]
    return int(rng.choice(nearest[np.isfinite(off_m[nearest])]))


def _pick_far(rng: np.random.Generator, building: Building, rooms: _Rooms) -> int:
    """Index of a room among the farther half, by the way and in plan."""
    middle_xy_m = tracked_outline(building).mean(axis=0)
    centre_xy_m = np.array([building.polygons[p].outline_xy_m.mean(axis=0) for p in rooms.polygon])
    plan_m = np.hypot(*(centre_xy_m - middle_xy_m).T)
    is_far = (rooms.way_m >= np.median(rooms.way_m)) & (plan_m >= np.median(plan_m))
    return int(rng.choice(np.flatnonzero(is_far)))


def _draw_pass(rng: np.random.Generator, building: Building, wing: IntArray, wanted_m: float) -> list[Place]:
    """Places in one to three rooms of the wing, so that the way through it is about as long as wanted."""
    best: tuple[float, list[Place]] = (np.inf, [])
    for _ in range(24):
        rooms = rng.choice(wing, min(int(rng.integers(1, 4)), len(wing)), replace=False)
        places = [_draw_place_in(rng, building, int(room)) for room in rooms]
        off_m = abs(_pass_m(building, places) - wanted_m)
        if off_m < best[0]:
            best = off_m, places
    return best[1]


def _pass_m(building: Building, places: Sequence[Place]) -> float:
    """Way inside the wing: along its corridor, from the street and back, and from doors into rooms, straight."""
    outline = tracked_outline(building)
    middle_m, entrance_m = outline[:, 0].mean(), np.abs(outline[:, 1]).min()
    doors_m = np.array([_door_m(building, place) for place in places])
    beside_m = np.abs([place.xy_m[1] for place in places]) - doors_m
    across_m = np.array([place.xy_m[0] for place in places]) - middle_m
    corridor_m = np.abs(np.diff(doors_m, prepend=entrance_m, append=entrance_m)).sum()
    return float(corridor_m + 2 * np.hypot(beside_m, across_m).sum())


def _door_m(building: Building, place: Place) -> float:
    """Distance from the street, along the wing, of the nearest doorway of the room that a place lies in."""
    beyond = [building.polygons[i] for i in set(building.polygons[place.polygon].neighbour.tolist()) if i != WALL]
    doors_m = np.abs([polygon.outline_xy_m[:, 1].mean() for polygon in beyond])
    return float(doors_m[np.abs(doors_m - abs(place.xy_m[1])).argmin()])
