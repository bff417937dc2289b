from __future__ import annotations

import numpy as np
import pytest

from pdrbench.building import WALL
from pdrbench.errors import MapError
from pdrbench.simulate.mall import MallParams, make_mall
from pdrbench.simulate.route import Place, navigation_mesh


@pytest.mark.parametrize("num_levels", [1, 3])
def test_every_shop_can_be_reached_from_the_concourse(num_levels: int):
    mall = make_mall(np.random.default_rng(4), num_levels=num_levels, area_m2=9000.0 * num_levels)
    start = next(i for i, polygon in enumerate(mall.polygons) if polygon.id == "0/concourse")
    sample, xy_m = mall.sample_uniform(np.random.default_rng(0), 200, 0)
    place = Place(start, xy_m[sample == start][0])
    assert navigation_mesh(mall).reachable(place).all()
    assert set(mall.levels) == set(range(num_levels))
    kinds = [zone.kind for zone in mall.zones]
    assert kinds.count("concourse") == num_levels
    assert kinds.count("shop") >= 12 * num_levels


def test_one_level_has_the_area_that_was_asked_for_and_no_gap():
    for seed, area_m2 in enumerate((7500.0, 12000.0, 24000.0)):
        assert make_mall(np.random.default_rng(seed), area_m2=area_m2).area_m2 == pytest.approx(area_m2, rel=1e-4)


def test_concourses_are_as_wide_as_the_parameters_say():
    params = MallParams()
    mall = make_mall(np.random.default_rng(1), area_m2=9000.0, params=params)
    concourse = next(polygon for polygon in mall.polygons if polygon.id == "0/concourse")
    low, high = concourse.outline_xy_m.min(axis=0), concourse.outline_xy_m.max(axis=0)
    holes = np.concatenate(concourse.holes)
    margins_m = np.concatenate([holes.min(axis=0) - low, high - holes.max(axis=0)])
    assert (margins_m >= params.concourse_width_m[0] - 2e-3).all()
    assert (margins_m <= params.concourse_width_m[1] + 2e-3).all()


def test_only_upper_levels_have_a_void_and_only_the_lowest_has_entrances():
    mall = make_mall(np.random.default_rng(2), num_levels=2, area_m2=24000.0)
    ground, upper = (next(p for p in mall.polygons if p.id == f"{level}/concourse") for level in (0, 1))
    assert len(upper.holes) == len(ground.holes) + 1
    entrances = {polygon.level for polygon in mall.polygons if "entrance" in polygon.id}
    assert entrances == {0}


def test_shops_differ_from_level_to_level_and_from_seed_to_seed():
    mall = make_mall(np.random.default_rng(3), num_levels=2, area_m2=24000.0)
    fronts = [
        np.sort(np.hypot(*(mall.edge_end_xy_m - mall.edge_start_xy_m)[own].T))
        for level in (0, 1)
        for own in [(mall.edge_leads_to != WALL) & (mall.level(mall.edge_polygon) == level)]
    ]
    assert not np.array_equal(*fronts)
    same, other = (make_mall(np.random.default_rng(seed), num_levels=2, area_m2=24000.0) for seed in (3, 5))
    np.testing.assert_array_equal(same.edge_start_xy_m, mall.edge_start_xy_m)
    assert (
        other.edge_start_xy_m.shape != mall.edge_start_xy_m.shape
        or (other.edge_start_xy_m != mall.edge_start_xy_m).any()
    )


def test_what_is_too_small_says_so():
    with pytest.raises(MapError, match="needs 7000 m2 per level; got 500 m2"):
        make_mall(np.random.default_rng(0), area_m2=500.0)
    with pytest.raises(MapError, match="at least 1 level"):
        make_mall(np.random.default_rng(0), num_levels=0)
