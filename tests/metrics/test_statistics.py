"""Statistics over walks: known answers, coverage, order."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike
from scipy import stats

from pdrbench.geometry import FloatArray
from pdrbench.metrics.ecdf_band import ecdf_band
from pdrbench.metrics.statistics import (
    SUMMARIES,
    Units,
    holm,
    mean,
    mean_interval,
    median,
    over_seeds,
    quantile_interval,
    sign_flip_p,
)


def fresh() -> np.random.Generator:
    return np.random.default_rng(7)


# Intervals -----------------------------------------------------------------------------------------------------


def interval(values: ArrayLike, units: Units | None = None, **settings: Any) -> tuple[float, float]:
    low, high = mean_interval(values, units, **settings)
    return float(low), float(high)


def test_below_four_units_there_is_neither_interval_nor_band() -> None:
    assert all(math.isnan(end) for end in interval([1.0, 2.0, 3.0]))
    assert all(math.isnan(end) for end in interval([1.0, 2.0, 3.0, math.nan]))
    assert all(math.isnan(end) for end in interval(np.arange(30.0), ["a", "b", "c"] * 10))
    assert all(math.isnan(end) for end in quantile_interval([np.arange(9.0)] * 3, 0.5))
    low, high = interval([1.0, 2.0, 3.0, 4.0])
    assert low < 2.5 < high
    walks = {f"w{i}": [1.0, 2.0] for i in range(4)}
    assert band(walks) is not None
    assert band(walks, unit={walk: str(int(walk == "w0")) for walk in walks}) is None
    assert band({}) is None


def test_equal_units_have_the_interval_of_student() -> None:
    # three walks each: the mean of a unit is one observation
    values = np.random.default_rng(1).normal(10.0, 2.0, size=(7, 3))
    means = values.mean(axis=1)
    half = stats.t.ppf(0.975, 6) * means.std(ddof=1) / math.sqrt(7)
    found = interval(values.ravel(), np.repeat(np.arange(7), 3))
    assert found == pytest.approx((means.mean() - half, means.mean() + half))
    low, high = interval(values.ravel(), np.repeat(np.arange(7), 3), scale="size")
    assert (math.sqrt(low * high), high / low) == pytest.approx((means.mean(), math.exp(2 * half / means.mean())))


def test_unequal_units_cost_degrees_of_freedom() -> None:
    # independent walks in units of which one holds half: Bell and McCaffrey 2002 by brute force, the residuals of units
    # as linear forms of the walks
    units = np.repeat(np.arange(5), [8, 2, 2, 2, 2])
    values = np.random.default_rng(2).normal(size=16)
    share = np.bincount(units) / 16
    forms = np.stack([((units == k) - share[k]) / math.sqrt(1 - share[k]) for k in range(5)])
    gram = forms @ forms.T
    degrees = np.trace(gram) ** 2 / np.sum(gram**2)
    half = stats.t.ppf(0.975, degrees) * np.linalg.norm(forms @ (values - values.mean())) / 16
    assert degrees < 3.5
    assert interval(values, units) == pytest.approx((values.mean() - half, values.mean() + half))


def test_weights_make_the_interval_of_a_pooled_mean() -> None:
    samples = [np.full(count, float(value)) for value, count in enumerate([1, 2, 3, 4, 5, 6])]
    weighted = interval(range(6), weights=[1, 2, 3, 4, 5, 6])
    sums = np.array([of.sum() for of in samples])
    pooled = np.concatenate(samples).mean()
    assert np.mean(weighted) == pytest.approx(pooled) == sums.sum() / 21
    assert interval([*range(6), 99.0], weights=[1, 2, 3, 4, 5, 6, 0]) == weighted, "no weight, no walk"


def test_a_fraction_stays_between_zero_and_one() -> None:
    low, high = interval([1.0, 1.0, 1.0, 1.0, 0.9, 1.0], scale="fraction")
    assert 0.8 < low < 0.95 and 0.98 < high < 1.0
    n = 400  # Wilson's own interval of independent answers, Student's quantile instead of the normal one
    answers = (np.arange(n) < 120).astype(float)
    t = stats.t.ppf(0.975, n - 1)
    centre, width = 0.3 + t**2 / (2 * n), t * math.sqrt(0.21 / n + t**2 / (4 * n**2))
    expected = (centre - width) / (1 + t**2 / n), (centre + width) / (1 + t**2 / n)
    assert interval(answers, scale="fraction") == pytest.approx(expected, rel=2e-3)
    assert interval(np.arange(5.0) - 2, scale="fraction") == interval(np.arange(5.0) - 2), "no fractions"
    assert interval(np.arange(5.0), scale="fraction") == interval(np.arange(5.0), scale="size")


def test_equal_walks_have_an_interval_of_no_width_and_no_difference_is_no_evidence() -> None:
    for scale, value in (("any", -0.1), ("size", 0.1), ("size", 0.0), ("fraction", 1.0)):
        assert interval(np.full(7, value), scale=scale) == pytest.approx((value, value), abs=1e-12)
    assert p_of(np.zeros(8)) == 1.0


def test_order_and_nan_change_nothing() -> None:
    rng = np.random.default_rng(3)
    values, units = rng.gamma(2.0, size=25), rng.integers(0, 6, 25)
    order = rng.permutation(25)
    expected = interval(values, units)
    assert interval(values[order], units[order]) == pytest.approx(expected)
    assert interval([*values, math.nan], [*units, 9]) == pytest.approx(expected)
    samples = np.split(rng.gamma(2.0, size=250), 25)
    assert quantile_interval([samples[i] for i in order], 0.75, units[order]) == quantile_interval(samples, 0.75, units)


def test_wrong_shapes_are_refused() -> None:
    with pytest.raises(ValueError, match="average over seeds first"):
        mean_interval(np.ones((6, 2, 1)))
    with pytest.raises(ValueError, match="one unit per walk"):
        mean_interval(np.ones(6), ["a"] * 5)


# Coverage ------------------------------------------------------------------------------------------------------

DESIGNS = {
    "4 x 4": [4] * 4,
    "8 x 4": [4] * 8,
    "unequal 4": [1, 3, 4, 8],
    "unequal 8": [1, 1, 2, 2, 4, 6, 8, 8],
    "unequal 60": [1] * 30 + [2] * 15 + [5] * 10 + [8] * 5,
}
NOMINAL = 0.92  # what 95 % intervals shall cover at least
SIGMA = 0.6  # of the logarithm of errors of walks: median over the boards with recorded walks


def draw_walks(
    rng: np.random.Generator, sizes: list[int], correlation: float, sigma: float, count: int
) -> tuple[np.ndarray, np.ndarray, float]:
    """(count, W) errors of walks, their units, and the mean they are drawn with; normal where sigma is 0."""
    units = np.repeat(np.arange(len(sizes)), sizes)
    shared = rng.normal(size=(count, len(sizes)))[:, units]
    z = math.sqrt(correlation) * shared + math.sqrt(1 - correlation) * rng.normal(size=(count, len(units)))
    return (np.exp(sigma * z), units, math.exp(sigma**2 / 2)) if sigma else (5.0 + z, units, 5.0)


def coverage(sizes: list[int], correlation: float, sigma: float, count: int) -> float:
    """Fraction of intervals that hold the mean. All share their units, so they are computed at once."""
    walks, units, truth = draw_walks(np.random.default_rng(19), sizes, correlation, sigma, count)
    low, high = mean_interval(walks.T, units, scale="size" if sigma else "any")
    return float(np.mean((low <= truth) & (truth <= high)))


@pytest.mark.parametrize("correlation", [0.0, 0.4])
@pytest.mark.parametrize("sizes", DESIGNS.values(), ids=DESIGNS)
def test_intervals_cover(sizes: list[int], correlation: float) -> None:
    # binomial standard error of 92 % in 4000: 0.43 %, three of them
    for sigma in (0.0, SIGMA):
        assert coverage(sizes, correlation, sigma, 4000) >= NOMINAL - 0.013


def test_the_interval_of_a_quantile_covers() -> None:
    # Medians over walks of which some are infinite, and 75th percentiles of pooled places of walks with a level of
    # their own. Binomial standard error of 92 % in 400: 1.4 %, two of them.
    rng = np.random.default_rng(4)
    units = np.repeat(np.arange(10), 3)
    median_hits = pooled_hits = 0
    for values in draw_walks(rng, [3] * 10, 0.4, SIGMA, 400)[0]:
        low, high = SUMMARIES["median"].interval(np.where(values > 1.6, math.inf, values), units, "size")
        median_hits += low <= 1.0 <= high
        places = [value * rng.exponential(size=rng.integers(3, 12)) for value in values]
        low, high = quantile_interval(places, 0.75, units)
        pooled_hits += low <= POOLED_P75 <= high
    assert median_hits / 400 >= NOMINAL - 0.028
    assert pooled_hits / 400 >= NOMINAL - 0.028


# 75th percentile of exp(0.6 z) times an exponential: P(> q) = E exp(-q / exp(0.6 z)) = 1/4, by Gauss-Hermite
POOLED_P75 = 1.4962


# Paired tests --------------------------------------------------------------------------------------------------


def p_of(differences: ArrayLike, **settings: Any) -> float:
    """Of one pair, whose units differ by so much."""
    array = np.asarray(differences, dtype=np.float64)
    (p,) = sign_flip_p(np.column_stack([array, np.zeros_like(array)]), rng=fresh(), **settings)
    return float(p)


def brute_force_p(values: list[float]) -> float:
    sums = [
        abs(sum(s * d for s, d in zip(signs, values, strict=True)))
        for signs in itertools.product((1, -1), repeat=len(values))
    ]
    return float(np.mean(np.array(sums) >= abs(sum(values)) - 1e-9))


@pytest.mark.parametrize(
    "values", [[1.0, 2.0, 3.0], [1.0, -1.0, 2.0, 0.0], [0.1] * 9, [0.3, -2.0, 1.0, 4.0, 1.5, -0.2, 0.0]]
)
def test_sign_flips_are_exact_up_to_twenty_walks(values: list[float]) -> None:
    assert p_of(values) == brute_force_p(values)


def test_many_walks_are_tested_by_random_flips() -> None:
    values = np.append(np.linspace(-1.0, 1.2, 19), 2.5)
    exact, random = p_of(values), p_of(values, exact_units=0)
    assert 0.01 < exact < 0.5
    assert random == pytest.approx(exact, abs=4 * math.sqrt(exact / 100_000))
    assert p_of(np.ones(60), draws=999) == 1 / 1000  # never 0


def test_holm_of_known_values_without_pairs_that_were_not_tested() -> None:
    assert holm([0.01, 0.04, 0.03, 0.005]).tolist() == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.6, 0.9]).tolist() == [1.0, 1.0]
    assert holm([]).tolist() == []
    adjusted = holm([0.01, math.nan, 0.04])
    assert adjusted[[0, 2]].tolist() == [0.02, 0.04]
    assert math.isnan(adjusted[1])


@pytest.mark.parametrize("sizes", [[4] * 8, [1, 1, 2, 2, 4, 6, 8, 8]], ids=str)
def test_tests_hold_their_level_where_walks_of_a_unit_depend_on_each_other(sizes: list[int]) -> None:
    # Differences without an effect, intraclass correlation 0.4. Binomial standard error of 5 % in 600: 0.9 %, three.
    walks, units, _ = draw_walks(np.random.default_rng(6), sizes, 0.4, 0.0, 600)
    sums = np.stack([(walks - 5.0)[:, units == unit].sum(axis=1) for unit in range(8)])
    assert np.mean([p_of(of) <= 0.05 for of in sums.T]) <= 0.05 + 0.027
    by_walk = [p_of(of, exact_units=8, draws=500) <= 0.05 for of in walks[:200] - 5.0]
    assert np.mean(by_walk) > 0.1, "walk by walk it does not"


def test_pairs_of_localizers_are_tested_at_once_as_one_by_one() -> None:
    sums = np.random.default_rng(12).normal(0.3, size=(9, 4))
    expected = [p_of(sums[:, i] - sums[:, j]) for i, j in itertools.combinations(range(4), 2)]
    assert sign_flip_p(sums, rng=fresh()).tolist() == expected


# Summaries -----------------------------------------------------------------------------------------------------


def test_seeds_are_averaged_before_walks_are_counted() -> None:
    means = over_seeds([[1.0, 3.0], [math.nan, 5.0], [math.nan, math.nan]], mean)
    assert means[:2].tolist() == [2.0, 5.0]
    assert math.isnan(means[2])


# What may never happen -------------------------------------------------------------------------------------------


def test_the_median_is_the_time_by_which_half_of_the_walks_have_converged() -> None:
    never = math.inf
    assert median(np.array([[1.0, never, 3.0], [never, 9.0, never]])).tolist() == [3.0, never]
    assert median(np.array([4.0, never])) == 4.0, "one of two is half"
    assert over_seeds([[1.0, never, 3.0], [math.nan, never, 2.0], [math.nan] * 3], median)[:2].tolist() == [3.0, 2.0]
    assert math.isnan(over_seeds([[math.nan]], median)[0])


@pytest.mark.parametrize("count", [7, 40])
def test_walks_that_never_get_there_stay_in_the_interval_of_the_median(count: int) -> None:
    def ends(values: np.ndarray) -> tuple[float, float]:
        return SUMMARIES["median"].interval(values, np.arange(len(values)), "size")

    reached = np.arange(1.0, count + 1)
    low, high = ends(reached)
    assert low < median(reached) < high
    some = np.where(reached > 0.6 * count, math.inf, reached)
    assert ends(some) == (low, math.inf)
    assert ends(np.full(count, math.inf)) == (math.inf, math.inf)
    assert ends(some[::-1]) == ends(np.append(some, math.nan)) == ends(some)


# Bands of distributions ------------------------------------------------------------------------------------------

GRID_M = np.linspace(0.0, 10.0, 101)


def band(by_walk: dict[str, list[float]], unit: dict[str, str] | None = None) -> tuple[FloatArray, FloatArray] | None:
    values = {walk: np.array(errors) for walk, errors in by_walk.items()}
    return ecdf_band(values, unit or {walk: walk for walk in by_walk}, GRID_M)


def test_band_of_equal_walks_has_no_width_and_of_different_walks_has() -> None:
    equal = band({f"w{i}": [2.0, 5.0] for i in range(8)})
    assert equal is not None
    np.testing.assert_allclose(equal[0], equal[1])
    different = band({f"w{i}": [float(i)] * 50 for i in range(8)})
    assert different is not None
    at_4 = int(np.flatnonzero(GRID_M == 4.0)[0])
    # five of eight walks have an error of at most 4 m, all of their places: the interval of that fraction of walks
    low, high = mean_interval([1.0] * 5 + [0.0] * 3, scale="fraction")
    assert (different[0][at_4], different[1][at_4]) == pytest.approx((low, high))
    assert (different[0] >= 0).all() and (different[1] <= 1).all()
