"""Answers that come late or never, and clocks that are stopped."""

from __future__ import annotations

import contextlib
import os
import signal
import time

from hostile.common import Honest, define
from pdrbench.localizer import Estimate, Observation

define(
    globals(),
    Honest,
    "misbehave",
    {
        "Spins": lambda self: sum(iter(int, 1)),  # holds the interpreter in compiled code
        "StopsItself": lambda self: os.kill(os.getpid(), signal.SIGSTOP),  # neither ends nor runs on
    },
)
define(globals(), Honest, "__init__", {"NeverIsMade": lambda self: time.sleep(3600)})


class NeverAnswers(Honest):
    def misbehave(self) -> object:
        while True:
            with contextlib.suppress(BaseException):
                time.sleep(3600)


class Late(Honest):
    """Answers every observation, each later than there is time for."""

    def step(self, observation: Observation) -> Estimate:
        time.sleep(0.6)
        return super().step(observation)


class PatchesTime(Honest):
    """Stops every clock that Python has, and takes its time."""

    def misbehave(self) -> object:
        sleep = time.sleep
        for name in ("time", "monotonic", "perf_counter", "process_time"):
            setattr(time, name, lambda: 0.0)
            setattr(time, f"{name}_ns", lambda: 0)
        sleep(0.3)
        return None
