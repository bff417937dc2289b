"""Whether two samples may come from one law, where values repeat within people: the rule of `notebook/realism.md`.

Values of one person (session, walk) are alike. Their number says less than the number of people, so that every bound
here counts clusters: all values of one person, or of one set, are one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import stats

from pdrbench.geometry import FloatArray, IntArray, read_only

LOW, HIGH = 0.1, 0.9  # quantiles of synthetic values that are printed; a real median there is off by a stated size
LEVEL: Final = 0.05  # two samples of one law fail in at most this fraction of cases
CHANCE_KS: Final = 1.358  # times sqrt(1/n + 1/m): the KS distance that chance alone exceeds in 5 % of cases (Smirnov)
MIN_POWER: Final = 0.8  # with less a row cannot be decided; the customary value (J. Cohen, 1988)
MARGIN: Final = 0.3  # of the real median: 30 % is what errors of strides may be off (sources.md 1.3)
MIN_CLUSTERS: Final = 5  # with fewer real ones, the medians of clusters are compared: no distribution is known
_MEDIAN_VARIANCE: Final = math.pi / 2  # of a median of n normal values, over that of their mean


@dataclass(frozen=True, slots=True)
class Sample:
    """Values (n,) and to which cluster, 0 to K - 1, each belongs (n,)."""

    values: FloatArray
    cluster: IntArray

    @staticmethod
    def of(values: FloatArray, cluster: FloatArray | IntArray | None = None) -> Sample:
        """Finite values; without clusters each value is one of its own."""
        values = np.asarray(values, dtype=np.float64).ravel()
        kept = ~np.isnan(values)
        names = np.arange(len(values)) if cluster is None or not len(cluster) else np.asarray(cluster)
        _, index = np.unique(names[kept], return_inverse=True)
        return Sample(read_only(values[kept]), read_only(index, np.int64))

    def __len__(self) -> int:
        return len(self.values)

    @property
    def sizes(self) -> IntArray:
        """(K,) values of each cluster."""
        return np.bincount(self.cluster)

    def by_cluster(self) -> list[FloatArray]:
        """The values of each cluster."""
        order = np.argsort(self.cluster, kind="stable")
        return np.split(self.values[order], np.cumsum(self.sizes)[:-1])


@dataclass(frozen=True, slots=True)
class Comparison:
    """What two samples say.

    Attributes:
        distance: Kolmogorov-Smirnov distance; of medians of few clusters, NaN.
        is_apart: Whether they differ by more than tolerance and chance allow.
        reason: In words, where they do.
        size: Shift in the unit of the values, which a law has to be off by to count as wrong.
        power: Chance with which such a shift is found.
    """

    distance: float
    is_apart: bool
    reason: str
    size: float
    power: float


def stated_size(real: Sample, synthetic: Sample, scale: float | None = None) -> float:
    """Shift that has to be found: `MARGIN` of the real median, or what moves a median to P10 or P90 if that is more.

    Args:
        real: Real values.
        synthetic: Synthetic ones.
        scale: Taken instead of the size of the real median where 0 is no natural origin, as for correlations.
    """
    low, high = np.quantile(synthetic.values, (LOW, HIGH))
    known = abs(float(np.median(real.values))) if scale is None else scale
    return max(MARGIN * known, float(high - low) / 2)


def rank_icc(sample: Sample) -> float:
    """Intraclass correlation of the ranks of values within clusters, one-way analysis of variance; NaN without repeats.

    Averaged over the law, the indicators of "below x" of two values of one cluster correlate by that of their ranks.
    """
    sizes = sample.sizes
    many, count = len(sizes), len(sample)
    if many < 2 or count <= many:
        return math.nan
    rank = stats.rankdata(sample.values)
    means = np.bincount(sample.cluster, weights=rank) / sizes
    between = float(sizes @ (means - rank.mean()) ** 2) / (many - 1)
    within = float(np.sum((rank - means[sample.cluster]) ** 2)) / (count - many)
    usual = (count - float(sizes @ sizes) / count) / (many - 1)
    total = between + (usual - 1) * within
    return float(np.clip((between - within) / total, 0.0, 1.0)) if total > 0 else 0.0


def effective_number(sizes: IntArray, icc: float) -> float:
    """Independent values that the values of clusters of these sizes are worth: L. Kish, Survey Sampling, 1965.

    The variance of a mean, and so of the empirical distribution at any place, is sigma2 ((1 - icc) sum n + icc sum n^2)
    / (sum n)^2.

    >>> effective_number(np.array([10, 10]), 1.0), effective_number(np.array([10, 10]), 0.0)
    (2.0, 20.0)
    """
    count = float(sizes.sum())
    return count**2 / ((1 - icc) * count + icc * float(sizes @ sizes))


def ks_distance(one: FloatArray, other: FloatArray) -> float:
    """Largest difference of the empirical distributions of (n,) and (m,) values.

    >>> ks_distance(np.array([1.0, 2.0]), np.array([2.0, 3.0]))
    0.5
    """
    at = np.concatenate([one, other])
    below = [np.searchsorted(np.sort(values), at, side="right") / len(values) for values in (one, other)]
    return float(np.abs(below[0] - below[1]).max())


def compare_laws(real: Sample, synthetic: Sample, tolerance: float, size: float) -> Comparison:
    """The Kolmogorov-Smirnov distance of two samples with clusters against what is tolerated and what chance makes.

    The bound is the larger of `tolerance` and Smirnov's 95 % point with effective numbers. The power is a lower one: of
    the difference of both distributions where a shift of `size` makes it largest, taken as normal.
    """
    distance = ks_distance(real.values, synthetic.values)
    iccs = np.array([rank_icc(real), rank_icc(synthetic)])
    iccs = np.where(np.isnan(iccs), iccs[::-1], iccs)  # the other side's where nothing repeats on this one
    n, m = (
        effective_number(sample.sizes, float(np.nan_to_num(icc)))
        for sample, icc in zip((real, synthetic), iccs, strict=True)
    )
    chance = CHANCE_KS * math.sqrt(1 / n + 1 / m)
    bound = max(tolerance, chance)
    reason = f"KS {distance:.2f} > {bound:.2f}" if distance > bound else ""
    if reason and bound > tolerance:
        reason += ", which chance alone stays below"
    return Comparison(distance, distance > bound, reason, size, _ks_power(synthetic.values, size, bound, n, m))


def _ks_power(values: FloatArray, size: float, bound: float, n: float, m: float) -> float:
    values = np.sort(values)
    at = np.concatenate([values, values + size])
    here, moved = (np.searchsorted(values, where, side="right") / len(values) for where in (at, at - size))
    largest = int(np.argmax(here - moved))
    p, q = float(here[largest]), float(moved[largest])
    variance = p * (1 - p) / m + q * (1 - q) / n
    return float(stats.norm.cdf((p - q - bound) / math.sqrt(max(variance, 1e-12))))


def compare_sets(real: Sample, synthetic: Sample, size: float) -> Comparison:
    """The medians of few real clusters against those of synthetic clusters: Student's interval for further draws.

    One person, one set, is one draw, however many values it has. With M synthetic medians of standard deviation s, the
    mean of K further ones lies within t s sqrt(1 / K + 1 / M) of theirs in 95 % of cases. Where a real cluster has
    fewer values than synthetic ones have, the variance within clusters that this adds is added to s.
    """
    ours, theirs = (np.array([np.median(values) for values in side.by_cluster()]) for side in (real, synthetic))
    many = len(theirs)
    within = [float(values.var(ddof=1)) for values in synthetic.by_cluster() if len(values) > 1]
    fewer = max(0.0, float(np.mean(1 / real.sizes) - np.mean(1 / synthetic.sizes)))
    variance = float(theirs.var(ddof=1)) + (_MEDIAN_VARIANCE * fewer * float(np.mean(within)) if within else 0.0)
    error = math.sqrt(variance * (1 / len(ours) + 1 / many))
    reach = float(stats.t.ppf(1 - LEVEL / 2, many - 1)) * error
    middle, off = float(theirs.mean()), float(ours.mean() - theirs.mean())
    reason = f"real {ours.mean():.3g} outside {middle - reach:.3g} to {middle + reach:.3g}" if abs(off) > reach else ""
    limit = reach / max(error, 1e-300)
    found = stats.nct.sf(limit, many - 1, size / error) if error else 1.0
    return Comparison(math.nan, abs(off) > reach, reason, size, float(found))
