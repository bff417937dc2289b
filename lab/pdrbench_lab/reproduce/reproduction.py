"""What a reproduction of a paper is: experiments that measure, claims that read the measurements, and their gates.

The claims of a paper lie beside its baseline and are registered under `pdrbench.reproductions`:

    REPRODUCTION = Reproduction(
        name="author1999",
        paper="Author, A.: Title. Venue 1999",
        experiments=(Experiment("tracking", "my_package.author1999_claims:track"),),
        claims=(
            Claim("A1", "error, 75 %", "0.50 m", "tracking", median_over_seeds("p75_m"), Gate(high=0.5), "m"),
        ),
    )

`track(seed)` returns numbers by name. `reproduce` runs it for every seed and prints the table.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from pdrbench.errors import PdrbenchError
from pdrbench.geometry import FloatArray, IntArray
from pdrbench.metrics.position import percentile
from pdrbench.metrics.statistics import CONFIDENCE, mean_interval, quantile_interval
from pdrbench_lab.reproduce.number_text import SHARE, three_digits

REPRODUCTIONS_GROUP: Final = "pdrbench.reproductions"  # of entry points
Numbers = Mapping[str, float | FloatArray]  # what an experiment returned for one seed: numbers or (N,) arrays by name
Reduce = Callable[[FloatArray], float]


class ClaimError(PdrbenchError):
    """A claim cannot be computed from what its experiment returned."""


@dataclass(frozen=True, slots=True)
class Gate:
    """The range in which a measured value upholds a claim.

    Attributes:
        low: Least value, which counts.
        high: Largest value, which counts.
    """

    low: float = -math.inf
    high: float = math.inf

    def __post_init__(self) -> None:
        if not self.low <= self.high or not (math.isfinite(self.low) or math.isfinite(self.high)):
            raise ValueError(f"a gate has a lower end, an upper end or both, in order; got {self.low} to {self.high}")

    @classmethod
    def around(cls, centre: float, fraction: float) -> Gate:
        """From `centre` minus to `centre` plus a fraction of it: `around(4.53e6, 0.1)` is 4.53 M ± 10 %."""
        return cls(centre - fraction * abs(centre), centre + fraction * abs(centre))

    def holds(self, value: float) -> bool:
        """True where the value lies within; nothing holds for NaN."""
        return self.low <= value <= self.high

    def text(self, unit: str = "") -> str:
        """For people.

        >>> Gate(high=0.73).text("m"), Gate(low=0.95).text("share"), Gate.around(4.53e6, 0.1).text()
        ('≤ 0.73 m', '≥ 95 %', '4.08 M to 4.98 M')
        """
        if not math.isfinite(self.low):
            return f"≤ {three_digits(self.high, unit)}"
        if not math.isfinite(self.high):
            return f"≥ {three_digits(self.low, unit)}"
        return f"{three_digits(self.low, unit if unit == SHARE else '')} to {three_digits(self.high, unit)}"


@dataclass(frozen=True, slots=True)
class Measured:
    """A value with its 95 % interval over seeds."""

    ours: float  # NaN where nothing was measured
    low: float = math.nan  # NaN where there is no interval
    high: float = math.nan  # NaN where there is no interval
    gate: Gate | None = None  # where it depends on what was measured, as on the size of the samples


Value = Callable[[Sequence[Numbers]], Measured]  # from the numbers of every seed


@dataclass(frozen=True, slots=True)
class Experiment:
    """One computation for one seed; any number of claims may read what it returns.

    Attributes:
        name: Part of file names: small letters, digits and underscores.
        measure: `package.module:function`, called with the seed in a process of its own with one numeric thread. It
            returns numbers and sequences of numbers by name, and depends on nothing but the seed and `envs`.
        seeds: It is run with the seeds 0 to `seeds` - 1.
        quick_seeds: The same of a quick run.
        alone: True where it measures wall-clock time: then nothing of this run goes on beside it.
        envs: Environments on recorded data that it reads; it is measured again where their walks are others.
    """

    name: str
    measure: str
    seeds: int = 20
    quick_seeds: int = 2
    alone: bool = False
    envs: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not re.fullmatch(r"[a-z0-9_]+", self.name):
            raise ValueError(f"experiment {self.name!r}: use small letters, digits and underscores")
        if not re.fullmatch(r"[\w.]+:\w+", self.measure):
            raise ValueError(f"experiment {self.name!r}: measure is 'package.module:function'; got {self.measure!r}")
        if not 1 <= self.quick_seeds <= self.seeds:
            raise ValueError(
                f"experiment {self.name!r} needs 1 <= quick_seeds <= seeds; got {self.quick_seeds} and {self.seeds}"
            )

    def claim(self, id: str, what: str, paper: str, value: Value, gate: Gate | None = None, unit: str = "") -> Claim:
        """A claim that reads this experiment."""
        return Claim(id, what, paper, self.name, value, gate, unit)


@dataclass(frozen=True, slots=True)
class Claim:
    """One line of the table.

    Attributes:
        id: Number of the claim, as "W1". A claim of several values has several lines with the same id.
        what: What is measured; distinguishes lines of one id.
        paper: What the paper states, in its words and units.
        experiment: Whose numbers it reads.
        value: Its value from the numbers of every seed that succeeded, at least one.
        gate: Which values uphold the claim, unless what was measured has a gate; None where it is only shown.
        unit: Of the value; "share" for 0 to 1 shown in percent.
    """

    id: str
    what: str
    paper: str
    experiment: str
    value: Value
    gate: Gate | None = None
    unit: str = ""


def claims_of(id: str, experiment: str, unit: str = "") -> Callable[..., Claim]:
    """Makes claims with one number, experiment and unit: call it with `what`, `paper`, `value` and `gate`."""

    def claim(what: str, paper: str, value: Value, gate: Gate | None = None) -> Claim:
        return Claim(id, what, paper, experiment, value, gate, unit)

    return claim


@dataclass(frozen=True, slots=True)
class Reproduction:
    """The claims of a paper and what it takes to measure them.

    Attributes:
        name: Under which it is registered.
        paper: Full citation.
        experiments: In the order in which they are run; the slowest first lets all processes end together.
        claims: In the order of the table.
        figures: `package.module:function`, called as `(folder, measured, quick)` when everything is measured; it draws
            the figures of the paper into the folder and returns the files. `measured` holds, by experiment, the numbers
            of every seed that succeeded. Empty where there are none.
    """

    name: str
    paper: str
    experiments: tuple[Experiment, ...]
    claims: tuple[Claim, ...]
    figures: str = ""

    def __post_init__(self) -> None:
        if not re.fullmatch(r"[A-Za-z0-9_-]+", self.name):
            raise ValueError(
                f"reproduction {self.name!r}: its name is that of a folder, and made of letters and digits"
            )
        names = [experiment.name for experiment in self.experiments]
        lines = [(claim.id, claim.what) for claim in self.claims]
        for listed in (names, lines):
            twice = {str(name) for name in listed if listed.count(name) > 1}  # type: ignore[arg-type]
            if twice:
                raise ValueError(f"{self.name}: listed twice: {', '.join(sorted(twice))}")
        for claim in self.claims:
            if claim.experiment not in names:
                raise ValueError(f"{self.name}: claim {claim.id} reads experiment {claim.experiment!r}; have {names}")


def median_over_seeds(key: str, of: Reduce | None = None) -> Value:
    """Median over seeds of one number per seed, with its exact interval.

    The interval lies between two of the sorted values and needs no assumption on how they are distributed: the number
    of n values below the median is binomial (n, 1/2). Six seeds are the fewest that have one of 95 %. A NaN takes its
    seed out; an infinity counts as larger than anything.

    Args:
        key: Name of the number.
        of: Makes one number of the array that a seed has under this name, as `np.max` or `at_quantile(0.75)`.
    """
    return lambda runs: _median(_by_seed(runs, key, of))


def mean_over_seeds(key: str, of: Reduce | None = None) -> Value:
    """As `median_over_seeds`, the mean; the interval is `mean_interval` with every seed a unit, none below four."""
    return lambda runs: _mean(_by_seed(runs, key, of))


def largest_over_seeds(key: str, of: Reduce | None = np.max) -> Value:
    """As `median_over_seeds`, the largest number of all seeds, without an interval."""

    def value(runs: Sequence[Numbers]) -> Measured:
        values = _by_seed(runs, key, of)
        return Measured(float(values.max()) if len(values) else math.nan)

    return value


def fraction_over_seeds(key: str) -> Value:
    """Fraction of runs in which something is true: the mean over seeds of the fraction within a seed.

    The interval is Wilson's for an effective number of runs p (1 - p) / Var(mean over seeds), at least the number of
    seeds and at most that of all runs: runs of one seed share a building and say less than as many seeds.

    Args:
        key: Name of a truth value, or of an array of truth values.
    """

    def value(runs: Sequence[Numbers]) -> Measured:
        by_seed = _by_seed(runs, key, np.mean)
        if not len(by_seed):
            return Measured(math.nan)
        if by_seed.min() < 0 or by_seed.max() > 1:
            raise ClaimError(f"{key!r} holds truth values, 0 or 1; their mean is {by_seed.min()} to {by_seed.max()}")
        fraction, count = float(by_seed.mean()), len(by_seed)
        num_runs = sum(np.size(run[key]) for run in runs)
        variance = float(np.var(by_seed, ddof=1)) / count if count > 1 else 0.0
        effective = fraction * (1 - fraction) / variance if variance > 0 else count
        return Measured(fraction, *wilson_interval(fraction, min(max(effective, count), num_runs)))

    return value


def pooled_percentile(key: str, quantile: float) -> Value:
    """Quantile of the samples of all seeds together, as papers state it; the interval is by whole seeds."""

    def value(runs: Sequence[Numbers]) -> Measured:
        samples = [np.atleast_1d(_lookup(run, key)) for run in runs]
        samples = [of_seed[~np.isnan(of_seed)] for of_seed in samples]
        pooled = np.concatenate(samples) if samples else np.zeros(0)
        return Measured(percentile(pooled, quantile), *quantile_interval(samples, quantile))

    return value


def ratio_over_seeds(above: str, below: str) -> Value:
    """Ratio R of two means over seeds; the interval is `mean_interval` of (above - R below) / mean(below), by seed."""

    def value(runs: Sequence[Numbers]) -> Measured:
        over, under = (np.array([float(_lookup(run, key)) for run in runs]) for key in (above, below))
        ratio = float(over.mean() / under.mean())
        low, high = mean_interval((over - ratio * under) / under.mean())
        return Measured(ratio, ratio + float(low), ratio + float(high))

    return value


def mean_over_walks(key: str, units: str = "") -> Value:
    """Mean of an array with one number per walk; the interval is `mean_interval` by unit, none below four.

    Seeds play the same walks in the same order and are averaged first; a walk with a NaN is left out.

    Args:
        key: Name of the array.
        units: Name of an array with the number of the unit of each walk: the building, session or person that a new
            sample would draw anew. Empty: every walk is one.
    """
    return lambda runs: _mean(_by_walk(runs, key), _units(runs, key, units))


def median_over_walks(key: str, units: str = "") -> Value:
    """As `mean_over_walks`, the median; the interval is that of `median_over_seeds`, by units `quantile_interval`."""
    return lambda runs: _median(_by_walk(runs, key), _units(runs, key, units))


def at_quantile(quantile: float) -> Reduce:
    """Quantile of the samples of one seed, as in `median_over_seeds(key, of=at_quantile(0.75))`; NaN without any."""
    return lambda samples: percentile(samples, quantile)


def wilson_interval(fraction: float, count: float, z: float = 1.959964) -> tuple[float, float]:
    """95 % interval of a fraction of `count` independent runs; Wilson 1927.

    >>> low, high = wilson_interval(1.0, 20)
    >>> round(low, 3), high
    (0.839, 1.0)
    """
    centre = fraction + z**2 / (2 * count)
    half_width = z * math.sqrt(fraction * (1 - fraction) / count + (z / (2 * count)) ** 2)
    scale = 1 + z**2 / count
    return max(0.0, (centre - half_width) / scale), min(1.0, (centre + half_width) / scale)


def _lookup(run: Numbers, key: str) -> float | FloatArray:
    if key not in run:
        raise ClaimError(f"the experiment returns no {key!r}; it returns {', '.join(sorted(run))}")
    return run[key]


def _by_seed(runs: Iterable[Numbers], key: str, of: Reduce | None) -> FloatArray:
    """(S,) one number for each seed that has one."""
    values = []
    for run in runs:
        found = _lookup(run, key)
        if isinstance(found, np.ndarray):
            if of is None:
                raise ClaimError(
                    f"{key!r} holds {len(found)} numbers per seed; say which one: of=np.max, at_quantile(0.75)"
                )
            found = float(of(found)) if len(found) else math.nan
        values.append(float(found))
    array = np.asarray(values, dtype=np.float64)
    return array[~np.isnan(array)]


def _by_walk(runs: Sequence[Numbers], key: str, *, keep_missing: bool = False) -> FloatArray:
    """(W,) one number for each walk that has one, or NaN for those that have none: the mean over seeds."""
    by_seed = [np.atleast_1d(_lookup(run, key)) for run in runs]
    if len({len(values) for values in by_seed}) > 1:
        raise ClaimError(f"seeds differ in walks: {key!r} holds {[len(values) for values in by_seed]} numbers")
    values: FloatArray = np.mean(by_seed, axis=0) if by_seed else np.zeros(0)
    return values if keep_missing else values[~np.isnan(values)]


def _units(runs: Sequence[Numbers], key: str, units: str) -> IntArray | None:
    """(W,) number of the unit of each walk that has a value."""
    if not units or not runs:
        return None
    values, numbers = _by_walk(runs, key, keep_missing=True), np.atleast_1d(_lookup(runs[0], units))
    if len(values) != len(numbers):
        raise ClaimError(f"{key!r} holds {len(values)} walks and {units!r} the units of {len(numbers)}")
    return np.asarray(numbers, dtype=np.int64)[~np.isnan(values)]


def _median(values: FloatArray, units: IntArray | None = None) -> Measured:
    from scipy.stats import binom

    if not len(values):
        return Measured(math.nan)
    ends = None if units is None else quantile_interval(list(values[:, None]), 0.5, units)
    values = np.sort(values)
    middle = values[[(len(values) - 1) // 2, len(values) // 2]]
    ours = float(middle[0] if middle[0] == middle[1] else middle.mean())
    if ends is not None:
        return Measured(ours, *ends)
    rank = int(binom.ppf((1 - CONFIDENCE) / 2, len(values), 0.5)) - 1  # ppf: the least k with P(at most k) >= 2.5 %
    return Measured(ours) if rank < 0 else Measured(ours, float(values[rank]), float(values[-1 - rank]))


def _mean(values: FloatArray, units: IntArray | None = None) -> Measured:
    if not len(values) or not np.isfinite(values).all():
        return Measured(float(values.max(initial=-math.inf)) if len(values) else math.nan)
    low, high = mean_interval(values, units)
    return Measured(float(np.mean(values)), float(low), float(high))
