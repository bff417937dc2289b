"""Gets every job of a run done, whatever becomes of the processes: the engine of `evaluate` and `reproduce`."""

from __future__ import annotations

import itertools
import time
import warnings
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, Final

import numpy as np

from pdrbench.errors import ResultError
from pdrbench.evaluation import pool
from pdrbench.evaluation.durations import expected_s, learn
from pdrbench.evaluation.jobs import Job, JobContext, Outcome, finish, run_jobs
from pdrbench.evaluation.locks import cleanup, crashed_workers, result_locks
from pdrbench.evaluation.progress import Advance, reporting
from pdrbench.files import sync
from pdrbench.process.child_process import BEGUN
from pdrbench.result import COMPLETE

WAIT_S: Final = 0.2  # between looks at what another run on the same folder computes
MAX_IDLE_DEATHS: Final = 3  # processes that end before they begin any job are given up after this many tries
CHANGED_THERE: Final = (
    "a worker of the cluster has other sources of an environment or a localizer than this machine; install these there "
    "and restart its workers: what is stored already is kept"
)
CHANGED: Final = "sources changed while it ran; run it again: what is stored already is kept"


def run_all(
    jobs: Sequence[Job], context: JobContext, num_workers: int, *, is_warm: bool, progress: bool, what: str
) -> dict[str, Any]:
    """Computes what is not stored yet; two runs may share a folder.

    Args:
        jobs: In the order in which they begin; walks of localizers begin in one of chance, which no result depends on.
        context: Of the run.
        num_workers: Processes.
        is_warm: As for `pool.spread`; only then the joblib backend that the user chose is honoured.
        progress: Shows on stderr how far it is.
        what: What the jobs are called there.

    Returns:
        What each result holds, by the name of its job; jobs that failed without one are left out.

    Raises:
        ResultError: A full disk, sources that change meanwhile, processes that end before they begin.
    """
    with cleanup(context.folder, context.run):
        found = {job.name: stored for job in jobs if (stored := _read_stored(job, context)) is not None}
        todo = [job for job in jobs if job.name not in found]
        begun_s = time.monotonic()
        with reporting(
            len(jobs), len(found), shown=progress, what=what, expected_s=expected_s(todo, num_workers)
        ) as advance:
            scheduler = Scheduler(todo, context, num_workers, advance, is_warm=is_warm)
            scheduler.run()
        if not pool.is_foreign():
            learn(todo, num_workers, time.monotonic() - begun_s)
        if context.keeps:
            sync(context.folder)
        for job in todo:
            content = scheduler.contents.get(job.name) or _read(job, context)
            if content is not None:
                found[job.name] = job.decode(content, context.folder / job.name)
    return found


def _read(job: Job, context: JobContext) -> bytes | None:
    path = context.folder / job.name
    try:
        return path.read_bytes()
    except FileNotFoundError:
        return None
    except OSError as error:
        raise ResultError(f"cannot read result {path}: {error.strerror or error}") from error


def _read_stored(job: Job, context: JobContext) -> Any:
    """What is stored already; a torn file is removed with a notice, so that its job is done again."""
    try:
        content = _read(job, context)
        return None if content is None else job.decode(content, context.folder / job.name)
    except ResultError as error:
        warnings.warn(f"{error}: removed, it is computed again", stacklevel=4)
        (context.folder / job.name).unlink(missing_ok=True)
        return None


class Scheduler:
    """Runs jobs that have no result yet in a pool of processes, and calls `advance` with the status of each.

    Jobs that may have killed a process run apart from the others, jobs that run alone at the end.

    Attributes:
        contents: Results that are not stored, by name.
    """

    def __init__(
        self, todo: Iterable[Job], context: JobContext, num_workers: int, advance: Advance, *, is_warm: bool
    ) -> None:
        self._todo = {job.name: job for job in todo}
        self._context, self._num_workers, self._advance, self._is_warm = context, num_workers, advance, is_warm
        self._is_foreign = is_warm and pool.is_foreign()
        self._deadly: set[str] = set()  # families that killed a process twice
        self._num_renewed = 0
        self._num_idle_deaths = 0
        self.contents: dict[str, bytes] = {}

    def run(self) -> None:
        """Returns when every job is done."""
        while self._todo:
            num_before = len(self._todo)
            shared = [job for job in self._todo.values() if not job.is_alone]
            free = self._free(shared or list(self._todo.values()))
            self._in_pool([job for job in free if job.family not in self._deadly], self._num_workers if shared else 1)
            for job in free:
                if job.name in self._todo and job.family in self._deadly:
                    self._run_apart(job)
            if len(self._todo) == num_before:
                time.sleep(WAIT_S)

    def _free(self, jobs: Iterable[Job]) -> list[Job]:
        """What no other run computes; what another has computed is done."""
        own = result_locks(self._context.folder, self._context.run)
        free = []
        for job in jobs:
            if self._context.keeps and (self._context.folder / job.name).exists():
                self._note(Outcome(job.name, "done", COMPLETE))
            elif own.is_free(job.name):
                free.append(job)
        return free

    def _in_pool(self, jobs: Sequence[Job], num_workers: int) -> None:
        groups = [tuple(group) for _, group in itertools.groupby(jobs, key=lambda job: job.group)]
        # a localizer that plays before or after another walk must not learn which
        if self._context.owner and not all(job.in_order for job in jobs):
            groups = [groups[place] for place in np.random.default_rng().permutation(len(groups))]
        is_stale = False
        try:
            for outcome in self._outcomes(groups, num_workers):
                is_stale |= outcome.state == "stale"
                self._note(outcome)
        except pool.TerminatedWorkerError as error:
            self._find_culprit(error)
        if is_stale:
            self._renew()

    def _outcomes(self, groups: Sequence[pool.Group], num_workers: int) -> Iterator[Outcome]:
        if not self._context.owner:
            return itertools.chain.from_iterable(run_jobs(group, self._context) for group in groups)
        if self._is_foreign:
            return pool.spread_on_cluster(groups, self._context)
        return pool.spread(groups, self._context, num_workers, is_warm=self._is_warm)

    def _note(self, outcome: Outcome) -> None:
        if outcome.state == "done" and (job := self._todo.pop(outcome.name, None)) is not None:
            if outcome.content:
                self.contents[outcome.name] = outcome.content
            self._advance(outcome.status, job.label)

    def _renew(self) -> None:
        """New processes, since the present ones hold older code; once is enough unless sources change meanwhile."""
        if self._is_foreign:
            raise ResultError(CHANGED_THERE)
        if self._num_renewed or not self._is_warm:
            raise ResultError(CHANGED)
        self._num_renewed += 1
        pool.discard()

    def _find_culprit(self, error: pool.TerminatedWorkerError) -> None:
        """Finds the jobs that were being done when a process died, and runs each in a process of its own."""
        names = crashed_workers(self._context.folder, self._context.run)
        suspects = [self._todo[name] for name in names if name in self._todo]
        self._num_idle_deaths = 0 if suspects else self._num_idle_deaths + 1
        if self._num_idle_deaths >= MAX_IDLE_DEATHS:
            raise ResultError(f"worker processes end before they begin a job: {error}") from error
        for job in suspects:
            if BEGUN in names[job.name]:  # played again, it would know its future
                self._give_up(job, f"{names[job.name]}\n{error}")
            else:
                self._run_apart(job)

    def _run_apart(self, job: Job) -> None:
        """One job in a fresh process; where too many of those die, its result says so."""
        report = ended = ""
        for _ in range(job.max_deaths - 1):
            outcomes = pool.in_fresh_process(run_jobs, [job], self._context)
            if not isinstance(outcomes, str):
                for outcome in outcomes:
                    if outcome.state == "stale":
                        raise ResultError(CHANGED)
                    self._note(outcome)
                return
            ended = outcomes
            report = crashed_workers(self._context.folder, self._context.run).get(job.name, report)
            if BEGUN in report:
                break
        self._give_up(job, f"{report}\nits process died: {ended}\n".lstrip())

    def _give_up(self, job: Job, how: str) -> None:
        self._deadly.add(job.family)
        with result_locks(self._context.folder, self._context.run).hold(job.name) as note:
            if note is not None:  # otherwise another run tries it now
                self._note(finish(job, self._context, job.give_up(self._context, how)))
