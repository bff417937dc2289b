"""Processes that do the jobs: joblib's, warm between runs, or fresh ones."""

from __future__ import annotations

import atexit
import functools
import itertools
import re
import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Final, ParamSpec, TypeVar

import joblib
from joblib.executor import get_memmapping_executor
from joblib.externals.loky import ProcessPoolExecutor, as_completed
from joblib.externals.loky.process_executor import TerminatedWorkerError
from joblib.parallel import get_active_backend

from pdrbench.arithmetic import THREADS
from pdrbench.evaluation.jobs import Job, JobContext, Outcome, run_jobs, run_jobs_on_cluster

__all__ = ["TerminatedWorkerError", "discard", "in_fresh_process", "in_order", "is_foreign", "spread"]

MAX_BATCH: Final = 8  # groups between two signs of progress
BATCHES_PER_WORKER: Final = 3  # what is left is cut into so many, so that all processes end together
IDLE_S: Final = 300  # joblib's own default for its workers
Group = Sequence[Job]
Given = ParamSpec("Given")
Returned = TypeVar("Returned")


def is_foreign() -> bool:
    """True where the user chose another joblib backend, such as Dask, by `joblib.parallel_config`."""
    backend, _ = get_active_backend()
    return type(backend).__name__ != "LokyBackend"


def spread_on_cluster(groups: Sequence[Group], context: JobContext) -> Iterator[Outcome]:
    """Outcomes as they come from the joblib backend that the user chose."""
    parallel = joblib.Parallel(return_as="generator_unordered")
    outcomes: Any = parallel(joblib.delayed(run_jobs_on_cluster)(group, context) for group in groups)
    try:
        yield from itertools.chain.from_iterable(outcomes)
    finally:
        outcomes.close()


def spread(groups: Sequence[Group], context: JobContext, num_workers: int, *, is_warm: bool) -> Iterator[Outcome]:
    """Outcomes as they come, in any order.

    Joblib itself would compute in this process where there is one worker, and a plug-in could take it down.

    Args:
        groups: What goes to one process together.
        context: Of the run.
        num_workers: Processes.
        is_warm: True for the processes that later runs use again, False for fresh ones.

    Raises:
        TerminatedWorkerError: A process died; the others have been ended too.
    """
    if not groups:
        return
    executor = (
        _warm_executor(num_workers) if is_warm else ProcessPoolExecutor(min(num_workers, len(groups)), env=_variables())
    )
    batches = _batches(groups, num_workers) if is_warm and num_workers > 1 else groups
    is_done = False
    try:
        for future in as_completed([executor.submit(run_jobs, batch, context) for batch in batches]):
            yield from future.result()
        is_done = True
    finally:
        if not (is_warm and is_done):
            executor.shutdown(wait=True, kill_workers=True)


def _batches(groups: Sequence[Group], num_workers: int) -> Iterator[Group]:
    """Groups put together, fewer and fewer: each task has its cost, and large ones end unevenly."""
    begun = 0
    while begun < len(groups):
        size = min(MAX_BATCH, max(1, (len(groups) - begun) // (BATCHES_PER_WORKER * num_workers)))
        yield tuple(itertools.chain.from_iterable(groups[begun : begun + size]))
        begun += size


def _warm_executor(num_workers: int) -> Any:
    """Joblib's own pool: two kinds of reused loky pools in one program displace each other."""
    return get_memmapping_executor(num_workers, timeout=IDLE_S, env=_variables())


def in_order(call: Callable[..., Returned], arguments: Sequence[tuple[Any, ...]], num_workers: int) -> list[Returned]:
    """What a function returns for each tuple of arguments, by the warm processes."""
    return list(_warm_executor(num_workers).map(call, *zip(*arguments, strict=True)))


def in_fresh_process(
    call: Callable[Given, Returned], *arguments: Given.args, **options: Given.kwargs
) -> Returned | str:
    """What a function returns in a process of its own; how that process ended, as in "SIGSEGV(-11)", where it died."""
    executor = ProcessPoolExecutor(max_workers=1, env=_variables())
    try:
        returned: Returned = executor.submit(call, *arguments, **options).result()
        return returned
    except TerminatedWorkerError as error:
        codes = re.search(r"exit codes of the workers are \{(.*)\}", str(error))
        return codes.group(1) if codes else "unknown exit code"
    finally:
        executor.shutdown(wait=True, kill_workers=True)


@functools.cache
def _variables() -> dict[str, str]:
    """Of workers; their temporary files go with this process, since launchers of a killed worker leave theirs."""
    folder = tempfile.mkdtemp(prefix="pdrbench-workers-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return THREADS | {"TMPDIR": folder}


def discard() -> None:
    """Ends the warm processes; the next run starts new ones."""
    _warm_executor(1).shutdown(wait=True, kill_workers=True)
