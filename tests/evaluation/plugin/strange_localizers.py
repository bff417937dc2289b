"""Localizers of every kind that a benchmark meets, good and bad."""

from __future__ import annotations

import contextlib
import itertools
import os
import sys
import time
from pathlib import Path

import numpy as np

from pdrbench.errors import UnsuitableError
from pdrbench.localizer import Briefing, Estimate, Observation
from pdrbench.trajectory import Trajectory

BAD_STEP = 4  # the observation at which a bad localizer shows what it is


class Good:
    """Adds up strides along x, and random noise."""

    def __init__(self, noise_m: float = 0.0) -> None:
        self.noise_m = noise_m

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        self.x_m, self.count, self.rng = 0.0, 0, rng

    def step(self, observation: Observation) -> Estimate:
        self.x_m += float(observation["stride"][:, 1].sum()) + self.noise_m * self.rng.standard_normal()
        self.count += 1
        answer = self.misbehave() if self.count == BAD_STEP + 1 else None
        return Estimate(np.array([self.x_m, 0.0]), 0) if answer is None else answer

    def misbehave(self) -> object:
        return None


class Noisy(Good):
    def __init__(self) -> None:
        super().__init__(noise_m=0.1)


class Worse(Good):
    def __init__(self) -> None:
        super().__init__(noise_m=2.0)


class Slow(Good):
    """Takes 20 ms for a walk and notes every walk it was run to the end of."""

    def step(self, observation: Observation) -> Estimate:
        time.sleep(0.02 / 13)
        if self.count == 12 and "CORRIDOR_COUNTER" in os.environ:
            handle = os.open(os.environ["CORRIDOR_COUNTER"], os.O_WRONLY | os.O_APPEND | os.O_CREAT)
            os.write(handle, b"%r\n" % self.x_m)
            os.close(handle)
        return super().step(observation)


class NotFinite(Good):
    def misbehave(self) -> object:
        return Estimate(np.array([np.nan, 0.0]), 0)


class WrongShape(Good):
    def misbehave(self) -> object:
        return Estimate(np.zeros(3), 0)


class WrongType(Good):
    def misbehave(self) -> object:
        return (1.0, 2.0, 0)


class SaysNothing(Good):
    def step(self, observation: Observation) -> None:  # type: ignore[override]
        return None


class RaisesInConstruction(Good):
    def __init__(self) -> None:
        raise RuntimeError("no weights")


class RaisesInReset(Good):
    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        raise RuntimeError("reset went wrong")


class RaisesInStep(Good):
    def misbehave(self) -> object:
        raise ZeroDivisionError("step went wrong")


class RunsOutOfMemory(Good):
    def misbehave(self) -> object:
        return bytearray(2**62)


class Exits(Good):
    def misbehave(self) -> object:
        sys.exit(3)


class Interrupts(Good):
    def misbehave(self) -> object:
        raise KeyboardInterrupt


class Unsuitable(Good):
    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        raise UnsuitableError("needs an altimeter")


class HangsInPython(Good):
    def misbehave(self) -> object:
        while True:
            pass


class HangsInReset(Good):
    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        time.sleep(3600)


class SwallowsTheAlarm(Good):
    """Catches every exception, and goes on answering."""

    def misbehave(self) -> object:
        for _ in range(3):
            with contextlib.suppress(BaseException):
                time.sleep(3600)
        return None


class NeverGivesUp(Good):
    """Catches every exception, for ever."""

    def misbehave(self) -> object:
        while True:
            with contextlib.suppress(BaseException):
                while True:
                    pass


class HangsInC(Good):
    """Holds the interpreter's lock in compiled code: no signal handler of Python ever runs."""

    def misbehave(self) -> object:
        return sum(itertools.repeat(0))


class ExitsHard(Good):
    def misbehave(self) -> object:
        os._exit(7)


class KillsTheWorkerOnce(Good):
    """Kills the process that started its own, which only an unconfined one can, and would answer in a second pass."""

    def __init__(self, path: str) -> None:
        super().__init__()
        self.mark = Path(path)

    def misbehave(self) -> object:
        passes = len(self.mark.read_text()) if self.mark.exists() else 0
        self.mark.write_text("x" * (passes + 1))
        if not passes:
            os.kill(os.getppid(), 9)
            time.sleep(60)
        return None


class Oracle:
    """Is given the truth."""

    def tell(self, reference: Trajectory) -> None:
        self.reference = reference

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        pass

    def step(self, observation: Observation) -> Estimate:
        row = min(max(int(np.searchsorted(self.reference.t_s, observation.now_s, "right")) - 1, 0), 11)
        return Estimate(self.reference.xy_m[row], int(self.reference.level[row]))
