"""A walk with the localizer in a process of its own."""

from __future__ import annotations

import contextlib
import dataclasses
from typing import IO, Any, Final, cast

from pdrbench.episode import Episode, play
from pdrbench.errors import PdrbenchError, UnsuitableError
from pdrbench.evaluation import store
from pdrbench.evaluation.jobs import Finished, JobContext
from pdrbench.evaluation.randomness import generator
from pdrbench.evaluation.walk_job import HIDDEN_SPLITS, WalkJob, crashed_result, load_walk, provenance_of, refused
from pdrbench.process.child_process import BEGUN, LaunchError
from pdrbench.process.launch import find_launcher
from pdrbench.process.localizer_process import LocalizerProcess, Terms
from pdrbench.result import FAILED, UNSUITABLE, Result
from pdrbench.task import Task

REHEARSED: Final = ("val", "train")  # splits whose walks are public and not scored here
MAX_LAUNCHES: Final = 3  # a walk over which the launcher is killed is given up after this many tries


def compute_in_child(job: WalkJob, context: JobContext, note: IO[bytes], memory: dict[str, Any]) -> Finished:
    """The work of a job with the localizer in a process of its own."""
    result = refused(job, memory) or play_in_child(job, memory, note)
    return result.status, store.encode(result)


def play_in_child(job: WalkJob, memory: dict[str, Any], note: IO[bytes]) -> Result:
    """The walk of a job.

    It is played once more where no process could be had, but never once an observation was handed out.
    A walk that is played twice shows its future: the first pass leaves notes for the second. Whatever ended the process
    of a localizer, the answers given until then are its result.
    """
    for num_tries in range(1, MAX_LAUNCHES + 1):
        try:
            result = _play_once(job, load_walk(job, memory), note)
        except LaunchError as error:
            if num_tries == MAX_LAUNCHES:
                return crashed_result(job, f"{error} (after {num_tries} tries)")
            continue
        return dataclasses.replace(result, provenance={**result.provenance, "tries": num_tries})
    raise AssertionError


def _rehearse(job: WalkJob, task: Task) -> None:
    """Plays a public walk that is not scored, where the launcher wants it: what a localizer compiles then is kept.

    Nothing of the walks that are scored is known to it, and what it does is nobody's result.
    """
    terms = Terms(cast(Any, job.isolation), job.budget, task.period_s, 1, is_rehearsal=True)
    public = [walk for split in REHEARSED for walk in task.walks.get(split, ())]
    if not public or not find_launcher(job.isolation).wants_rehearsal(terms.order(job.localizer, job.target)):
        return
    episode = Episode(task.load(public[0]), task)
    localizer = _localizer(job, episode, dataclasses.replace(terms, num_steps=len(episode)))
    with contextlib.suppress(PdrbenchError):
        localizer.start()
        play(localizer, episode, generator(job.seed, task, public[0], ""), name=job.localizer, seed=job.seed)
    localizer.close()


def _localizer(job: WalkJob, episode: Episode, terms: Terms) -> LocalizerProcess:
    hides = job.split in HIDDEN_SPLITS
    reference = None if hides else episode.recording.reference
    return LocalizerProcess(job.localizer, job.target, parameters=job.parameters, terms=terms, reference=reference)


def _play_once(job: WalkJob, episode: Episode, note: IO[bytes]) -> Result:
    """The walk in a child process; raises `LaunchError` where none of it has been shown to the localizer."""
    _rehearse(job, episode.task)
    localizer = _localizer(
        job, episode, Terms(cast(Any, job.isolation), job.budget, episode.task.period_s, len(episode))
    )
    status, failure = FAILED, ""
    try:
        localizer.start()
        note.write(BEGUN.encode())
        rng = generator(job.seed, episode.task, job.walk, job.nonce)
        result = play(localizer, episode, rng, name=job.localizer, seed=job.seed)
        localizer.finish()
    except LaunchError as error:
        if not localizer.has_begun:
            raise
        result, failure = None, f"{error}; {BEGUN}"
    except UnsuitableError as error:
        result, status, failure = None, UNSUITABLE, str(error)
    except PdrbenchError as error:
        result, failure = None, localizer.failure or str(error)
    finally:
        facts = localizer.close()
    if result is None:
        result = episode.result(localizer=job.localizer, seed=job.seed, status=status, failure=failure)
    elif result.status == FAILED:
        result = dataclasses.replace(result, failure=localizer.failure or result.failure)
    missed = {} if result.status != FAILED else {"missed": len(episode) - episode.num_answered}
    return dataclasses.replace(result, provenance=provenance_of(job) | facts | missed)
