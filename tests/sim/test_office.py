from __future__ import annotations

import re

import numpy as np
import pytest
import shapely

from pdrbench.building import WALL, Building
from pdrbench.errors import MapError
from pdrbench_sim.buildings.office import make_office


def connection_widths_m(building: Building, one: str, other: str) -> np.ndarray:
    """Widths of the connections from polygons whose id matches `one` to those that match `other`."""
    edges = np.flatnonzero(building.edge_neighbour != WALL)
    ids = [polygon.id for polygon in building.polygons]
    keep = [
        edge
        for edge in edges
        if re.search(one, ids[building.edge_polygon[edge]]) and re.search(other, ids[building.edge_neighbour[edge]])
    ]
    return np.hypot(*(building.edge_end_xy_m[keep] - building.edge_start_xy_m[keep]).T)


@pytest.mark.parametrize(("area_m2", "num_levels", "seed"), [(600, 1, 2), (1400, 4, 3), (20_000, 5, 4)])
def test_area_is_met_within_one_percent(area_m2, num_levels, seed):
    building = make_office(np.random.default_rng(seed), num_levels=num_levels, area_m2=area_m2)
    assert building.area_m2 == pytest.approx(area_m2, rel=0.01)
    assert building.levels == tuple(range(num_levels))


@pytest.mark.parametrize("seed", range(2))
def test_corridors_doors_and_stairs_have_the_sizes_of_real_ones(seed):
    building = make_office(np.random.default_rng(seed))
    for polygon in building.polygons:
        if "/corridor-" in polygon.id or "/cross-" in polygon.id:
            assert 1.8 - 1e-3 <= np.ptp(polygon.outline_xy_m, axis=0).min() <= 2.4 + 1e-3
        if re.search(r"-(up|down)-\d+$", polygon.id):
            depth_m = np.ptp(polygon.outline_xy_m[:, 1])
            assert 0.28 - 1.5e-3 <= depth_m <= 0.30 + 1.5e-3
    doors_m = connection_widths_m(building, r"/room-\d+$", "/corridor-")
    assert np.min(doors_m) == pytest.approx(0.9)
    assert np.mean(np.isclose(doors_m, 0.9)) > 0.6
    np.testing.assert_allclose(connection_widths_m(building, r"/stairwell-[^/]*\d[ns]?$", "/corridor-"), 0.9)


@pytest.mark.parametrize("seed", range(2))
def test_stairs_rise_evenly_from_level_to_level(seed):
    building = make_office(np.random.default_rng(seed))
    height_m = building.height(np.arange(len(building.polygons)))
    is_stairs = np.array([polygon.kind == "stairs" for polygon in building.polygons])
    edges = np.flatnonzero(building.edge_neighbour != WALL)
    one, other = building.edge_polygon[edges], building.edge_neighbour[edges]
    rise_m = np.abs(height_m[one] - height_m[other])[is_stairs[one] | is_stairs[other]]
    assert rise_m.min() >= 0.15
    assert rise_m.max() <= 0.18
    np.testing.assert_allclose(rise_m, rise_m[0], atol=1.1e-3)  # heights are whole millimetres
    np.testing.assert_array_equal(rise_m > 0, True)
    # At the top of the stairs is the next floor, not something near it.
    floors = {level: set() for level in building.levels}
    for polygon in building.polygons:
        if polygon.kind == "floor":
            floors[polygon.level].add(polygon.height_m)
    assert [len(heights) for heights in floors.values()] == [1, 1, 1]


def test_polygons_of_one_level_do_not_overlap_and_flights_of_consecutive_levels_do(office):
    for level in office.levels:
        on_level = [p for p in office.polygons if p.level == level]
        assert office.walkable(level).area == pytest.approx(sum(p.area_m2 for p in on_level), abs=1e-6)
    stairs = [
        shapely.union_all(
            [shapely.Polygon(p.outline_xy_m) for p in office.polygons if p.kind == "stairs" and p.level == k]
        )
        for k in (0, 1)
    ]
    assert stairs[0].intersection(stairs[1]).area > 0.9 * stairs[0].area


@pytest.mark.parametrize("wish", [{"area_m2": 600.0}, {"num_levels": 0}, {"area_m2": float("nan")}])
def test_impossible_wishes_are_refused(wish):
    with pytest.raises(MapError, match="level"):
        make_office(np.random.default_rng(0), **wish)
