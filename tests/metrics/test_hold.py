"""The causal hold: which answer counts when, and how missing answers score."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tracks import make_answers, make_reference

from pdrbench.metrics import METRICS, hold_at, score
from pdrbench.metrics.hold import MAX_COORDINATE_M, availability, staleness_s
from pdrbench.trajectory import Estimates, Start, Trajectory

FALLBACK = Start(xy_m=np.array([-7.0, 2.0]), level=3, heading_rad=0.5)


def make_estimates(t_s: list[float], x_m: list[float], level: object = 0.0) -> Estimates:
    return make_answers(t_s, np.reshape(x_m, (-1, 1)) * [1.0, 0.0], level)


def unmoved(t_s: list[float]) -> Trajectory:
    return make_reference(np.zeros((len(t_s), 2)), t_s=t_s)


def test_the_fallback_is_held_before_the_first_answer_and_where_there_is_none() -> None:
    held = hold_at(make_estimates([5.0], [1.0]), np.array([4.0, 5.0]), FALLBACK)
    assert held.xy_m.tolist() == [[-7.0, 2.0], [1.0, 0.0]]
    assert held.level.tolist() == [3.0, 0.0]
    assert held.heading_rad[0] == 0.5
    assert held.is_answer.tolist() == [False, True]
    assert held.age_s.tolist() == [4.0, 0.0]
    scores = score(make_estimates([], []), unmoved([1.0, 2.0]), None, FALLBACK, period_s=0.5)
    assert scores["mean_m"] == pytest.approx(math.hypot(7, 2))
    assert scores["n"] == 2
    assert scores["level_hit_rate"] == 0.0
    assert scores["availability"] == 0.0
    assert scores["staleness_s"] == 1.5


@pytest.mark.parametrize("column", ["xy_m", "level"])
def test_a_missing_answer_holds_the_one_before(column: str) -> None:
    broken = {"xy_m": ([10.0, math.nan, 12.0], 0.0), "level": ([10.0, 11.0, 12.0], [0.0, math.nan, 0.0])}[column]
    held = hold_at(make_estimates([0.0, 1.0, 2.0], *broken), np.array([0.5, 1.5, 2.5]), FALLBACK)
    assert held.xy_m[:, 0].tolist() == [10.0, 10.0, 12.0]
    assert held.age_s.tolist() == [0.5, 1.5, 0.5]


def test_an_absurd_answer_is_scored_as_far_away_and_stays_finite() -> None:
    scores = score(make_estimates([0.0], [1e300], [1e300]), unmoved([1.0, 2.0]), None, FALLBACK)
    assert scores["rmse_m"] == MAX_COORDINATE_M
    assert all(math.isfinite(scores[name]) for name in ("p75_level_penalised_m", "ate_se2_aligned_m", "rte_60s_m"))


def test_availability_asks_for_an_answer_to_the_newest_observation() -> None:
    reference = unmoved([0.1, 0.6, 1.1, 1.6, 2.1])
    answers = make_estimates([0.0, 0.5, 1.0, 1.5, 2.0], [0.0, math.nan, 0.0, 0.0, 0.0])
    held = hold_at(answers, reference.t_s, FALLBACK)
    assert availability(held, reference, 0.5) == 0.8
    assert staleness_s(held, reference) == pytest.approx((0.1 + 0.6 + 0.1 + 0.1 + 0.1) / 5)
    assert math.isnan(availability(held, reference, None))


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    estimate_ticks=st.lists(st.integers(0, 400), max_size=12),
    is_missing=st.lists(st.booleans(), min_size=12, max_size=12),
    reference_ticks=st.lists(st.integers(0, 400), min_size=1, max_size=12),
)
def test_hold_equals_brute_force(estimate_ticks: list[int], is_missing: list[bool], reference_ticks: list[int]) -> None:
    # ticks of 5 ms lie on both sides of the slack of 10 ms
    t_s = [0.005 * tick for tick in sorted(estimate_ticks)]
    x_m = [math.nan if gone else float(row) for row, gone in zip(range(len(t_s)), is_missing, strict=False)]
    at_s = np.array([0.005 * tick for tick in reference_ticks])
    expected = []
    for t in at_s:
        found = float(FALLBACK.xy_m[0])
        for t_est, x in zip(t_s, x_m, strict=True):
            if t_est <= t + 0.01 and not math.isnan(x):
                found = x
        expected.append(found)
    assert hold_at(make_estimates(t_s, x_m), at_s, FALLBACK).xy_m[:, 0].tolist() == expected


SILENCE_COSTS = {"availability", "staleness_s"}


def make_walk(rng: np.random.Generator, count: int) -> tuple[Estimates, Trajectory]:
    t_s = np.arange(count) * 1.0
    way_m = np.cumsum(rng.normal(size=(count, 2)), axis=0)
    reference = make_reference(way_m, rng.integers(0, 2, count), rng.random(count) < 0.8, t_s=t_s + 0.3)
    return make_answers(t_s, way_m + rng.normal(size=(count, 2)) * 3, rng.integers(0, 2, count)), reference


def cut(estimates: Estimates, rows: int) -> Estimates:
    return Estimates(
        *(getattr(estimates, name)[:rows] for name in ("t_s", "xy_m", "level", "heading_rad", "sigma_m", "converged"))
    )


@settings(max_examples=20, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(2, 30), data=st.data())
def test_missing_answers_score_as_the_last_answer_repeated(seed: int, count: int, data: st.DataObject) -> None:
    # A localizer that stops answering, by crash or by NaN, is scored as if it repeated its last answer: no row is
    # dropped and no error is lower than that of the answers. Only availability and staleness get worse.
    estimates, reference = make_walk(np.random.default_rng(seed), count)
    last = data.draw(st.integers(1, count)) - 1
    row = np.minimum(np.arange(count), last)
    repeated = make_answers(estimates.t_s, estimates.xy_m[row], estimates.level[row])
    xy_m = np.where(np.arange(count)[:, None] > last, math.nan, estimates.xy_m)
    silenced = {"crashed": cut(estimates, last + 1), "NaN": make_answers(estimates.t_s, xy_m, estimates.level)}
    wanted = score(repeated, reference, None, FALLBACK, period_s=1.0)
    for silent in silenced.values():
        got = score(silent, reference, None, FALLBACK, period_s=1.0)
        for name in METRICS.keys() - SILENCE_COSTS:
            assert got[name] == wanted[name] or math.isnan(wanted[name]), name
        if wanted["n"]:
            assert got["availability"] <= wanted["availability"]
            assert got["staleness_s"] >= wanted["staleness_s"]
