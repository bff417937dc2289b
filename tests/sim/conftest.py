"""Small buildings, and one walk through an office that several tests look at."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from pdrbench.building import WALL, Building, FloorPolygon
from pdrbench_sim.buildings.office import make_office
from pdrbench_sim.people.person import Person, draw_person
from pdrbench_sim.people.route import NavigationMesh, Place, navigation_mesh
from pdrbench_sim.people.walk import SimulatedWalk
from pdrbench_sim.people.walker import WalkParams, draw_place, walk_through


def make_room(name: str, outline, *, neighbour=None, holes=(), **facts) -> FloorPolygon:
    """A floor polygon with walls everywhere, or with the connections given by edge."""
    edges = len(outline) + sum(len(hole) for hole in holes)
    leads = np.full(edges, WALL)
    for edge, other in (neighbour or {}).items():
        leads[edge] = other
    facts = {"height_m": 0.0, "level": 0} | facts
    return FloorPolygon(
        id=name,
        outline_xy_m=np.array(outline, dtype=float),
        neighbour=leads,
        holes=tuple(np.array(hole, dtype=float) for hole in holes),
        **facts,
    )


def straight_walk(length_m: float) -> SimulatedWalk:
    """So far along a corridor at an even speed."""
    outline = [(0, 0), (length_m + 4, 0), (length_m + 4, 4), (0, 4)]
    person = Person(height_m=1.7, cadence_hz=1.9, step_length_m=0.65, step_slope_m_per_hz=0.3, asymmetry=0.0)
    even = WalkParams(speed_sigma=0.0, pause_every_s=1e9, sway_sigma_m=0.0)
    places = [Place(0, np.array([2.0, 2.0])), Place(0, np.array([length_m + 2.0, 2.0]))]
    mesh = navigation_mesh(Building("corridor", (make_room("corridor", outline),)))
    return walk_through(np.random.default_rng(0), mesh, person, places, even)


@pytest.fixture(scope="session")
def room() -> Callable[..., FloorPolygon]:
    """Makes floor polygons."""
    return make_room


@pytest.fixture(scope="session")
def l_room() -> Building:
    """An L, 8 m by 8 m, without its upper right 4 m by 4 m."""
    outline = [(0, 0), (8, 0), (8, 4), (4, 4), (4, 8), (0, 8)]
    return Building("L", (make_room("L", outline),))


@pytest.fixture(scope="session")
def ring() -> Building:
    """A square of 10 m around a hole of 4 m, the hole nearer to the top."""
    outline = [(0, 0), (10, 0), (10, 10), (0, 10)]
    hole = [(3, 4), (3, 8), (7, 8), (7, 4)]
    return Building("ring", (make_room("ring", outline, holes=(hole,)),))


@pytest.fixture(scope="session")
def corridor() -> Building:
    """A corridor of 120 m."""
    return Building("corridor", (make_room("corridor", [(0, 0), (120, 0), (120, 4), (0, 4)]),))


@pytest.fixture(scope="session")
def two_rooms() -> Building:
    """Two rooms of 4 m by 4 m with a door of 0.9 m between them, and a third, unreachable one."""
    west = make_room("west", [(0, 0), (4, 0), (4, 1), (4, 1.9), (4, 4), (0, 4)], neighbour={2: 1})
    east = make_room("east", [(4, 0), (8, 0), (8, 4), (4, 4), (4, 1.9), (4, 1)], neighbour={4: 0})
    alone = make_room("alone", [(8, 0), (12, 0), (12, 4), (8, 4)])
    return Building("two", (west, east, alone))


@pytest.fixture(scope="session")
def office() -> Building:
    return make_office(np.random.default_rng(1), area_m2=2600.0)


@pytest.fixture(scope="session")
def mesh(office: Building) -> NavigationMesh:
    return navigation_mesh(office)


@pytest.fixture(scope="session")
def person() -> Person:
    return draw_person(np.random.default_rng(2))


@pytest.fixture(scope="session")
def walks(office: Building, mesh: NavigationMesh, person: Person) -> list[SimulatedWalk]:
    """Four walks over all levels, about twenty minutes together."""
    made = []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        places = [draw_place(rng, mesh, level=level) for level in (0, 0, 2, 2, 1, 0)]
        made.append(walk_through(rng, mesh, person, places))
    return made
