"""One job of a run, and what a process does with the jobs that it is given."""

from __future__ import annotations

import abc
import dataclasses
import functools
import gc
import os
import signal
import sys
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, ClassVar, Literal

from pdrbench.errors import PdrbenchError, UnknownNameError
from pdrbench.evaluation.locks import result_locks
from pdrbench.evaluation.store import write_whole
from pdrbench.process.child_main import end_with
from pdrbench.registry import PluginError

Finished = tuple[str, bytes | None]  # status, and the content of the result file, None where there is none


@dataclass(frozen=True, slots=True, kw_only=True)
class Job(abc.ABC):
    """One thing to compute, as names only: a localizer on a walk, or an experiment, with one seed."""

    name: str  # file name of the result, which holds the beginning of the key
    key: str  # sha256 of everything that determines the result
    seed: int
    group: Hashable  # neighbours of one group share what they load, and go to one process
    family: str  # jobs of a family that killed a process twice run in processes of their own
    max_deaths: int  # processes that may die over it before it is given up
    sources: Mapping[str, str]  # versions and digests by what they are of; what runs must agree with them
    is_alone: bool = False  # true where no other job of the run may go on beside it
    in_order: ClassVar[bool] = False  # true where they begin as planned, since neighbours share what they load

    @property
    def label(self) -> str:
        """What progress calls it."""
        return self.family

    @abc.abstractmethod
    def present_sources(self) -> Mapping[str, str]:
        """What `sources` is at present, for this process and on this machine."""

    @abc.abstractmethod
    def decode(self, content: bytes, path: Path) -> Any:
        """What a result file holds; raises `ResultError` where it is torn."""

    @abc.abstractmethod
    def give_up(self, context: JobContext, how: str) -> Finished:
        """The result where the process died."""


def check_counts(**counts: object) -> None:
    """Raises `PdrbenchError` where a count is neither None nor a whole number, at least 1."""
    for name, count in counts.items():
        if count is not None and (not isinstance(count, int) or count < 1):
            raise PdrbenchError(f"{name} is a whole number, at least 1; got {count!r}")


@dataclass(frozen=True, slots=True)
class JobContext:
    """What all jobs of a run share."""

    folder: Path  # where results go, the locks on them, and a note of each process on its present job
    run: str  # id of the run
    owner: int  # process that started the run; 0 where jobs are done in that process itself
    # Does a job: given the job, the context, the note that outlives the process, and a memory that the jobs of one call
    # share
    compute: Callable[[Any, JobContext, IO[bytes], dict[str, Any]], Finished]
    keeps: bool = True  # true where results are stored in `folder`; False where they are returned
    # What a process inherits and cannot learn later; a process of another world is not used again
    world: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of a job."""

    name: str  # of its job
    # "done"; "busy": a living process of another run computes it; "stale": this process, or the job, is older than the
    # sources
    state: Literal["done", "busy", "stale"]
    status: str = ""  # status of the result where this process computed it
    content: bytes = b""  # the result as in a file, where it is not stored


def run_jobs(jobs: Sequence[Job], context: JobContext) -> list[Outcome]:
    """Computes and stores jobs, neighbours of which share what they load; never raises for what a plug-in does."""
    if context.owner:
        settle(context.owner)
    memory: dict[str, Any] = {}
    outcomes = []
    for job in jobs:
        if context.owner and os.getppid() != context.owner:
            break  # the owner is dead: no process waits for the rest
        is_stale = context.owner and not is_current(job, context)
        outcomes.append(Outcome(job.name, "stale") if is_stale else _run(job, context, memory))
    if context.owner:
        _freeze_loaded()
    return outcomes


def run_jobs_on_cluster(jobs: Sequence[Job], context: JobContext) -> list[Outcome]:
    """The same on a machine of a cluster, whose tasks run in threads: localizers have processes of their own anyway."""
    there = dataclasses.replace(context, owner=0, world=())
    current = [job for job in jobs if is_current(job, there)]
    stale = [Outcome(job.name, "stale") for job in jobs if job not in current]
    return [*stale, *run_jobs(current, there)]


def finish(job: Job, context: JobContext, finished: Finished) -> Outcome:
    """Stores what came of a job where results are kept."""
    status, content = finished
    if context.keeps and content is not None:
        write_whole(context.folder / job.name, content)
    return Outcome(job.name, "done", status, b"" if context.keeps or content is None else content)


def is_current(job: Job, context: JobContext) -> bool:
    """True where what this process would run is what the job asks for."""
    if _memory().setdefault("world", context.world) != context.world:
        return False
    try:
        return job.present_sources() == job.sources
    except (KeyError, PluginError, UnknownNameError):
        return False


@functools.cache
def settle(owner: int) -> None:
    """Prepares a worker process for plug-ins: interrupts go to the owner only, prints go to standard error.

    A joblib worker whose owner was killed would wait for more work for minutes; ours ends.
    """
    end_with(owner)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    sys.stdout.flush()
    os.dup2(2, 1)


@functools.cache
def _freeze_loaded() -> None:
    """Takes what the first jobs have loaded out of garbage collection.

    joblib's workers collect everything once a second, which took 25 ms each time with numpy and an environment loaded.
    """
    gc.collect()
    gc.freeze()


@functools.cache
def _memory() -> dict[str, tuple[str, ...]]:
    """The world of the first job that this process was given."""
    return {}


def _run(job: Job, context: JobContext, memory: dict[str, Any]) -> Outcome:
    path = context.folder / job.name
    if context.keeps and path.exists():
        return Outcome(job.name, "done")
    with result_locks(context.folder, context.run).hold(job.name) as note:
        if note is None:
            return Outcome(job.name, "busy")
        if context.keeps and path.exists():
            return Outcome(job.name, "done")  # stored by another run between the look and the lock
        return finish(job, context, context.compute(job, context, note, memory))
