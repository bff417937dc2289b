"""Whether two runs of a localizer on the same walks came to the same, by score and by distance, never by bytes.

The last bits of sums differ between processors, and a filter that draws may go another way from there. A walk agrees
where its score does within 1 %, and nearly all of its answers lie where they were, as measured by its error. Of the
walks 95 % have to agree, and the others may differ by no more than seeds do. What is allowed follows from the walk
itself: noise of other walks excuses nothing, and differences of millimetres decide nothing.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Final

import numpy as np

from pdrbench.evaluation.tables import Results
from pdrbench.geometry import FloatArray
from pdrbench.metrics.statistics import mean_interval
from pdrbench.result import Result

MAX_RATIO: Final = 0.01  # by which the score of a walk may differ
MAX_FRACTION_APART: Final = 0.05  # of walks that need not agree
FLOOR_M: Final = 2e-3  # below which no difference counts: answers are stored in steps of 0.1 mm
NEAR_RATIO: Final = 0.1  # of the mean error of a walk: as far as an answer may lie from where it was
NEAR_M: Final = 0.1  # likewise where that error is not known
FRACTION_NEAR: Final = 0.95  # of the answers of a walk that have to lie so near
LOOSE_RATIO: Final = 0.1  # by which the score of a walk that does not agree may differ where no seeds say more
Run = tuple[str, int]  # walk and seed
Played = tuple[Result, float, float]  # a run, its score, and how far from an answer another one is near it


def disagreement(sent: Results, again: Results, metric: str) -> Iterator[str]:
    """What differs between runs and those made again; nothing where they came to the same.

    Args:
        sent: The runs.
        again: Of the same walks and seeds, or of some of them.
        metric: In metres or percent, by which they are scored.
    """
    before = _by_run(sent, metric)
    after = _by_run(again, metric)
    apart: dict[str, str] = {}
    for run, (result, score, _) in after.items():
        if run not in before:
            continue
        first, was, reach_m = before[run]
        where = f"walk {run[0]}, seed {run[1]}"
        if result.status != first.status:
            why = (result.failure or first.failure).strip().splitlines()[-1:] or [""]
            yield f"{where}: was {first.status}, is {result.status}{f' ({why[0][:200]})' if why[0] else ''}"
        elif result.division != first.division or dict(result.missing) != dict(first.missing):
            yield f"{where}: was {_facts(first)}, is {_facts(result)}"
        elif what := _difference(first, result, was, score, reach_m):
            apart.setdefault(run[0], f"{where}: {what}")
            if abs(score - was) > _loose(run[0], was, after):
                yield apart[run[0]]
    walks = {walk for walk, _ in after if any(walk == other for other, _ in before)}
    if len(apart) > MAX_FRACTION_APART * len(walks):
        yield f"{len(apart)} of {len(walks)} walks differ, the first is {next(iter(apart.values()))}"
    elif apart:
        yield from _means(sent, before, after)


def _by_run(results: Results, metric: str) -> dict[Run, Played]:
    found = {}
    for result, scored in zip(results.results, results.scored, strict=True):
        error_m = scored.scores.get("mean_m", math.nan)
        reach_m = NEAR_M if math.isnan(error_m) else max(NEAR_RATIO * error_m, FLOOR_M)
        found[result.walk, result.seed] = (result, scored.scores.get(metric, math.nan), reach_m)
    return found


def _facts(result: Result) -> str:
    return f"{result.division} with {sum(result.missing.values())} missing answers"


def _difference(first: Result, again: Result, was: float, score: float, reach_m: float) -> str:
    """What differs in one run; empty where it agrees."""
    one, other = first.estimates, again.estimates
    if len(one) != len(other):
        return f"{len(one)} estimates were given, {len(other)} came"
    if abs(score - was) > max(MAX_RATIO * abs(was), FLOOR_M) or math.isnan(score) != math.isnan(was):
        return f"its score was {was:.4g}, is {score:.4g}"
    if not len(one):
        return ""
    distance_m = np.hypot(*(one.xy_m - other.xy_m).T)
    both = one.given & other.given
    strange = (one.given != other.given) | (both & (one.level != other.level))
    is_near = ~strange & (~both | (distance_m <= reach_m))
    if is_near.mean() >= FRACTION_NEAR:
        return ""
    row = int(np.flatnonzero(~is_near)[0])
    return f"{int((~is_near).sum())} of {len(one)} answers lie elsewhere, the first at {one.t_s[row]:g} s"


def _loose(walk: str, was: float, after: Mapping[Run, Played]) -> float:
    """How far the score of a walk that does not agree may lie from what it was: as far as its seeds lie apart."""
    scores = [score for (other, _), (_, score, _) in after.items() if other == walk and math.isfinite(score)]
    spread = max(scores) - min(scores) if len(scores) > 1 else 0.0
    return max(LOOSE_RATIO * abs(was), spread, FLOOR_M)


def _means(sent: Results, before: Mapping[Run, Played], after: Mapping[Run, Played]) -> Iterator[str]:
    """Whether the mean over walks is outside of its interval."""
    units = {result.walk: scored.unit for result, scored in zip(sent.results, sent.scored, strict=True)}
    walks = [walk for walk in units if any(walk == other for other, _ in after)]
    was, now = _walk_means(walks, before, after), _walk_means(walks, after, before)
    kept = np.isfinite(was) & np.isfinite(now)
    if not kept.any():
        return
    of = [units[walk] for walk, keep in zip(walks, kept, strict=True) if keep]
    low, high = map(float, mean_interval(was[kept], of))
    mean = float(now[kept].mean())
    if math.isfinite(low) and not low <= mean <= high:
        yield f"the mean over walks was {was[kept].mean():.4g} ({low:.4g} to {high:.4g}), is {mean:.4g}"


def _walk_means(walks: Sequence[str], runs: Mapping[Run, Played], common: Mapping[Run, object]) -> FloatArray:
    """(W,) mean score of each walk over the seeds that both have."""
    found = [[score for run, (_, score, _) in runs.items() if run[0] == walk and run in common] for walk in walks]
    return np.array([float(np.mean(scores)) if scores else math.nan for scores in found])
