"""Scores of results: the one place where answers and truth meet after the walk."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from pdrbench.errors import REFUSALS, ResultError
from pdrbench.geometry import FloatArray
from pdrbench.metrics import METRICS, errors_m, hold_at
from pdrbench.metrics import score as score_estimates
from pdrbench.recording import Recording
from pdrbench.registry import make_task
from pdrbench.result import FAILED, UNSUITABLE, Result
from pdrbench.task import Task

MIN_SPREAD_WALKS: Final = 8  # walks; below, processes cost more than they save


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


def score(result: Result) -> dict[str, float]:
    """Looks the truth up and scores a result by every metric of `pdrbench.metrics.METRICS`.

    A walk that failed is scored with what was answered before; a walk that was declined has no scores.

    Raises:
        ResultError: The environment is not the one that the result was made on.
    """
    return score_group([result])[0].scores


def score_all(results: Sequence[Result], jobs: int = 1, secret: str | None = None) -> list[Scored]:
    """Scores in the order of the results; every recording is loaded once.

    Args:
        results: On any environments and walks.
        jobs: Processes.
        secret: Behind the walks, where they are held out.
    """
    groups: dict[tuple[str, str], list[int]] = {}
    for index, result in enumerate(results):
        groups.setdefault((result.env, result.walk), []).append(index)
    grouped = [[results[index] for index in group] for group in groups.values()]
    if jobs > 1 and len(groups) >= MIN_SPREAD_WALKS:
        import joblib

        scored = joblib.Parallel(n_jobs=jobs)(joblib.delayed(score_group)(group, secret) for group in grouped)
    else:
        scored = [score_group(group, secret) for group in grouped]
    order = itertools.chain.from_iterable(groups.values())
    found = dict(zip(order, itertools.chain.from_iterable(scored), strict=True))
    return [found[index] for index in range(len(results))]


def score_group(results: Sequence[Result], secret: str | None = None) -> list[Scored]:
    """Scores of results on one walk."""
    task = make_task(results[0].task, secret)
    for result in results:
        check_walk(result, task)
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
    for name, present in task.walk_identity(result.walk).items():
        made_on = str(result.provenance.get(name, present))
        if made_on != present:
            raise ResultError(
                f"walk {result.walk!r} of {result.localizer}: its {task.id} has the digest {made_on[:12]}, the present "
                f"one {present[:12]}, so the two are not comparable: run the walk again on the present one"
            )
    split = task.split_of(result.walk)
    if split != result.split:
        raise ResultError(f"walk {result.walk!r} of {task.id} is of the {split} split, its result says {result.split}")


def _score_one(result: Result, task: Task, recording: Recording, scan_m: FloatArray) -> Scored:
    building = recording.building.name if recording.building is not None else ""
    unit = task.units.get(result.walk, building)
    if result.status == UNSUITABLE:
        return Scored({}, building, unit, np.zeros(0), np.zeros(0), *_extent(recording))
    if task.start == "unknown" and recording.building is None:
        raise ResultError(f"{task.id} gives neither a start nor a building: a silent localizer cannot be scored")
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
    )
    held = hold_at(result.estimates, recording.reference.t_s, fallback)
    return Scored(scores, building, unit, errors_m(held, recording.reference), scan_m, *_extent(recording))


def _extent(recording: Recording) -> tuple[float, int]:
    """`Scored.diagonal_m` and `Scored.level_span`."""
    corners_m, levels = recording.reference.xy_m, set(recording.reference.level.astype(int).tolist())
    if recording.building is not None:
        corners_m = np.concatenate([corners_m, np.reshape(recording.building.bounds_m(), (2, 2))])
        levels |= set(recording.building.levels)
    return float(np.hypot(*np.ptp(corners_m, axis=0))), max(levels) - min(levels)
