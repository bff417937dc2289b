"""`evaluate`: localizers, environments, walks and seeds, whatever becomes of the processes."""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import os
import sys
import tempfile
import time
import uuid
import warnings
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, get_args

from pdrbench.errors import PdrbenchError, ResultError
from pdrbench.evaluation import claims, pool, store
from pdrbench.evaluation.items import NONE, Item, Outcome, Setting, dead_result, plan
from pdrbench.evaluation.progress import Advance, reporting
from pdrbench.evaluation.tables import Results
from pdrbench.evaluation.work import is_current, run_group
from pdrbench.isolation.budget import Budget
from pdrbench.isolation.isolated import Isolation
from pdrbench.result import FAILED, Result
from pdrbench.task import HELD_OUT

WAIT_S: Final = 0.2  # between looks at what another sweep on the same folder computes
MOST_STARTS: Final = 3  # processes that end before they begin anything are given up after this many tries
MOST_DEATHS: Final = 3  # so are walks over which that many processes of ours died: the machine may be short of memory
STANDARD: Final = Budget()
CHANGED_THERE: Final = (
    "a worker of the cluster has other sources of an environment or a localizer than this machine; install these there "
    "and restart its workers: what is stored already is kept"
)
CHANGED: Final = "sources changed while the sweep ran; run it again: what is stored already is kept"


def evaluate(
    localizers: str | Sequence[str],
    envs: str | Sequence[str],
    *,
    split: str = "test",
    seeds: int = 1,
    walks: int | Sequence[str] | None = None,
    jobs: int = 1,
    out: Path | str | None = None,
    isolation: Isolation = "auto",
    budget: Budget = STANDARD,
    progress: bool = False,
    parameters: Mapping[str, Any] | None = None,
    secret: str | None = None,
) -> Results:
    """Runs localizers through walks and collects what they answered.

    A localizer that raises, hangs or takes its process down gets a failed result that says how; the rest goes on.
    The estimates depend on the seed and the walk, not on `jobs`. With `joblib.parallel_config(backend="dask")` the
    walks go to a cluster; `out` must then be a folder that all its machines see.

    Args:
        localizers: Ids, `package.module:Class` or `path/to/file.py:Class`.
        envs: Environment ids.
        split: "train", "val", "test" or "heldout". A localizer that has to be told the truth is unsuitable for the
            last two.
        seeds: Every walk is run with the seeds 0 to `seeds` - 1.
        walks: Only the first so many of the split, or those with these ids; None for all.
        jobs: Processes; none of them is this one.
        out: Folder for one file per result. What it holds already is not computed again; two sweeps may share it.
            None: results are kept in memory only.
        isolation: "auto": every walk has a process of its own, which may do as little as the system can make sure of,
            and the result says what held; "process": such a process without that; "none": this process, for debugging:
            a localizer that crashes takes it down.
        budget: Wall time of every localizer.
        progress: Shows on stderr how far it is.
        parameters: Keyword arguments of the localizer's class, made of what JSON knows; only with one localizer.
        secret: Behind the walks of the split "heldout": it stays in the trusted processes, and results name its sha256.

    Raises:
        PdrbenchError: An unknown name, a plug-in that does not load, data that is not at hand, a full disk.
    """
    specs, names = _listed(localizers), _listed(envs)
    _check_counts(seeds=seeds, jobs=jobs, walks=None if isinstance(walks, (list, tuple)) else walks)
    if (secret is None) == (split == HELD_OUT):
        raise PdrbenchError(f"a secret goes with the split {HELD_OUT!r} and no other; got the split {split!r}")
    _check_isolation(isolation, jobs, on_cluster=pool.is_foreign())
    if parameters and len(specs) > 1:
        raise PdrbenchError(f"parameters go with one localizer; got {len(specs)}: run them one by one")
    items = plan(
        specs,
        names,
        split=split,
        seeds=seeds,
        walks=walks,
        parameters=parameters or {},
        budget=budget,
        isolation=isolation,
        secret=secret,
    )
    with _result_folder(out) as folder:
        setting = Setting(
            folder=folder,
            sweep=uuid.uuid4().hex,
            keeps=out is not None,
            budget=budget,
            isolation=isolation,
            owner=0 if isolation == NONE else os.getpid(),
            world=(str(Path.cwd()), os.environ.get("PDRBENCH_DATA", ""), *sys.path),
            secret=secret,
        )
        with claims.order(setting.folder, setting.sweep):
            done = _stored(items, folder)
            todo = {item.name: item for item in items if item.name not in done}
            with reporting(len(items), len(done), shown=progress) as advance:
                done |= Sweep(todo, setting, jobs, advance).run()
            if out is not None:
                store.sync_folder(folder)
            results = [done[item.name] if item.name in done else store.load(folder / item.name) for item in items]
    return Results(tuple(results), jobs=jobs, secret=secret)


def _listed(names: str | Sequence[str]) -> list[str]:
    """Without duplicates, in order."""
    if isinstance(names, type) or not all(isinstance(name, str) for name in names):
        raise PdrbenchError(f"localizers and environments are named, as 'stay-v0' or 'file.py:Class'; got {names!r}")
    listed = list(dict.fromkeys([names] if isinstance(names, str) else names))
    if not listed:
        raise PdrbenchError("evaluate needs at least one localizer and one environment")
    return listed


def _check_counts(**counts: object) -> None:
    for name, count in counts.items():
        if count is not None and (not isinstance(count, int) or count < 1):
            raise PdrbenchError(f"{name} is a whole number, at least 1; got {count!r}")


def _check_isolation(isolation: str, jobs: int, *, on_cluster: bool) -> None:
    if isolation not in get_args(Isolation):
        raise PdrbenchError(f"isolation is one of {', '.join(get_args(Isolation))}; got {isolation!r}")
    if isolation == NONE and jobs > 1:
        raise PdrbenchError(f"isolation 'none' runs localizers in this process, one after the other; got {jobs} jobs")
    if on_cluster and isolation == NONE:
        raise PdrbenchError("isolation 'none' runs localizers in this process, which is none of the cluster")
    if on_cluster and jobs > 1:
        raise PdrbenchError(f"jobs are processes of this machine, and a cluster has its own workers; got {jobs} jobs")


@contextlib.contextmanager
def _result_folder(out: Path | str | None) -> Iterator[Path]:
    if out is None:
        with tempfile.TemporaryDirectory(prefix="pdrbench-") as folder:
            yield Path(folder)
        return
    folder_path = Path(out).absolute()
    try:
        folder_path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ResultError(f"cannot make the folder {folder_path}: {error.strerror or error}") from error
    yield folder_path


def _stored(items: Sequence[Item], folder: Path) -> dict[str, Result]:
    """What is there already; a torn file is removed with a notice, so that its walk is computed again."""
    present = {path.name for path in folder.glob(f"*{store.SUFFIX}")}
    found = {}
    for item in items:
        if item.name in present:
            try:
                found[item.name] = store.load(folder / item.name)
            except ResultError as error:
                warnings.warn(f"{error}: removed, the walk is computed again", stacklevel=3)
                (folder / item.name).unlink(missing_ok=True)
    return found


class Sweep:
    """Gets every item done, whatever becomes of the processes.

    Args:
        todo: Items by name.
        setting: What they share.
        jobs: Processes.
        advance: Called with the status of each finished item.
    """

    def __init__(self, todo: Mapping[str, Item], setting: Setting, jobs: int, advance: Advance) -> None:
        self._todo = dict(todo)
        self._setting, self._jobs, self._advance = setting, jobs, advance
        self._found: dict[str, Result] = {}
        self._deaths: Counter[str] = Counter()
        self._num_stale = 0
        self._num_idle_deaths = 0

    def run(self) -> dict[str, Result]:
        """Returns when every item is done; with what is not stored, by name."""
        while self._todo:
            before = len(self._todo)
            self._in_pool(list(self._todo.values()))
            if len(self._todo) == before:
                time.sleep(WAIT_S)
        return self._found

    def _in_pool(self, items: list[Item]) -> None:
        groups = [tuple(group) for _, group in itertools.groupby(items, key=lambda item: (item.env, item.walk))]
        stale = False
        try:
            for outcome in self._outcomes(groups):
                stale |= outcome.state == "stale"
                self._note(outcome)
        except pool.TerminatedWorkerError as error:
            self._bury(error)
        if stale:
            self._renew()

    def _outcomes(self, groups: Sequence[Sequence[Item]]) -> Iterator[Outcome]:
        if self._setting.owner:
            return pool.spread(groups, self._setting, self._jobs, run_apart)
        return itertools.chain.from_iterable(run_group(group, self._setting) for group in groups)

    def _note(self, outcome: Outcome) -> None:
        if outcome.state == "done" and self._todo.pop(outcome.name, None) is not None:
            if outcome.content:
                self._found[outcome.name] = store.decode(outcome.content, outcome.name)
            self._advance(outcome.status)

    def _renew(self) -> None:
        """New processes, since those at hand hold older code; once is enough unless sources change meanwhile."""
        self._num_stale += 1
        if pool.is_foreign():
            raise ResultError(CHANGED_THERE)
        if self._num_stale > 1:
            raise ResultError(CHANGED)
        pool.discard()

    def _bury(self, error: pool.TerminatedWorkerError) -> None:
        """Finds over which items processes of ours died; they are tried again, but not for ever."""
        fallen = claims.fallen(self._setting.folder, self._setting.sweep)
        names = [name for name in fallen if name in self._todo]
        self._num_idle_deaths *= not names
        if not names:
            self._num_idle_deaths += 1
            if self._num_idle_deaths >= MOST_STARTS:
                raise ResultError(f"worker processes end before they begin a walk: {error}") from error
        for name in names:
            self._deaths[name] += 1
            if self._deaths[name] >= MOST_DEATHS:
                self._record_death(self._todo[name], str(error))

    def _record_death(self, item: Item, error: str) -> None:
        how = f"the evaluating process died {MOST_DEATHS} times over this walk: {' '.join(error.split())}"
        result = dead_result(item, self._setting, how)
        if self._setting.keeps:
            with claims.ledger(self._setting.folder, self._setting.sweep).claim(item.name) as note:
                if note is None:
                    return  # another sweep is having a try at it
                store.save(result, self._setting.folder / item.name)
        self._note(Outcome(item.name, "done", FAILED, b"" if self._setting.keeps else store.encode(result)))


def run_apart(items: Sequence[Item], setting: Setting) -> list[Outcome]:
    """A group on a machine of a cluster, whose tasks run in threads: localizers have processes of their own anyway."""
    here = dataclasses.replace(setting, owner=0, world=())  # of another machine
    current = [item for item in items if is_current(item, here)]
    stale = [Outcome(item.name, "stale") for item in items if item not in current]
    return [*stale, *run_group(current, here)]
