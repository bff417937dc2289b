"""Experiments of a reproduction, seed by seed, in processes; what was measured is kept and never measured again.

What a seed gave is one file of JSON in the folder of measurements, written whole or not at all, named by a key of
everything that produced it. Where a seed failed, a text file of the same name says why; it is tried again by the next
run.
"""

from __future__ import annotations

import contextlib
import functools
import json
import math
import time
import traceback
from collections.abc import Generator, Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import numpy as np
from joblib.externals.loky import ProcessPoolExecutor, as_completed

from pdrbench.errors import ResultError
from pdrbench.evaluation import claims, pool, store
from pdrbench.evaluation.deadlines import last_words
from pdrbench.evaluation.items import Outcome
from pdrbench.evaluation.progress import Advance
from pdrbench.evaluation.reproduction import Experiment, Numbers
from pdrbench.evaluation.sources import core_sha256, machine, target_sha256, versions
from pdrbench.evaluation.work import settle
from pdrbench.isolation.launching import THREADS
from pdrbench.registry import Entry, make_task
from pdrbench.result import COMPLETE, FAILED

FORMAT: Final = "pdrbench-measurement 1"
SUFFIX: Final = ".json"
FAILURE_SUFFIX: Final = ".failure.txt"
WAIT_S: Final = 0.5  # between looks at what another run on the same folder measures
MOST_STARTS: Final = 3  # processes that end before they begin anything are given up after this many tries
CHANGED: Final = "sources changed while it ran; run it again: what is measured already is kept"
# Rooms and files of the core that cannot change what an experiment returns; unlike an estimate, a score can.
NEUTRAL: Final = frozenset({"bench", "cli", "leaderboard", "picture", "report"})
NEUTRAL_FILES: Final = frozenset(
    f"evaluation/{name}.py" for name in ("measuring", "progress", "reproduce", "reproduction", "trace")
)
# JSON has no word for these.
TO_JSON: Final = {math.inf: "inf", -math.inf: "-inf"}
FROM_JSON: Final = {None: math.nan, "inf": math.inf, "-inf": -math.inf}


@dataclass(frozen=True, slots=True)
class Item:
    """One experiment with one seed.

    Attributes:
        experiment: Its name.
        measure: `package.module:function`.
        seed: Seed.
        alone: True where nothing may go on beside it.
        sources: Digest by package; what runs must agree with it.
        key: Sha256 of everything that determines the measurement.
    """

    experiment: str
    measure: str
    seed: int
    alone: bool
    sources: Mapping[str, str]
    key: str

    @property
    def name(self) -> str:
        """File name of the measurement."""
        return f"{self.experiment}.s{self.seed:03d}.{self.key[: store.KEY_CHARACTERS_IN_NAME]}{SUFFIX}"


@dataclass(frozen=True, slots=True)
class Setting:
    """What all items of a run share.

    Attributes:
        folder: Of measurements.
        run: Id of the run.
        owner: Process that gives the orders.
    """

    folder: Path
    run: str
    owner: int


def sources_of(packages: Iterable[str]) -> dict[str, str]:
    """Digests of the code that measures: of the core, and of every file of some packages."""
    core = core_sha256(NEUTRAL, NEUTRAL_FILES)
    return {"pdrbench": core, **{package: target_sha256(package) for package in sorted(packages)}}


def plan(experiments: Iterable[Experiment], seeds: Mapping[str, int], packages: Iterable[str]) -> list[Item]:
    """Every item of a run, what is measured alone at the end.

    Args:
        experiments: In the order in which they are run.
        seeds: Number of seeds by experiment.
        packages: Whose sources, beside those of the core, determine a measurement.
    """
    sources = sources_of(packages)
    items = []
    for experiment in sorted(experiments, key=lambda experiment: experiment.alone):
        ingredients = {
            "experiment": experiment.name,
            "measure": experiment.measure,
            "sources": sources,
            "versions": versions(),
            "machine": machine() if experiment.alone else None,  # wall-clock times of another machine are no answer
        }
        if experiment.envs:
            ingredients["walks"] = {env: make_task(env).sha256 for env in experiment.envs}
        for seed in range(seeds[experiment.name]):
            key = store.result_key(ingredients | {"seed": seed})
            items.append(Item(experiment.name, experiment.measure, seed, experiment.alone, sources, key))
    return items


class Run:
    """Gets every item measured: in a pool of processes, what takes its process down apart, what is alone at the end.

    Args:
        todo: Items that have no measurement yet.
        setting: What they share.
        jobs: Processes.
        advance: Called with the status of each finished item.
    """

    def __init__(self, todo: Iterable[Item], setting: Setting, jobs: int, advance: Advance) -> None:
        self._todo = {item.name: item for item in todo}
        self._setting, self._jobs, self._advance = setting, jobs, advance
        self._deadly: set[str] = set()  # experiments over which a process died
        self._num_idle_deaths = 0

    def run(self) -> None:
        """Returns when every item has a measurement or a failure in the folder."""
        while self._todo:
            shared = [item for item in self._todo.values() if not item.alone]
            free = self._free(shared or list(self._todo.values()))
            if not free:
                time.sleep(WAIT_S)
            self._in_pool([item for item in free if item.experiment not in self._deadly], self._jobs if shared else 1)
            for item in free:
                if item.name in self._todo and item.experiment in self._deadly:
                    self._take(self._apart(item))

    def _free(self, items: Iterable[Item]) -> list[Item]:
        """What no other run measures; what another has measured is done."""
        own = claims.ledger(self._setting.folder, self._setting.run)
        free = []
        for item in items:
            if (self._setting.folder / item.name).exists():
                self._take(Outcome(item.name, "done", COMPLETE))
            elif own.is_free(item.name):
                free.append(item)
        return free

    def _take(self, outcome: Outcome) -> None:
        if outcome.state == "stale":
            raise ResultError(CHANGED)
        if outcome.state == "done" and self._todo.pop(outcome.name, None) is not None:
            self._advance(outcome.status)

    def _in_pool(self, items: Sequence[Item], jobs: int) -> None:
        try:
            with contextlib.closing(_spread(items, self._setting, jobs)) as outcomes:
                for outcome in outcomes:
                    self._take(outcome)
        except pool.TerminatedWorkerError as error:
            self._bury(error)

    def _bury(self, error: pool.TerminatedWorkerError) -> None:
        """Finds what processes had in hand when one died, and measures that apart: the culprit and its neighbours."""
        fallen = claims.fallen(self._setting.folder, self._setting.run)
        suspects = [self._todo[name] for name in fallen if name in self._todo]
        self._num_idle_deaths = 0 if suspects else self._num_idle_deaths + 1
        if self._num_idle_deaths >= MOST_STARTS:
            raise ResultError(f"worker processes end before they begin to measure: {error}") from error
        for item in suspects:
            self._take(self._apart(item))

    def _apart(self, item: Item) -> Outcome:
        """One item in a fresh process; where that dies too, its death is the failure."""
        ended = pool.in_fresh_process(measure, item, self._setting)
        if isinstance(ended, Outcome):
            return ended
        self._deadly.add(item.experiment)
        report = claims.fallen(self._setting.folder, self._setting.run).get(item.name, "")
        _note_failure(item, self._setting, f"{report}\nits process died: {ended}\n".lstrip())
        return Outcome(item.name, "done", FAILED)


def _spread(items: Sequence[Item], setting: Setting, jobs: int) -> Generator[Outcome, None, None]:
    """Outcomes as they come; raises `TerminatedWorkerError` where a process died."""
    if not items:
        return
    executor = ProcessPoolExecutor(max_workers=min(jobs, len(items)), env=THREADS)
    try:
        for future in as_completed([executor.submit(measure, item, setting) for item in items]):
            yield future.result()
    finally:
        executor.shutdown(wait=True, kill_workers=True)


def measure(item: Item, setting: Setting) -> Outcome:
    """Measures and stores one item in this process; never raises for what the experiment does."""
    settle(setting.owner)
    if _loaded_sources(tuple(sorted(item.sources))) != item.sources:
        return Outcome(item.name, "stale")
    path = setting.folder / item.name
    with claims.ledger(setting.folder, setting.run).claim(item.name) as note:
        if note is None:
            return Outcome(item.name, "busy")
        if path.exists():
            return Outcome(item.name, "done", COMPLETE)  # stored by another run between the look and the claim
        started_at, began_s = datetime.now(UTC), time.perf_counter()
        try:
            with last_words(note):
                numbers = plain_numbers(Entry(item.experiment, item.measure, "this reproduction").load()(item.seed))
        except BaseException:  # noqa: BLE001  an experiment may raise anything
            _note_failure(item, setting, traceback.format_exc())
            return Outcome(item.name, "done", FAILED)
        document = {
            "format": FORMAT,
            "experiment": item.experiment,
            "seed": item.seed,
            "numbers": numbers,
            "measure": item.measure,
            "elapsed_s": round(time.perf_counter() - began_s, 3),
            "started_at": started_at.isoformat(timespec="seconds"),
            "key": item.key,
            "sources": dict(item.sources),
            "versions": versions(),
            "machine": machine(),
        }
        store.write_whole(path, (json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n").encode())
    return Outcome(item.name, "done", COMPLETE)


@functools.cache
def _loaded_sources(packages: tuple[str, ...]) -> dict[str, str]:
    """Digests of the sources when this process began to load them."""
    return sources_of(package for package in packages if package != "pdrbench")


def _note_failure(item: Item, setting: Setting, failure: str) -> None:
    store.write_whole(failure_path(item, setting.folder), failure.encode())


def failure_path(item: Item, folder: Path) -> Path:
    """Where it says why an item failed."""
    return folder / (item.name.removesuffix(SUFFIX) + FAILURE_SUFFIX)


def load(item: Item, folder: Path) -> Numbers | None:
    """What was measured for an item; None where nothing is stored.

    Raises:
        ResultError: The file is torn or of another format.
    """
    path = folder / item.name
    try:
        document = json.loads(path.read_bytes())
        if document["format"] != FORMAT or document["key"] != item.key:
            raise ResultError(f"{path} is no {FORMAT} of this experiment")
        return {name: _from_json(value) for name, value in document["numbers"].items()}
    except FileNotFoundError:
        return None
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise ResultError(f"{path} is torn: {type(error).__name__}: {error}") from error


def plain_numbers(returned: object) -> dict[str, Any]:
    """What an experiment returned, as JSON: NaN becomes null, infinities "inf" and "-inf".

    >>> plain_numbers({"error_m": np.array([0.5, np.nan]), "found": True})
    {'error_m': [0.5, None], 'found': 1.0}

    Raises:
        TypeError: It is no mapping of names to numbers or sequences of numbers.
    """
    if not isinstance(returned, Mapping) or not returned or not all(isinstance(name, str) for name in returned):
        raise TypeError(f"an experiment returns numbers by name; got {returned!r:.200}")
    plain: dict[str, Any] = {}
    for name, value in returned.items():
        array = np.asarray(value)
        if array.ndim > 1 or array.dtype.kind not in "biuf":
            raise TypeError(f"{name!r} is a number or a sequence of numbers; got {value!r:.200}")
        listed = [_to_json(float(number)) for number in array.ravel()]
        plain[name] = listed if array.ndim else listed[0]
    return plain


def _to_json(number: float) -> float | str | None:
    return None if math.isnan(number) else TO_JSON.get(number, number)


def _from_json(value: Any) -> float | Any:
    if isinstance(value, list):
        return np.array([FROM_JSON[of] if of is None or isinstance(of, str) else of for of in value], dtype=np.float64)
    return float(FROM_JSON[value] if value is None or isinstance(value, str) else value)
