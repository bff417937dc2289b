"""Later rows change no earlier estimate: every registered localizer, byte for byte, on every kind of future."""

from __future__ import annotations

import dataclasses
import functools
import gc
from collections.abc import Callable, Mapping

import numpy as np
import pytest

from pdrbench.episode import CLOCK_SLACK_S
from pdrbench.errors import PdrbenchError, UnsuitableError
from pdrbench.gym.checking import SEED, Online, by_episode, only
from pdrbench.gym.localizer_checks import begin_of
from pdrbench.localizer import Briefing, Estimate, Localizer, Observation
from pdrbench.recording import Recording, SensorStream
from pdrbench.registry import environments, localizers, make_localizer, make_task
from pdrbench.result import COMPLETE
from pdrbench.task import SPLITS, Task

SHORT_S, LONG_S = 18.0, 40.0  # of the beginning that is played
UNTIL_S = (13.3, 28.0)  # streams agree up to here: between two observations, and on one
INERTIAL = ("accel", "gyro", "mag", "stride")  # whose values may become any others; ids of transmitters may not
NEEDS_TRUTH = "tell"

Future = Callable[[SensorStream, np.ndarray, np.random.Generator], np.ndarray]


def shuffled(stream: SensorStream, later: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Later rows permuted, and scaled where they are measurements of motion."""
    rows = stream.rows.copy()
    rows[later, 1:] = rng.permutation(rows[later, 1:]) * (-1.7 if stream.spec.name in INERTIAL else 1.0)
    return rows.clip(stream.spec.low, stream.spec.high)


def ended(stream: SensorStream, later: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """No later rows."""
    return stream.rows[~later]


def thinned(stream: SensorStream, later: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Every third of the later rows is lost."""
    return stream.rows[~later | (np.arange(len(later)) % 3 > 0)]


FUTURES: dict[str, Future] = {"shuffled": shuffled, "ended": ended, "thinned": thinned}


def with_future(recording: Recording, until_s: float, future: Future) -> Recording:
    rng = np.random.default_rng(SEED)
    streams = {
        name: SensorStream(stream.spec, future(stream, stream.t_s > until_s + CLOCK_SLACK_S, rng))
        for name, stream in recording.streams.items()
    }
    return dataclasses.replace(recording, streams=streams)


@functools.cache
def beginning(env: str, seconds: float) -> tuple[Task, Recording]:
    """The first walk of an environment, cut; raises `PdrbenchError` where its data is missing."""
    task = make_task(env)
    split = next(split for split in SPLITS if task.walks.get(split))
    recording = begin_of(task.load(task.split(split)[0]), seconds)
    return only(task, recording), recording


def made(localizer: str, recording: Recording) -> Localizer:
    found = make_localizer(localizer)
    if hasattr(found, NEEDS_TRUTH):
        found.tell(recording.reference)
    return Online(found)


def suits(localizer: str, env: str) -> bool:
    try:
        task, recording = beginning(env, SHORT_S)
        made(localizer, recording).reset(task.brief(recording), np.random.default_rng(SEED))
    except UnsuitableError:
        return False
    return True


def is_available(env: str) -> bool:
    try:
        beginning(env, SHORT_S)
    except PdrbenchError:
        return False
    return True


def answers_until(make: Callable[[], Localizer], task: Task, recording: Recording, until_s: float) -> bytes:
    """The answers up to a time, which a localizer has to reach; a future that cannot be may make it fail later."""
    result = by_episode(make(), task, recording)
    one = result.estimates
    assert result.status == COMPLETE or (len(one) and one.t_s[-1] + task.period_s > until_s), result.failure
    count = int(np.searchsorted(one.t_s, until_s, side="right"))
    assert count > 5, "a walk of some seconds"
    parts = (one.t_s, one.xy_m, one.level, one.heading_rad, one.sigma_m, one.converged)
    return b"".join(np.ascontiguousarray(part[:count]).tobytes() for part in parts)


def check(make: Callable[[], Localizer], task: Task, recording: Recording, futures: Mapping[str, Future]) -> None:
    for until_s in UNTIL_S:
        if until_s < recording.end_s - 1.0:
            as_it_was = answers_until(make, task, recording, until_s)
            for name, future in futures.items():
                other = with_future(recording, until_s, future)
                assert answers_until(make, task, other, until_s) == as_it_was, f"{name} after {until_s} s on {task.id}"


def embedded() -> list[str]:
    """Environments without recorded data; those without a given start need many particles and come last."""
    names = [env for env in environments() if make_task(env).dataset is None]
    return sorted(names, key=lambda env: (make_task(env).start == "unknown", env))


@pytest.mark.long(seconds=3)  # the default run has the same rule with one other future, see tests/test_conformance.py
@pytest.mark.parametrize("localizer", sorted(localizers()))
def test_no_registered_localizer_looks_ahead(localizer: str) -> None:
    env = next((env for env in embedded() if suits(localizer, env)), None)
    if env is None:
        pytest.skip(f"{localizer} suits no environment without recorded data; the slow test tries the others")
    task, recording = beginning(env, SHORT_S)
    check(lambda: made(localizer, recording), task, recording, {"shuffled": shuffled})


@pytest.mark.long
@pytest.mark.timeout(900)  # all localizers, each several times
@pytest.mark.parametrize("env", sorted(environments()))
def test_no_registered_localizer_looks_ahead_in_any_environment(env: str) -> None:
    if not is_available(env):
        pytest.skip(f"the recorded data of {env} is missing")
    task, recording = beginning(env, LONG_S)
    for localizer in sorted(localizers()):
        if suits(localizer, env):
            check(lambda name=localizer: made(name, recording), task, recording, FUTURES)  # type: ignore[misc]


class Peeks:
    """Finds the rows that are still to come in the memory of the process."""

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        ahead = [thing.streams["stride"].rows for thing in gc.get_objects() if is_of_strides(thing)]
        self.x_m = sum(float(rows.sum()) for rows in ahead)

    def step(self, observation: Observation) -> Estimate:
        return Estimate(np.array([self.x_m, 0.0]), 0)


def is_of_strides(thing: object) -> bool:
    return type(thing) is Recording and "stride" in thing.streams


def test_a_localizer_that_looks_ahead_is_detected() -> None:
    task, recording = beginning("OfficeStride-v2", SHORT_S)
    with pytest.raises(AssertionError, match="shuffled after 13"):
        check(Peeks, task, recording, FUTURES)
