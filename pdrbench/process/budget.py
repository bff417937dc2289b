"""Time limits of a localizer: a mean pace, slack for steps that take longer, time to start, a total."""

from __future__ import annotations

import math
from dataclasses import dataclass

from pdrbench.episode import REVISE, STEP
from pdrbench.errors import PdrbenchError

CONSTRUCTION = "construction"  # the call before `reset`, beside those that `episode` names


class LocalizerTimeout(PdrbenchError):
    """A localizer did not answer in time."""


class LocalizerExit(PdrbenchError):
    """A localizer tried to end its process, or its process ended."""


@dataclass(frozen=True, slots=True)
class Budget:
    """Wall time that a localizer may take, on the clock of the evaluating side.

    For step k = 1, 2, ... it has `pace * period_s + u`, where u is the time left over from the steps before, at most
    `slack_s`; u is `slack_s` at first. `start_s` is for start-up, construction, `reset` and step 0 together, where code
    is compiled, and once more for `revise`. All calls of a walk together have `walk_s`. The defaults are ours: several
    times what the slowest registered localizer takes on a busy machine, so that its load changes no result.

    Attributes:
        pace: Mean wall time of a step, in periods of the environment.
        slack_s: Upper limit of the time left over.
        start_s: Wall time of everything up to the first answer.
        walk_s: Wall time of a walk, from start-up to `revise`.
    """

    pace: float = 2.0
    slack_s: float = 60.0
    start_s: float = 600.0
    walk_s: float = 1200.0

    def __post_init__(self) -> None:
        finite = all(math.isfinite(value) for value in (self.pace, self.slack_s, self.start_s, self.walk_s))
        if not (finite and self.pace > 0 and self.slack_s >= 0 and self.start_s > 0 and self.walk_s > 0):
            raise PdrbenchError(f"a budget is positive and finite (slack may be 0); got {self}")


class TimeAccount:
    """The time that one localizer has left on one walk.

    >>> account = TimeAccount(Budget(pace=1.0, slack_s=3.0, start_s=9.0), period_s=0.5)
    >>> account.spend("reset", 4.0), account.spend("step", 2.0), account.allowed_s("step")
    (None, None, 3.5)
    >>> account.spend("step", 1.5), account.allowed_s("step")
    (None, 2.5)
    >>> account.spent_s
    7.5
    """

    __slots__ = ("_begun", "_budget", "_pace_s", "_start_left_s", "_unused_s", "spent_s")

    def __init__(self, budget: Budget, period_s: float) -> None:
        self._budget = budget
        self._pace_s = budget.pace * period_s
        self._start_left_s = budget.start_s
        self._unused_s = budget.slack_s
        self._begun = False  # True once a step has been answered
        self.spent_s = 0.0  # by all calls

    def allowed_s(self, call: str) -> float:
        """Upper limit of the wall time of the next call ("construction", "reset", "step" or "revise"), 0 or more."""
        return min(self._allowed_by_call_s(call), max(self._budget.walk_s - self.spent_s, 0.0))

    def spend(self, call: str, taken_s: float) -> None:
        """Books a call that has ended."""
        self.spent_s += taken_s
        if call == STEP and self._begun:
            self._unused_s = min(max(self._pace_s + self._unused_s - taken_s, 0.0), self._budget.slack_s)
        elif call != REVISE:
            self._start_left_s = max(self._start_left_s - taken_s, 0.0)
            self._begun = call == STEP

    def rule(self, call: str) -> str:
        """The rule behind the time of a call, for the message of a timeout."""
        budget = self._budget
        if budget.walk_s - self.spent_s < self._allowed_by_call_s(call):
            return f"budget: {budget.walk_s:g} s for all calls of a walk together"
        if call == STEP and self._begun:
            return f"budget: {self._pace_s:g} s a step and up to {budget.slack_s:g} s left over from those before"
        if call == REVISE:
            return f"budget: {budget.start_s:g} s"
        return f"budget: {budget.start_s:g} s for start-up, construction, reset and the first step together"

    def _allowed_by_call_s(self, call: str) -> float:
        """What the rule of a call alone allows."""
        if call == REVISE:
            return self._budget.start_s
        if call == STEP and self._begun:
            return self._pace_s + self._unused_s
        return self._start_left_s
