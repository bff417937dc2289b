"""The rule of the budget in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from pdrbench.errors import PdrbenchError
from pdrbench.process import Budget, TimeAccount


def begun(budget: Budget, period_s: float = 1.0) -> TimeAccount:
    """The account of a localizer that has answered once."""
    account = TimeAccount(budget, period_s)
    for call in ("construction", "reset", "step"):
        account.spend(call, 0.0)
    return account


def test_start_up_has_one_budget_up_to_the_first_answer() -> None:
    account = TimeAccount(Budget(pace=1.0, slack_s=5.0, start_s=10.0), 1.0)
    left = []
    for call, taken_s in (("construction", 3.0), ("reset", 4.0), ("step", 2.0), ("step", 0.0)):
        left.append(account.allowed_s(call))
        account.spend(call, taken_s)
    assert left == [10.0, 7.0, 3.0, 6.0]


@pytest.mark.parametrize(("pace", "slack_s"), [(0.5, 2.0), (2.0, 0.0), (1.0, 3.0)])
def test_unused_time_accumulates_up_to_the_slack(pace: float, slack_s: float) -> None:
    """u = min(slack, u + pace * period - taken), from u = slack on; without slack every step stands alone."""
    account = begun(Budget(pace=pace, slack_s=slack_s, start_s=1.0), period_s=0.2)
    pace_s, unused_s = pace * 0.2, slack_s
    for taken_s in np.random.default_rng(1).choice([0.0, 0.05, pace_s, 0.4, 0.9], size=200):
        assert account.allowed_s("step") == pytest.approx(pace_s + unused_s)
        account.spend("step", taken_s)
        unused_s = min(slack_s, max(0.0, unused_s + pace_s - taken_s))


def test_the_past_has_as_long_as_the_start_whatever_was_left() -> None:
    account = TimeAccount(Budget(pace=1.0, slack_s=1.0, start_s=8.0), 1.0)
    account.spend("construction", 8.0)
    assert account.allowed_s("reset") == 0.0
    assert account.allowed_s("revise") == 8.0


@pytest.mark.parametrize("wrong", [{"pace": 0.0}, {"slack_s": -1.0}, {"start_s": 0.0}, {"pace": float("inf")}])
def test_a_budget_is_positive_and_finite(wrong: dict[str, float]) -> None:
    with pytest.raises(PdrbenchError, match="positive and finite"):
        Budget(**wrong)


def test_all_calls_of_a_walk_have_one_total() -> None:
    account = TimeAccount(Budget(pace=1.0, slack_s=10.0, start_s=50.0, walk_s=20.0), 1.0)
    left = []
    for call, taken_s in (("construction", 5.0), ("reset", 1.0), ("step", 4.0), ("step", 7.0), ("revise", 2.0)):
        left.append(account.allowed_s(call))
        account.spend(call, taken_s)
    assert left == [20.0, 15.0, 14.0, 10.0, 3.0]
    assert account.spent_s == 19.0
    assert "20 s for all calls of a walk together" in account.rule("revise")
    account.spend("revise", 5.0)
    assert account.allowed_s("revise") == 0.0


def test_totals_are_positive_and_finite() -> None:
    with pytest.raises(PdrbenchError, match="positive and finite"):
        Budget(walk_s=0.0)
