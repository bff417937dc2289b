"""A localizer that only consumes time; it imports what the file of a user's localizer imports."""

from __future__ import annotations

import time

import numpy as np

from pdrbench.localizer import Briefing, Estimate, Observation


class Busy:
    """Computes for a while at each step, and answers with what it was given."""

    def __init__(self, busy_s: float) -> None:
        self._busy_s = busy_s

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        """Nothing to prepare."""

    def step(self, observation: Observation) -> Estimate:
        """Spins, since a process that sleeps is woken late and would hide what the way there costs."""
        ends_s = time.thread_time() + self._busy_s
        while time.thread_time() < ends_s:
            pass
        return Estimate(observation["accel"][0, 1:3], 0)
