"""Gates that know how many people the paper asked, and how many are simulated here.

The paper states what came out for a few people: 20 laps, five people whose headings were looked at, ten who walked four
laps each, eight with phones. Others would have given other numbers. So the statistic T that is compared is computed of
all simulated people, and again, as T*, of samples of the paper's size: seeds are drawn with replacement, which is the
chance in ours, and from them as many people as the paper had, which is the chance in the paper's. The stated value s
agrees where it lies in the middle 95 % of T*. Solved for T that is the gate

    s - (q97.5 - T) <= T <= s + (T - q2.5),

with half a unit of the last stated digit on either side. A claim has a tolerance as well, from before anything was
measured: differences that do not matter. The gate is the wider of both ends: a claim is missed where the difference
matters and is more than chance.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from pdrbench.geometry import FloatArray
from pdrbench.metrics.statistics import CONFIDENCE
from pdrbench_lab.reproduce.reproduction import Gate, Measured, Numbers, Value

DRAWS: Final = 2000  # the ends of a gate then err by 3 % of its width
SEED: Final = 2012
LONGEST: Final = 400  # steps of a lap, of which 92 m have some 130

# Numbers of people, (D, n) or (D, n, L) for each key, to the statistic of each sample (D,).
Statistic = Callable[..., FloatArray]


@dataclass(frozen=True, slots=True)
class Sample:
    """What the paper did: how many took part, and what it states of them.

    Attributes:
        people: Of the paper, or laps where it had about one of each person.
        keys: Arrays that an experiment returns, one number for each person of a seed.
        statistic: Of the arrays of these names.
        counts: Name of the array with the number of steps of each person, where the others hold a number for each step.
    """

    people: int
    keys: tuple[str, ...]
    statistic: Statistic
    counts: str = ""

    def pool(self, runs: Sequence[Numbers]) -> list[FloatArray]:
        """(S, P) or (S, P, L) numbers of all people of all seeds, by key; NaN after the last step of a person."""
        if not self.counts:
            return [np.array([run[key] for run in runs]) for key in self.keys]
        return [np.array([_by_person(run, key, self.counts) for run in runs]) for key in self.keys]

    def of_all(self, runs: Sequence[Numbers]) -> float:
        """The statistic of everybody: T."""
        pool = self.pool(runs)
        return float(self.statistic(*(numbers.reshape(1, -1, *numbers.shape[2:]) for numbers in pool))[0])

    def drawn(self, runs: Sequence[Numbers], draws: int = DRAWS) -> FloatArray:
        """(D,) the statistic of samples of the paper's size: T*."""
        pool, rng = self.pool(runs), np.random.default_rng(SEED)
        num_seeds, num_people = pool[0].shape[:2]
        seeds = rng.integers(num_seeds, size=(draws, num_seeds))
        seed = np.take_along_axis(seeds, rng.integers(num_seeds, size=(draws, self.people)), axis=1)
        person = rng.integers(num_people, size=(draws, self.people))
        return self.statistic(*(numbers[seed, person] for numbers in pool))


def gated(value: Value, sample: Sample, stated: float, resolution: float, tolerance: Gate) -> Value:
    """The same value with the gate of a sample of the paper's size, or of the tolerance where that is wider.

    Args:
        value: What is shown.
        sample: Of the paper.
        stated: What it states.
        resolution: One unit of the last digit with which it does.
        tolerance: Differences that do not matter.
    """

    def of(runs: Sequence[Numbers]) -> Measured:
        ours, drawn = sample.of_all(runs), sample.drawn(runs)
        low, high = np.quantile(drawn, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2]) - ours
        least = 0.0 if drawn.min() >= 0 else -np.inf  # of what is never negative
        ends = max(least, float(stated - resolution / 2 - high)), float(stated + resolution / 2 - low)
        return replace(value(runs), gate=Gate(min(tolerance.low, ends[0]), max(tolerance.high, ends[1])))

    return of


def mean_of(total: FloatArray, count: FloatArray) -> FloatArray:
    """Mean over all steps of a sample, from sums and numbers of steps by person."""
    return np.asarray(total.sum(axis=1) / count.sum(axis=1))


def percent_of(count: FloatArray, made: FloatArray) -> FloatArray:
    """The same in percent."""
    return 100.0 * mean_of(count, made)


def less_than(better: FloatArray, count: FloatArray, worse: FloatArray, worse_count: FloatArray) -> FloatArray:
    """By which fraction the mean of a sample is below another of the same people."""
    return 1.0 - mean_of(better, count) / mean_of(worse, worse_count)


def mean_of_steps(values: FloatArray) -> FloatArray:
    """Mean over all steps of a sample, from their values."""
    return np.asarray(np.nanmean(values, axis=(1, 2)))


def percentile_of_steps(quantile: float) -> Statistic:
    """Quantile of all steps of a sample: the first value that at least this fraction does not exceed."""

    def statistic(values: FloatArray) -> FloatArray:
        ordered = np.sort(values.reshape(len(values), -1), axis=1)  # NaN come last
        place = np.ceil(quantile * np.isfinite(ordered).sum(axis=1) - 1e-9).astype(np.int64) - 1
        return np.asarray(np.take_along_axis(ordered, place[:, None], axis=1)[:, 0])

    return statistic


def _by_person(run: Numbers, key: str, counts: str) -> FloatArray:
    """(P, LONGEST) numbers of the steps of each person."""
    ends = np.cumsum(np.asarray(run[counts], dtype=np.int64))
    table = np.full((len(ends), LONGEST), np.nan)
    for row, steps in zip(table, np.split(np.asarray(run[key]), ends[:-1]), strict=True):
        row[: len(steps)] = steps
    return table
