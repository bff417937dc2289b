"""The map walk against a readable reference, closed forms and invariances (claims W6 and W7)."""

from __future__ import annotations

import numpy as np
import pytest

from pdrbench.building import WALL, Building, FloorPolygon
from pdrbench.building.kernels import MAX_CROSSINGS
from pdrbench.errors import MapError


def walk(building: Building, polygon: int, start: np.ndarray, end: np.ndarray) -> tuple[int, bool]:
    """Algorithm 1 with complex numbers, one polygon after the other: slow, and written in another way."""
    here, done = polygon, 0.0
    a, b = complex(*start), complex(*end)
    for _ in range(MAX_CROSSINGS):
        hits = []
        rings = building.polygons[here].rings
        edges = [(complex(*p), complex(*q)) for ring in rings for p, q in zip(ring, np.roll(ring, -1, 0), strict=True)]
        for (p, q), to in zip(edges, building.polygons[here].neighbour.tolist(), strict=True):
            turned = (b - a) / (q - p)  # in the frame of the edge: leaving means a negative imaginary part
            if turned.imag >= 0:
                continue
            at = (a - p) / (q - p)
            t = at.imag / -turned.imag
            s = at.real + t * turned.real
            if -1e-9 <= s <= 1 + 1e-9 and done - 1e-9 <= t <= 1:
                hits.append((t, to))
        if not hits:
            return here, True
        first = min(t for t, _ in hits)
        met = [to for t, to in hits if t <= first + 1e-9]
        if WALL in met:
            return polygon, False
        here, done = met[0], first
    return polygon, False


def random_steps(house: Building, rng: np.random.Generator, count: int, length_m: float) -> tuple[np.ndarray, ...]:
    polygon, start = house.sample_uniform(rng, count)
    angle = rng.uniform(0, 2 * np.pi, count)
    return polygon, start, start + length_m * np.column_stack([np.cos(angle), np.sin(angle)])


@pytest.mark.parametrize("length_m", [0.0, 0.1, 1.2, 6.0, 40.0])
def test_agrees_with_the_twin(house: Building, rng: np.random.Generator, length_m: float) -> None:
    polygon, start, end = random_steps(house, rng, 400, length_m)
    reached, alive = house.move(polygon, start, end)
    expected = [walk(house, *step) for step in zip(polygon.tolist(), start, end, strict=True)]
    assert list(zip(reached.tolist(), alive.tolist(), strict=True)) == expected


def test_an_alive_point_is_in_the_polygon_it_reached(house: Building, rng: np.random.Generator) -> None:
    import shapely

    polygon, start, end = random_steps(house, rng, 20_000, 3.0)
    reached, alive = house.move(polygon, start, end)
    shapes = np.array([shapely.Polygon(p.outline_xy_m, p.holes).buffer(1e-9) for p in house.polygons])
    assert alive.any() and not alive.all()
    assert shapely.covers(shapes[reached[alive]], shapely.points(end[alive])).all()
    assert (reached[~alive] == polygon[~alive]).all()


def test_one_stride_climbs_many_treads(house: Building) -> None:
    reached, alive = house.move([1], [[15, 5.9]], [[15, 9.6]])
    assert alive.all() and house.polygons[reached[0]].id == "gallery"
    reached, alive = house.move([14], [[15, 9.6]], [[15, 5.9]])
    assert alive.all() and reached.tolist() == [1]


def test_along_a_wall_and_standing_on_it_a_walker_stays_in_its_polygon_and_level(house: Building) -> None:
    # the gallery lies over the hall: no segment falls through or is lifted
    assert house.move([14], [[1, 9.7]], [[1, 9.9]])[0].tolist() == [14]
    assert house.move([0], [[1, 9.7]], [[1, 9.9]])[0].tolist() == [0]
    reached, alive = house.move([0, 0, 0], [[1, 0], [5, 5], [0, 0]], [[9, 0], [5, 5], [0, 0]])
    assert alive.all() and (reached == 0).all()
    _, alive = house.move([0], [[5.0, 0.0]], [[5.0, -1.0]])
    assert not alive.any()


@pytest.mark.parametrize("jamb_m", [2.0, 3.0])
def test_a_step_that_hits_a_door_jamb_is_not_alive(house: Building, jamb_m: float) -> None:
    for start in ([8.0, jamb_m], [9.0, jamb_m - 0.5], [9.0, jamb_m + 0.5]):
        aim = np.array([10.0, jamb_m])
        _, alive = house.move([0], [start], [aim + (aim - start)])
        assert not alive.any()


def test_crossings_are_capped() -> None:
    def corridor(cells: int) -> Building:
        return Building(
            "corridor",
            tuple(
                FloorPolygon(
                    f"{i}",
                    [[i, 0], [i + 1, 0], [i + 1, 1], [i, 1]],
                    [WALL, i + 1 if i + 1 < cells else WALL, WALL, i - 1 if i else WALL],
                    0.0,
                    0,
                )
                for i in range(cells)
            ),
        )

    reached, alive = corridor(100).move([0, 0], [[0.5, 0.5], [0.5, 0.5]], [[60.5, 0.5], [80.5, 0.5]])
    assert alive.tolist() == [True, False] and reached.tolist() == [60, 0]


@pytest.mark.parametrize("angle_rad", [0.3, 1.9, -2.7])
def test_turning_and_shifting_everything_changes_nothing(
    house: Building, rng: np.random.Generator, angle_rad: float
) -> None:
    turn = np.array([[np.cos(angle_rad), -np.sin(angle_rad)], [np.sin(angle_rad), np.cos(angle_rad)]])

    def moved(xy_m: np.ndarray) -> np.ndarray:
        return xy_m @ turn.T + [120.0, -45.0]

    turned = Building(
        house.name,
        tuple(
            FloorPolygon(p.id, moved(p.outline_xy_m), p.neighbour, p.height_m, p.level, p.kind,
                         tuple(moved(hole) for hole in p.holes))
            for p in house.polygons
        ),
    )  # fmt: skip
    polygon, start, end = random_steps(house, rng, 5000, 2.0)
    before, after = house.move(polygon, start, end), turned.move(polygon, moved(start), moved(end))
    assert np.array_equal(before[0], after[0]) and np.array_equal(before[1], after[1])


def test_bad_arguments_are_errors(house: Building) -> None:
    with pytest.raises(MapError, match=r"polygon must lie in 0\.\.14"):
        house.move([-1], [[0, 0]], [[1, 1]])
    with pytest.raises(MapError, match="1 polygons, 2 starts and 1 ends"):
        house.move([0], [[0, 0], [1, 1]], [[1, 1]])
    assert len(house.move([], np.zeros((0, 2)), np.zeros((0, 2)))[0]) == 0
