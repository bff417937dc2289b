"""Matching events, counting steps, measuring strides."""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment

from pdrbench.errors import EstimateError, PdrbenchError, RecordingError
from pdrbench_lab.papers.li2012.step_scores import (
    EventMatch,
    false_steps_per_min,
    match_events,
    step_count_error_pct,
    step_f1,
    stride_bias_m,
    stride_errors_m,
    stride_relative_error_pct,
    stride_rmse_m,
)

TICKS = st.lists(st.integers(0, 40), max_size=12)  # of 50 ms: five are the tolerance, many are equal


def pairs(match: EventMatch) -> list[tuple[int, int]]:
    return list(zip(match.estimated.tolist(), match.reference.tolist(), strict=True))


def brute_force(estimated_s: np.ndarray, reference_s: np.ndarray, tolerance_s: float) -> tuple[int, float]:
    """Most pairs, and the least sum of time differences among matchings with so many."""
    apart_s = np.abs(estimated_s[:, None] - reference_s)
    fits = apart_s <= tolerance_s + 1e-9
    row, column = linear_sum_assignment(np.where(fits, apart_s - 1000.0, 0.0))
    taken = fits[row, column]
    return int(taken.sum()), float(apart_s[row, column][taken].sum())


@settings(max_examples=300, deadline=None, derandomize=True)
@given(estimated=TICKS, reference=TICKS)
def test_matching_equals_brute_force_on_ticks(estimated: list[int], reference: list[int]) -> None:
    check_against_brute_force(0.05 * np.array(estimated), 0.05 * np.array(reference))


@pytest.mark.parametrize("span_s", [0.3, 1.0, 4.0])
def test_matching_equals_brute_force_anywhere(span_s: float) -> None:
    rng = np.random.default_rng(1)
    for _ in range(300):
        check_against_brute_force(*(rng.uniform(0.0, span_s, rng.integers(0, 13)) for _ in range(2)))


def check_against_brute_force(estimated_s: np.ndarray, reference_s: np.ndarray) -> None:
    match = match_events(estimated_s, reference_s)
    assert len(set(match.estimated.tolist())) == len(set(match.reference.tolist())) == match.true_positives
    apart_s = np.abs(estimated_s[match.estimated] - reference_s[match.reference])
    assert (apart_s <= 0.25 + 1e-9).all()
    wanted, least_s = brute_force(estimated_s, reference_s, 0.25)
    assert match.true_positives == wanted
    assert apart_s.sum() == pytest.approx(least_s, abs=1e-9)
    assert match.false_positives == len(estimated_s) - wanted
    assert match.false_negatives == len(reference_s) - wanted


def test_as_many_pairs_as_possible_where_the_nearest_first_takes_one() -> None:
    # 0.20 is nearest to 0.25, which leaves nothing for 0.0 and 0.45 within 0.25 s
    assert pairs(match_events([0.2, 0.45], [0.0, 0.25])) == [(0, 0), (1, 1)]


def test_the_least_difference_of_equally_many_pairs() -> None:
    assert pairs(match_events([1.0], [0.8, 1.1, 1.2])) == [(0, 1)]
    assert pairs(match_events([0.8, 1.1, 1.2], [1.0])) == [(1, 0)]


def test_the_tolerance_is_inclusive_whatever_the_rounding() -> None:
    assert 0.55 - 0.30 > 0.25
    assert match_events([0.55], [0.30]).true_positives == 1
    assert match_events([0.551], [0.30]).true_positives == 0
    assert match_events([0.551], [0.30], tolerance_s=0.26).true_positives == 1


def test_counts_and_fractions() -> None:
    # steps at 1 and 3 found, 2 missed, two false
    match = match_events([1.1, 2.9, 5.0, 6.0], [1.0, 2.0, 3.0])
    assert (match.true_positives, match.false_positives, match.false_negatives) == (2, 2, 1)
    assert (match.precision, match.recall) == (0.5, pytest.approx(2 / 3))
    assert match.f1 == pytest.approx(2 * 0.5 * (2 / 3) / (0.5 + 2 / 3))
    assert match.count_error_pct == pytest.approx(100 / 3)
    assert step_f1([1.1, 2.9, 5.0, 6.0], [1.0, 2.0, 3.0]) == match.f1
    assert step_count_error_pct([1.1, 2.9, 5.0, 6.0], [1.0, 2.0, 3.0]) == match.count_error_pct


def test_the_oracle_finds_every_step() -> None:
    steps_s = np.cumsum(np.random.default_rng(2).uniform(0.3, 0.7, 500))
    match = match_events(steps_s, steps_s)
    assert pairs(match) == [(row, row) for row in range(500)]
    assert (match.precision, match.recall, match.f1, match.count_error_pct) == (1.0, 1.0, 1.0, 0.0)


def test_doing_worse_never_scores_better() -> None:
    rng = np.random.default_rng(3)
    steps_s = np.cumsum(rng.uniform(0.3, 0.7, 60))
    found_s = steps_s[rng.random(60) < 0.9] + 0.05
    match = match_events(found_s, steps_s)
    assert match_events(np.append(found_s, 100.0), steps_s).f1 < match.f1  # one more false step
    assert match_events(found_s[1:], steps_s).f1 < match.f1  # one more missed
    assert match_events(found_s, steps_s, tolerance_s=0.04).f1 < match.f1
    assert match_events(np.append(found_s, found_s), steps_s).f1 < match.f1  # every step found twice


def test_events_come_in_any_order_and_at_any_time() -> None:
    rng = np.random.default_rng(4)
    found_s, made_s = rng.uniform(0, 20, 40), rng.uniform(0, 20, 40)
    in_order = np.sort(found_s), np.sort(made_s)
    wanted = {(in_order[0][i], in_order[1][j]) for i, j in pairs(match_events(*in_order))}
    assert {(found_s[i], made_s[j]) for i, j in pairs(match_events(found_s, made_s))} == wanted
    later = match_events(found_s + 1000.0, made_s + 1000.0)
    assert pairs(later) == pairs(match_events(found_s, made_s))
    turned = match_events(made_s, found_s)
    assert turned.f1 == match_events(found_s, made_s).f1


def test_of_two_events_at_one_time_one_is_true() -> None:
    assert match_events([1.0, 1.0], [1.0]).false_positives == 1
    assert match_events([1.0], [1.0, 1.0]).false_negatives == 1
    assert match_events([1.0, 1.0], [1.0, 1.0]).f1 == 1.0


def test_no_events() -> None:
    neither = match_events([], [])
    assert all(math.isnan(v) for v in (neither.precision, neither.recall, neither.f1, neither.count_error_pct))
    silent = match_events([], [1.0, 2.0])
    assert (silent.recall, silent.f1, silent.count_error_pct, silent.false_negatives) == (0.0, 0.0, -100.0, 2)
    assert math.isnan(silent.precision)
    ghosts = match_events([1.0, 2.0], [])
    assert (ghosts.precision, ghosts.f1, ghosts.false_positives) == (0.0, 0.0, 2)
    assert math.isnan(ghosts.recall) and math.isnan(ghosts.count_error_pct)


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_times_that_are_no_times_are_refused(bad: float) -> None:
    with pytest.raises(EstimateError, match="estimated events are not finite at row 1"):
        match_events([1.0, bad], [1.0])
    with pytest.raises(RecordingError, match="reference events are not finite at row 0"):
        match_events([1.0], [bad])
    with pytest.raises(EstimateError, match=r"shape \(1, 2\)"):
        match_events([[1.0, 2.0]], [1.0])
    with pytest.raises(EstimateError, match="row 0"):
        step_count_error_pct([bad], [1.0])


@pytest.mark.parametrize("tolerance_s", [0.0, -1.0, math.nan, math.inf])
def test_a_tolerance_that_is_none_is_refused(tolerance_s: float) -> None:
    with pytest.raises(PdrbenchError, match="tolerance_s"):
        match_events([1.0], [1.0], tolerance_s=tolerance_s)


def test_ten_thousand_steps_take_less_than_a_second() -> None:
    # at three steps a second every event lies within the tolerance of two others
    rng = np.random.default_rng(5)
    made_s = np.cumsum(rng.normal(0.33, 0.03, 10_000))
    found_s = made_s + rng.normal(0.0, 0.1, 10_000)
    begin_s = time.process_time()
    match = match_events(found_s, made_s)
    assert time.process_time() - begin_s < 1.0
    assert match.f1 > 0.95


def test_false_steps_are_those_while_the_person_stands() -> None:
    still_s = [[0.0, 30.0], [60.0, 90.0]]
    # 30 and 60 belong to an interval, 30.1 to none
    assert false_steps_per_min([-1.0, 1.0, 30.0, 30.1, 60.0, 95.0], still_s) == 3.0
    assert false_steps_per_min([], still_s) == 0.0
    assert math.isnan(false_steps_per_min([1.0], []))
    assert math.isnan(false_steps_per_min([1.0], np.zeros((0, 2))))
    assert false_steps_per_min([0.5], [[0.0, 15.0], [15.0, 30.0]]) == 2.0


@pytest.mark.parametrize(
    ("still_s", "message"),
    [
        ([[0.0, 1.0], [5.0, 5.0]], "interval 1 is empty"),
        ([[2.0, 1.0]], "interval 0 is empty"),
        ([[0.0, 1.0], [1.0, 3.0], [2.0, 4.0]], "interval 2 .*sort and merge"),
        ([[5.0, 6.0], [0.0, 1.0]], "interval 1 .*sort and merge"),
        ([0.0, 1.0], r"shape \(2,\)"),
        ([[0.0, math.nan]], "finite"),
    ],
)
def test_still_intervals_that_are_none_are_refused(still_s: Any, message: str) -> None:
    with pytest.raises(RecordingError, match=message):
        false_steps_per_min([1.0], still_s)


def test_strides_are_compared_where_they_match() -> None:
    # the second stride was missed and the last found is none: neither enters
    match = match_events([1.0, 3.0, 9.0], [1.0, 2.0, 3.0])
    found_m, made_m = [1.0, 1.5, 77.0], [1.2, 99.0, 1.4]
    assert stride_errors_m(match, found_m, made_m).tolist() == pytest.approx([-0.2, 0.1])
    assert stride_rmse_m(match, found_m, made_m) == pytest.approx(math.sqrt((0.04 + 0.01) / 2))
    assert stride_bias_m(match, found_m, made_m) == pytest.approx(-0.05)
    assert stride_relative_error_pct(match, found_m, made_m) == pytest.approx(50 * (0.2 / 1.2 + 0.1 / 1.4))


def test_strides_with_equal_errors() -> None:
    t_s = np.arange(50.0)
    made_m = np.random.default_rng(6).uniform(0.8, 1.6, 50)
    match = match_events(t_s[::-1], t_s)  # found in another order
    assert stride_bias_m(match, made_m[::-1] - 0.02, made_m) == pytest.approx(-0.02)
    assert stride_rmse_m(match, made_m[::-1] - 0.02, made_m) == pytest.approx(0.02)
    assert stride_relative_error_pct(match, 0.981 * made_m[::-1], made_m) == pytest.approx(1.9)
    assert stride_rmse_m(match, made_m[::-1], made_m) == 0.0


def test_strides_without_a_match_have_no_error() -> None:
    match = match_events([1.0], [5.0])
    for measure in (stride_rmse_m, stride_bias_m, stride_relative_error_pct):
        assert math.isnan(measure(match, [1.0], [1.0]))


def test_lengths_that_do_not_fit_are_refused() -> None:
    match = match_events([1.0, 2.0], [1.0, 2.0])
    with pytest.raises(EstimateError, match="1 lengths for 2 estimated strides"):
        stride_rmse_m(match, [1.0], [1.0, 1.0])
    with pytest.raises(RecordingError, match="3 lengths for 2 reference strides"):
        stride_rmse_m(match, [1.0, 1.0], [1.0, 1.0, 1.0])
    with pytest.raises(RecordingError, match=r"reference stride 1 is 0\.0 m long"):
        stride_relative_error_pct(match, [1.0, 1.0], [1.0, 0.0])
    with pytest.raises(EstimateError, match="not finite at row 1"):
        stride_bias_m(match, [1.0, math.nan], [1.0, 1.0])
