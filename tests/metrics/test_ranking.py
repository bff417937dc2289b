"""Order of localizers: known answers, walks that are missing, ties, coverage of intervals and of ranks."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence

import numpy as np
import pytest
from numpy.typing import ArrayLike

from pdrbench.metrics.ranking import Ranking, Standing, rank, smallest_ratio
from pdrbench.metrics.statistics import mean_interval, sign_flip_p

NONE = math.nan


def ranked(
    values: Mapping[str, ArrayLike], units: Sequence[int] | None = None, noise_m: float = 0.01, draws: int = 2000
) -> Ranking:
    """On one environment."""
    count = np.size(next(iter(values.values())))
    return rank(
        {name: {"Env-v1": of} for name, of in values.items()},
        units={"Env-v1": np.arange(count) if units is None else list(units)},
        noise_m={"Env-v1": noise_m},
        rng=np.random.default_rng(3),
        draws=draws,
    )


def standing(ranking: Ranking, name: str) -> Standing:
    return next(of for of in ranking.standings if of.name == name)


WALK_M = np.random.default_rng(5).lognormal(1.0, 0.6, 30)  # walks differ far more than localizers
JITTER = np.random.default_rng(6).lognormal(0.0, 0.05, (3, 30))


def test_scores_are_geometric_and_ratios_are_on_the_same_walks() -> None:
    found = ranked({"worse": 1.5 * WALK_M * JITTER[0], "first": WALK_M})
    first, worse = found.standings
    assert (first.name, first.rank, first.ratio, worse.rank) == ("first", (1, 1), 1.0, (2, 2))
    assert first.score_m == pytest.approx(math.exp(np.log(WALK_M).mean()))
    low, high = mean_interval(np.log(1.5 * JITTER[0]))
    assert (worse.ratio_low, worse.ratio_high) == pytest.approx((math.exp(low), math.exp(high)))
    assert worse.ratio_low < 1.5 < worse.ratio_high < 1.6 and worse.p_holm < 0.01
    assert worse.high_m / worse.low_m > 1.4, "of the score itself: walks differ"
    assert math.isnan(first.p_holm) and found.best == 0 and found.ties == ()


def test_no_walk_counts_as_better_than_its_reference() -> None:
    found = ranked({"a": [0.001, 2.0, 2.0, 2.0], "b": [0.2, 2.0, 2.0, 2.0]}, noise_m=0.5)
    assert [of.score_m for of in found.standings] == [pytest.approx(math.sqrt(2.0))] * 2
    assert [of.rank for of in found.standings] == [(1, 2), (1, 2)] and found.ties == (("a", "b"),)


@pytest.mark.parametrize(("small", "share"), [(30, 1 / 2), (500, 1 / 2), (15, 1 / 3), (5, 1 / 7)])
def test_environments_count_alike_from_thirty_units_on(small: int, share: float) -> None:
    values = {
        "a": {"Small-v1": np.full(small, 1.0), "Large-v1": np.full(500, 8.0)},
        "b": {"Small-v1": np.full(small, 4.0), "Large-v1": np.full(500, 8.0)},
    }
    found = rank(
        values,
        units={"Small-v1": np.arange(small), "Large-v1": np.arange(500)},
        noise_m={"Small-v1": 0.1, "Large-v1": 0.1},
        rng=np.random.default_rng(0),
        draws=100,
    )
    assert [of.score_m for of in found.standings] == pytest.approx([8.0 ** (1 - share), 8.0 * 0.5**share])
    assert found.standings[1].ratio == pytest.approx(4.0**share)


def test_a_missing_walk_counts_with_the_worst_answer_there_and_with_its_own_worst() -> None:
    values = {"stay": [30.0, 40.0, 50.0, 60.0], "good": [3.0, 4.0, 2.0, 2.0], "picky": [1.0, NONE, 1.0, 1.0]}
    found = ranked(values)
    picky = standing(found, "picky")
    assert (picky.walks, picky.of) == (3, 4) and picky.score_m == pytest.approx(40.0**0.25)
    assert found.standings[found.best].name != "picky", "the best has played every walk"
    proud = ranked({"good": [3.0, 4.0, 2.0, 2.0], "proud": [9.0, NONE, 1.0, 1.0]})
    assert standing(proud, "proud").score_m == pytest.approx(81.0**0.25), "no answer there is as bad as its own worst"


def test_one_of_three_walks_is_never_best_and_those_that_none_played_are_left_out() -> None:
    # case: a localizer that declines the walks it does not like, and answers as another one elsewhere
    found = ranked({"declines": [9.0, NONE, NONE], "stay": [9.0, 17.0, 25.0]})
    assert [(of.name, of.walks) for of in found.standings] == [("stay", 3), ("declines", 1)]
    assert found.standings[found.best].name == "stay"
    assert [of.rank for of in found.standings] == [(1, 2)] * 2
    found = ranked({"a": [1.0, NONE, 2.0], "none": [NONE] * 3, "b": [2.0, NONE, 3.0]})
    assert found.unranked == ("none",) and {of.of for of in found.standings} == {2}
    with pytest.raises(ValueError, match="nothing to rank"):
        ranked({"none": [NONE] * 3})


def test_an_environment_that_a_localizer_lacks_is_missing_walks() -> None:
    found = rank(
        {"a": {"E-v1": [1.0] * 4, "F-v1": [1.0] * 4}, "b": {"E-v1": [1.0] * 4}},
        units={"E-v1": range(4), "F-v1": range(4)},
        noise_m={"E-v1": 0.1, "F-v1": 0.1},
        rng=np.random.default_rng(0),
    )
    assert [(of.name, of.walks, of.of) for of in found.standings] == [("a", 8, 8), ("b", 4, 8)]


def test_few_people_are_named_and_their_walks_counted() -> None:
    one = ranked({"a": WALK_M, "b": 1.5 * WALK_M * JITTER[0]}, units=[0] * 30)
    assert one.by_walk == {"Env-v1"} and one.num_units == {"Env-v1": 1}
    assert one.standings[1].p_holm < 0.01
    beside = rank(
        {"a": {"One-v1": [1.0] * 40, "Many-v1": [8.0] * 40}, "b": {"One-v1": [4.0] * 40, "Many-v1": [8.0] * 40}},
        units={"One-v1": [0] * 40, "Many-v1": range(40)},
        noise_m={"One-v1": 0.1, "Many-v1": 0.1},
        rng=np.random.default_rng(0),
    )
    assert beside.standings[1].ratio == pytest.approx(4.0 ** (1 / 31)), "one person beside thirty others"
    four = ranked({"a": WALK_M, "b": 1.5 * WALK_M * JITTER[0]}, units=[walk % 4 for walk in range(30)])
    assert not four.by_walk and four.standings[1].p_holm == 0.125, "four people cannot tell"
    assert four.standings[1].ratio_low > 1.3, "their interval is another question"


def test_ties_are_runs_of_neighbours_that_are_not_told_apart() -> None:
    scale = {"a": 1.0, "b": 1.005, "c": 1.5, "d": 1.51, "e": 3.0}
    noise = np.random.default_rng(7).lognormal(0.0, 0.1, (5, 30))
    found = ranked({name: of * WALK_M * noise[row] for row, (name, of) in enumerate(scale.items())})
    assert {frozenset(run) for run in found.ties} == {frozenset("ab"), frozenset("cd")}
    assert sorted(of.rank for of in found.standings) == [(1, 2), (1, 2), (3, 4), (3, 4), (5, 5)]
    assert (found.pairs.is_worse == (found.pairs.is_apart & (found.pairs.log_ratio > 0))).all()


def test_the_smallest_ratio_is_that_of_the_design_and_told_four_times_in_five() -> None:
    # spread 0.575 of the logarithm between neighbours: (3.49 + 0.84) 0.575 / sqrt(n), exponential; design section 4
    assert smallest_ratio(0.575 / math.sqrt(200), 1e9) == pytest.approx(1.193, abs=1e-3)
    assert smallest_ratio(0.575 / math.sqrt(100), 1e9) == pytest.approx(1.283, abs=1e-3)
    assert smallest_ratio(0.1, 7) > smallest_ratio(0.1, 70) > smallest_ratio(0.1, 70, num_entries=2)
    # 2 localizers, 24 units: binomial standard error of 80 % in 400 is 2 %, three of them
    rng = np.random.default_rng(11)
    logs = rng.normal(0.0, 0.4, (400, 24, 1))
    ratio = smallest_ratio(0.4 / math.sqrt(24), 23, num_entries=2)
    sums = np.concatenate([logs + math.log(ratio), np.zeros_like(logs)], axis=2)
    p = [sign_flip_p(of, rng=rng, draws=1000) for of in sums]
    assert np.mean(np.array(p) < 0.05) == pytest.approx(0.8, abs=0.06)


@pytest.mark.parametrize("units", [9, 24], ids=str)
def test_intervals_and_ranks_cover(units: int) -> None:
    # 4 equal localizers on walks that differ, 2 walks a unit. Binomial standard error of 95 % in 400: 1.1 %, two below
    # 93 %; the pairs of one draw count as one. A rank interval holds where no test is wrong.
    rng = np.random.default_rng(13)
    held, no_false = [], 0
    for _ in range(400):
        shared, own = rng.normal(size=(1, units)), rng.normal(size=(4, units))
        logs = np.repeat(shared + 0.4 * own, 2, axis=1) + 0.3 * rng.normal(size=(4, 2 * units))
        values = {str(row): np.exp(of) for row, of in enumerate(logs)}
        found = ranked(values, units=[walk // 2 for walk in range(2 * units)], draws=800)
        ends = [found.pairs.ratio(i, j)[1:] for i, j in itertools.combinations(range(4), 2)]
        held.append(np.mean([low <= 1.0 <= high for low, high in ends]))
        no_false += all(of.rank == (1, 4) for of in found.standings)
    assert 0.93 - 0.022 <= np.mean(held) <= 0.97 + 0.022
    assert no_false / 400 >= 0.93 - 0.022
