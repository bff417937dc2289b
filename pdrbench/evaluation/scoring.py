"""Scores of results: the one place where answers and truth meet after the walk."""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import itertools
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np

from pdrbench.building import Building
from pdrbench.errors import REFUSALS, ResultError
from pdrbench.evaluation.origin import environment_version, package_sha256, versions
from pdrbench.evaluation.store import write_whole
from pdrbench.geometry import FloatArray
from pdrbench.metrics import METRICS, errors_m, hold_at
from pdrbench.metrics import score as score_estimates
from pdrbench.metrics.competition import penalised_errors_m
from pdrbench.recording import Recording
from pdrbench.registry import make_task
from pdrbench.result import FAILED, UNSUITABLE, Result
from pdrbench.task import FILES_SHA256, Task
from pdrbench.trajectory import Trajectory

SPREAD_S: Final = 5.0  # of scoring that is left; below, processes cost more than they save
MAX_KEPT: Final = 5_000  # results of a walk whose scores are kept


@dataclass(frozen=True, slots=True)
class Scored:
    """Scores of one result."""

    # Value by metric, NaN where it does not apply, infinite for the time of what never happened; empty where the
    # localizer declined the walk
    scores: dict[str, float]
    building: str  # name of the building; empty where there is none
    unit: str  # of replication, which intervals count: `Task.units`, or the building
    errors_m: FloatArray  # (n,) Euclidean error at each surveyed position
    # (n,) from there to the nearest scan of the radio survey on the level, infinite where it has none; NaN where the
    # task has no recorded survey
    scan_m: FloatArray
    # Diagonal of the box around building and reference, and levels between the lowest and the highest of either: how
    # wrong an answer inside can be
    diagonal_m: float = math.nan
    level_span: int = 0
    truth: tuple[Trajectory, Building | None] | None = None  # reference and map; None where scores were kept
    penalised_m: FloatArray = field(default_factory=lambda: np.zeros(0))  # (n,) `errors_m` with penalties of EvAAL


def score(result: Result) -> dict[str, float]:
    """Looks the truth up and scores a result by every metric of `pdrbench.metrics.METRICS`.

    A walk that failed is scored with what was answered before; a walk that was declined has no scores.

    Raises:
        ResultError: The environment is not the one that the result was made on, or it is no result.
    """
    if not isinstance(result, Result):
        raise ResultError(
            f"expected a Result, got {type(result).__name__}: an environment gives info['result'] at the end"
        )
    return score_group([result])[0].scores


def score_all(
    results: Sequence[Result], jobs: int = 1, secret: str | None = None, folder: Path | None = None
) -> list[Scored]:
    """Scores in the order of the results; every recording is loaded once.

    Args:
        results: On any environments and walks.
        jobs: Processes.
        secret: Behind the walks, where they are held out.
        folder: Where scores are kept, and those of the same answers by the same code are taken from; None: nowhere.
    """
    groups: dict[tuple[str, str], list[int]] = {}
    for index, result in enumerate(results):
        groups.setdefault((result.env, result.walk), []).append(index)
    grouped = [[results[index] for index in group] for group in groups.values()]
    kept: dict[str, tuple[Path, str]] = {}
    if folder is not None and secret is None:
        kept = {env: (folder, code_sha256(env)) for env in {result.task for result in results}}
    scored: list[list[Scored]] = []
    began_s = time.perf_counter()
    while left := len(grouped) - len(scored):
        if jobs > 1 and scored and (time.perf_counter() - began_s) / len(scored) * left > SPREAD_S:
            from pdrbench.evaluation.pool import in_order

            rest = [(group, secret, kept.get(group[0].task)) for group in grouped[len(scored) :]]
            scored += in_order(score_group, rest, jobs)
        else:
            group = grouped[len(scored)]
            scored.append(score_group(group, secret, kept.get(group[0].task)))
    order = itertools.chain.from_iterable(groups.values())
    buildings: dict[str, Building] = {}  # processes give back one for each walk
    found = {}
    for index, each in zip(order, itertools.chain.from_iterable(scored), strict=True):
        if each.truth is not None and (building := each.truth[1]) is not None:
            shared = buildings.setdefault(building.sha256, building)
            each = dataclasses.replace(each, truth=(each.truth[0], shared))
        found[index] = each
    return [found[index] for index in range(len(results))]


def score_group(
    results: Sequence[Result], secret: str | None = None, place: tuple[Path, str] | None = None
) -> list[Scored]:
    """Scores of results on one walk; `place` is the folder where they are kept, and the digest of what scores."""
    task = make_task(results[0].task, secret)
    for result in results:
        check_walk(result, task)
    kept = None if place is None else KeptScores(*place, results[0])
    found = {} if kept is None else kept.read(results)
    if new := [result for index, result in enumerate(results) if index not in found]:
        scored = iter(_score_walk(new, task))
        found |= {index: next(scored) for index in range(len(results)) if index not in found}
        if kept is not None:
            kept.write([found[index] for index in range(len(results))])
    return [found[index] for index in range(len(results))]


def _score_walk(results: Sequence[Result], task: Task) -> list[Scored]:
    """Loads the walk and scores."""
    try:
        recording = task.load(results[0].walk)
    except REFUSALS:
        if any(result.status != FAILED for result in results):
            raise
        none = Scored(
            dict.fromkeys(METRICS, math.nan), "", task.units.get(results[0].walk, ""), np.zeros(0), np.zeros(0)
        )
        return [none] * len(results)
    scan_m = _scan_m(task, recording)
    return [_score_one(result, task, recording, scan_m) for result in results]


class KeptScores:
    """Scores of one walk that were computed before, in a file of their own.

    The file says by which code and of which walk. Other ones replace it, so that a folder has one file a walk.

    Args:
        folder: Made where it is missing.
        code: Digest of what makes the walk and scores.
        result: One on the walk.
    """

    def __init__(self, folder: Path, code: str, result: Result) -> None:
        self._path = folder / f"{hashlib.sha256(f'{result.task} {result.walk}'.encode()).hexdigest()[:32]}.scores"
        self._origin = f"{code} {sorted(make_task(result.task).walk_identity(result.walk).items())}"
        self._known: dict[str, Any] = {}
        self._digests: list[str] = []

    def read(self, results: Sequence[Result]) -> dict[int, Scored]:
        """Scores by place in `results`, as far as there are any."""
        self._digests = [answers_sha256(result) for result in results]
        with contextlib.suppress(OSError, ValueError, TypeError):  # what cannot be read is computed
            origin, known = msgspec.msgpack.decode(self._path.read_bytes())
            self._known = known if origin == self._origin else {}
            rows = {index: self._known[digest] for index, digest in enumerate(self._digests) if digest in self._known}
            return {
                index: Scored(
                    *(row[0], row[1], row[2], np.frombuffer(row[3]), np.frombuffer(row[4]), row[5], row[6], None),
                    np.frombuffer(row[7]),
                )
                for index, row in rows.items()
            }
        return {}

    def write(self, scored: Sequence[Scored]) -> None:
        """Keeps the scores of what was read; where that is impossible, they are computed again."""
        rows = {
            digest: [
                *(s.scores, s.building, s.unit, s.errors_m.tobytes(), s.scan_m.tobytes()),
                *(s.diagonal_m, s.level_span, s.penalised_m.tobytes()),
            ]
            for digest, s in zip(self._digests, scored, strict=True)
        }
        kept = self._known | rows
        with contextlib.suppress(OSError, ResultError):
            self._path.parent.mkdir(parents=True, exist_ok=True)
            content = [self._origin, kept if len(kept) <= MAX_KEPT else rows]
            write_whole(self._path, msgspec.msgpack.encode(content))


def code_sha256(env: str) -> str:
    """Digest of what scores and draws the walks of an environment, and of versions of libraries."""
    packages = {"pdrbench", *(metric.target.partition(".")[0] for metric in METRICS.values())}
    parts = [environment_version(env), *(package_sha256(name) for name in sorted(packages)), versions()]
    return hashlib.sha256(repr(parts).encode()).hexdigest()


def answers_sha256(result: Result) -> str:
    """Of everything in a result that its scores follow from."""
    facts = [result.status, result.split, result.reset_s, sorted(result.missing.items())]
    columns = [result.estimates.t_s, result.estimates.columns, result.step_s]
    return hashlib.sha256(b"".join([repr(facts).encode(), *(column.tobytes() for column in columns)])).hexdigest()


def _scan_m(task: Task, recording: Recording) -> FloatArray:
    """`Scored.scan_m`. Generated surveys are dense grids, costly to make: distances to them would tell nothing."""
    reference = recording.reference
    radio_map = None if task.dataset is None else task.radio_map(recording)
    if radio_map is None:
        return np.full(int(reference.surveyed.sum()), np.nan)
    from scipy.spatial import KDTree

    found = np.full(len(reference), np.inf)
    for level in np.unique(reference.level):
        scans_m = radio_map.xy_m[radio_map.level == level]
        here = reference.level == level
        if len(scans_m):
            found[here] = KDTree(scans_m).query(reference.xy_m[here])[0]
    return found[reference.surveyed]


def check_walk(result: Result, task: Task) -> None:
    """Raises `ResultError` where a result was made on another walk than the present one of the same id."""
    present = task.walk_identity(result.walk).get(FILES_SHA256, "")
    made_on = str(result.provenance.get(FILES_SHA256, "")) if result.provenance else present
    if made_on != present:
        raise ResultError(
            f"walk {result.walk!r} of {result.localizer}: its {task.id} is made of {_files(made_on)}, the present one "
            f"of {_files(present)}, so the two are not comparable: run the walk again on the present one"
        )
    split = task.split_of(result.walk)
    if split != result.split:
        raise ResultError(f"walk {result.walk!r} of {task.id} is of the {split} split, its result says {result.split}")


def _files(digest: str) -> str:
    return f"files with the digest {digest[:12]}" if digest else "the registered files"


def _score_one(result: Result, task: Task, recording: Recording, scan_m: FloatArray) -> Scored:
    building = recording.building.name if recording.building is not None else ""
    unit = task.units.get(result.walk, building)
    if result.status == UNSUITABLE:
        return Scored({}, building, unit, np.zeros(0), np.zeros(0), *_seen(recording))
    if task.start == "unknown" and recording.building is None and not task.radio_map(recording):
        raise ResultError(
            f"{task.id} gives neither a start nor a building nor a survey: a silent localizer cannot be scored"
        )
    fallback = task.fallback(recording)
    scores = score_estimates(
        result.estimates,
        recording.reference,
        recording.building,
        fallback,
        step_s=result.step_s,
        period_s=task.period_s,
        reset_s=result.reset_s,
        missing=result.missing,
        mounting=recording.mounting,
    )
    held = hold_at(result.estimates, recording.reference.t_s, fallback)
    errors = errors_m(held, recording.reference)
    penalised_m = penalised_errors_m(held, recording.reference)
    return Scored(scores, building, unit, errors, scan_m, *_seen(recording), penalised_m)


def _seen(recording: Recording) -> tuple[float, int, tuple[Trajectory, Building | None]]:
    """`Scored.diagonal_m`, `Scored.level_span` and `Scored.truth`."""
    corners_m, levels = recording.reference.xy_m, set(recording.reference.level.astype(int).tolist())
    if recording.building is not None:
        corners_m = np.concatenate([corners_m, np.reshape(recording.building.bounds_m(), (2, 2))])
        levels |= set(recording.building.levels)
    diagonal_m = float(np.hypot(*np.ptp(corners_m, axis=0)))
    return diagonal_m, max(levels) - min(levels), (recording.reference, recording.building)
