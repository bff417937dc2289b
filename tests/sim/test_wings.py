from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import shapely

from pdrbench.building import Building
from pdrbench.building.connectivity import lift_shafts, reachable_parts
from pdrbench_sim.buildings.wings import make_ring_floors, make_wings

KINDS = [make_ring_floors, make_wings]


@pytest.mark.parametrize("make", KINDS)
@pytest.mark.parametrize("seed", range(6))
def test_every_room_can_be_walked_to_and_no_two_overlap(make: Callable[..., Building], seed: int) -> None:
    building = make(np.random.default_rng(seed), num_levels=3)
    assert building.levels == (0, 1, 2)
    assert reachable_parts(building, by_lift=False).max() == 0
    assert all(len(shaft) == 3 for shaft in lift_shafts(building))
    for level in building.levels:
        shapes = [shapely.Polygon(p.outline_xy_m, p.holes) for p in building.polygons if p.level == level]
        overlap_m2 = sum(shape.area for shape in shapes) - shapely.unary_union(shapes).area
        assert abs(overlap_m2) < 0.5


@pytest.mark.parametrize("make", KINDS)
def test_the_same_numbers_give_the_same_building(make: Callable[..., Building]) -> None:
    same, again, other = (make(np.random.default_rng(seed)).sha256 for seed in (3, 3, 4))
    assert same == again != other


def test_a_hall_has_no_walls_inside() -> None:
    building = make_wings(np.random.default_rng(1))
    hall = max((p for p in building.polygons if p.id == "0/hall"), key=lambda p: p.area_m2)
    assert hall.area_m2 > 250.0
