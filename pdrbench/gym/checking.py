"""What both kinds of checks are made of."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import math
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from pdrbench.episode import Episode, play
from pdrbench.errors import PdrbenchError
from pdrbench.gym.env import LocalizationEnv, drive
from pdrbench.gym.spaces import CLAIM_BOUNDS
from pdrbench.localizer import Localizer
from pdrbench.recording import Recording
from pdrbench.result import Result
from pdrbench.task import SURVEYS, Task
from pdrbench.trajectory import ESTIMATE_COLUMNS

CLAIMS: Final = tuple(CLAIM_BOUNDS)
SEED: Final = 20080921  # of every generator handed to a localizer under test


@dataclass(frozen=True, slots=True)
class Check:
    """The outcome of one check.

    Attributes:
        name: The rule.
        passed: Whether it holds.
        why: The likely cause where it does not, otherwise a remark or nothing.
    """

    name: str
    passed: bool
    why: str = ""


class RefutedError(Exception):
    """A rule does not hold; says why."""


def require(condition: object, why: str) -> None:
    """Raises `RefutedError` where a condition does not hold."""
    if not condition:
        raise RefutedError(why)


def run_check(name: str, look: Callable[[], str | None]) -> Check:
    """Runs one check; what it returns is a remark."""
    try:
        return Check(name, True, look() or "")
    except (RefutedError, PdrbenchError, AssertionError) as error:
        return Check(name, False, str(error))
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # noqa: BLE001  the plug-in under test may raise anything: that is what is reported
        frame = traceback.extract_tb(error.__traceback__)[-1]
        return Check(name, False, f"{type(error).__name__}: {error} ({frame.filename}, line {frame.lineno})")


def only(task: Task, recording: Recording) -> Task:
    """The task with this one walk, whose briefing is made once."""
    made = {kind: functools.cache(functools.partial(getattr(task, kind), recording)) for kind in SURVEYS}
    surveys: dict[str, Any] = {kind: lambda _, survey=survey: survey() for kind, survey in made.items()}
    return dataclasses.replace(
        task, walks={task.split_of(recording.id): (recording.id,)}, load=lambda walk: recording, **surveys
    )


def by_episode(localizer: Localizer, task: Task, recording: Recording) -> Result:
    """One walk played as `evaluate` plays it."""
    rng = np.random.default_rng(SEED)
    return play(localizer, Episode(recording, task), rng, name="check", seed=SEED, guard=_without_exit)


@contextlib.contextmanager
def _without_exit(call: str) -> Iterator[None]:
    """Makes an exit out of a localizer, such as `sys.exit`, an error like any other."""
    try:
        yield
    except (Exception, KeyboardInterrupt):
        raise
    except BaseException as error:
        raise RefutedError(f"{call} raised {type(error).__name__}: {error}; raise an Exception") from error


def by_env(localizer: Localizer, task: Task, recording: Recording) -> Result:
    """The only walk of a task by `env.reset` and `env.step`."""
    env = LocalizationEnv(task, task.split_of(recording.id), claims=CLAIMS)
    return drive(localizer, env, np.random.default_rng(SEED))


def require_equal(first: Result, second: Result, what: str, until_s: float = math.inf) -> None:
    """Requires bit-identical estimates up to a time, naming the first that differ."""
    one, two = first.estimates, second.estimates
    count = int(np.searchsorted(one.t_s, until_s, side="right"))
    if until_s == math.inf:
        require(len(one) == len(two), f"{what}: {len(one)} estimates against {len(two)}; {second.failure}")
    require(len(two) >= count, f"{what}: ended after {len(two)} estimates; {second.failure}")
    for name, a, b in zip(("t_s", *ESTIMATE_COLUMNS), (one.t_s, *one.columns), (two.t_s, *two.columns), strict=True):
        a, b = a[:count], b[:count]
        differs = (a != b) & ~(np.isnan(a) & np.isnan(b))
        if differs.any():
            row = int(np.argmax(differs))
            raise RefutedError(f"{what}: {name} at {one.t_s[row]:.1f} s is {a[row]} and {b[row]}")
    if until_s == math.inf and first.revised is not None and second.revised is not None:
        require_equal(first.offline(), second.offline(), f"{what} (when the walk is over)")
