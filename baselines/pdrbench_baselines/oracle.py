"""The localizer that receives the truth: the lower bracket of every environment, and a test of its scoring."""

from __future__ import annotations

import numpy as np

from pdrbench.errors import UnsuitableError
from pdrbench.localizer import Briefing, Estimate, Observation
from pdrbench.trajectory import Trajectory


class Oracle:
    """Answers the reference position that the answer will be scored at.

    An estimate holds until the next one (zero-order hold), so the oracle answers the first reference that falls
    due before the next observation, and between references the last one. `tell` is called by the conformance suite, and
    by `evaluate` on train and val splits only, where the truth is public.
    """

    _reference: Trajectory | None = None

    def tell(self, reference: Trajectory) -> None:
        """Takes the truth of the next walk."""
        self._reference = reference

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        if self._reference is None or not len(self._reference):
            raise UnsuitableError(
                "the oracle is given the truth by the conformance suite and on train and val splits only"
            )
        self._period_s = briefing.period_s

    def step(self, observation: Observation) -> Estimate:
        reference = self._reference
        assert reference is not None
        hold_slack_s = 0.01
        due = int(np.searchsorted(reference.t_s, observation.now_s - hold_slack_s, side="left"))
        falls_due = due < len(reference) and reference.t_s[due] < observation.now_s + self._period_s - hold_slack_s
        row = due if falls_due else max(due - 1, 0)
        return Estimate(xy_m=reference.xy_m[row], level=int(reference.level[row]))
