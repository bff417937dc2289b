"""The replica of the floor of Köping et al. 2012."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from pdrbench.errors import MapError
from pdrbench_lab.papers.koeping2012.building_site.site import SiteParams, draw_visits, make_site
from pdrbench_sim.people.route import navigation_mesh


@pytest.mark.parametrize("seed", range(8))
def test_floor_is_that_of_the_paper(seed: int) -> None:
    building = make_site(np.random.default_rng(seed))
    assert building.bounds_m() == (0.0, 0.0, 16.0, 30.0)
    assert building.area_m2 == pytest.approx(480.0)
    assert building.levels == (2,)
    assert 9 <= len(building.polygons) <= 25
    corridor = building.polygons[0]
    leads = {int(edge) for edge in corridor.neighbour if edge >= 0}
    assert leads == set(range(1, len(building.polygons)))  # every room has a door to the corridor


def test_visits_lead_to_another_room_each_time() -> None:
    mesh = navigation_mesh(make_site(np.random.default_rng(0)))
    places = draw_visits(np.random.default_rng(0), mesh, 12)
    assert len(places) == 12
    assert all(one.polygon != next_.polygon for one, next_ in itertools.pairwise(places))


@pytest.mark.parametrize("sizes", [{"size_m": (4.0, 30.0)}, {"size_m": (16.0, 2.0)}, {"room_m": (1.0, 2.0)}])
def test_floors_without_room_for_rooms_are_refused(sizes: dict) -> None:
    with pytest.raises(MapError):
        SiteParams(**sizes)
