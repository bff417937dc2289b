from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pdrbench.building import WALL, Building, FloorPolygon
from pdrbench_sim.buildings.mall import make_mall
from pdrbench_sim.buildings.office import make_office
from pdrbench_sim.radio.rays import LIGHT_WALL_M, MAX_WALL_M, PARALLEL, Obstacles, PlanLines, obstacles


def rectangle(name, x0, y0, x1, y1, neighbour=(WALL,) * 4, height_m=0.0, kind="floor", level=0, holes=()):
    outline = [[x0, y0], [x1, y0], [x1, y1], [x0, y1]]
    leads = [*neighbour, *(WALL for hole in holes for _ in hole)]
    return FloorPolygon(
        name, np.array(outline, float), np.array(leads), height_m, level, kind, tuple(np.array(h, float) for h in holes)
    )


@pytest.fixture(scope="module")
def row() -> Building:
    """Rooms 4 m wide along x: a wall without thickness, one of 0.08 m, one of 0.3 m, a shaft of 1 m; all y in 0..4."""
    edges = ((0, 4), (4, 8), (8.08, 12), (12.3, 16), (17, 20))
    return Building("row", tuple(rectangle(f"room {i}", low, 0, high, 4) for i, (low, high) in enumerate(edges)))


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def crossed(building: Building, origin, *places) -> list[tuple[int, int]]:
    light, heavy = obstacles(building)[0].walls_crossed(np.array(origin, float), np.array(places, float))
    return list(zip(light.tolist(), heavy.tolist(), strict=True))


def test_walls_count_once_and_by_their_thickness_however_they_are_crossed(row: Building):
    along = [(3, 2), (6, 2), (10, 2), (14, 2), (18, 2)]
    #  none, one line, 0.08 m, 0.3 m, two faces of a shaft
    assert crossed(row, (1, 2), *along) == [(0, 0), (1, 0), (2, 0), (2, 1), (2, 3)]
    assert crossed(row, (18, 2), *along) == [(2, 3), (1, 3), (0, 3), (0, 2), (0, 0)]
    # At 72 degrees to the normal the two faces of the wall of 0.3 m lie 1 m apart along the ray.
    assert crossed(row, (11.8, 0.5), (12.9, 3.9)) == [(0, 1)]


def test_both_ways_cross_the_same(rng: np.random.Generator):
    building = make_office(np.random.default_rng(3), num_levels=1, area_m2=900.0)
    here = obstacles(building)[0]
    _, places = building.sample_uniform(rng, 40)
    forth = np.stack([sum(here.walls_crossed(place, places)) for place in places])
    np.testing.assert_array_equal(forth, forth.T)


def test_sectors_lose_no_crossing(rng: np.random.Generator):
    """Against the plain test of every ray with every line."""
    start, end = rng.uniform(-9, 9, (300, 2)), rng.uniform(-9, 9, (300, 2))
    lines = PlanLines(start, end)
    for origin in ([0.0, 0.0], [20.0, 1.0], [-3.0, 4.0]):
        places = rng.uniform(-12, 12, (200, 2))
        place, line, fraction = lines.crossings(np.array(origin), places)
        ray, along = (places - origin)[:, None], (end - start)[None]
        towards = cross(ray, along)
        away = start[None] - origin
        on_ray, on_line = cross(away, along) / towards, cross(away, ray) / towards
        expected = np.argwhere((on_ray > 0) & (on_ray < 1) & (on_line > 0) & (on_line < 1))
        assert set(zip(place.tolist(), line.tolist(), strict=True)) == set(map(tuple, expected.tolist()))
        np.testing.assert_allclose(fraction, on_ray[place, line])
        assert (np.diff(place + fraction) >= 0).all()


def walls_one_by_one(here: Obstacles, origin: np.ndarray, places: np.ndarray) -> list[tuple[int, int]]:
    """`Obstacles.walls_crossed` in plain words: the faces of each ray from near to far, grouped into walls."""
    lines, found = here.walls, []
    along = lines.end_xy_m - lines.start_xy_m
    along /= np.hypot(*along.T)[:, None]
    for place in places:
        _, line, fraction = lines.crossings(origin, place[None])
        ray_m = np.hypot(*(place - origin))
        walls: list[list[float]] = []  # of each, how far behind the last one its faces lie
        for nth in range(len(line)):
            if nth == 0:
                walls.append([0.0])
                continue
            gap_m = (fraction[nth] - fraction[nth - 1]) * ray_m
            is_parallel = abs(cross(along[line[nth - 1]], along[line[nth]])) < PARALLEL
            across_m = gap_m * abs(cross((place - origin) / ray_m, along[line[nth]])) if is_parallel else gap_m
            if min(gap_m, across_m) < MAX_WALL_M:
                walls[-1].append(across_m)
            else:
                walls.append([0.0])
        light = sum(len(faces) > 1 and max(faces) <= LIGHT_WALL_M for faces in walls)
        found.append((light, len(walls) - light))
    return found


@pytest.mark.parametrize("plan", ["office", "mall"])
def test_walls_are_those_of_the_plain_count(plan: str):
    rng = np.random.default_rng(6)
    building = {"office": make_office, "mall": make_mall}[plan](np.random.default_rng(3))
    here = obstacles(building)[0]
    _, places = building.sample_uniform(rng, 150, 0)
    for origin in places[:4]:
        light, heavy = here.walls_crossed(origin, places)
        expected = walls_one_by_one(here, origin, places)
        assert list(zip(light.tolist(), heavy.tolist(), strict=True)) == expected
        assert sum(map(sum, expected)) > 100


def test_a_turned_plan_has_the_same_walls(rng: np.random.Generator):
    building = make_office(np.random.default_rng(5), num_levels=1, area_m2=900.0)
    turn_rad = 0.7
    turn = np.array([[np.cos(turn_rad), -np.sin(turn_rad)], [np.sin(turn_rad), np.cos(turn_rad)]])
    turned = Building(
        "turned",
        tuple(
            replace(p, outline_xy_m=p.outline_xy_m @ turn.T, holes=tuple(h @ turn.T for h in p.holes))
            for p in building.polygons
        ),
    )
    _, places = building.sample_uniform(rng, 300)
    one = obstacles(building)[0].walls_crossed(places[0], places[1:])
    other = obstacles(turned)[0].walls_crossed(places[0] @ turn.T, places[1:] @ turn.T)
    np.testing.assert_array_equal(one, other)


def test_doors_are_connections_as_wide_as_a_door(two_rooms: Building):
    here = obstacles(two_rooms)[0]
    places = np.array([[6.0, 1.5], [6.0, 3.0], [3.0, 1.0], [10.0, 1.5]])
    place, door = here.doors_crossed(np.array([1.0, 1.5]), places)
    assert (place.tolist(), door.tolist()) == ([0, 3], [0, 0])
    assert crossed(two_rooms, (1, 1.5), *places) == [(0, 0), (1, 0), (0, 0), (1, 0)]


def test_a_sill_has_one_door_however_deep():
    w = WALL
    polygons = (
        FloorPolygon(
            "west",
            np.array([[0, 0], [4, 0], [4, 1], [4, 1.9], [4, 4], [0, 4]], float),
            np.array([w, w, 1, w, w, w]),
            0.0,
            0,
        ),
        rectangle("sill", 4, 1, 4.7, 1.9, (w, 2, w, 0)),
        FloorPolygon(
            "east",
            np.array([[4.7, 0], [8, 0], [8, 4], [4.7, 4], [4.7, 1.9], [4.7, 1]], float),
            np.array([w, w, w, w, 1, w]),
            0.0,
            0,
        ),
    )
    here = obstacles(Building("deep", polygons))[0]
    place, door = here.doors_crossed(np.array([1.0, 1.5]), np.array([[6.0, 1.5], [4.3, 1.5], [2.0, 1.5]]))
    assert (place.tolist(), door.tolist()) == ([0, 1], [0, 0])
    assert crossed(Building("deep", polygons), (1, 1.5), (6, 1.5)) == [(0, 0)]


def test_a_void_stops_no_ray_and_a_shaft_does():
    void, shaft = [[2, 2], [2, 3], [3, 3], [3, 2]], [[6, 2], [6, 3], [7, 3], [7, 2]]
    ground = rectangle("ground", 0, 0, 9, 5, holes=(shaft,))
    gallery = rectangle("gallery", 0, 0, 9, 5, height_m=3.0, level=1, holes=(void, shaft))
    here = obstacles(Building("gallery", (ground, gallery)))[1]
    light, heavy = here.walls_crossed(np.array([1.0, 2.5]), np.array([[4.0, 2.5], [8.0, 2.5]]))
    assert (light.tolist(), heavy.tolist()) == ([0, 0], [0, 2])
