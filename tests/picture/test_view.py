"""Buildings from above and aside, and particles in them."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

from pdrbench.building import Building
from pdrbench_formats.replays.view import PLAN, Dots, View, dots_of, exploded_view, floor_height_m, level_height_m
from pdrbench_sim.buildings.office import make_office


@pytest.fixture(scope="module")
def office() -> Building:
    return make_office(np.random.default_rng(4), num_levels=3, area_m2=8725.0)


def some_dots(building: Building, count: int, no_weight: float = 0.0) -> Dots:
    rng = np.random.default_rng(5)
    polygon, xy_m = building.sample_uniform(rng, count)
    weight = np.where(rng.random(count) < no_weight, 0.0, 1.0)
    found = dots_of({"particles_xy_m": xy_m, "particles_polygon": polygon, "particles_weight": weight}, building)
    assert found is not None
    return found


def test_a_plan_leaves_places_where_they_are_and_heights_are_stretched(rng: np.random.Generator) -> None:
    xy_m = rng.normal(size=(20, 2)) * 50
    np.testing.assert_allclose(PLAN.project(xy_m, rng.normal(size=20)), xy_m, atol=1e-12)
    view = View(azimuth_rad=0.0, elevation_rad=math.radians(30), stretch=10.0)
    origin, east, north, up = view.project(np.array([[0, 0], [3, 0], [0, 3], [0, 0]]), np.array([0, 0, 0, 3.0]))
    np.testing.assert_allclose(origin, 0.0, atol=1e-12)
    np.testing.assert_allclose(east, [3.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(north, [0.0, 1.5], atol=1e-12)
    np.testing.assert_allclose(up, [0.0, 30 * math.cos(math.radians(30))], atol=1e-12)


def test_no_level_hides_another(office: Building) -> None:
    view = exploded_view(office)
    drawn = {
        level: shapely.union_all(
            [
                shapely.Polygon(view.project(p.outline_xy_m, p.height_m))
                for p in office.polygons
                if p.level == level and p.kind == "floor"
            ]
        )
        for level in office.levels
    }
    for level in office.levels[1:]:
        assert drawn[level].intersection(drawn[level - 1]).area == 0.0
        assert drawn[level].distance(drawn[level - 1]) < 10.0  # and they are no farther apart than that takes


def test_heights_of_places_are_those_of_the_floor_below(building: Building) -> None:
    hall_m = level_height_m(building, 1)
    found = floor_height_m(building, [[6.0, 4.5], [18.0, 3.0], [12.1, 1.0], [-50.0, 0.0], [6.0, 4.5]], [0, 1, 0, 1, 9])
    np.testing.assert_allclose(found, [0.0, hall_m, 0.17, hall_m, np.nan])


def test_dots_take_height_and_level_from_their_polygon(building: Building) -> None:
    debug = {"particles_xy_m": np.array([[6.0, 4.0], [18.0, 3.0], [np.nan, 0.0]])}
    hall = len(building.polygons) - 1
    given = dots_of(debug | {"particles_polygon": np.array([0, hall, 0])}, building)
    guessed = dots_of(debug | {"particles_level": np.array([0, 1, 0])}, building)
    assert given is not None and guessed is not None and dots_of({"num_particles": np.array(3)}, building) is None
    for found in (given, guessed):
        assert len(found) == 2  # the one without a polygon is left out
        assert found.level.tolist() == [0, 1]
        np.testing.assert_allclose(found.height_m, [0.0, level_height_m(building, 1)])
        assert found.alive.all()
    debug["particles_xy_m"][0] = -1.0
    assert given.xy_m[0].tolist() == [6.0, 4.0]


def test_thinning_keeps_an_even_choice(office: Building) -> None:
    dots = some_dots(office, 10_000)
    few = dots.thinned(100)
    assert len(few) == 100 and len(dots.thinned(20_000)) == 10_000
    assert few.xy_m[0].tolist() == dots.xy_m[0].tolist() and few.xy_m[-1].tolist() == dots.xy_m[-1].tolist()
