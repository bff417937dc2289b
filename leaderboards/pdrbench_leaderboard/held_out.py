"""Scores on held-out walks: what ranks. Failing or declining never helps."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from pdrbench.evaluation import answers
from pdrbench.evaluation.scoring import Scored
from pdrbench.evaluation.tables import Results
from pdrbench.metrics import METRICS
from pdrbench.registry import make_task
from pdrbench.result import COMPLETE, FAILED, UNSUITABLE, Result
from pdrbench.task import HELD_OUT, commitment
from pdrbench_leaderboard.entry import encode_results
from pdrbench_leaderboard.suites import Suite
from pdrbench_leaderboard.verification import HELD_OUT_FILE, HeldOut

WORST_PCT: Final = 100.0  # of the length of the path
DIGITS: Final = 6  # of a value that is published
LOOP_RANKING: Final = "loop_closure_pct"  # where nothing but the return to the start is scored: staying is no merit


def worst_answer(metric: str, scored: Scored) -> float:
    """What a run that failed or was declined counts as; no run counts more.

    For errors in metres the diagonal of the box around the building and the reference, and the penalty for every level
    that the metric has; 100 for percentages of the path; 0 for fractions that are better when they are high.
    """
    known = METRICS[metric]
    if known.better == "higher":
        return 0.0
    if known.unit == "%":
        return WORST_PCT
    return scored.diagonal_m + float(known.constants.get("per_level_m", 0.0)) * scored.level_span


def value_of(metric: str, scored: Scored, status: str) -> float:
    """The value of one run: the worst answer where it failed or was declined, and never worse than that."""
    worst = worst_answer(metric, scored)
    if status in (FAILED, UNSUITABLE):
        return worst
    value = scored.scores.get(metric, math.nan)
    clipped = max(value, worst) if METRICS[metric].better == "higher" else min(value, worst)
    return math.nan if math.isnan(value) else clipped


def values_by_walk(metric: str, results: Sequence[Result], scored: Sequence[Scored]) -> dict[str, float]:
    """The value of each walk, mean over seeds, walks in their order."""
    runs: dict[str, list[float]] = {}
    for result, of_run in zip(results, scored, strict=True):
        runs.setdefault(result.walk, []).append(value_of(metric, of_run, result.status))
    return {walk: float(np.mean(values)) for walk, values in runs.items()}


def held_out_scores(results: Results, suite: Suite) -> tuple[HeldOut, bytes]:
    """What is published of runs on held-out walks, and the estimates, which are not before the round is over.

    Args:
        results: Of one localizer, every walk with every seed, with their secret.
        suite: Whose metrics are kept.
    """
    assert results.secret is not None
    metrics = dict.fromkeys([*suite.metrics, LOOP_RANKING])
    unit = {result.walk: scored.unit for result, scored in zip(results.results, results.scored, strict=True)}
    values = {
        metric: [_rounded(value) for value in values_by_walk(metric, results.results, results.scored).values()]
        for metric in metrics
    }
    estimates = encode_results(results.results)
    letters = {COMPLETE: "c", FAILED: "f", UNSUITABLE: "d"}
    found = HeldOut(
        round=commitment(results.secret),
        estimates_sha256=hashlib.sha256(estimates).hexdigest(),
        seeds=len({result.seed for result in results.results}),
        statuses="".join(letters[result.status] for result in results.results),
        units=tuple(_numbers([*unit.values()])),
        values={metric: tuple(of) for metric, of in values.items() if any(value is not None for value in of)},
    )
    return found, estimates


def scored_again(found: HeldOut, content: bytes, env: str, secret: str, suite: Suite) -> HeldOut:
    """The same from what was published when the round was over: its secret, and the estimates.

    Args:
        found: What a maintainer has signed.
        content: Of `held_out.bin`.
        env: Environment id.
        secret: Behind the walks.
        suite: Whose metrics were kept.

    Raises:
        ResultError: These are no estimates.
    """
    task = make_task(env, secret)
    walks = task.split(HELD_OUT)[: len(found.units)]
    statuses = {"c": COMPLETE, "f": FAILED, "d": UNSUITABLE}
    results, begin = [], 0
    for index, letter in enumerate(found.statuses):
        whole, begin = answers.decode(content, HELD_OUT_FILE, begin)
        estimates = answers.from_whole_numbers(whole, np.arange(whole.shape[1], dtype=np.float64) * task.period_s)
        where: dict[str, Any] = {"walk": walks[index // found.seeds], "seed": index % found.seeds}
        step_s = np.full(len(estimates), np.nan)
        results.append(
            Result(
                task.id, HELD_OUT, localizer="", estimates=estimates, step_s=step_s, status=statuses[letter], **where
            )
        )
    return held_out_scores(Results(tuple(results), secret=secret), suite)[0]


def _rounded(value: float) -> float | None:
    return None if math.isnan(value) else float(f"{value:.{DIGITS}g}")


def _numbers(units: Sequence[str]) -> list[int]:
    """Units as numbers in the order of their first walk: their names are those of buildings and people."""
    known = list(dict.fromkeys(units))
    return [known.index(unit) for unit in units]
