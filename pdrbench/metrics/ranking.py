"""Who is ahead, by how much, and how sure that is: localizers in their order on the walks of some environments.

The score is the geometric mean over walks of an error, environments weighted by `environment_weights`. Two localizers
differ by a ratio on the same walks, and walks of one unit count as one observation; see `statistics`. Where an
environment has fewer than `MIN_UNITS` units, such as one person, its walks are the units: the result then holds for
those people or buildings.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from pdrbench.geometry import BoolArray, FloatArray, IntArray
from pdrbench.metrics.statistics import DRAWS, MIN_UNITS, Units, holm, sign_flip_p, student, unit_codes, weighted_mean

SIGNIFICANT: Final = 0.05  # p-value, corrected, below which two localizers are separated
NUM_ENTRIES: Final = 15  # of a board for which power is stated: those of version 1.0
POWER: Final = 0.8  # by convention
FULL_UNITS: Final = 30  # ours: so many buildings or people give an environment its full weight
MAX_LOG_RATIO: Final = 20.0  # two or three units tell nothing: no localizer errs 5e8 times as much


@dataclass(frozen=True, slots=True)
class Standing:
    """One localizer among others on the same walks.

    Attributes:
        name: Localizer.
        walks: Walks that it played to their end.
        of: Walks that any localizer played. Those that this one lacks are imputed, see `rank`.
        rank: Lowest and highest place that the paired tests cannot exclude; 1 is best.
        score_m: Geometric mean over walks, environments weighted by `environment_weights`.
        low_m: Lower end of its 95 % interval, NaN where an environment has fewer than `MIN_UNITS` walks.
        high_m: Upper end.
        ratio: Its score over that of the best.
        ratio_low: Lower end of the 95 % interval of the ratio; NaN for the best itself.
        ratio_high: Upper end.
        p_holm: P-value of the difference from the best, adjusted over all pairs; NaN for the best itself.
    """

    name: str
    walks: int
    of: int
    rank: tuple[int, int]
    score_m: float
    low_m: float
    high_m: float
    ratio: float
    ratio_low: float
    ratio_high: float
    p_holm: float


@dataclass(frozen=True, eq=False)
class Pairs:
    """Every two of N localizers, of which the row is compared with the column.

    Attributes:
        log_ratio: (N, N) logarithm of the score of the row over that of the column.
        error: (N, N) its standard error, NaN where an environment has fewer than `MIN_UNITS` walks.
        degrees: (N, N) degrees of freedom of that.
        p_holm: (N, N) adjusted p-value of the paired test; 1 on the diagonal.
        p: (N, N) the same before any adjustment.
    """

    log_ratio: FloatArray
    error: FloatArray
    degrees: FloatArray
    p_holm: FloatArray
    p: FloatArray

    @property
    def is_apart(self) -> BoolArray:
        """(N, N) whether two are separated."""
        return self.p_holm < SIGNIFICANT

    @property
    def is_worse(self) -> BoolArray:
        """(N, N) whether the row is significantly worse than the column."""
        return self.is_apart & (self.log_ratio > 0)

    def ratio(self, row: int, column: int) -> tuple[float, float, float]:
        """Score of the row over that of the column, and both ends of its 95 % interval; NaN of one to itself."""
        half = student(self.degrees[row, column]) * self.error[row, column] if row != column else math.nan
        return _as_ratios(self.log_ratio[row, column], half)


@dataclass(frozen=True, eq=False)
class Ranking:
    """Localizers in their order.

    Attributes:
        standings: Best first.
        best: Place in `standings` of the first that played every walk, which ratios refer to.
        pairs: Of `standings`, in their order.
        num_units: Units by environment, such as buildings or people.
        by_walk: Environments with so few units that their walks are the units.
        unranked: Localizers without any walk.
    """

    standings: tuple[Standing, ...]
    best: int
    pairs: Pairs
    num_units: Mapping[str, int]
    by_walk: frozenset[str]
    unranked: tuple[str, ...]

    @property
    def ties(self) -> tuple[tuple[str, ...], ...]:
        """Longest runs of neighbours of which no two are separated, two or more in each: bars beside a table."""
        return tuple(tuple(of.name for of in self.standings[run]) for run in _runs(self.pairs.is_apart))

    @property
    def neighbour_error(self) -> tuple[float, float]:
        """Median standard error of the logarithm of the ratio of neighbours that differ, and its degrees of freedom."""
        error, degrees = np.diagonal(self.pairs.error, 1), np.diagonal(self.pairs.degrees, 1)
        differ = error > 0
        return (float(np.median(error[differ])), float(np.median(degrees[differ]))) if differ.any() else (math.nan,) * 2

    def against(self, name: str) -> dict[str, tuple[float, float, float, float]]:
        """Ratio of each other localizer to one, both ends of its interval, p-value adjusted over these comparisons."""
        names = [of.name for of in self.standings]
        if name not in names:
            return {}
        column = names.index(name)
        others = [row for row in range(len(names)) if row != column]
        adjusted = holm(self.pairs.p[others, column]).tolist()
        return {names[row]: (*self.pairs.ratio(row, column), p) for row, p in zip(others, adjusted, strict=True)}

    def smallest_ratio(self, num_entries: int = NUM_ENTRIES) -> float:
        """Smallest ratio between neighbours that these walks can tell; NaN without neighbours that differ."""
        return smallest_ratio(*self.neighbour_error, num_entries)


def rank(
    values: Mapping[str, Mapping[str, ArrayLike]],
    *,
    units: Mapping[str, Units],
    noise_m: Mapping[str, float],
    rng: np.random.Generator,
    draws: int = DRAWS,
) -> Ranking:
    """Puts localizers into order by the geometric mean over walks of an error, and tells them apart in pairs.

    Score = exp(weighted mean over environments of mean over walks of log max(error, noise_m)). Pairs are compared by
    the logarithm of their ratio: intervals by the spread of units within environments (CR2 with Satterthwaite's degrees
    of freedom, see `statistics.mean_interval`; Welch's over environments), p-values by flipping the signs of whole
    units, adjusted over all pairs (Holm 1979). A rank is an interval: from 1 + those significantly better, to all but
    those significantly worse.

    A walk that a localizer declined or failed counts with the worst answer that any localizer has there, and with its
    own worst in that environment where this is worse, so that it never pays to leave a walk out. Of equal scores the
    one with more walks is first.

    Args:
        values: By localizer and environment, (W,) errors in metres; NaN where a walk was declined or failed. A
            localizer may lack an environment.
        units: By environment, (W,) unit of each walk.
        noise_m: By environment, the error of its reference, above 0: no walk counts as better.
        rng: Draws signs.
        draws: Random patterns of signs, where there are too many units for all patterns; 0 for the order without tests
            and intervals of ratios.

    Raises:
        ValueError: No localizer has a value on any walk, or one has another number of walks than there are units.
    """
    names = [name for name, of in values.items() if any(np.isfinite(np.asarray(v)).any() for v in of.values())]
    found = {env: _part([values[name].get(env) for name in names], of, noise_m[env]) for env, of in units.items()}
    parts = {env: part for env, part in found.items() if part.log_m.size}
    if not parts:
        raise ValueError("nothing to rank: no localizer has a value on any walk")
    score = _score(list(parts.values()))
    missing = np.sum([(~part.is_played).sum(axis=1) for part in parts.values()], axis=0)
    order = sorted(range(len(names)), key=lambda row: (round(float(score[row]), 12), missing[row], names[row]))
    ordered = [part.take(order) for part in parts.values()]
    best = next((place for place, row in enumerate(order) if not missing[row]), 0)
    pairs = _pairs(ordered, rng, draws)
    return Ranking(
        standings=tuple(_standings([names[row] for row in order], ordered, pairs, best)),
        best=best,
        pairs=pairs,
        num_units={env: part.num_units for env, part in parts.items()},
        by_walk=frozenset(env for env, part in parts.items() if part.num_units < MIN_UNITS),
        unranked=tuple(name for name in values if name not in names),
    )


def environment_weights(num_units: Sequence[float]) -> FloatArray:
    """(E,) weights of environments in a score: equal from `FULL_UNITS` units on, below it by their number.

    Eight walks in four buildings say too little to count as much as two hundred buildings do, and forty walks of one
    person, which are compared walk by walk, say nothing of another: they count as one.

    >>> environment_weights([200, 30, 15]).tolist()
    [0.4, 0.4, 0.2]
    """
    counted = np.minimum(np.asarray(num_units, dtype=np.float64), FULL_UNITS)
    weights: FloatArray = counted / counted.sum()
    return weights


def smallest_ratio(error: float, degrees: float, num_entries: int = NUM_ENTRIES) -> float:
    """Smallest ratio that is told with a power of 80 %, p-values corrected for all pairs of so many localizers.

    exp((t(1 - a/2) + t(0.8)) se) with a = 0.05 / number of pairs, which is Holm's first and strictest level.

    Args:
        error: Standard error se of the logarithm of the ratio.
        degrees: Of freedom of that.
        num_entries: At least 2.
    """
    level = SIGNIFICANT / math.comb(num_entries, 2)
    log_ratio = (student(degrees, 1 - level) + student(degrees, 2 * POWER - 1)) * error
    return math.inf if log_ratio > MAX_LOG_RATIO else math.exp(log_ratio)


@dataclass(frozen=True, slots=True)
class _Part:
    """The walks of one environment that any localizer played: (N, W) values, (W,) units."""

    log_m: FloatArray  # with imputed walks
    is_played: BoolArray
    code: IntArray  # unit, or walk where there are too few units
    num_units: int

    def take(self, rows: Sequence[int]) -> _Part:
        """The localizers of some rows."""
        return dataclasses.replace(self, log_m=self.log_m[rows], is_played=self.is_played[rows])


def _part(values_m: Sequence[ArrayLike | None], units: Units, noise_m: float) -> _Part:
    if not noise_m > 0:
        raise ValueError(f"the error of a reference is above 0; got {noise_m}")
    none = np.full(len(units), math.nan)
    errors_m = np.array([none if of is None else np.asarray(of, dtype=np.float64) for of in values_m])
    is_played = np.isfinite(errors_m)
    shared = is_played.any(axis=0)
    errors_m, is_played = errors_m[:, shared], is_played[:, shared]
    code = unit_codes(units, len(units))[shared]
    num_units = len(np.unique(code))
    worst_m = np.max(errors_m, axis=0, where=is_played, initial=0.0)
    own_worst_m = np.max(errors_m, axis=1, where=is_played, initial=0.0)
    errors_m = np.where(is_played, errors_m, np.maximum(worst_m, own_worst_m[:, None]))
    code = code if num_units >= MIN_UNITS else np.arange(len(code))
    return _Part(np.log(np.maximum(errors_m, noise_m)), is_played, code, num_units)


def _weights(parts: Sequence[_Part]) -> FloatArray:
    return environment_weights([part.num_units for part in parts])


def _score(parts: Sequence[_Part]) -> FloatArray:
    """(N,) logarithms of scores."""
    score: FloatArray = _weights(parts) @ np.array([part.log_m.mean(axis=1) for part in parts])
    return score


def _pairs(parts: Sequence[_Part], rng: np.random.Generator, draws: int) -> Pairs:
    num = len(parts[0].log_m)
    first, second = np.triu_indices(num, 1)
    error, degrees, p = np.full((3, len(first)), [[math.nan], [math.nan], [1.0]])
    if draws:
        error, degrees = _errors([part.log_m[first] - part.log_m[second] for part in parts], parts)
        sums = [weight * _unit_means(part) for weight, part in zip(_weights(parts), parts, strict=True)]
        p = sign_flip_p(np.concatenate(sums), rng=rng, draws=draws)
    score = _score(parts)

    def square(of_pairs: FloatArray, diagonal: float) -> FloatArray:
        matrix = np.full((num, num), diagonal)
        matrix[first, second] = matrix[second, first] = of_pairs
        return matrix

    tests = square(holm(p), 1.0), square(p, 1.0)
    return Pairs(score[:, None] - score, square(error, 0.0), square(degrees, math.inf), *tests)


def _unit_means(part: _Part) -> FloatArray:
    """(K, N) what each unit adds to the mean over walks, above what it adds to that of all localizers."""
    above = (part.log_m - part.log_m.mean(axis=0)) / part.log_m.shape[1]
    return np.asarray((part.code == np.unique(part.code)[:, None]).astype(np.float64) @ above.T)


def _errors(logs: Sequence[FloatArray], parts: Sequence[_Part]) -> tuple[FloatArray, FloatArray]:
    """(M,) standard errors of the means of (M, W) values of each environment, and degrees of freedom; Welch 1947."""
    variances, of_degrees = [], []
    for values, part, weight in zip(logs, parts, _weights(parts), strict=True):
        found = weighted_mean(values.T, np.ones(len(part.code)), part.code)
        error, degrees = (np.full(len(values), math.nan), math.nan) if found is None else found[1:]
        variances.append((weight * error) ** 2)
        of_degrees.append(degrees)
    total = np.sum(variances, axis=0)
    squares = np.sum([variance**2 / degrees for variance, degrees in zip(variances, of_degrees, strict=True)], axis=0)
    least = np.full_like(total, np.min(of_degrees))
    return np.sqrt(total), np.divide(total**2, squares, out=least, where=squares > 0)


def _standings(names: Sequence[str], parts: Sequence[_Part], pairs: Pairs, best: int) -> Iterator[Standing]:
    score = _score(parts)
    error, degrees = _errors([part.log_m for part in parts], parts)
    walks = np.sum([part.is_played.sum(axis=1) for part in parts], axis=0)
    is_worse = pairs.is_worse
    for row, name in enumerate(names):
        yield Standing(
            name,
            int(walks[row]),
            sum(part.log_m.shape[1] for part in parts),
            (1 + int(is_worse[row].sum()), len(names) - int(is_worse[:, row].sum())),
            *_as_ratios(score[row], student(degrees[row]) * error[row]),
            *pairs.ratio(row, best),
            p_holm=math.nan if row == best else float(pairs.p_holm[row, best]),
        )


def _as_ratios(log: float, half: float) -> tuple[float, float, float]:
    """A logarithm and both ends of its interval, as ratios."""
    return math.exp(log), math.exp(log - half), math.exp(log + half)


def _runs(is_apart: BoolArray) -> Iterator[slice]:
    """Longest runs of two or more rows of which no two are apart."""
    end = 0
    for first in range(len(is_apart)):
        last = first + 1
        while last < len(is_apart) and not is_apart[first:last, last].any():
            last += 1
        if last > max(end, first + 1):
            end = last
            yield slice(first, last)
