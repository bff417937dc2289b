"""What scores of walks say about a localizer: intervals, comparisons, summaries.

The unit of replication is what a new sample would draw anew: a building, a recording session, a person (`Task.units`).
Walks of one unit depend on each other, samples of one walk even more, so every interval and test here counts units:
the spread of whole units around the mean contains the spread of the walks inside them. Where a localizer ran with
several seeds, average over seeds first (`over_seeds`): seeds on the same walk are no new walks. A NaN, a metric that
does not apply to a walk, takes the walk out; an infinite value, a time of what never happened, does not.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike

from pdrbench.geometry import FloatArray, IntArray

MIN_UNITS: Final = 4  # with three, an interval that holds is over twice as wide as one with a known spread
CONFIDENCE: Final = 0.95
CHUNK: Final = 200_000  # signs at a time: what the cache of a processor holds
SIGNS: Final = 1.0 - 2.0 * np.unpackbits(np.arange(256, dtype=np.uint8)[:, None], axis=1)  # of the bits of a byte
EXACT_UNITS: Final = 20  # most units for all patterns of signs; more are drawn
DRAWS: Final = 100_000  # of patterns: the smallest p-value, 1e-5, times 435 pairs of 30 entries is still below 0.01

Units = Sequence[str] | Sequence[int] | IntArray
# What values can be, which shapes their interval: any number, a size of at least 0, a fraction from 0 to 1.
Scale = Literal["any", "size", "fraction"]


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


def mean_interval(
    values: ArrayLike, units: Units | None = None, *, weights: ArrayLike | None = None, scale: Scale = "any"
) -> tuple[FloatArray, FloatArray]:
    """95 % confidence interval of the mean over walks, by the spread of whole units; no random numbers.

    Standard error from the sums of residuals r_i = sum_j w_j (x_j - m) of units, corrected for the fraction h_i of
    the weight in unit i: se^2 = sum_i r_i^2 / (1 - h_i) / (sum w)^2, with Satterthwaite degrees of freedom (CR2; Bell &
    McCaffrey 2002). With t their quantile of Student, the interval is m +- t se; of a size m exp(+- t se / m), since
    errors have a long upper tail; of a fraction Wilson's for n = m (1 - m) / se^2 (Wilson 1927). Measured coverage is
    on the page on results.

    Args:
        values: (W,) one value per walk, or (W, M) for M means at once; where it is (W,), NaN takes a walk out.
        units: (W,) unit of each walk; None: each walk is one.
        weights: (W,) of the walks, such as their numbers of samples for a pooled mean; None: all equal.
        scale: What the values can be; a negative "size" and a "fraction" beyond 0 and 1 are treated as "any".

    Returns:
        low, high: () or (M,); NaN below `MIN_UNITS` units.
    """
    array = np.asarray(values, dtype=np.float64)
    weight = np.ones(len(array)) if weights is None else np.asarray(weights, dtype=np.float64)
    if array.ndim == 1:
        weight = np.where(np.isnan(array), 0.0, weight)
    found = weighted_mean(array, weight, unit_codes(units, len(array)))
    if found is None:
        return (np.full(array.shape[1:], math.nan),) * 2
    average, error, degrees = found
    return _ends(average, error, student(degrees), _scale_of(array[weight > 0], scale))


def quantile_interval(
    samples: Sequence[FloatArray], quantile: float, units: Units | None = None
) -> tuple[float, float]:
    """95 % confidence interval of a quantile of pooled samples, by the spread of whole units; Woodruff 1952.

    The interval of the fraction of samples up to the estimate, as `mean_interval` has it, at the samples that it leads
    to; its standard error is at least that of as many independent samples. Infinite samples are allowed.

    Args:
        samples: (n,) of each walk; for a median over walks, one sample each.
        quantile: In (0, 1).
        units: (W,) unit of each walk; None: each walk is one.

    Returns:
        low, high, two of the samples; NaN below `MIN_UNITS` units.
    """
    pooled = np.sort(np.concatenate([*samples, np.zeros(0)]))
    count = np.array([len(of) for of in samples], dtype=np.float64)
    place = _place(quantile, len(pooled))
    below = np.array([float(np.mean(of <= pooled[place])) if len(of) else 0.0 for of in samples])
    found = weighted_mean(below, count, unit_codes(units, len(samples)))
    if found is None:
        return math.nan, math.nan
    _, error, degrees = found
    error = np.maximum(error, math.sqrt(quantile * (1 - quantile) / len(pooled)))
    low, high = _ends(np.asarray(quantile), error, student(degrees), "fraction")
    return float(pooled[_place(float(low), len(pooled))]), float(pooled[_place(float(high), len(pooled))])


def _mean_over_walks(values: FloatArray, units: Units, scale: Scale) -> tuple[float, float]:
    low, high = mean_interval(values, units, scale=scale)
    return float(low), float(high)


def _median_over_walks(values: FloatArray, units: Units, scale: Scale) -> tuple[float, float]:
    return quantile_interval([row[~np.isnan(row)] for row in values[:, None]], 0.5, units)


@dataclass(frozen=True, slots=True)
class Summary:
    """How a row of a table is made of its walks, and the value of a walk of its seeds.

    Attributes:
        statistic: One number from many.
        interval: Of (W,) values of walks, their units and the scale of the values.
    """

    statistic: Statistic
    interval: Callable[[FloatArray, Units, Scale], tuple[float, float]]


SUMMARIES: Final[Mapping[str, Summary]] = MappingProxyType(
    {"mean": Summary(mean, _mean_over_walks), "median": Summary(median, _median_over_walks)}
)


def sign_flip_p(
    sums: FloatArray, *, rng: np.random.Generator, exact_units: int = EXACT_UNITS, draws: int = DRAWS
) -> FloatArray:
    """Two-sided p-values of the paired permutation test of every two of N localizers, in the order of `combinations`.

    Under no difference every sign of the difference d_i on a unit is as likely as its opposite: p = fraction of the
    sign patterns s with |sum s_i d_i| >= |sum d_i|; all 2^K patterns up to `exact_units` units, else
    (1 + count) / (1 + draws) of random ones. K units give no p-value below 2^(1-K). Flipped sums of differences are
    differences of flipped sums, so that the cost of a pattern grows with N K and not with the number of pairs.

    Args:
        sums: (K, N) sum over the walks of each unit, by localizer.
        rng: Draws the patterns, the same for all pairs; not touched where the test is exact.
        exact_units: Most units for all patterns.
        draws: Random patterns beyond.
    """
    first, second = np.triu_indices(sums.shape[1], 1)
    least = _least(sums[:, first] - sums[:, second])
    reached, patterns = np.zeros(len(first)), 0
    for signs in _sign_patterns(len(sums), len(first), rng, exact_units, draws):
        flipped = (signs @ sums).T
        for pair in range(len(first)):
            reached[pair] += np.count_nonzero(np.abs(flipped[first[pair]] - flipped[second[pair]]) >= least[pair])
        patterns += len(signs)
    return reached / patterns if len(sums) <= exact_units else (1 + reached) / (1 + patterns)


def _least(sums: FloatArray) -> FloatArray:
    """What a flipped sum has to reach: (K, ...) -> (...); rounding must not break ties."""
    return np.asarray(np.abs(sums.sum(axis=0)) - 1e-12 * np.abs(sums).sum(axis=0))


def _sign_patterns(
    num_units: int, num_pairs: int, rng: np.random.Generator, exact_units: int, draws: int
) -> Iterator[FloatArray]:
    """(n, K) signs, some at a time: all patterns up to `exact_units` units, else random ones."""
    is_exact = num_units <= exact_units
    patterns = 2 ** (num_units - 1) if is_exact else draws  # turning all signs changes no sum's size
    rows = max(1, CHUNK // max(num_units, num_pairs))
    for begun in range(0, patterns, rows):
        number = np.arange(begun, min(begun + rows, patterns))
        if is_exact:
            yield np.asarray(1.0 - 2.0 * (number[:, None] >> np.arange(num_units) & 1), dtype=np.float64)
        else:
            drawn = np.frombuffer(rng.bytes(len(number) * math.ceil(num_units / 8)), dtype=np.uint8)
            yield np.asarray(SIGNS[drawn].reshape(len(number), -1)[:, :num_units])


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


def over_seeds(values: ArrayLike, statistic: Statistic) -> FloatArray:
    """(W,) a statistic over seeds of (W, S) values, the NaN left out; NaN where a walk has no value."""
    by_seed = np.asarray(values, dtype=np.float64)
    present = ~np.isnan(by_seed)
    if present.all() and by_seed.size:
        return statistic(by_seed)
    rows = [float(statistic(row[here])) if here.any() else math.nan for row, here in zip(by_seed, present, strict=True)]
    return np.array(rows)


def unit_codes(units: Units | None, count: int) -> IntArray:
    """(W,) number of the unit of each walk."""
    if units is None:
        return np.arange(count)
    labels = np.asarray(units)
    if labels.shape != (count,):
        raise ValueError(f"expected one unit per walk, shape ({count},); got {labels.shape}")
    return np.unique(labels, return_inverse=True)[1].astype(np.int64)


def weighted_mean(
    values: FloatArray, weight: FloatArray, code: IntArray
) -> tuple[FloatArray, FloatArray, float] | None:
    """Mean, its standard error and degrees of freedom, as `mean_interval` has them; None below `MIN_UNITS` units.

    Args:
        values: (W,) or (W, M); not looked at where the weight is 0.
        weight: (W,).
        code: (W,) number of the unit.
    """
    if values.shape[:1] != weight.shape or values.ndim > 2:
        raise ValueError(f"expected one value per walk, shape (W,); got {values.shape}: average over seeds first")
    names, member = np.unique(code[weight > 0], return_inverse=True)
    if len(names) < MIN_UNITS:
        return None
    values, fraction = values[weight > 0], weight[weight > 0] / weight.sum()
    is_member = member == np.arange(len(names))[:, None]
    of_unit = is_member @ fraction
    average = np.asarray(fraction @ values)
    with np.errstate(invalid="ignore"):  # infinite values have no spread
        residual = (is_member * fraction) @ (values - average)
    squares = is_member @ fraction**2
    # Covariance of the residuals, corrected as they are below, were walks independent: trace^2 / sum of squares is df.
    covariance = np.diag(squares) - np.outer(squares, of_unit) - np.outer(of_unit, squares)
    covariance = (covariance + np.outer(of_unit, of_unit) * squares.sum()) / np.sqrt(np.outer(1 - of_unit, 1 - of_unit))
    degrees = np.trace(covariance) ** 2 / np.sum(covariance**2)
    error = np.sqrt((1 / (1 - of_unit)) @ residual**2)
    return average, np.asarray(error), float(degrees)


def student(degrees: float, confidence: float = CONFIDENCE) -> float:
    """Quantile of Student's t that holds so much of both sides; NaN for degrees of freedom that are."""
    from scipy.special import stdtrit

    return float(stdtrit(degrees, (1 + confidence) / 2))


def _ends(mean_of: FloatArray, error: FloatArray, t: float, scale: Scale) -> tuple[FloatArray, FloatArray]:
    """Both ends of an interval of t standard errors on a scale; of no width where there is no error."""
    half = t * error
    if scale == "size":
        ratio = np.exp(np.divide(half, mean_of, out=np.zeros_like(half), where=half > 0))
        return mean_of / ratio, mean_of * ratio
    if scale == "any":
        return mean_of - half, mean_of + half
    weight = np.divide(half**2, mean_of * (1 - mean_of), out=np.zeros_like(half), where=half > 0)
    width = np.sqrt(half**2 + weight**2 / 4)
    return (mean_of + weight / 2 - width) / (1 + weight), (mean_of + weight / 2 + width) / (1 + weight)


def _scale_of(values: FloatArray, scale: Scale) -> Scale:
    """The scale that values keep to."""
    if scale == "fraction" and values.size and values.max() > 1:
        scale = "size"
    return "any" if values.size and values.min() < 0 else scale


def _place(quantile: float, count: int) -> int:
    """Row of a quantile among sorted samples: the first that at least this fraction does not exceed."""
    return min(max(math.ceil(quantile * count - 1e-9), 1), max(count, 1)) - 1
