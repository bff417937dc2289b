"""Score: answers to drawn walks meet their truth; what is kept of them is packed."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from pdrbench.evaluation import answers
from pdrbench.geometry import FloatArray
from pdrbench.metrics import hold_at
from pdrbench.metrics import score as score_estimates
from pdrbench.metrics.competition import penalised_errors_m
from pdrbench.metrics.level import level_differences
from pdrbench.metrics.position import errors_m
from pdrbench.result import COMPLETE, FAILED, ONLINE, UNSUITABLE, Result
from pdrbench.trajectory import Estimates, Trajectory
from pdrbench_leaderboard.boards import P75
from pdrbench_leaderboard.draw import DrawnPart, Truth, read_truth

# Metrics of a walk that are kept, and what they are called in an entry
METRICS: Final[Mapping[str, str]] = {
    "p75_m": P75,
    "mean_m": "mean_m",
    "p95_m": "p95_m",
    "level": "level_hit_rate",
    "coverage": "coverage_95",
    "outside_pct": "outside_pct",
}
VALUES: Final = (*METRICS, "found_s", "load")
FOUND_M: Final = 5.0  # a walk whose start is unknown is found where an answer is so near, on the right level
QUANTILES: Final = np.linspace(0.0, 1.0, 201)  # of the error over all moments of a part
DIGITS: Final = 4  # of a value that is kept: the fifth is below any difference that a board can tell
LETTERS: Final = {COMPLETE: "c", FAILED: "f", UNSUITABLE: "d"}


@dataclass(frozen=True, slots=True)
class ScoredPart:
    """What came of one localizer on one part of an environment, in one division.

    Attributes:
        statuses: A letter for each walk, in the order of names: "c" complete, "f" failed, "d" declined.
        failures: How many walks failed or were declined, by the last line of the reason.
        values: By name of `METRICS`, "found_s" and "load": (W,), NaN where a walk was not played to its end. "found_s"
            is the time to the first answer within 5 m, infinite where there is none; "load" is processor time over the
            time of the walk.
        moments: Scored moments of the walks that were played.
        quantiles_m: Of the level-penalised error over them, at `QUANTILES`.
        answers: Packed: those at the scored moments of each walk, one walk after the other.
    """

    division: str
    statuses: str
    failures: Mapping[str, int]
    values: Mapping[str, FloatArray]
    moments: int
    quantiles_m: FloatArray
    answers: bytes


@dataclass(frozen=True, slots=True)
class _ScoredWalk:
    values: dict[str, float]
    errors_m: FloatArray  # level-penalised
    whole: answers.Whole  # (6, M) answers at the scored moments


def kept_metrics(metric: str = P75) -> Mapping[str, str]:
    """Metrics of a walk by what they are called in an entry, on a board that ranks by one of them."""
    return METRICS if metric == P75 else {**METRICS, metric: metric}


def score_part(
    drawn: DrawnPart, results: Sequence[Result], *, metric: str = P75, jobs: int = 1
) -> dict[tuple[str, str], ScoredPart]:
    """Scores of each localizer by its name and division.

    Args:
        drawn: The walks.
        results: Of one or more localizers on all of them, as `play` returns them.
        metric: That ranks.
        jobs: Processes.
    """
    import joblib

    by_walk: dict[str, list[Result]] = {name: [] for name in drawn.walks}
    for result in results:
        if result.walk in by_walk:  # canaries have no truth
            by_walk[result.walk].append(result)
    tasks = (joblib.delayed(_score_walk)(drawn, name, of, metric) for name, of in by_walk.items())
    scored = joblib.Parallel(n_jobs=jobs)(tasks)
    found: dict[tuple[str, str], list[tuple[Result, _ScoredWalk]]] = {}
    for of_walk, of_scored in zip(by_walk.values(), scored, strict=True):
        for result, one in zip(of_walk, of_scored, strict=True):
            found.setdefault((result.localizer, result.division), []).append((result, one))
    return {place: _part(pairs, (*kept_metrics(metric), *VALUES)) for place, pairs in found.items()}


def _score_walk(drawn: DrawnPart, name: str, results: Sequence[Result], metric: str) -> list[_ScoredWalk]:
    truth = read_truth(drawn, name)
    return [_score_one(result, truth, metric) for result in results]


def _score_one(result: Result, truth: Truth, metric: str) -> _ScoredWalk:
    """Scores what is packed: the answers in force at the scored moments, as they are rounded."""
    reference = truth.reference
    kept = at_moments(result.estimates, truth)
    whole = answers.whole_numbers(kept, answers.COARSE)
    if result.status != COMPLETE:
        return _ScoredWalk({}, np.zeros(0), whole)
    estimates = answers.from_whole_numbers(whole, reference.t_s, answers.COARSE)
    values = walk_values(estimates, truth, metric)
    values["load"] = _cpu_s(result) / truth.duration_s if truth.duration_s > 0 else math.nan
    held = hold_at(estimates, reference.t_s, truth.fallback)
    return _ScoredWalk(values, penalised_errors_m(held, reference), whole)


def at_moments(estimates: Estimates, truth: Truth) -> Estimates:
    """The answers in force at the scored moments; missing where none was given yet. Headings are left out."""
    held = hold_at(estimates, truth.reference.t_s, truth.fallback)
    is_answer = held.is_answer
    nan = np.full(len(held), math.nan)
    return Estimates(
        t_s=truth.reference.t_s,
        xy_m=np.where(is_answer[:, None], held.xy_m, math.nan),
        level=np.where(is_answer, held.level, math.nan),
        heading_rad=nan,
        sigma_m=np.where(is_answer, held.sigma_m, math.nan),
        converged=nan,
    )


def walk_values(estimates: Estimates, truth: Truth, metric: str = P75) -> dict[str, float]:
    """Metrics of a walk from its packed answers."""
    reference, kept = truth.reference, kept_metrics(metric)
    scores = score_estimates(estimates, reference, truth.building, truth.fallback, names=kept.values())
    return {name: scores[of] for name, of in kept.items()} | {"found_s": _found_s(estimates, truth)}


def _found_s(estimates: Estimates, truth: Truth) -> float:
    """Time of the first answer within 5 m on the right level; infinite where there is none."""
    reference: Trajectory = truth.reference
    held = hold_at(estimates, reference.t_s, truth.fallback)
    is_found = held.is_answer & (errors_m(held, reference) <= FOUND_M) & (level_differences(held, reference) == 0)
    return float(reference.t_s[is_found.argmax()]) if is_found.any() else math.inf


def _cpu_s(result: Result) -> float:
    """Processor time of a localizer on a walk; the time that its calls took where the former is not known."""
    child: Any = result.provenance.get("child")
    known: Any = child.get("cpu_s") if isinstance(child, Mapping) else result.provenance.get("cpu_s")
    return float(known) if known else float(np.nansum([result.reset_s, np.nansum(result.step_s)]))


def _part(pairs: Sequence[tuple[Result, _ScoredWalk]], names: Sequence[str]) -> ScoredPart:
    errors = np.concatenate([np.zeros(0), *(one.errors_m for _, one in pairs)])
    failures = Counter(last_line(result.failure) for result, _ in pairs if result.status != COMPLETE)
    return ScoredPart(
        division=pairs[0][0].division if pairs else ONLINE,
        statuses="".join(LETTERS[result.status] for result, _ in pairs),
        failures=dict(failures.most_common()),
        values={name: np.array([one.values.get(name, math.nan) for _, one in pairs]) for name in names},
        moments=len(errors),
        quantiles_m=np.quantile(errors, QUANTILES) if len(errors) else np.zeros(0),
        answers=answers.encode(np.concatenate([one.whole for _, one in pairs], axis=1)),
    )


def last_line(text: str) -> str:
    """What happened, without the traceback, which names folders of a machine."""
    return (text.strip().splitlines() or [""])[-1][:200]
