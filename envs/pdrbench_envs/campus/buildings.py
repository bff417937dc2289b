"""Kinds of buildings, and where people go in them."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from pdrbench.errors import MapError

if TYPE_CHECKING:
    from pdrbench.building import Building
    from pdrbench_sim.people.route import NavigationMesh, Place
    from pdrbench_sim.radio.networks import NetworkParams

OFFICE_LEVELS: Final = (2, 5)  # least, and one more than most; ours
ONE_CORRIDOR_M2: Final = (600.0, 1000.0)  # of a level; a corridor of 45 to 75 m
TWO_CORRIDORS_M2: Final = (900.0, 1500.0)  # of a level
MALL_LEVELS: Final = 2
MALL_M2: Final = (9000.0, 10500.0)  # of a level: the smaller floors of ILC20
NEAR: Final = 3  # people go to the nearest of so many places; ours: a way is some 20 m long, in malls 50 m
CHANGE_LEVEL: Final = 0.5  # of the places after the first two, those on another level than the one before; ours
LIFT_FRACTION: Final = 0.5  # of those, the ones that people go to by lift, where one stops; ours
MIN_WAY_M: Final = 2.0  # between two places; ours
SECONDS_A_PLACE: Final = 8.0  # fewer than any way and stay takes; ours
CLEARANCE_M: Final = 0.5  # of a place from the walls round it; ours
POOL: Final = 200  # places to choose from on a level, most of which are free
_TRIES: Final = 16  # of a plan that may not come out


@dataclass(frozen=True, slots=True)
class BuildingKind:
    """One kind, and how much of it is surveyed.

    Attributes:
        draw: The building of a name.
        draw_networks: What its WLAN sends.
        m_per_m2: Way of survey walks for each square metre of floor, least and most; ours. The surveys of ILC20 have
            about 0.1.
    """

    draw: Callable[[np.random.Generator, str], Building]
    draw_networks: Callable[[np.random.Generator], NetworkParams]
    m_per_m2: tuple[float, float]


def _office(num_corridors: int, level_m2: tuple[float, float], rng: np.random.Generator, name: str) -> Building:
    from pdrbench_sim.buildings.office import OfficeParams, make_office

    params = OfficeParams(num_corridors=num_corridors, has_lifts=True)

    def draw() -> Building:
        num_levels = int(rng.integers(*OFFICE_LEVELS))
        area_m2 = num_levels * float(rng.uniform(*level_m2))
        return make_office(rng.spawn(1)[0], num_levels=num_levels, area_m2=area_m2, name=name, params=params)

    return _tried(draw, name)


def _ring(rng: np.random.Generator, name: str) -> Building:
    from pdrbench_sim.buildings.wings import make_ring_floors

    return make_ring_floors(rng, num_levels=int(rng.integers(*OFFICE_LEVELS)), name=name)


def _wings(rng: np.random.Generator, name: str) -> Building:
    from pdrbench_sim.buildings.wings import make_wings

    return make_wings(rng, num_levels=int(rng.integers(*OFFICE_LEVELS)), name=name)


def _mall(rng: np.random.Generator, name: str) -> Building:
    from pdrbench_sim.buildings.mall import make_mall

    def draw() -> Building:
        area_m2 = MALL_LEVELS * float(rng.uniform(*MALL_M2))
        return make_mall(rng.spawn(1)[0], num_levels=MALL_LEVELS, area_m2=area_m2, name=name)

    return _tried(draw, name)


def _tried(draw: Callable[[], Building], name: str) -> Building:
    """The first plan that comes out of some draws."""
    for _ in range(_TRIES):
        with contextlib.suppress(MapError):
            return draw()
    raise MapError(f"no plan of {name} came out in {_TRIES} draws")


def _office_networks(rng: np.random.Generator) -> NetworkParams:
    """Offices have more boxes or fewer, of one owner or of many; the laws are ours."""
    from pdrbench_sim.radio.networks import OFFICE_NETWORKS

    return dataclasses.replace(
        OFFICE_NETWORKS,
        area_per_box_m2=OFFICE_NETWORKS.area_per_box_m2 * math.exp(0.3 * float(np.clip(rng.standard_normal(), -1, 2))),
        managed_fraction=float(rng.uniform(0.4, 0.9)),
        hard_of_hearing_db=float(rng.standard_normal()),
    )


def _mall_networks(rng: np.random.Generator) -> NetworkParams:
    from pdrbench_sim.radio.networks import draw_mall_networks

    return draw_mall_networks(rng)


BUILDINGS: Final = {
    "one corridor": BuildingKind(functools.partial(_office, 1, ONE_CORRIDOR_M2), _office_networks, (0.04, 0.16)),
    "two corridors": BuildingKind(functools.partial(_office, 2, TWO_CORRIDORS_M2), _office_networks, (0.04, 0.16)),
    "ring": BuildingKind(_ring, _office_networks, (0.04, 0.16)),
    "wings and hall": BuildingKind(_wings, _office_networks, (0.04, 0.16)),
    "shopping centre": BuildingKind(_mall, _mall_networks, (0.02, 0.06)),
}


def draw_places(
    rng: np.random.Generator, mesh: NavigationMesh, duration_s: float, *, changes: bool, by_lift: bool
) -> list[Place]:
    """Places to visit, more than there is time for.

    Args:
        rng: Draws them.
        mesh: Of a building of two levels or more.
        duration_s: Of the walk.
        changes: Whether the walk leaves its first level: at once then, and at every second place.
        by_lift: Whether half of the ways to another level go by lift, where one stops on both.
    """
    from pdrbench_sim.people.walker import lift_ride

    building, pools = mesh.building, {level: _pool(rng, mesh, level) for level in mesh.building.levels}
    level = int(rng.choice(building.levels))
    places = [pools[level].pop()]
    for number in range(2 + int(duration_s / SECONDS_A_PLACE)):
        if changes and (number == 0 or rng.random() < CHANGE_LEVEL):
            before = level
            level = int(rng.choice([other for other in building.levels if abs(other - before) in (1, 2)]))
            ride = lift_ride(building, places[-1].xy_m, (before, level))
            places += ride if by_lift and rng.random() < LIFT_FRACTION else []
        places.append(_nearest(pools[level], places[-1]))
    return places


def _pool(rng: np.random.Generator, mesh: NavigationMesh, level: int) -> list[Place]:
    """Places of a level where a person could have business: uniform over the floor, off stairs, away from walls."""
    from pdrbench_sim.buildings.walls import walls_along
    from pdrbench_sim.people.route import Place

    polygon, xy_m = mesh.building.sample_uniform(rng, POOL, level)
    is_free = np.array([mesh.building.polygons[p].kind == "floor" for p in polygon])
    is_free[walls_along(mesh.building, xy_m, polygon, CLEARANCE_M, 0).point] = False
    return [Place(int(polygon[row]), xy_m[row]) for row in np.flatnonzero(is_free)]


def _nearest(pool: list[Place], here: Place) -> Place:
    """Takes a place out of a pool: the nearest of the next ones, but not where one stands."""
    way_m = [float(np.hypot(*(place.xy_m - here.xy_m))) for place in pool]
    fit = [row for row, way in enumerate(way_m) if way >= MIN_WAY_M][:NEAR]
    return pool.pop(min(fit, key=way_m.__getitem__))
