"""Rules of the scorecard on values whose verdict is known."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
import pytest
from scipy.stats import norm

from pdrbench.registry import PluginError
from pdrbench_lab.realism.block import Block, Distribution, Figure, Order, RealismStatistic, Rule, Values, Within
from pdrbench_lab.realism.classifier import PERSON, separability
from pdrbench_lab.realism.criteria import ScorecardRow, block_rows
from pdrbench_lab.realism.targets import reduce

NONE: Values = MappingProxyType({})
GRID = (np.arange(400) + 0.5) / 400


def row(rule: Rule, real: object, synthetic: object) -> ScorecardRow:
    """The row of one statistic."""
    block = Block(
        "Toy", (RealismStatistic("x", "an x", "m", "walk", rule),), ("ilc20",), lambda part: NONE, lambda s, n: NONE
    )
    values = {} if real is None else {"x": np.asarray(real, dtype=float)}
    other = {} if synthetic is None else {"x": np.asarray(synthetic, dtype=float)}
    (found,) = block_rows("toy", block, reduce(block, values), other)
    return found


@pytest.mark.parametrize("shift", [0.0, 0.3, 0.6, -0.6, 0.7, 1.0])
def test_the_distance_of_two_normal_laws(shift: float) -> None:
    """KS of N(0, 1) and N(d, 1) is 2 Phi(d / 2) - 1: 0.236 at 0.6 passes, 0.274 at 0.7 does not."""
    found = row(Distribution(), norm.ppf(GRID), norm.ppf(GRID) + shift)
    expected = 2 * norm.cdf(abs(shift) / 2) - 1
    assert found.distance == pytest.approx(expected, abs=0.01)  # 200 quantiles: steps of 0.005
    assert found.passed == (expected <= 0.25)
    assert found.judged and bool(found.why) != found.passed
    assert found.real is not None and found.real[1] == pytest.approx(0, abs=1e-3)
    assert found.synthetic == pytest.approx((shift - 1.2816, shift, shift + 1.2816), abs=0.01)
    assert (found.num_real, found.num_synthetic) == (400, 400)


def test_few_values_that_lie_apart_fail() -> None:
    """Five walks, each by itself, and ten: chance alone makes 1.358 sqrt(1/5 + 1/10) = 0.74."""
    found = row(Distribution(), [22.0, 22.1, 22.2, 22.3, 22.4], np.arange(10.0))
    assert not found.passed and found.judged and found.why.startswith("KS 1.00 > 0.74")


def test_few_values_within_chance_cannot_be_told() -> None:
    """A shift of the stated size, (8.1 - 0.9) / 2, makes a distance of 0.4: below the 0.74 that chance makes."""
    found = row(Distribution(), [2.0, 2.1, 2.2, 2.3, 2.4], np.arange(10.0))
    assert not found.passed and not found.judged and found.power < 0.2 and found.size == pytest.approx(3.6)
    assert found.why.startswith("a shift of 3.6 is found in")


@pytest.mark.parametrize(
    ("real", "passes"), [([100.0], True), ([80.0], False), ([120.0], False), ([99, 101, 250], True)]
)
def test_a_figure_is_a_further_draw(real: list[float], passes: bool) -> None:
    """Ten sets of 100 +- 4.5: a further one lies within 2.26 * 4.5 * sqrt(1.1) = 10.7 of them; 30 are found."""
    found = row(Figure(), real, 95.0 + 1.5 * np.arange(10.0) - 1.75)
    assert found.passed is passes and found.judged and math.isnan(found.distance) and found.power > 0.99


@pytest.mark.parametrize(("middle", "passes"), [(0.73, True), (0.93, True), (0.5, False), (1.0, False)])
def test_a_published_range_needs_no_real_value(middle: float, passes: bool) -> None:
    found = row(Within(0.73, 0.93, "a paper"), None, [middle - 9, middle, middle + 9])
    assert found.passed is passes and found.judged and found.real is None
    assert "a paper" in found.rule


@pytest.mark.parametrize(
    ("synthetic", "tau", "passes"), [([3.0, 5.0, 40.0], 1.0, True), ([5, 3, 40], 1 / 3, False), ([40, 5, 3], -1, False)]
)
def test_the_order_of_competitors(synthetic: list[float], tau: float, passes: bool) -> None:
    """Kendall: of three pairs none, one or all are turned round; values keep their places."""
    found = row(Order(), [4.0, 12.0, 46.0], synthetic)
    assert found.distance == pytest.approx(tau) and found.passed is passes


@pytest.mark.parametrize("rule", [Distribution(), Figure(), Order()])
@pytest.mark.parametrize("real", [None, [], [math.nan] * 20])
def test_no_real_values(rule: Rule, real: list[float] | None) -> None:
    found = row(rule, real, np.arange(20.0))
    assert not found.passed and not found.judged and "real" in found.why and found.real is None


@pytest.mark.parametrize("rule", [Distribution(), Figure(), Order(), Within(0, 1, "a paper")])
@pytest.mark.parametrize("synthetic", [None, [], [math.nan] * 20, [1.0, math.inf, 2.0] * 10])
def test_no_synthetic_values(rule: Rule, synthetic: list[float] | None) -> None:
    found = row(rule, np.arange(20.0), synthetic)
    assert not found.passed and not found.judged and "synthetic" in found.why


def test_too_few_synthetic_values_have_no_tenth() -> None:
    found = row(Figure(), [4.0], np.arange(9.0))
    assert not found.judged and found.why == "only 9 synthetic values; at least 10 are needed"


def test_missing_values_are_left_out() -> None:
    holes = np.where(np.arange(400) % 4 == 0, np.nan, GRID)
    found = row(Distribution(), holes, GRID)
    assert found.passed and (found.num_real, found.num_synthetic) == (300, 400)


def _separated(real: Mapping[str, object], synthetic: Mapping[str, object]) -> ScorecardRow:
    statistics = tuple(RealismStatistic(name, name, "", "walk", Figure()) for name in real)
    block = Block("Toy", statistics, ("ilc20",), lambda part: NONE, lambda s, n: NONE, features=tuple(real))
    ours = {name: np.asarray(values, dtype=float) for name, values in real.items()}
    theirs = {name: np.asarray(values, dtype=float) for name, values in synthetic.items()}
    found = block_rows("toy", block, reduce(block, ours), theirs)
    assert [row.statistic for row in found] == [*real, "classifier"]
    return found[-1]


def test_a_classifier_without_features_separates_nothing(rng: np.random.Generator) -> None:
    """Same law: 0.5, with a standard error of about sqrt(1/12 (1/60 + 1/100)) = 0.05."""
    found = _separated(
        {"a": rng.normal(size=60), "b": rng.normal(size=60)}, {"a": rng.normal(size=100), "b": rng.normal(size=100)}
    )
    assert found.passed and found.distance == pytest.approx(0.5, abs=0.2)


def test_a_classifier_separates_by_what_single_statistics_hide(rng: np.random.Generator) -> None:
    """Two laws with the same margins, in which a + b is 0 on one side only in the sum: N(0.9) each, opposed noise."""
    common, shift = rng.normal(size=(2, 100)) * 3, 1.0
    found = _separated(
        {"a": common[0] + shift, "b": -common[0] + rng.normal(0, 0.1, 100)},
        {"a": common[1], "b": -common[1] + rng.normal(0, 0.1, 100)},
    )
    assert found.judged and not found.passed and found.distance > 0.95
    assert "> 0.75" in found.why and "weighs most" in found.why


def test_the_area_of_two_normal_laws() -> None:
    """AUC of N(0, 1) and N(d, 1) is Phi(d / sqrt 2)."""
    found = _separated({"a": norm.ppf(GRID) + 1.0}, {"a": norm.ppf(GRID)})
    assert found.distance == pytest.approx(norm.cdf(1 / math.sqrt(2)), abs=0.02)


def _people(rng: np.random.Generator, people: int, walks: int, off: float = 0.0) -> dict[str, np.ndarray]:
    """Two features of walks of people who differ far more than the walks of one do."""
    own = np.repeat(rng.normal(size=(people, 2)), walks, axis=0)
    x = own + 0.1 * rng.normal(size=own.shape) + [off, 0.0]
    return {"a": x[:, 0], "b": x[:, 1], PERSON: np.repeat(np.arange(people), walks).astype(float)}


def test_a_classifier_is_not_judged_on_those_it_only_learns_from(rng: np.random.Generator) -> None:
    real, synthetic = _people(rng, 2, 8), _people(rng, 20, 4)
    real[PERSON] -= 1  # one to judge by, one to learn from
    learned = {**real, "a": np.where(real[PERSON] < 0, real["a"] + 50.0, real["a"])}
    found, _ = separability(learned, synthetic, ("a", "b"), 0.8)
    assert found.distance < 1.0 and "of 1 new people" in found.unknown
    alone = {name: values[:12] for name, values in _people(rng, 1, 12).items()}
    assert "another one to learn from" in separability(alone, synthetic, ("a", "b"), 0.8)[0].unknown


def test_features_of_too_few_walks_are_not_compared() -> None:
    found = _separated({"a": np.arange(9.0)}, {"a": np.arange(50.0)})
    assert not found.judged and not found.passed and "9 real and 50 synthetic walks" in found.why


def test_a_walk_without_a_feature_is_left_out_of_the_classifier() -> None:
    holes = np.where(np.arange(40) < 10, np.nan, 1.0)
    found = _separated({"a": holes, "b": np.arange(40.0)}, {"a": np.ones(30), "b": np.arange(30.0)})
    assert (found.num_real, found.num_synthetic) == (30, 30) and found.judged


def test_blocks_that_contradict_themselves_are_refused() -> None:
    x = RealismStatistic("x", "an x", "", "walk", Figure())
    with pytest.raises(PluginError, match="two statistics have one name"):
        Block("Toy", (x, x), ("ilc20",), lambda part: NONE, lambda s, n: NONE)
    with pytest.raises(PluginError, match="without datasets"):
        Block("Toy", (x,), (), lambda part: NONE, lambda s, n: NONE)
