"""`evaluate`: localizers, environments, walks and seeds, whatever becomes of the processes."""

from __future__ import annotations

import contextlib
import os
import sys
import tempfile
import uuid
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, get_args

from pdrbench.errors import PdrbenchError
from pdrbench.evaluation import pool, store
from pdrbench.evaluation.inprocess_run import compute_in_process
from pdrbench.evaluation.jobs import JobContext, check_counts
from pdrbench.evaluation.process_run import compute_in_child
from pdrbench.evaluation.randomness import check_nonce
from pdrbench.evaluation.scheduler import run_all
from pdrbench.evaluation.tables import Results
from pdrbench.evaluation.walk_job import NONE, plan_walks
from pdrbench.process.budget import Budget
from pdrbench.process.launch import Isolation
from pdrbench.registry import canonical_localizer
from pdrbench.task import HELD_OUT

STANDARD: Final = Budget()
SCORES_FOLDER: Final = "scores"  # below the folder of the results


def evaluate(
    localizers: str | Sequence[str] | Mapping[str, Sequence[str]],
    envs: str | Sequence[str],
    *,
    split: str | None = None,
    seeds: int = 1,
    walks: int | Sequence[str] | None = None,
    jobs: int = 1,
    out: Path | str | None = None,
    isolation: Isolation = "process",
    budget: Budget = STANDARD,
    progress: bool = False,
    parameters: Mapping[str, Any] | None = None,
    nonce: str = "",
    secret: str | None = None,
) -> Results:
    """Runs localizers through walks and collects what they answered.

    A localizer that raises, hangs or takes its process down gets a failed result that says how; the rest goes on.
    The estimates depend on the seed, the walk and the nonce, not on `jobs`. With
    `joblib.parallel_config(backend="dask")` the walks go to a cluster; `out` must then be a folder that all its
    machines see.

    Args:
        localizers: Ids, `package.module:Class`, `path/to/file.py:Class` or `path/to/folder`, with settings where
            wanted, as `li2012?map=false`; by environment where they differ.
        envs: Environment ids.
        split: "train", "val", "test" or "heldout"; None: "test". A localizer that needs the truth is unsuitable for the
            last two.
        seeds: Every walk is run with the seeds 0 to `seeds` - 1. One is enough: chance differs from walk to walk
            anyway, and more walks tell more than more seeds.
        walks: Only the first so many of the split, or those with these ids. None: all.
        jobs: Processes; this one is among them with one job and the isolation "none" only.
        out: Folder for one file per result. What it holds already is not computed again; two sweeps may share it.
            None: results are kept in memory only.
        isolation: "process": in a process of its own, which plays one walk after the other; "confined": every walk
            alone, in a process that may do as little as the system can make sure of, as strangers' code is verified:
            the result says what held, and an error where that does not keep it from files and networks; "none": in
            the process that evaluates, which with one job is this one: for debugging, and for code that one trusts. A
            localizer that crashes takes it down.
        budget: Wall time of every localizer.
        progress: Shows on stderr how far it is.
        parameters: Keyword arguments of the localizer's class, made of what JSON knows; only with one localizer.
        nonce: 32 hexadecimal digits that all randomness depends on besides, as `randomness.new_nonce` makes them;
            stored with the results. Empty: randomness that is the same in every run.
        secret: Behind the walks of the split "heldout" and their nonce: it stays in the trusted processes, and results
            name its sha256.

    Raises:
        PdrbenchError: An unknown name, a plug-in that does not load, data that is not found, a full disk.
    """
    names = _listed(envs)
    by_env = localizers if isinstance(localizers, Mapping) else dict.fromkeys(names, localizers)
    loads = True if isolation == NONE else None
    specs = {env: _canonical(_listed(by_env[env]), loads) for env in names}
    check_counts(seeds=seeds, jobs=jobs, walks=None if isinstance(walks, (list, tuple)) else walks)
    if (secret is None) == (split == HELD_OUT):
        raise PdrbenchError(f"a secret goes with the split {HELD_OUT!r} and no other; got the split {split!r}")
    if check_nonce(nonce) and secret is not None:
        raise PdrbenchError(f"the nonce of the split {HELD_OUT!r} follows from its secret: leave it out")
    _check_isolation(isolation, jobs, on_cluster=pool.is_foreign())
    if parameters and (num_specs := len({spec for of in specs.values() for spec in of})) > 1:
        raise PdrbenchError(f"parameters go with one localizer; got {num_specs}: run them one by one")
    jobs_to_do = plan_walks(
        specs,
        split=split,
        seeds=range(seeds),
        walks=walks,
        parameters=parameters or {},
        budget=budget,
        isolation=isolation,
        nonce=nonce,
        secret=secret,
    )
    with _result_folder(out) as folder:
        context = JobContext(
            folder=folder,
            run=uuid.uuid4().hex,
            owner=0 if isolation == NONE and jobs == 1 else os.getpid(),
            compute=compute_in_process if isolation == NONE else compute_in_child,
            keeps=out is not None,
            world=(str(Path.cwd()), os.environ.get("PDRBENCH_DATA", ""), *sys.path),
        )
        found = run_all(jobs_to_do, context, jobs, is_warm=True, progress=progress, what="walks")
    kept = None if out is None else context.folder / SCORES_FOLDER
    return Results(tuple(found[job.name] for job in jobs_to_do), jobs=jobs, secret=secret, kept=kept)


def _listed(names: str | Sequence[str]) -> list[str]:
    """Without duplicates, in order."""
    if isinstance(names, type) or not all(isinstance(name, str) for name in names):
        raise PdrbenchError(f"localizers and environments are named, as 'stay' or 'file.py:Class'; got {names!r}")
    listed = list(dict.fromkeys([names] if isinstance(names, str) else names))
    if not listed:
        raise PdrbenchError("evaluate needs at least one localizer and one environment")
    return listed


def _canonical(names: Sequence[str], loads: bool | None) -> list[str]:
    """Names under which results are stored, each once."""
    return list(dict.fromkeys(canonical_localizer(name, loads=loads) for name in names))


def _check_isolation(isolation: str, jobs: int, *, on_cluster: bool) -> None:
    if isolation not in get_args(Isolation):
        raise PdrbenchError(f"isolation is one of {', '.join(get_args(Isolation))}; got {isolation!r}")
    if on_cluster and isolation == NONE:
        raise PdrbenchError("isolation 'none' runs localizers in processes that evaluate; a cluster's have threads")
    if on_cluster and jobs > 1:
        raise PdrbenchError(f"jobs are processes of this machine, and a cluster has its own workers; got {jobs} jobs")


@contextlib.contextmanager
def _result_folder(out: Path | str | None) -> Iterator[Path]:
    if out is None:
        with tempfile.TemporaryDirectory(prefix="pdrbench-") as folder:
            yield Path(folder)
        return
    yield store.make_folder(Path(out))
