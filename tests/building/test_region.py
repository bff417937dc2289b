from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from pdrbench.building import Building, FloorRegion
from pdrbench.errors import MapError


@pytest.fixture
def region() -> FloorRegion:
    """Triangles of 0.5, 4 and 1 m2; the first two belong to polygon 7 and lie apart, the third lies over the first."""
    corners = [[[0, 0], [1, 0], [0, 1]], [[2, 0], [4, 0], [2, 4]], [[0, 0], [0, 2], [1, 0]]]
    return FloorRegion(np.array(corners, dtype=float), np.array([7, 7, 3]))


def test_area_counts_holes_and_treads_and_samples_are_inside(house: Building, rng: np.random.Generator):
    whole = FloorRegion.whole(house)
    assert whole.area_m2 == pytest.approx(house.area_m2, rel=1e-12)
    for polygon, piece in enumerate(house.polygons):
        assert whole.restricted(whole.polygon == polygon).area_m2 == pytest.approx(piece.area_m2, rel=1e-12)
    whole = FloorRegion.whole(house)
    polygon, xy_m = whole.sample(rng, 5000)
    assert whole.contains(polygon, xy_m).all()
    assert (house.locate(xy_m, house.level(polygon)) >= 0).all()
    drawn_from = whole.restricted(whole.polygon == 3)
    assert (drawn_from.sample(rng, 50)[0] == 3).all()


def test_sampling_is_uniform_by_area(region: FloorRegion, rng: np.random.Generator):
    polygon, xy_m = region.sample(rng, 22_000)
    number = np.select([polygon == 3, xy_m[:, 0] < 1.5], [2, 0], 1)
    expected = 22_000 * np.array([0.5, 4.0, 1.0]) / 5.5
    # 1e-4: a correct sampler fails once in 10 000 generators, and this one is fixed
    assert stats.chisquare(np.bincount(number), expected).pvalue > 1e-4
    # Within the large triangle: y / (4 - 2 (x - 2)) is uniform, and so is the square of its complement along x.
    x, y = xy_m[number == 1].T
    assert stats.kstest(y / (4 - 2 * (x - 2)), "uniform").pvalue > 1e-4
    assert stats.kstest((1 - (x - 2) / 2) ** 2, "uniform").pvalue > 1e-4


def test_contains_asks_for_the_polygon_and_counts_the_boundary(region: FloorRegion):
    places = np.array([[0.25, 0.25], [0.5, 0.5], [1, 0], [0.2, 1.2], [3.0, 2.0], [3.01, 2.01], [np.nan, 0.1]])
    assert region.contains(7, places).tolist() == [True, True, True, False, True, False, False]
    assert region.contains(3, places).tolist() == [True, True, True, True, False, False, False]
    assert not region.contains(5, places).any()


def test_an_empty_region_contains_nothing_and_says_so_when_drawn_from(house: Building, rng: np.random.Generator):
    whole = FloorRegion.whole(house)
    empty = whole.restricted(np.zeros(len(whole), dtype=bool))
    assert (len(empty), empty.area_m2) == (0, 0.0)
    assert not empty.contains(0, [[1.0, 1.0]]).any()
    with pytest.raises(MapError, match="no place to draw from"):
        empty.sample(rng, 1)
