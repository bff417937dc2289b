from __future__ import annotations

import math

import numpy as np
import pytest

from pdrbench.building import Building
from pdrbench.filters import FilterError
from pdrbench_baselines.woodman2008.discs import floor_around, floor_from


def test_a_disc_on_open_floor(hangar: Building, rng: np.random.Generator) -> None:
    for region in (floor_around(hangar, [20.0, 20.0], 0, 3.0), floor_from(hangar, 0, [20.0, 20.0], 3.0)):
        assert region.area_m2 == pytest.approx(math.pi * 9, rel=0.01)  # 32 facets are 0.6 % short
        _, xy_m = region.sample(rng, 1000)
        assert np.hypot(*(xy_m - 20.0).T).max() <= 3.0


def test_walls_part_it_and_flights_belong_to_it(stairs: Building) -> None:
    from_the_room = floor_from(stairs, 0, [5.0, 5.5], 2.5)
    assert set(from_the_room.polygon) == {
        0,
        1,
        2,
        3,
        4,
    }  # treads up to x = 7; not the room behind the wall, half a metre away
    given = floor_around(stairs, [5.0, 5.5], 0, 2.5)
    assert set(given.polygon) == {0, 1, 2, 3, 4, 20}  # of a given start only the level is known
    assert from_the_room.area_m2 < given.area_m2


def test_the_level_decides_where_floors_overlap(stairs: Building) -> None:
    landing = floor_around(stairs, [12.0, 3.0], 1, 1.0)
    assert set(stairs.level(landing.polygon)) == {1}


def test_a_place_without_floor_is_an_error(stairs: Building) -> None:
    with pytest.raises(
        FilterError, match=r"level 0 of building 'stairs' lies within 1 m of \(30.00, 3.00\).*\(.* 0, 1\)"
    ):
        floor_around(stairs, [30.0, 3.0], 0, 1.0)
    with pytest.raises(FilterError, match="radius above 0 m; got 0"):
        floor_from(stairs, 0, [3.0, 3.0], 0.0)
