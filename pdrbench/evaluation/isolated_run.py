"""A walk with the localizer in a process of its own."""

from __future__ import annotations

import dataclasses
from typing import IO, Any, Final, cast

from pdrbench.episode import Episode, play
from pdrbench.errors import PdrbenchError, UnsuitableError
from pdrbench.evaluation import store
from pdrbench.evaluation.jobs import Finished, JobContext
from pdrbench.evaluation.walk_job import (
    HIDDEN_SPLITS,
    WalkJob,
    crashed_result,
    generator,
    load_walk,
    provenance_of,
    refused,
)
from pdrbench.isolation.child_process import IsolationError
from pdrbench.isolation.isolated import IsolatedLocalizer, Terms
from pdrbench.result import FAILED, UNSUITABLE, Result

MAX_LAUNCHES: Final = 3  # a walk over which the launcher is killed is given up after this many tries
MAX_KILLS: Final = 2  # so is one over which a user, or the system short of memory, killed the localizer


def compute_isolated(job: WalkJob, context: JobContext, note: IO[bytes], memory: dict[str, Any]) -> Finished:
    """The work of a job with the localizer in a process of its own."""
    result = refused(job, memory) or play_isolated(job, memory)
    return result.status, store.encode(result)


def play_isolated(job: WalkJob, memory: dict[str, Any]) -> Result:
    """The walk of a job; once more where the localizer's process ended through no fault of its own."""
    num_launches = num_kills = 0
    while True:
        try:
            result, was_killed = _play_once(job, load_walk(job, memory))
        except IsolationError as error:
            num_launches += 1
            if num_launches == MAX_LAUNCHES:
                return crashed_result(job, f"{error} (after {num_launches} tries)")
            continue
        num_kills += was_killed
        if not was_killed or num_kills == MAX_KILLS:
            return result


def _play_once(job: WalkJob, episode: Episode) -> tuple[Result, bool]:
    """The walk in a child process, and whether another process killed that."""
    terms = Terms(cast(Any, job.isolation), job.budget, episode.task.period_s, len(episode))
    localizer = IsolatedLocalizer(
        job.localizer,
        job.target,
        parameters=job.parameters,
        terms=terms,
        reference=None if job.split in HIDDEN_SPLITS else episode.recording.reference,
    )
    status, failure = FAILED, ""
    try:
        localizer.start()
        rng = generator(job.seed, episode.task, job.walk)
        result = play(localizer, episode, rng, name=job.localizer, seed=job.seed)
        localizer.finish()
    except IsolationError:
        raise
    except UnsuitableError as error:
        result, status, failure = None, UNSUITABLE, str(error)
    except PdrbenchError as error:
        result, failure = None, localizer.failure or str(error)
    finally:
        facts = localizer.close()
    if localizer.uncached_packages:
        from pdrbench.isolation.numba_cache import compile_package  # takes half a second to import

        for package in localizer.uncached_packages:
            compile_package(package)  # for the walks to come
    if result is None:
        result = episode.result(localizer=job.localizer, seed=job.seed, status=status, failure=failure)
    elif result.status == FAILED:
        result = dataclasses.replace(result, failure=localizer.failure or result.failure)
    missed = {} if result.status != FAILED else {"missed": len(episode) - episode.num_answered}
    return dataclasses.replace(result, provenance=provenance_of(job) | facts | missed), localizer.was_killed
