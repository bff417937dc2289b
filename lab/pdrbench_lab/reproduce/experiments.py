"""Experiments of a reproduction, seed by seed; what was measured is kept and never measured again.

What a seed gave is one file of JSON in the folder of measurements, written whole or not at all, named by a key of
everything that produced it. Where a seed failed, a text file of the same name says why; it is tried again by the next
run.
"""

from __future__ import annotations

import contextlib
import faulthandler
import functools
import json
import math
import sys
import time
import traceback
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import IO, Any, ClassVar, Final

import numpy as np

from pdrbench.errors import ResultError
from pdrbench.evaluation import store
from pdrbench.evaluation.jobs import Finished, Job, JobContext
from pdrbench.evaluation.origin import machine, package_sha256, versions
from pdrbench.registry import PluginEntry, make_task
from pdrbench.result import COMPLETE, FAILED
from pdrbench_lab.reproduce.reproduction import Experiment, Numbers

MAX_DEATHS: Final = 2  # one process beside others, which may be to blame, and one apart from them
FORMAT: Final = "pdrbench-measurement 1"
SUFFIX: Final = ".json"
FAILURE_SUFFIX: Final = ".failure.txt"
FROM_JSON: Final = {None: math.nan, "inf": math.inf, "-inf": -math.inf}  # JSON has no numbers for these


@dataclass(frozen=True, slots=True, kw_only=True)
class ExperimentJob(Job):
    """One experiment with one seed; its family is the experiment, and its sources are packages."""

    in_order: ClassVar[bool] = True
    measure: str  # `package.module:function`

    def present_sources(self) -> Mapping[str, str]:
        """Digests of the packages when this process first looked, which is before it loads them."""
        return {package: _digest(package) for package in self.sources}

    def failure_path(self, folder: Path) -> Path:
        """Where it says why the job failed."""
        return folder / (self.name.removesuffix(SUFFIX) + FAILURE_SUFFIX)

    def decode(self, content: bytes, path: Path) -> Numbers:
        """What was measured; raises `ResultError` where the file is torn or of another format."""
        try:
            document = json.loads(content)
            if document["format"] != FORMAT or document["key"] != self.key:
                raise ResultError(f"{path} is no {FORMAT} of this experiment")
            return {name: _from_json(value) for name, value in document["numbers"].items()}
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise ResultError(f"{path} is torn: {type(error).__name__}: {error}") from error

    def give_up(self, context: JobContext, how: str) -> Finished:
        """Stores why there is no measurement."""
        store.write_whole(self.failure_path(context.folder), how.encode())
        return FAILED, None


@functools.cache
def _digest(package: str) -> str:
    return package_sha256(package)


def plan_experiments(
    experiments: Iterable[Experiment], seeds: Mapping[str, int], packages: Iterable[str]
) -> list[ExperimentJob]:
    """Every job of a reproduction, seed by seed, so that a process makes the walk of a seed once for all of them.

    Args:
        experiments: In the order in which they are run on a seed; what is measured alone comes at the end.
        seeds: Number of seeds by experiment.
        packages: Whose sources, beside those of the core, determine a measurement.
    """
    sources = {package: package_sha256(package) for package in ("pdrbench", *sorted(packages))}
    jobs = []
    for experiment in experiments:
        ingredients = {
            "experiment": experiment.name,
            "measure": experiment.measure,
            "sources": sources,
            "versions": versions(),
            "machine": machine() if experiment.alone else None,  # wall-clock times of another machine are no answer
        }
        if experiment.envs:
            notes = {env: make_task(env).note for env in experiment.envs}
            ingredients["recorded"] = notes  # which name data in place of the registered one
        for seed in range(seeds[experiment.name]):
            key = store.result_key(ingredients | {"seed": seed})
            name = f"{experiment.name}.s{seed:03d}.{key[: store.KEY_CHARACTERS_IN_NAME]}{SUFFIX}"
            jobs.append(
                ExperimentJob(
                    name=name,
                    key=key,
                    seed=seed,
                    group=name,
                    family=experiment.name,
                    max_deaths=MAX_DEATHS,
                    sources=sources,
                    is_alone=experiment.alone,
                    measure=experiment.measure,
                )
            )
    return sorted(jobs, key=lambda job: (job.is_alone, job.seed))


def measure(job: ExperimentJob, context: JobContext, note: IO[bytes], memory: dict[str, Any]) -> Finished:
    """The work of a job; never raises for what the experiment does."""
    job.failure_path(context.folder).unlink(missing_ok=True)
    started_at, began_s = datetime.now(UTC), time.perf_counter()
    try:
        with last_words(note):
            numbers = plain_numbers(PluginEntry(job.family, job.measure, "this reproduction").load()(job.seed))
    except BaseException:  # noqa: BLE001  an experiment may raise anything
        return job.give_up(context, traceback.format_exc())
    document = {
        "format": FORMAT,
        "experiment": job.family,
        "seed": job.seed,
        "numbers": numbers,
        "measure": job.measure,
        "elapsed_s": round(time.perf_counter() - began_s, 3),
        "started_at": started_at.isoformat(timespec="seconds"),
        "key": job.key,
        "sources": dict(job.sources),
        "versions": versions(),
        "machine": machine(),
    }
    return COMPLETE, (json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n").encode()


@contextlib.contextmanager
def last_words(report: IO[Any]) -> Iterator[None]:
    """Whatever ends the process inside leaves a traceback in `report`, also where compiled code is to blame."""
    faulthandler.enable(report)
    try:
        yield
    finally:
        faulthandler.enable(sys.__stderr__ or 2)


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
    return None if math.isnan(number) else number if math.isfinite(number) else str(number)


def _from_json(value: Any) -> float | Any:
    if isinstance(value, list):
        return np.array([FROM_JSON[of] if of is None or isinstance(of, str) else of for of in value], dtype=np.float64)
    return float(FROM_JSON[value] if value is None or isinstance(value, str) else value)
