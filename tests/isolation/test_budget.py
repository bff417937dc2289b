"""The rule of the budget in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from pdrbench.errors import PdrbenchError
from pdrbench.isolation import Budget, TimeAccount


def begun(budget: Budget, period_s: float = 1.0) -> TimeAccount:
    """The account of a localizer that has answered once."""
    account = TimeAccount(budget, period_s)
    for call in ("construction", "reset", "step"):
        account.spend(call, 0.0)
    return account


def test_start_up_has_one_sum_for_everything_up_to_the_first_answer() -> None:
    account = TimeAccount(Budget(pace=1.0, slack_s=5.0, start_s=10.0), 1.0)
    left = []
    for call, taken_s in (("construction", 3.0), ("reset", 4.0), ("step", 2.0), ("step", 0.0)):
        left.append(account.allowed_s(call))
        account.spend(call, taken_s)
    assert left == [10.0, 7.0, 3.0, 6.0]


def test_what_is_left_over_adds_up_to_the_slack_and_no_further() -> None:
    """u = min(slack, u + pace * period - taken), from u = slack on."""
    account = begun(Budget(pace=0.5, slack_s=2.0, start_s=1.0), period_s=0.2)
    taken_s = np.random.default_rng(1).choice([0.0, 0.05, 0.4, 0.9], size=200)
    unused_s = 2.0
    for taken in taken_s:
        assert account.allowed_s("step") == pytest.approx(0.1 + unused_s)
        account.spend("step", taken)
        unused_s = min(2.0, max(0.0, unused_s + 0.1 - taken))


def test_a_steady_pace_just_fits_for_ever_and_a_slower_one_runs_out_after_the_slack() -> None:
    budget = Budget(pace=1.0, slack_s=3.0, start_s=1.0)
    steady, slow = begun(budget), begun(budget)
    for step in range(1000):
        steady.spend("step", 1.0)
        assert steady.allowed_s("step") == 4.0, step
    steps = 0
    while slow.allowed_s("step") >= 1.25:
        slow.spend("step", 1.25)
        steps += 1
    assert steps == 12, "3 s of slack, a quarter of a second more than the pace at each step"


def test_without_slack_every_step_stands_alone() -> None:
    account = begun(Budget(pace=2.0, slack_s=0.0, start_s=1.0), period_s=0.5)
    for taken_s in (0.0, 1.0, 0.3):
        assert account.allowed_s("step") == 1.0
        account.spend("step", taken_s)


def test_the_past_has_as_long_as_the_start_whatever_was_left() -> None:
    account = TimeAccount(Budget(pace=1.0, slack_s=1.0, start_s=8.0), 1.0)
    account.spend("construction", 8.0)
    assert account.allowed_s("reset") == 0.0
    assert account.allowed_s("revise") == 8.0


@pytest.mark.parametrize("wrong", [{"pace": 0.0}, {"slack_s": -1.0}, {"start_s": 0.0}, {"pace": float("inf")}])
def test_a_budget_is_positive_and_finite(wrong: dict[str, float]) -> None:
    with pytest.raises(PdrbenchError, match="positive and finite"):
        Budget(**wrong)


def test_the_total_bounds_every_walk() -> None:
    budget = Budget(pace=2.0, slack_s=5.0, start_s=7.0)
    assert budget.total_s(10, 0.5) == 7.0 + 5.0 + 10.0 + 7.0
