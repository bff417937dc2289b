"""What scores of walks say about a localizer: intervals, comparisons, summaries.

The unit of replication is the walk: samples of one walk depend on each other, so nothing here ever resamples
samples. Where a localizer ran with several seeds, average over seeds first (`over_seeds`): seeds on the same walk
are no new walks. A NaN, a metric that does not apply to a walk, takes the walk out; an infinite value, a time of what
never happened, does not.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from statistics import NormalDist
from types import MappingProxyType
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike

from pdrbench.geometry import FloatArray, IntArray

MIN_WALKS: Final = 5  # fewer say nothing about their spread: no interval
BCA_WALKS: Final = 20  # from here the acceleration is known well enough to correct for it
CONFIDENCE: Final = 0.95
DRAWS: Final = 10_000
CHUNK: Final = 2_000_000  # values drawn at a time: bounds memory, changes nothing

Strata = Sequence[str] | Sequence[int] | IntArray
Better = Literal["lower", "higher"]


Statistic = Callable[[FloatArray], FloatArray]  # one number from the values of walks, last axis: (..., W) -> (...)


def mean(values: FloatArray) -> FloatArray:
    """Arithmetic mean along the last axis: (..., W) -> (...)."""
    return np.asarray(np.mean(values, axis=-1))


def median(values: FloatArray) -> FloatArray:
    """Lower median along the last axis: (..., W) -> (...), the smallest value that at least half of all do not exceed.

    It is one of the values, so a time of what never happened may be infinite: where half of the times are finite so is
    the median, whatever the others are.

    >>> float(median(np.array([12.0, math.inf, 7.0, math.inf])))
    12.0
    """
    middle = (np.shape(values)[-1] - 1) // 2
    return np.asarray(np.partition(values, middle, axis=-1)[..., middle])


def interquartile_mean(values: ArrayLike) -> FloatArray:
    """Mean of the middle half along the last axis: (..., W) -> (...); Agarwal et al. 2021, with exact quarters.

    A quarter of the total weight is cut from either end; where W is not a multiple of four, the values on the two
    edges count in part, so that the mean moves smoothly with W.

    >>> float(interquartile_mean([1.0, 2.0, 4.0, 900.0]))
    3.0
    """
    ordered = np.sort(np.asarray(values, dtype=np.float64), axis=-1)
    count = ordered.shape[-1]
    if not count:
        return np.full(ordered.shape[:-1], math.nan)
    weight = np.diff(np.clip(np.arange(count + 1) / count, 0.25, 0.75))
    return np.asarray(ordered @ (weight / weight.sum()))


@dataclass(frozen=True, slots=True)
class Summary:
    """How a row of a table is made of its walks, and the value of a walk of its seeds.

    Attributes:
        statistic: One number from many.
        bca_walks: From this many walks its interval is BCa.
    """

    statistic: Statistic
    bca_walks: int


# The jackknife, which BCa takes the acceleration from, is inconsistent for a median (Efron & Tibshirani 1993, 10.6).
SUMMARIES: Final[Mapping[str, Summary]] = MappingProxyType(
    {"mean": Summary(mean, BCA_WALKS), "median": Summary(median, sys.maxsize)}
)


def bootstrap_interval(
    values_by_walk: ArrayLike,
    *,
    rng: np.random.Generator,
    strata: Strata | None = None,
    statistic: Statistic = mean,
    confidence: float = CONFIDENCE,
    draws: int = DRAWS,
    min_walks: int = MIN_WALKS,
    bca_walks: int = BCA_WALKS,
) -> tuple[float, float]:
    """Confidence interval of a statistic of walks, by resampling walks within each stratum (building).

    Percentile interval below `bca_walks` walks; from there bias-corrected and accelerated (Efron 1987): the percentiles
    Phi(z0 + (z0 + z) / (1 - a (z0 + z))) of the draws, z0 = Phi^-1(fraction of draws below the estimate), a from the
    jackknife within strata. The order of the walks does not matter, not even for the draws.

    Args:
        values_by_walk: (W,) one value per walk; NaN takes a walk out.
        rng: Draws the walks.
        strata: (W,) building of each walk, or None; every resample keeps the number of walks of each. Buildings with
            one walk are collapsed into one stratum (or into the smallest other one): alone they would show no spread.
        statistic: Invariant to the order of its values.
        confidence: Nominal coverage.
        draws: Resamples.
        min_walks: Below it there is no interval.
        bca_walks: From this many walks the interval is BCa.

    Returns:
        low, high; NaN, NaN below `min_walks` walks.
    """
    values, members = _in_order(values_by_walk, strata)
    if len(values) < min_walks:
        return math.nan, math.nan
    drawn = _resample(values, members, statistic, draws, rng)
    tails = np.array([(1 - confidence) / 2, (1 + confidence) / 2])
    if len(values) >= bca_walks:
        tails = _bca_tails(tails, drawn, values, members, statistic)
    low, high = _quantiles(drawn, tails)
    return float(low), float(high)


def bootstrap_pooled_interval(
    errors_by_walk: Sequence[FloatArray],
    statistic: Callable[[FloatArray], float],
    *,
    rng: np.random.Generator,
    strata: Strata | None = None,
    confidence: float = CONFIDENCE,
    draws: int = DRAWS,
    min_walks: int = MIN_WALKS,
) -> tuple[float, float]:
    """Percentile interval of a statistic of pooled samples, by resampling whole walks within each stratum.

    Args:
        errors_by_walk: (n,) samples of each walk; walks without samples are taken out.
        statistic: One number from all samples (N,) together, as `np.mean`.
        rng: Draws the walks.
        strata: (W,) building of each walk, or None.
        confidence: Nominal coverage.
        draws: Resamples.
        min_walks: Below it there is no interval.

    Returns:
        low, high; NaN, NaN below `min_walks` walks.
    """
    kept = np.flatnonzero([len(errors) > 0 for errors in errors_by_walk])
    if len(kept) < min_walks:
        return math.nan, math.nan
    members = _members(_codes(strata, len(errors_by_walk))[kept])
    drawn = np.empty(draws)
    for draw in range(draws):
        walks = np.concatenate([rng.choice(rows, len(rows)) for rows in members])
        drawn[draw] = statistic(np.concatenate([errors_by_walk[kept[walk]] for walk in walks]))
    low, high = np.quantile(drawn, [(1 - confidence) / 2, (1 + confidence) / 2])
    return float(low), float(high)


def sign_flip_p(
    differences: ArrayLike, *, rng: np.random.Generator, exact_walks: int = 20, draws: int = 100_000
) -> float:
    """Two-sided p-value of the paired permutation test: under no difference every sign is as likely as its opposite.

    p = fraction of the sign patterns s with |sum s_i d_i| >= |sum d_i|; all 2^W patterns up to `exact_walks` walks,
    else (1 + count) / (1 + draws) of random ones.

    Args:
        differences: (W,) per-walk differences of two localizers on the same walks and seeds; NaN takes a walk out.
        rng: Draws the patterns; not touched where the test is exact.
        exact_walks: Most walks for all patterns.
        draws: Random patterns beyond.
    """
    values, _ = _in_order(differences, None)
    if not len(values):
        return math.nan
    least = abs(values.sum()) - 1e-12 * np.abs(values).sum()  # rounding must not break ties
    if len(values) <= exact_walks:
        return float(np.mean(np.abs(_signed_sums(values)) >= least))
    count = 0
    for size in _chunks(draws, len(values)):
        signs = 2.0 * rng.integers(0, 2, size=(size, len(values))) - 1.0
        count += int(np.count_nonzero(np.abs(signs @ values) >= least))
    return (1 + count) / (1 + draws)


def wilcoxon_p(differences: ArrayLike, *, rng: np.random.Generator | None = None) -> float:
    """Two-sided p-value of Wilcoxon's signed-rank test of (W,) differences, zeros as Pratt; 1 where all are zero.

    NaN takes a walk out. `rng` is not used; every test has the same signature.
    """
    from scipy.stats import wilcoxon

    values, _ = _in_order(differences, None)
    if not len(values):
        return math.nan
    if not values.any():
        return 1.0
    return float(wilcoxon(values, zero_method="pratt").pvalue)


# Two-sided p-value from (W,) per-walk differences, and a keyword `rng`.
TESTS: Final[Mapping[str, Callable[..., float]]] = MappingProxyType({"sign-flip": sign_flip_p, "wilcoxon": wilcoxon_p})


def holm(p_values: ArrayLike) -> FloatArray:
    """(M,) p-values adjusted for M comparisons; Holm 1979: p_(i)' = max over j <= i of min(1, (M - j + 1) p_(j)).

    A NaN stays NaN and is no comparison.

    >>> holm([0.01, 0.04, 0.03]).tolist()
    [0.03, 0.06, 0.06]
    """
    p = np.asarray(p_values, dtype=np.float64)
    adjusted = np.full(p.shape, math.nan)
    tested = np.flatnonzero(np.isfinite(p))
    order = tested[np.argsort(p[tested], kind="stable")]
    factor = np.arange(len(order), 0, -1)
    adjusted[order] = np.minimum(np.maximum.accumulate(factor * p[order]), 1.0)
    return adjusted


def probability_of_improvement(first: ArrayLike, second: ArrayLike, *, better: Better = "lower") -> float:
    """Fraction of walks on which the first is better than the second, ties by half; NaN without a common walk.

    Args:
        first: (W,) values on the same walks, in the same order.
        second: (W,).
        better: Which direction is better.
    """
    gain = np.asarray(second, dtype=np.float64) - np.asarray(first, dtype=np.float64)
    gain = gain[np.isfinite(gain)] * {"lower": 1.0, "higher": -1.0}[better]
    return float(np.mean((gain > 0) + 0.5 * (gain == 0))) if len(gain) else math.nan


def performance_profile(
    values_by_environment: Sequence[ArrayLike], thresholds: ArrayLike, *, better: Better = "lower"
) -> FloatArray:
    """(K,) fraction of walks at least as good as each threshold, every environment with the same weight.

    For errors the mean over environments of #{x <= tau} / W, right-continuous; for "higher" of #{x >= tau} / W.

    Args:
        values_by_environment: (W,) values of one localizer in each environment; NaN takes a walk out.
        thresholds: (K,) tau.
        better: Which direction is better.
    """
    sign = {"lower": 1.0, "higher": -1.0}[better]
    tau = sign * np.asarray(thresholds, dtype=np.float64)
    fractions = []
    for of in values_by_environment:
        values = np.sort(sign * np.asarray(of, dtype=np.float64))
        values = values[np.isfinite(values)]
        if len(values):
            fractions.append(np.searchsorted(values, tau, side="right") / len(values))
    return np.mean(fractions, axis=0) if fractions else np.full(tau.shape, math.nan)


@dataclass(frozen=True, slots=True)
class Comparison:
    """Two localizers on the same walks and seeds.

    Attributes:
        first: Localizer.
        second: Localizer.
        num_walks: Walks on which both have a value.
        effect: Mean over walks of first minus second, in the unit of the metric.
        low: Lower end of the interval of `effect`, NaN below five walks.
        high: Upper end.
        p: Two-sided p-value of the paired test.
        p_holm: Adjusted for all pairs that were compared with this one.
        improvement: Fraction of walks on which the first is better, ties by half.
        improvement_low: Lower end of its interval, NaN below five walks.
        improvement_high: Upper end.
    """

    first: str
    second: str
    num_walks: int
    effect: float
    low: float
    high: float
    p: float
    p_holm: float
    improvement: float
    improvement_low: float
    improvement_high: float


def compare_pairs(
    values_by_localizer: Mapping[str, ArrayLike],
    *,
    rng: np.random.Generator,
    strata: Strata | None = None,
    better: Better = "lower",
    test: str = "sign-flip",
    confidence: float = CONFIDENCE,
    draws: int = DRAWS,
) -> tuple[Comparison, ...]:
    """Every pair of localizers by their per-walk differences.

    Args:
        values_by_localizer: (W,) values by localizer, all on the same walks in the same order; NaN where there is none.
        rng: Draws walks and signs.
        strata: (W,) building of each walk, or None.
        better: Which direction is better.
        test: "sign-flip" or "wilcoxon".
        confidence: Of the intervals; they are of one pair each, not adjusted.
        draws: Resamples of the intervals.
    """
    if test not in TESTS:
        raise ValueError(f"no paired test {test!r}; known: {', '.join(TESTS)}")
    values = {name: np.asarray(of, dtype=np.float64) for name, of in values_by_localizer.items()}
    if len({of.shape for of in values.values()}) > 1:
        raise ValueError(f"localizers differ in walks: { ({name: of.shape for name, of in values.items()}) }")
    pairs = list(combinations(values, 2))
    differences = [values[first] - values[second] for first, second in pairs]
    p_values = [TESTS[test](difference, rng=rng) for difference in differences]

    def interval(of: FloatArray) -> tuple[float, float]:
        return bootstrap_interval(of, rng=rng, strata=strata, confidence=confidence, draws=draws)

    found = []
    for (first, second), difference, p, p_holm in zip(pairs, differences, p_values, holm(p_values), strict=True):
        both = np.isfinite(difference)
        effect = float(difference[both].mean()) if both.any() else math.nan
        wins = np.where(both, 0.5 - 0.5 * np.sign(difference) * {"lower": 1.0, "higher": -1.0}[better], math.nan)
        improvement = probability_of_improvement(values[first], values[second], better=better)
        row = first, second, int(both.sum()), effect, *interval(difference), p, float(p_holm)
        found.append(Comparison(*row, improvement, *interval(wins)))
    return tuple(found)


@dataclass(frozen=True, slots=True)
class Spread:
    """How a score spreads, by cause.

    Attributes:
        mean: Mean over walks of the mean over seeds.
        over_walks: Standard deviation over walks of the mean over seeds; NaN below two walks.
        over_seeds: Standard deviation over seeds of the mean over walks, by how much a row of a table changes when it
            is run again; NaN below two seeds.
    """

    mean: float
    over_walks: float
    over_seeds: float


def over_seeds(values: ArrayLike, statistic: Statistic) -> FloatArray:
    """(W,) a statistic over seeds of (W, S) values, the NaN left out; NaN where a walk has no value."""
    by_seed = np.asarray(values, dtype=np.float64)
    present = ~np.isnan(by_seed)
    if present.all() and by_seed.size:
        return statistic(by_seed)
    rows = [float(statistic(row[here])) if here.any() else math.nan for row, here in zip(by_seed, present, strict=True)]
    return np.array(rows)


def spread(values: ArrayLike) -> Spread:
    """Spread over walks apart from spread over seeds.

    Args:
        values: (W, S) one value for every walk and seed; walks with a NaN are taken out.
    """
    by_seed = np.asarray(values, dtype=np.float64)
    by_seed = by_seed[np.isfinite(by_seed).all(axis=1)]
    if not by_seed.size:
        return Spread(math.nan, math.nan, math.nan)
    over_walks, over_seeds = (
        float(np.std(means, ddof=1)) if len(means) > 1 else math.nan
        for means in (by_seed.mean(axis=1), by_seed.mean(axis=0))
    )
    return Spread(float(by_seed.mean()), over_walks, over_seeds)


def _in_order(values: ArrayLike, strata: Strata | None) -> tuple[FloatArray, list[IntArray]]:
    """What is not NaN, sorted within strata, so that the order of the walks cannot matter, and rows by stratum."""
    array = np.asarray(values, dtype=np.float64)
    if array.ndim != 1:
        raise ValueError(f"expected one value per walk, shape (W,); got {array.shape}: average over seeds first")
    code = _codes(strata, len(array))
    kept = ~np.isnan(array)
    order = np.lexsort((array[kept], code[kept]))
    return array[kept][order], _members(code[kept][order])


def _codes(strata: Strata | None, count: int) -> IntArray:
    if strata is None:
        return np.zeros(count, dtype=np.int64)
    labels = np.asarray(strata)
    if labels.shape != (count,):
        raise ValueError(f"expected one stratum per walk, shape ({count},); got {labels.shape}")
    return np.unique(labels, return_inverse=True)[1].astype(np.int64)


def _members(code: IntArray) -> list[IntArray]:
    """Rows of each stratum; strata of one walk are collapsed, since drawing from one walk shows no spread."""
    members = sorted((np.flatnonzero(code == label) for label in np.unique(code)), key=len, reverse=True)
    alone = [rows for rows in members if len(rows) == 1]
    together = members[: len(members) - len(alone)]
    if len(alone) == 1 and together:
        alone = [together.pop(), *alone]  # a single one joins the smallest of the others
    return [*together, np.sort(np.concatenate(alone))] if alone else together


def _signed_sums(values: FloatArray) -> FloatArray:
    """(2^W,) sum of the values under every pattern of signs."""
    sums = np.zeros(1)
    for value in values:
        sums = np.concatenate([sums + value, sums - value])
    return sums


def _resample(
    values: FloatArray, members: list[IntArray], statistic: Statistic, draws: int, rng: np.random.Generator
) -> FloatArray:
    """(draws,) the statistic of resampled walks, drawn with replacement within each stratum."""
    drawn = []
    for size in _chunks(draws, len(values)):
        rows = [row[rng.integers(0, len(row), size=(size, len(row)))] for row in members]
        drawn.append(statistic(values[np.concatenate(rows, axis=1)]))
    return np.concatenate(drawn)


def _quantiles(values: FloatArray, quantiles: FloatArray) -> FloatArray:
    """`numpy.quantile`, also of values some of which are infinite."""
    ordered = np.sort(values)
    place = quantiles * (len(ordered) - 1)
    below = np.floor(place).astype(np.int64)
    low, high = ordered[below], ordered[np.minimum(below + 1, len(ordered) - 1)]
    fraction = place - below
    with np.errstate(invalid="ignore"):
        return np.where((low == high) | (fraction == 0), low, low + fraction * (high - low))


def _chunks(draws: int, width: int) -> list[int]:
    """Sizes that add up to `draws`, each at most `CHUNK` values of `width`."""
    largest = max(1, CHUNK // max(width, 1))
    return [min(largest, draws - begun) for begun in range(0, draws, largest)]


def _bca_tails(
    tails: FloatArray, drawn: FloatArray, values: FloatArray, members: list[IntArray], statistic: Statistic
) -> FloatArray:
    """Percentiles of the draws that correct for bias and skew."""
    normal = NormalDist()
    estimate = float(statistic(values))
    tie = 1e-12 * max(float(np.abs(values).max()), 1e-300)  # draws equal to the estimate up to rounding count half
    below = np.mean(drawn < estimate - tie) + 0.5 * np.mean(np.abs(drawn - estimate) <= tie)
    z0 = normal.inv_cdf(float(np.clip(below, 1 / (2 * len(drawn)), 1 - 1 / (2 * len(drawn)))))
    acceleration = _acceleration(values, members, statistic)
    z = z0 + np.array([normal.inv_cdf(float(tail)) for tail in tails])
    return np.array([normal.cdf(corrected) for corrected in z0 + z / (1 - acceleration * z)])


def _acceleration(values: FloatArray, members: list[IntArray], statistic: Statistic) -> float:
    """Skewness of the influence of single walks, from leaving each out: sum l^3 / (6 (sum l^2)^(3/2))."""
    left_out = np.array([float(statistic(np.delete(values, row))) for row in range(len(values))])
    influence = np.empty(len(values))
    for rows in members:
        influence[rows] = left_out[rows].mean() - left_out[rows]
    square = float(np.sum(influence**2))
    return float(np.sum(influence**3)) / (6 * square**1.5) if square > 0 else 0.0
