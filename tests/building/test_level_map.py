from __future__ import annotations

import numpy as np
import pytest

from pdrbench.building import WALL, Building, FloorPolygon
from pdrbench.building.convex import compile_map
from pdrbench.building.level_map import TIDY_M, level_map
from pdrbench.errors import MapError


@pytest.fixture(scope="module")
def touching() -> Building:
    """A hall whose shop touches the outer wall in one point of a straight side, as drawn plans have it."""
    hall = [[0, 0], [10, 0], [20, 0], [20, 10], [0, 10]]
    shop = [[10, 0], [8, 3], [12, 3]]
    return Building("mall", (FloorPolygon("hall", hall, [WALL] * 8, 0.0, 2, holes=(np.array(shop),)),))  # type: ignore[arg-type]


def test_a_plan_that_does_not_compile_gets_thicker_walls(touching: Building) -> None:
    with pytest.raises(Exception):  # noqa: B017 - whatever the triangulation makes of it
        compile_map(touching)
    tidied = level_map(touching, 2)
    corners = tidied.corner_xy_m + tidied.origin_xy_m
    assert np.ptp(corners, axis=0) == pytest.approx([20 - 2 * TIDY_M, 10 - 2 * TIDY_M], abs=0.005)
    assert set(tidied.level.tolist()) == {2}


def test_the_nearest_floor(touching: Building) -> None:
    convex = level_map(touching, 2)
    (inside, moved), cell = convex.nearest(np.array([[5.0, 5.0], [10.0, 2.5]]), 2)  # one in the shop
    assert inside.tolist() == [5.0, 5.0]
    assert touching.contains(moved, 2).all()
    assert np.hypot(*(moved - [10.0, 2.5])) < 1.6
    assert convex.outside_m(cell, convex.local(np.array([inside, moved]))).max() < 0
    with pytest.raises(MapError, match="no floor on level 0"):
        convex.nearest(np.zeros((1, 2)), 0)


def test_a_plan_that_compiles_is_taken_as_it_is(house: Building) -> None:
    assert level_map(house, 0) is compile_map(house)
