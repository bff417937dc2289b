"""Checks of a localizer in a process of their own, since it may hang, crash or leave."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING, Any, Final

from pdrbench.localizer import Briefing, Estimate, Localizer, Observation

if TYPE_CHECKING:
    import numpy as np

    from pdrbench.gym import Check

STEP_DEADLINE_S: Final = 10.0  # as `evaluate` has it unless told otherwise
RESET_DEADLINE_S: Final = 600.0
NAME: Final = "answers in time and leaves its process alone"


def check_apart(name: str) -> list[Check]:
    """`pdrbench.gym.check_localizer`; one failed check where the localizer hangs or takes its process down.

    Args:
        name: As `registry.load_localizer` takes it.
    """
    from pdrbench.gym import Check

    sys.stdout.flush()
    ours, theirs = multiprocessing.Pipe(duplex=False)
    # forked, so that what was registered or imported here is there as well
    process = multiprocessing.get_context("fork").Process(target=_check, args=(name, theirs))
    process.start()
    theirs.close()
    try:
        checks: list[Check] = ours.recv()
    except EOFError:
        process.join()
        return [Check(NAME, False, _why_ended(process.exitcode))]
    finally:
        process.kill()  # threads of a localizer may outlive the checks
        process.join()
    return checks


def _check(name: str, answer: Connection) -> None:
    from pdrbench.gym import check_localizer
    from pdrbench.registry import load_localizer

    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    try:
        answer.send(check_localizer(_timed(load_localizer(name))))
    except KeyboardInterrupt:
        os._exit(128 + signal.SIGINT)


def _timed(make: Callable[[], Any]) -> Callable[[], Any]:
    def made() -> Any:
        localizer = make()
        return _Timed(localizer) if isinstance(localizer, Localizer) else localizer

    return made


class _Timed:
    """A localizer whose process is ended by an alarm where it does not answer in time."""

    def __init__(self, inner: Localizer) -> None:
        self._inner = inner
        if hasattr(inner, "revise"):
            self.revise = self._revise

    def __getattr__(self, name: str) -> Any:
        return getattr(self._inner, name)

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        signal.setitimer(signal.ITIMER_REAL, RESET_DEADLINE_S)
        try:
            self._inner.reset(briefing, rng)
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0)

    def step(self, observation: Observation) -> Estimate:
        signal.setitimer(signal.ITIMER_REAL, STEP_DEADLINE_S)
        try:
            return self._inner.step(observation)
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0)

    def _revise(self) -> object:
        signal.setitimer(signal.ITIMER_REAL, RESET_DEADLINE_S)
        try:
            return self._inner.revise()  # type: ignore[attr-defined]
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0)


def _why_ended(exit_code: int | None) -> str:
    if exit_code == -signal.SIGALRM:
        return f"a step took longer than {STEP_DEADLINE_S:g} s, or reset or revise longer than {RESET_DEADLINE_S:g} s"
    if exit_code is not None and exit_code < 0:
        return f"its process was ended by {signal.Signals(-exit_code).name}: compiled code crashed, or memory ran out"
    return f"it ended its process with exit code {exit_code}; raise an exception instead"
