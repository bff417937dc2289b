"""Power: variances that are drawn are found, and what is planned with them comes true."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pdrbench.metrics.ranking import smallest_ratio
from pdrbench_leaderboard.spreads import Design, Spread, measured_spread, neighbour_error, walks_for


def draw(rng: np.random.Generator, units: int, per_unit: int, seeds: int, spread: Spread) -> np.ndarray:
    """(W, S) logarithms of a ratio."""
    unit = np.repeat(rng.normal(0, math.sqrt(spread.unit), units), per_unit)[:, None]
    walk = rng.normal(0, math.sqrt(spread.walk), (units * per_unit, 1))
    return np.asarray(unit + walk + rng.normal(0, math.sqrt(spread.seed), (units * per_unit, seeds)))


def test_variances_of_units_walks_and_seeds_are_found() -> None:
    drawn = Spread(unit=0.3, walk=0.2, seed=0.1)
    found = measured_spread(draw(np.random.default_rng(1), 2000, 3, 2, drawn), np.repeat(np.arange(2000), 3))
    # relative standard error of a variance of 2000 units: sqrt(2 / 2000) = 3 %; the units' has that of a sum, 5 %
    assert (found.unit, found.walk, found.seed) == pytest.approx((0.3, 0.2, 0.1), rel=0.15)


def test_what_cannot_be_told_apart_is_counted_once() -> None:
    values = draw(np.random.default_rng(2), 4000, 1, 1, Spread(0.3, 0.2, 0.1))
    found = measured_spread(values, np.arange(4000))
    assert found.unit == pytest.approx(0.6, rel=0.1) and (found.walk, found.seed) == (0.0, 0.0)
    one_person = measured_spread(values, np.zeros(4000, dtype=np.int64))
    assert one_person == found, "the walks of one person are the units"
    missing = measured_spread(np.vstack([values, [[math.nan]]]), np.arange(4001))
    assert missing == found


def test_errors_of_environments_add_up() -> None:
    pair = {"E-v1": Spread(0.4, 0.0, 0.0), "F-v1": Spread(0.1, 0.3, 0.1)}
    designs = {"E-v1": Design(40, 40, 40), "F-v1": Design(10, 80, 10)}
    error, degrees = neighbour_error([pair], designs)
    large, small = 30 / 40, 10 / 40  # weights: ten units are a third of thirty
    assert error == pytest.approx(math.sqrt(large**2 * 0.4 / 40 + small**2 * (0.1 / 10 + 0.4 / 80)))
    assert 9 < degrees < 49
    assert math.isnan(neighbour_error([{"E-v1": Spread(0.0, 0.0, 0.0)}], designs)[0]), "they answer the same"


def test_so_many_walks_tell_what_they_are_planned_for() -> None:
    for ratio in (1.1, 1.25):
        walks = walks_for(ratio, 0.05, 99, 100)
        assert walks is not None
        assert smallest_ratio(0.05 * math.sqrt(100 / walks), 99 * walks / 100) <= ratio
        assert smallest_ratio(0.05 * math.sqrt(100 / (walks - 1)), 99 * (walks - 1) / 100) > ratio * 0.999
    assert walks_for(1.1, math.nan, 9, 10) is None
