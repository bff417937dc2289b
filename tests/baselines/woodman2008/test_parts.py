"""Parts of the filter by themselves: discs of floor, drift of turns, systematic resampling."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pdrbench.building import Building
from pdrbench.filters import FilterError
from pdrbench_baselines.woodman2008 import resampling
from pdrbench_baselines.woodman2008.discs import floor_around, floor_from
from pdrbench_baselines.woodman2008.drift import TurnDrift


def test_a_disc_on_open_floor(hangar: Building, rng: np.random.Generator) -> None:
    for region in (floor_around(hangar, [20.0, 20.0], 0, 3.0), floor_from(hangar, 0, [20.0, 20.0], 3.0)):
        assert region.area_m2 == pytest.approx(math.pi * 9, rel=0.01)  # 32 facets are 0.6 % short
        _, xy_m = region.sample(rng, 1000)
        assert np.hypot(*(xy_m - 20.0).T).max() <= 3.0


def test_flights_belong_to_the_disc_and_the_level_decides_where_floors_overlap(stairs: Building) -> None:
    from_the_room = floor_from(stairs, 0, [5.0, 5.5], 2.5)
    # treads up to x = 7; not the room behind the wall, half a metre away
    assert set(from_the_room.polygon) == {0, 1, 2, 3, 4}
    given = floor_around(stairs, [5.0, 5.5], 0, 2.5)
    assert set(given.polygon) == {0, 1, 2, 3, 4, 20}  # of a given start only the level is known
    assert from_the_room.area_m2 < given.area_m2
    landing = floor_around(stairs, [12.0, 3.0], 1, 1.0)
    assert set(stairs.level(landing.polygon)) == {1}


def test_a_place_without_floor_is_an_error(stairs: Building) -> None:
    with pytest.raises(
        FilterError, match=r"level 0 of building 'stairs' lies within 1 m of \(30.00, 3.00\).*\(.* 0, 1\)"
    ):
        floor_around(stairs, [30.0, 3.0], 0, 1.0)
    with pytest.raises(FilterError, match="radius above 0 m; got 0"):
        floor_from(stairs, 0, [3.0, 3.0], 0.0)


def test_equals_the_mean_of_the_observed_values() -> None:
    """With a flat prior, the Kalman filter is the running mean, and its sigma falls with the root of n."""
    rng = np.random.default_rng(0)
    turns = rng.normal(0, 0.3, 500)
    seen = 0.01 + rng.normal(0, 0.02, 500)
    drift = TurnDrift(mean_rad=0.0, sigma_rad=1e3, turn_sigma_rad=0.02)
    for turned, more in zip(turns, seen, strict=True):
        drift = drift.observed(reported_rad=float(turned + more), turned_rad=float(turned))
    assert drift.mean_rad == pytest.approx(seen.mean(), abs=1e-9)
    assert drift.sigma_rad == pytest.approx(0.02 / np.sqrt(500), rel=1e-6)


def test_turns_are_compared_the_short_way_round_and_an_exactly_known_drift_is_not_estimated() -> None:
    drift = TurnDrift(0.0, 0.1, 0.1).observed(reported_rad=np.pi - 0.01, turned_rad=-np.pi + 0.01)
    assert drift.mean_rad == pytest.approx(-0.01)
    drift = TurnDrift(0.002, 0.0, 0.01)
    assert drift.observed(1.0, 0.5) is drift


@pytest.mark.parametrize("count", [100, 50_000])
def test_systematic_resampling_gives_every_particle_its_fraction(rng: np.random.Generator, count: int) -> None:
    """Systematic resampling: N w offspring, rounded up or down, in total exactly as many as asked for."""
    weight = np.where(rng.random(count) < 0.3, 0, rng.exponential(size=count)).astype(np.float32)
    weight[3] = weight.sum() * 0.05  # thousands of copies of one particle
    cells = np.sort(rng.integers(0, 7, count)).astype(np.int32)
    number = 3 * count
    chunks = resampling.chunks_of(count)
    sums, offspring = np.empty((chunks, 2)), np.zeros((chunks, 7), np.int32)
    resampling.sum_weights((0, chunks, 0), weight, count, sums)
    before = np.concatenate([[0.0], np.cumsum(sums[:, 0])])
    scale = number / before[-1]
    resampling.count_offspring((0, chunks, 0), weight, cells, count, before, scale, 0.37, offspring)
    resampling.place_offspring(offspring, 5)
    ancestor = np.full(number + 5, -1, np.int32)
    resampling.choose_ancestors((0, chunks, 0), weight, cells, count, before, scale, 0.37, offspring, ancestor)
    copies = np.bincount(ancestor[5:], minlength=count)
    assert copies.sum() == number
    assert np.abs(copies - weight.astype(np.float64) * scale).max() < 1 + 1e-6
    assert (np.diff(cells[ancestor[5:]]) >= 0).all()
    assert (ancestor[:5] == -1).all()
