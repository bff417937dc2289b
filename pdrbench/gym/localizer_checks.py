"""Conformance of a localizer: rules that each keeps, and the likely cause where one does not."""

from __future__ import annotations

import dataclasses
import functools
import random  # noqa: TID251  its state is looked at, not used
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from pdrbench.episode import CLOCK_SLACK_S
from pdrbench.errors import PdrbenchError, UnsuitableError
from pdrbench.gym.checking import SEED, Check, RefutedError, by_env, by_episode, only, require, require_equal, run_check
from pdrbench.localizer import Briefing, Localizer, Observation
from pdrbench.process.watched import Watched
from pdrbench.recording import Recording, SensorStream
from pdrbench.registry import environments, make_localizer, make_task
from pdrbench.result import COMPLETE, UNSUITABLE, Result
from pdrbench.task import SPLITS, Task


def check_localizer(
    localizer: str | Callable[[], Localizer],
    task: str | Task | None = None,
    *,
    seconds: float = 60.0,
    make_watched: Callable[[], Any] | None = None,
) -> list[Check]:
    """Tests one localizer on the beginning of one walk.

    A localizer with a method `tell(reference)` is given the truth of that walk before each reset.

    Args:
        localizer: Registered id, `package.module:Class`, `path/to/file.py:Class`, or what makes a new localizer.
        task: Environment to test it on; None: the first registered one that it does not decline, with a known start if
            possible.
        seconds: Length of the beginning.
        make_watched: Makes one with the attributes of `pdrbench.process.watched.Watched`; that where None.
    """

    def make() -> Localizer:
        return make_localizer(localizer) if isinstance(localizer, str) else localizer()

    first = run_check("can be made", lambda: _require_methods(make()))
    if not first.passed:
        return [first]
    trial, chosen = _find_trial(make, make_watched or (lambda: Watched(make)), task, seconds)
    if trial is None:
        return [first, chosen]
    looks: dict[str, Callable[[], str | None]] = {
        "declines with UnsuitableError only": trial.declines,
        "answers every observation": trial.answers,
        "same generator, same answers": trial.repeats,
        "reset forgets the walk before": trial.forgets,
        "global random state is left alone": trial.leaves_global_state,
        "observations are neither changed nor kept": trial.keeps_nothing,
        "what comes later changes nothing before": trial.is_causal,
        "both roads give the same estimates": trial.agrees_with_env,
    }
    return [first, chosen, *(run_check(name, look) for name, look in looks.items())]


@dataclass(frozen=True)
class _Trial:
    """The beginning of one walk, and what makes the localizer that is checked on it; a play serves several checks."""

    make: Callable[[], Localizer]
    make_watched: Callable[[], Any]
    task: Task
    recording: Recording

    def made(self) -> Localizer:
        """A new localizer, which has been given the truth if it takes it."""
        return self.informed(self.make())

    def informed(self, localizer: Localizer) -> Localizer:
        if hasattr(localizer, "tell"):
            localizer.tell(self.recording.reference)
        return localizer

    def play(self, localizer: Localizer | None = None, recording: Recording | None = None) -> Result:
        """One walk, by a new localizer on the recording of the trial unless others are given."""
        player = self.informed(localizer or self.make())
        result = by_episode(player, self.task, recording or self.recording)
        failure = getattr(player, "failure", "")  # of a process: what was said there
        return dataclasses.replace(result, failure=failure) if failure else result

    @functools.cached_property
    def plain(self) -> Result:
        """The walk played by a new instance."""
        return self.play()

    @functools.cached_property
    def twice(self) -> tuple[Result, Result]:
        """The walk played by one more instance, and by the same one again."""
        localizer = self.make()
        return self.play(localizer), self.play(localizer)

    @functools.cached_property
    def watched(self) -> tuple[list[str], list[str], Result]:
        """What an instance that was watched has disturbed and changed, and its walk."""
        saved = random.getstate(), np.random.get_state()  # noqa: NPY002  put back below
        try:
            watched = self.make_watched()
            result = self.play(watched)
            return watched.disturbed(), watched.changed, result
        finally:
            random.setstate(saved[0])
            np.random.set_state(saved[1])  # noqa: NPY002

    def declines(self) -> str:
        bare = Briefing(building=None, sensors={}, period_s=self.task.period_s)
        localizer = self.make()
        try:
            localizer.reset(bare, np.random.default_rng(SEED))
            localizer.step(Observation(now_s=0.0, rows={}))
        except UnsuitableError as error:
            return str(error)
        except Exception as error:
            raise RefutedError(
                f"without sensors, start, map and survey it raises {type(error).__name__}: {error}; "
                f"call briefing.require(...) in reset for what it needs"
            ) from error
        return "needs nothing"

    def answers(self) -> str:
        result = self.plain
        require(result.status == COMPLETE, result.failure)
        counted = ", ".join(f"{count} times {reason}" for reason, count in result.missing.items())
        require(not result.missing, f"{counted}: of {len(result.estimates)} answers these count as missing")
        building = self.recording.building
        if building is not None:
            foreign = sorted(set(result.estimates.level.tolist()) - set(building.levels))
            require(not foreign, f"it answers levels {foreign}; the building has {building.levels}")
        revision = f", revised in {1e3 * result.revise_s:.3f} ms" if result.revised is not None else ""
        return f"{1e3 * float(np.mean(result.step_s)):.3f} ms a step{revision}"

    def repeats(self) -> None:
        what = "a second instance; is there randomness besides the rng of reset?"
        require_equal(self.plain, self.twice[0], what)

    def forgets(self) -> None:
        what = "the second walk of one instance; does reset leave something behind?"
        require_equal(*self.twice, what)

    def leaves_global_state(self) -> None:
        disturbed, _, _ = self.watched
        require(not disturbed, f"the global state of {', '.join(disturbed)} changed; use the rng given to reset")

    def keeps_nothing(self) -> None:
        _, changed, spoiled = self.watched
        require(not changed, f"step changes the rows of {', '.join(changed[:1])}; copy what is changed")
        require_equal(self.plain, spoiled, "arrays of an observation are used after its step; copy what is kept")

    def is_causal(self) -> str:
        """Plays the walk again with another second half."""
        until_s = self.recording.end_s / 2
        streams = {}
        for name, stream in self.recording.streams.items():
            later = stream.t_s > until_s + CLOCK_SLACK_S
            rows = stream.rows.copy()
            rows[later, 1:] = rows[later, 1:][::-1]
            streams[name] = SensorStream(stream.spec, rows)
        other = dataclasses.replace(self.recording, streams=streams)
        what = f"two walks that agree up to {until_s:.1f} s are answered differently before"
        require_equal(self.plain, self.play(recording=other), what, until_s)
        return f"agree up to {until_s:.1f} s"

    def agrees_with_env(self) -> None:
        driven = by_env(self.made(), self.task, self.recording)
        require_equal(self.plain, driven, "env.step differs from Episode")


def _require_methods(made: object) -> None:
    require(isinstance(made, Localizer), f"{type(made).__name__} lacks reset(briefing, rng) or step(observation)")


def _find_trial(
    make: Callable[[], Localizer], make_watched: Callable[[], Any], task: str | Task | None, seconds: float
) -> tuple[_Trial | None, Check]:
    """The beginning of the first walk that a localizer does not decline, embedded environments first."""
    name = "an environment suits it"
    declined = []
    for candidate in _candidates() if task is None else [task]:
        try:
            found = make_task(candidate) if isinstance(candidate, str) else candidate
            split = next(split for split in SPLITS if found.walks.get(split))
            recording = begin_of(found.load(found.split(split)[0]), seconds)
        except PdrbenchError as error:
            declined.append(f"{candidate}: {type(error).__name__}: {str(error).splitlines()[0]}")
            continue
        trial = _Trial(make, make_watched, only(found, recording), recording)
        result = trial.plain
        if result.status != UNSUITABLE:
            return trial, Check(name, True, f"{found.id}, {recording.id}, {len(result.estimates)} observations")
        declined.append(f"{found.id}: {result.failure}")
    return None, Check(name, False, "; ".join(declined) or "no environment is registered")


def _candidates() -> list[str]:
    """Registered environments: those that need no recorded data first, of these the ones with a known start first."""
    order = {}
    for name in environments():
        try:
            task = make_task(name)
            order[name] = (task.dataset is not None, task.start == "unknown")
        except PdrbenchError:
            order[name] = (True, True)
    return sorted(order, key=order.__getitem__)


def begin_of(recording: Recording, seconds: float) -> Recording:
    """The same walk, ended after some seconds."""
    streams = {name: SensorStream(s.spec, s.rows[s.t_s <= seconds]) for name, s in recording.streams.items()}
    reference = recording.reference
    return dataclasses.replace(recording, streams=streams, reference=reference.rows(reference.t_s <= seconds))
