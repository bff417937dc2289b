"""Checks of a localizer in a process of their own, since it may hang, crash or end the process.

The checks look at what a localizer does to the process that it runs in, so they run in that process as well. It may
read files, and write compiled code where the localizer is ours; it has no network, starts no programs and ends no other
process.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import sys
import tempfile
from collections.abc import Iterator, Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import msgspec

from pdrbench.isolation.scratch import empty
from pdrbench.localizer import Briefing, Estimate, Localizer, Observation

if TYPE_CHECKING:
    import numpy as np

    from pdrbench.gym import Check

STEP_DEADLINE_S: Final = 10.0  # the default of `evaluate`
RESET_DEADLINE_S: Final = 600.0
MAX_ANSWER_BYTES: Final = 1 << 20
NAME: Final = "answers in time and leaves its process alone"


def check_isolated(name: str, env: str | None = None) -> list[Check]:
    """`pdrbench.gym.check_localizer`; one failed check where the localizer hangs or takes its process down.

    Args:
        name: As `registry.load_localizer` takes it.
        env: Environment to check it on; the first that suits it where None.
    """
    from pdrbench.evaluation.sources import localizer_target
    from pdrbench.gym import Check
    from pdrbench.isolation.read_permissions import compiled_folders, environment_packages, permissions_of

    is_builtin = permissions_of(name, localizer_target(name)).is_builtin
    compiled = compiled_folders(environment_packages()) if is_builtin else ()  # walks are generated in there as well
    sys.stdout.flush()
    ours, theirs = multiprocessing.Pipe(duplex=False)
    # forked, so that what was registered or imported here is there as well
    scratch = tempfile.mkdtemp(prefix="pdrbench-check-")
    arguments = (name, env, (scratch, *compiled), theirs)
    process = multiprocessing.get_context("fork").Process(target=_check, args=arguments)
    process.start()
    theirs.close()
    try:
        found = ours.recv_bytes(MAX_ANSWER_BYTES)  # never unpickled: a stranger's code could have written it
        checks = msgspec.json.decode(found, type=list[Check])
    except EOFError:
        process.join()
        return [Check(NAME, False, _why_ended(process.exitcode))]
    except (OSError, msgspec.DecodeError) as error:
        return [Check(NAME, False, f"what came from its process is no list of checks: {error}")]
    finally:
        process.kill()  # threads of a localizer may outlive the checks
        process.join()
        empty(scratch)
        Path(scratch).rmdir()
    return checks


def _check(name: str, env: str | None, writable: Sequence[str], answer: Connection) -> None:
    from pdrbench.gym import check_localizer
    from pdrbench.registry import load_localizer

    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    _confine(writable)

    def make() -> Any:
        localizer = load_localizer(name)()
        return _Timed(localizer) if isinstance(localizer, Localizer) else localizer

    try:
        checks = check_localizer(make, env)
        answer.send_bytes(msgspec.json.encode(checks, enc_hook=bool))  # NumPy's True and False
    except KeyboardInterrupt:
        os._exit(128 + signal.SIGINT)


def _confine(writable: Sequence[str]) -> None:
    """Gives up what checks need not; what the system refuses is left.

    Args:
        writable: The scratch folder, and where compiled code is kept if the localizer may write there.
    """
    from pdrbench.isolation import numba_cache
    from pdrbench.isolation.boot import ProtectionRecord
    from pdrbench.isolation.confine import confine
    from pdrbench.isolation.landlock import Ruleset

    tempfile.tempdir, *compiled = writable
    if not compiled:
        numba_cache.disable_writing()
    try:
        ruleset = Ruleset()
    except OSError as error:
        confine(ProtectionRecord(), None, str(error))
        return
    ruleset.read(os.sep)
    for place in (*writable, os.devnull):
        ruleset.write(place)
    confine(ProtectionRecord(), ruleset, "")


class _Timed:
    """A localizer whose process is ended by an alarm where it does not answer in time."""

    def __init__(self, inner: Localizer) -> None:
        self._inner = inner
        if hasattr(inner, "revise"):
            self.revise = self._revise

    def __getattr__(self, name: str) -> Any:
        return getattr(self._inner, name)

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        with _alarm(RESET_DEADLINE_S):
            self._inner.reset(briefing, rng)

    def step(self, observation: Observation) -> Estimate:
        with _alarm(STEP_DEADLINE_S):
            return self._inner.step(observation)

    def _revise(self) -> object:
        with _alarm(RESET_DEADLINE_S):
            return self._inner.revise()  # type: ignore[attr-defined]


@contextlib.contextmanager
def _alarm(seconds: float) -> Iterator[None]:
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)


def _why_ended(exit_code: int | None) -> str:
    if exit_code == -signal.SIGALRM:
        return f"a step took longer than {STEP_DEADLINE_S:g} s, or reset or revise longer than {RESET_DEADLINE_S:g} s"
    if exit_code is not None and exit_code < 0:
        return f"its process was ended by {signal.Signals(-exit_code).name}: compiled code crashed, or memory ran out"
    return f"it ended its process with exit code {exit_code}; raise an exception instead"
