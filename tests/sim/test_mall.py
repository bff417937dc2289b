from __future__ import annotations

import numpy as np
import pytest
import shapely

from pdrbench.building import WALL
from pdrbench.building.connectivity import reachable_parts
from pdrbench.errors import MapError
from pdrbench_sim.buildings.mall import MallParams, make_mall
from pdrbench_sim.radio.rays import obstacles


@pytest.mark.parametrize("num_levels", [1, 3])
def test_every_shop_can_be_reached_from_the_concourse(num_levels: int):
    mall = make_mall(np.random.default_rng(4), num_levels=num_levels, area_m2=9000.0 * num_levels)
    assert not reachable_parts(mall, by_lift=False).any()
    assert set(mall.levels) == set(range(num_levels))
    kinds = [zone.kind for zone in mall.zones]
    assert kinds.count("concourse") == num_levels
    assert kinds.count("shop") >= 12 * num_levels


def test_one_level_has_the_area_that_was_asked_for_and_no_gap():
    params = MallParams(passage_every_m=np.inf)
    for seed, area_m2 in enumerate((7500.0, 12000.0, 24000.0)):
        mall = make_mall(np.random.default_rng(seed), area_m2=area_m2, params=params)
        assert mall.area_m2 == pytest.approx(area_m2, rel=1e-4)


def test_passages_lie_behind_shops_and_only_their_walls_take_floor():
    params = MallParams(passage_every_m=25.0)
    for seed in range(2):
        mall = make_mall(np.random.default_rng(seed), area_m2=24000.0, params=params)
        floors = {p.id: shapely.Polygon(p.outline_xy_m, p.holes) for p in mall.polygons}
        passages = {name: shape for name, shape in floors.items() if "passage" in name}
        assert len(passages) >= 6
        together = shapely.union_all(list(floors.values()))
        assert together.area == pytest.approx(mall.area_m2, abs=0.1)  # no overlaps
        outline = shapely.box(*together.bounds)
        assert outline.area == pytest.approx(24000.0, rel=1e-4)
        walls = outline.difference(together)
        assert walls.area == pytest.approx(24000.0 - mall.area_m2, abs=0.1)
        all_passages = shapely.union_all(list(passages.values()))
        nearby = all_passages.buffer(params.passage_wall_m + 2e-3, join_style="mitre")
        assert walls.difference(nearby).area < 0.05
        for passage in passages.values():
            assert 10.0 < passage.area / np.mean(params.passage_width_m) < 100.0  # metres of passage
            touched = [name for name, shape in floors.items() if shape is not passage and shape.touches(passage)]
            assert touched == ["0/concourse"]


def test_passages_are_reached_and_heavy_walls_shut_them_off_from_the_concourse():
    mall = make_mall(np.random.default_rng(1), area_m2=24000.0)
    polygon, xy_m = mall.sample_uniform(np.random.default_rng(0), 20_000, 0)
    names = np.array([p.id for p in mall.polygons])[polygon]
    inside, concourse = xy_m[np.char.find(names, "passage") >= 0][:100], xy_m[names == "0/concourse"][:100]
    assert len(inside) == 100
    assert not reachable_parts(mall, by_lift=False).any()
    heavy = [obstacles(mall)[0].walls_crossed(place, concourse)[1] for place in inside]
    assert np.mean(np.array(heavy) > 0) > 0.8
    among = [obstacles(mall)[0].walls_crossed(place, concourse)[1] for place in concourse]
    assert np.mean(np.array(among) > 0) < 0.1


def test_shops_differ_from_level_to_level_and_from_seed_to_seed():
    mall = make_mall(np.random.default_rng(3), num_levels=2, area_m2=24000.0)
    fronts = [
        np.sort(np.hypot(*(mall.edge_end_xy_m - mall.edge_start_xy_m)[own].T))
        for level in (0, 1)
        for own in [(mall.edge_neighbour != WALL) & (mall.level(mall.edge_polygon) == level)]
    ]
    assert not np.array_equal(*fronts)
    same, other = (make_mall(np.random.default_rng(seed), num_levels=2, area_m2=24000.0) for seed in (3, 5))
    np.testing.assert_array_equal(same.edge_start_xy_m, mall.edge_start_xy_m)
    assert (
        other.edge_start_xy_m.shape != mall.edge_start_xy_m.shape
        or (other.edge_start_xy_m != mall.edge_start_xy_m).any()
    )


def test_too_small_an_area_is_an_error():
    with pytest.raises(MapError, match="needs 7000 m2 per level; got 500 m2"):
        make_mall(np.random.default_rng(0), area_m2=500.0)
    with pytest.raises(MapError, match="at least 1 level"):
        make_mall(np.random.default_rng(0), num_levels=0)
