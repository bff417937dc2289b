"""Convergence, loss and claims in closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tracks import make_answers, make_reference

from pdrbench.metrics import hold_at
from pdrbench.metrics.global_localisation import (
    claimed_convergence_s,
    claimed_correct,
    converged_by,
    converged_errors_m,
    converged_mean_m,
    converged_percentile_m,
    converged_share,
    convergence_s,
    lost_count,
    lost_share,
    recovery_s,
    search,
)
from pdrbench.metrics.hold import Held
from pdrbench.trajectory import Estimates, Start, Trajectory

FAR, NEAR, BETWEEN = 20.0, 1.0, 7.0
NOWHERE = Start(xy_m=np.zeros(2), level=0)


def make_walk(
    errors: object, level: object = 0.0, begin_s: float = 0.0, every_s: float = 1.0, converged: object = math.nan
) -> tuple[Held, Trajectory, Held]:
    """Answers with these errors at every surveyed position: held there, the reference, held at every answer."""
    errors = np.asarray(errors, dtype=float)
    t_s = begin_s + every_s * np.arange(len(errors))
    reference = make_reference(np.zeros((len(errors), 2)), t_s=t_s)
    estimates = make_answers(t_s, errors[:, None] * [1.0, 0.0], level, converged=converged)
    return hold_at(estimates, t_s, NOWHERE), reference, hold_at(estimates, t_s, NOWHERE, slack_s=0.0)


# Convergence -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("begin_s", [0.0, 33.0])
def test_convergence_is_the_first_time_from_which_the_error_stays_small(begin_s: float) -> None:
    held, reference, _ = make_walk([FAR] * 7 + [NEAR] * 20, begin_s=begin_s)
    assert convergence_s(held, reference) == 7.0


def test_ten_seconds_are_enough_and_a_walk_too_short_does_not_count() -> None:
    assert convergence_s(*make_walk([NEAR] * 10 + [FAR] + [NEAR] * 11)[:2]) == 11.0, "ten positions last nine seconds"
    assert convergence_s(*make_walk([NEAR] * 11 + [FAR] * 11)[:2]) == 0.0
    assert convergence_s(*make_walk([5.0] * 11)[:2]) == 0.0, "the limit itself is within"
    assert convergence_s(*make_walk([NEAR] * 10 + [FAR] * 11)[:2]) == math.inf
    for errors in ([NEAR] * 10, [FAR] * 10, [NEAR], []):
        held, reference, _ = make_walk(errors)
        assert math.isnan(convergence_s(held, reference))
        assert math.isnan(lost_count(held, reference))


def test_on_the_wrong_level_and_without_convergence_there_is_none() -> None:
    level = np.array([1.0] * 12 + [0.0] * 12)
    assert convergence_s(*make_walk([NEAR] * 24, level)[:2]) == 12.0
    assert lost_count(*make_walk([NEAR] * 24, level[::-1])[:2]) == 1.0
    held, reference, _ = make_walk([FAR] * 100)
    assert convergence_s(held, reference) == math.inf
    assert math.isnan(lost_count(held, reference)) and math.isnan(lost_share(held, reference))


def test_converged_by_counts_every_walk_that_lasts_long_enough() -> None:
    late = [FAR] * 45 + [NEAR] * 60
    assert [converged_by(*make_walk(late)[:2], by_s=by_s) for by_s in (30.0, 45.0, 60.0)] == [0.0, 1.0, 1.0]
    assert math.isnan(converged_by(*make_walk(late)[:2], by_s=120.0))
    # walks that converge at once or never are both left out
    for errors in ([NEAR] * 40, [FAR] * 40):
        assert math.isnan(converged_by(*make_walk(errors)[:2], by_s=30.0))
    assert converged_by(*make_walk([NEAR] * 41)[:2], by_s=30.0) == 1.0


# Loss ------------------------------------------------------------------------------------------------------------


def test_a_loss_lasts_until_the_next_convergence() -> None:
    # found at 0, lost at 30, within 10 m from 45 and within 5 m from 50, until 99
    held, reference, _ = make_walk([NEAR] * 30 + [FAR] * 15 + [BETWEEN] * 5 + [NEAR] * 50)
    assert lost_count(held, reference) == 1.0
    assert recovery_s(held, reference) == 20.0
    assert lost_share(held, reference) == pytest.approx(20 / 99)


def test_a_permanent_loss_has_an_infinite_recovery_time() -> None:
    held, reference, _ = make_walk([NEAR] * 20 + [FAR] * 80)
    assert recovery_s(held, reference) == math.inf
    assert lost_share(held, reference) == pytest.approx(79 / 99)
    # of three losses the first takes 12 s, the second 20 s, the third is for good
    errors = [NEAR] * 20 + [FAR] * 12 + [NEAR] * 20 + [FAR] * 20 + [NEAR] * 20 + [FAR] * 20
    held, reference, _ = make_walk(errors)
    assert (lost_count(held, reference), recovery_s(held, reference)) == (3.0, 20.0)


@pytest.mark.parametrize("seed", range(10))
def test_search_agrees_with_a_loop_over_positions(seed: int) -> None:
    rng = np.random.default_rng(seed)
    held, reference, _ = make_walk(np.repeat(rng.choice([NEAR, BETWEEN, FAR], 40), rng.integers(1, 25, 40)))
    found = search(held, reference)
    errors, end = held.xy_m[:, 0], len(held)

    def lasts(first: int, is_so: np.ndarray, least: int) -> bool:
        return first + least < end and bool(is_so[first : first + least + 1].all())

    events, state = [], "searching"
    for row in range(end):
        if state == "searching" and lasts(row, errors <= 5.0, 10):
            state = "found"
            events.append(row)
        elif state == "found" and lasts(row, errors > 10.0, 11):
            state = "searching"
            events.append(row)
    found_s = [found.converged_s, *np.column_stack([found.lost_s, found.recovered_s]).ravel()]
    assert [time for time in found_s if math.isfinite(time)] == events


# Claims ----------------------------------------------------------------------------------------------------------


def test_a_claim_is_right_where_the_next_surveyed_position_is_near() -> None:
    claims = [0.0] * 12 + [1.0] * 8
    held, reference, answered = make_walk([FAR] * 10 + [2.9] * 10, converged=claims)
    assert claimed_convergence_s(answered, reference) == 12.0
    assert claimed_correct(held, reference, answered) == 1.0
    assert claimed_correct(held, reference, answered, within_m=2.0) == 0.0
    assert converged_share(held, reference) == pytest.approx(8 / 20)
    held, reference, answered = make_walk([FAR] * 13 + [NEAR] * 7, converged=claims)
    assert claimed_correct(held, reference, answered) == 0.0, "becoming right later does not help"
    held, reference, answered = make_walk([NEAR] * 20, level=1.0, converged=claims)
    assert claimed_correct(held, reference, answered) == 0.0


def test_unclaimed_convergence_is_late_and_a_missing_claim_is_not_scored() -> None:
    held, reference, answered = make_walk([NEAR] * 20, converged=0.0)
    assert claimed_convergence_s(answered, reference) == math.inf
    assert (claimed_correct(held, reference, answered), converged_share(held, reference)) == (0.0, 0.0)
    assert math.isnan(converged_mean_m(held, reference))
    held, reference, answered = make_walk([NEAR] * 20)
    for value in (
        claimed_convergence_s(answered, reference),
        claimed_correct(held, reference, answered),
        converged_share(held, reference),
        converged_mean_m(held, reference),
        converged_percentile_m(held, reference),
    ):
        assert math.isnan(value)


def test_a_claim_before_the_first_surveyed_position_takes_no_time() -> None:
    estimates = Estimates([2.0], [[1.0, 0.0]], [0.0], [math.nan], [math.nan], [1.0])
    reference = Trajectory([10.0, 25.0], np.zeros((2, 2)), [0, 0], [True, True])
    answered = hold_at(estimates, estimates.t_s, NOWHERE)
    held = hold_at(estimates, reference.t_s, NOWHERE)
    assert claimed_convergence_s(answered, reference) == 0.0
    assert claimed_correct(held, reference, answered) == 1.0


def test_errors_while_claimed_are_those_of_the_claims_in_force() -> None:
    held, reference, _ = make_walk([1.0, 2.0, 3.0, 4.0, 50.0], converged=[0.0, 1.0, 1.0, 1.0, math.nan])
    assert converged_errors_m(held, reference).tolist() == [2.0, 3.0, 4.0]
    assert converged_mean_m(held, reference) == 3.0
    assert converged_percentile_m(held, reference, quantile=0.5) == 3.0
    assert converged_percentile_m(held, reference, quantile=0.75) == pytest.approx(3.75)  # Hazen: place 3 * 0.75 + 1/2
    assert converged_share(held, reference) == pytest.approx(3 / 5)
