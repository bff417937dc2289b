"""Processes that do the work: joblib's, warm between sweeps, and fresh ones for what may kill its process."""

from __future__ import annotations

import contextlib
import itertools
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, Final, ParamSpec, TypeVar

import joblib
from joblib.executor import get_memmapping_executor
from joblib.externals.loky import ProcessPoolExecutor, as_completed
from joblib.externals.loky.process_executor import TerminatedWorkerError
from joblib.parallel import get_active_backend

from pdrbench.evaluation.items import Item, Outcome, Setting
from pdrbench.evaluation.work import run_group
from pdrbench.isolation.launching import THREADS

__all__ = ["TerminatedWorkerError", "discard", "in_fresh_process", "is_foreign", "spread"]

LARGEST_BATCH: Final = 8  # walks between two signs of progress
BATCHES_AT_HAND: Final = 3  # per process: what is left is cut so that all end together
IDLE_S: Final = 300  # joblib's own default for its workers
Run = Callable[[Sequence[Item], Setting], list[Outcome]]
Given = ParamSpec("Given")
Answer = TypeVar("Answer")


def is_foreign() -> bool:
    """True where the user chose another joblib backend, such as Dask, by `joblib.parallel_config`."""
    backend, _ = get_active_backend()
    return type(backend).__name__ != "LokyBackend"


def spread(groups: Sequence[Sequence[Item]], setting: Setting, jobs: int, run: Run) -> Iterator[Outcome]:
    """Outcomes as they come, in any order.

    Args:
        groups: What shares a recording, together.
        setting: Of the sweep.
        jobs: Processes.
        run: What a task of a foreign backend does with a group; ours call `run_group`.

    Raises:
        TerminatedWorkerError: A process died; the others have been ended too.
    """
    if is_foreign():
        yield from _many(joblib.Parallel(return_as="generator_unordered"), groups, setting, run)
    elif jobs == 1:
        yield from _one(groups, setting)
    else:
        with joblib.parallel_config(backend="loky", inner_max_num_threads=1):
            parallel = joblib.Parallel(n_jobs=jobs, return_as="generator_unordered", batch_size=1)
        yield from _many(parallel, _batches(groups, jobs), setting, run_group)


def _batches(groups: Sequence[Sequence[Item]], jobs: int) -> Iterator[Sequence[Item]]:
    """Groups put together, fewer and fewer: a task of joblib costs 1.3 ms, and large ones end unevenly."""
    begun = 0
    while begun < len(groups):
        size = min(LARGEST_BATCH, max(1, (len(groups) - begun) // (BATCHES_AT_HAND * jobs)))
        yield tuple(itertools.chain.from_iterable(groups[begun : begun + size]))
        begun += size


def _many(parallel: joblib.Parallel, groups: Iterable[Sequence[Item]], setting: Setting, run: Run) -> Iterator[Outcome]:
    """Outcomes of joblib's tasks; ends the processes where nobody waits for the rest."""
    outcomes: Any = parallel(joblib.delayed(run)(group, setting) for group in groups)
    with contextlib.closing(outcomes):
        for of_group in outcomes:
            yield from of_group


def _one(groups: Sequence[Sequence[Item]], setting: Setting) -> Iterator[Outcome]:
    """One process: joblib itself would compute in ours, which a localizer could take down."""
    executor = _warm_executor()
    try:
        for future in as_completed([executor.submit(run_group, group, setting) for group in groups]):
            yield from future.result()
    except BaseException:
        executor.shutdown(wait=True, kill_workers=True)
        raise


def _warm_executor() -> Any:
    """Joblib's own pool with one process: two kinds of loky pools in one program displace each other."""
    return get_memmapping_executor(1, timeout=IDLE_S, env=THREADS)


def in_fresh_process(call: Callable[Given, Answer], *arguments: Given.args, **options: Given.kwargs) -> Answer | str:
    """What a function answers in a process of its own; how that process ended, as in "SIGSEGV(-11)", where it died."""
    executor = ProcessPoolExecutor(max_workers=1, env=THREADS)
    try:
        answer: Answer = executor.submit(call, *arguments, **options).result()
        return answer
    except TerminatedWorkerError as error:
        codes = re.search(r"exit codes of the workers are \{(.*)\}", str(error))
        return codes.group(1) if codes else "unknown exit code"
    finally:
        executor.shutdown(wait=True, kill_workers=True)


def discard() -> None:
    """Ends the warm processes; the next sweep starts new ones."""
    _warm_executor().shutdown(wait=True, kill_workers=True)
