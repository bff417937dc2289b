"""The rule of a row by simulation: one law passes in 95 % of cases, and a shift is found as often as is printed."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import ks_2samp

from pdrbench_lab.realism.block import MIN_SYNTHETIC_VALUES, Distribution, Figure, clustered
from pdrbench_lab.realism.two_samples import (
    MIN_CLUSTERS,
    Comparison,
    Sample,
    compare_laws,
    compare_sets,
    effective_number,
    ks_distance,
    rank_icc,
    stated_size,
)

TRIALS = 150  # the standard error of a fraction of 0.95 is 0.018, of 0.8 0.033
ICCS = (0.0, 0.2, 0.4)
SHAPES = {  # clusters and values of each: real, synthetic
    "many walks": ((46, 1), (100, 1)),
    "few walks": ((16, 1), (60, 1)),
    "eight people": ((8, 12), (40, 6)),
    "one person": ((1, 21), (30, 4)),
    "a short set": ((1, 5), (30, 20)),
    "two people": ((2, 10), (12, 10)),
}


def draw(rng: np.random.Generator, clusters: int, values: int, icc: float) -> Sample:
    """Values of clusters with that intraclass correlation, 10 in the mean, with a standard deviation of 1."""
    common = np.repeat(rng.standard_normal(clusters), values)
    own = rng.standard_normal(clusters * values)
    found = 10 + math.sqrt(icc) * common + math.sqrt(1 - icc) * own
    return Sample.of(found, np.repeat(np.arange(clusters), values))


def compared(real: Sample, synthetic: Sample, tolerance: float, size: float) -> Comparison:
    if len(real.sizes) >= MIN_CLUSTERS:
        return compare_laws(real, synthetic, tolerance, size)
    return compare_sets(real, synthetic, size)


@pytest.mark.parametrize("icc", ICCS)
@pytest.mark.parametrize("shape", SHAPES)
def test_one_law_passes_and_a_shift_is_found_as_printed(rng: np.random.Generator, shape: str, icc: float) -> None:
    real, synthetic = SHAPES[shape]
    apart, found, printed = 0, 0, []
    for _ in range(TRIALS):
        ours, theirs = draw(rng, *real, icc), draw(rng, *synthetic, icc)
        # Without tolerance: the level is that of chance alone.
        apart += compared(ours, theirs, 0.0, 1.0).is_apart
        moved = compared(Sample(ours.values + 1.28, ours.cluster), theirs, 0.25, 1.28)
        found += moved.is_apart
        printed.append(moved.power)
    assert apart / TRIALS <= 0.05 + 3 * 0.018
    if np.mean(printed) >= 0.5:  # below, a row is not decided anyway
        assert found / TRIALS >= np.mean(printed) - 3 * 0.033 - 0.05


def test_one_person_is_one_draw_however_often_it_is_measured(rng: np.random.Generator) -> None:
    """People differ by 10 +- 1. A person at 11.5 is a likely one; a thousand walks of it do not make it less so."""
    people = draw(rng, 30, 4, 0.9)
    person = Sample.of(11.5 + 0.1 * rng.standard_normal(1000), np.zeros(1000))
    assert not Distribution().judge(person, people).reasons
    assert Distribution().judge(Sample.of(person.values), people).reasons  # taken for a thousand people
    assert Distribution().judge(Sample(person.values + 2.5, person.cluster), people).reasons


def test_what_could_not_have_failed_does_not_pass(rng: np.random.Generator) -> None:
    """One person of people who differ by 30 %: a shift by 38 % (to P90) is found in a quarter of cases."""
    people = Sample.of(10 + 3 * rng.standard_normal(40))
    verdict = Figure().judge(Sample.of(np.array([10.0])), people)
    assert not verdict.reasons and verdict.unknown.startswith("a shift of 3.") and verdict.power < 0.4
    alike = Sample.of(10 + 0.5 * rng.standard_normal(40))
    verdict = Figure().judge(Sample.of(np.array([10.0])), alike)
    assert not verdict.reasons and not verdict.unknown and verdict.power > 0.99 and verdict.size == pytest.approx(3.0)


def test_correlation_within_people_makes_values_worth_less() -> None:
    assert effective_number(np.array([10, 10, 10]), 0.5) == pytest.approx(30 / (1 + 9 * 0.5))  # Kish: n / (1 + 9 icc)
    assert effective_number(np.array([1, 1, 1]), 0.9) == pytest.approx(3.0)


@pytest.mark.parametrize("icc", ICCS)
def test_the_correlation_of_ranks_is_found(rng: np.random.Generator, icc: float) -> None:
    """Of normal values it is 6 / pi asin(icc / 2), as Spearman's is; 400 people of 5: standard error 0.03."""
    expected = 6 / math.pi * math.asin(icc / 2)
    assert rank_icc(draw(rng, 400, 5, icc)) == pytest.approx(expected, abs=0.08)


def test_without_repeats_no_correlation_is_known() -> None:
    assert math.isnan(rank_icc(Sample.of(np.arange(9.0))))


def test_the_distance_is_that_of_scipy(rng: np.random.Generator) -> None:
    one, other = rng.normal(size=37), np.round(rng.normal(size=61), 1)
    assert ks_distance(one, other) == pytest.approx(float(ks_2samp(one, other).statistic))


def test_the_stated_size_is_of_the_real_median_or_to_p90() -> None:
    synthetic = Sample.of(np.linspace(0.0, 10.0, 1001))
    assert stated_size(Sample.of(np.array([100.0])), synthetic) == pytest.approx(30.0)
    assert stated_size(Sample.of(np.array([0.1])), synthetic) == pytest.approx(4.0)  # P10 to P90 is 8 wide
    assert stated_size(Sample.of(np.array([0.1])), synthetic, scale=20.0) == pytest.approx(6.0)


def test_values_keep_their_clusters_and_gaps_leave_with_theirs() -> None:
    values = clustered("x", [np.array([1.0, np.nan]), np.array([np.nan]), np.array([2.0, 3.0])])
    sample = Sample.of(values["x"], values["x:cluster"])
    assert sample.sizes.tolist() == [1, 2] and [v.tolist() for v in sample.by_cluster()] == [[1.0], [2.0, 3.0]]


def test_few_synthetic_sets_are_too_few(rng: np.random.Generator) -> None:
    verdict = Distribution().judge(draw(rng, 1, 20, 0.2), draw(rng, MIN_SYNTHETIC_VALUES - 1, 20, 0.2))
    assert "synthetic sets" in verdict.unknown
