"""Parameters of a localizer, chosen on some folds of the train split and scored on the others."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from pdrbench.errors import PdrbenchError, unknown_name
from pdrbench.evaluation.sweep import evaluate
from pdrbench.evaluation.tables import Results
from pdrbench.evaluation.wording import last_line
from pdrbench.geometry import FloatArray, IntArray
from pdrbench.metrics import METRICS
from pdrbench.metrics.statistics import mean_interval
from pdrbench.registry import make_task
from pdrbench.settings import with_settings
from pdrbench.task import Task

SPLIT: Final = "train"
Parameters = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Tuned:
    """What came of a choice of parameters.

    Attributes:
        metric: That was made best: the mean over walks of a score.
        candidates: Every set of parameters that was tried.
        values: (C, W) score of each of them on each walk, mean over seeds; NaN where it does not apply.
        fold: (W,) fold of each walk.
        chosen: Index of the best candidate on all folds but one, for each of these; -1 where none has a score.
        left_out: (W,) score of each walk with the parameters that were chosen without its fold.
        value: Mean of `left_out`: the figure to report.
        low: Lower end of its 95 % interval over units of replication, NaN where these are too few.
        high: Upper end.
        final: Index of the best candidate on all folds: the parameters to use from here on. Its own mean over the walks
            that chose it is too good and is no result.
    """

    metric: str
    candidates: tuple[Parameters, ...]
    values: FloatArray
    fold: IntArray
    chosen: tuple[int, ...]
    left_out: FloatArray
    value: float
    low: float
    high: float
    final: int


def folds_of(task: Task, count: int) -> dict[str, int]:
    """Fold of each walk of the train split, whole units of replication only.

    They are those that the environment states, since surveys are made without them; else units are dealt to the folds
    with the fewest walks so far, from the largest on.

    Raises:
        PdrbenchError: The environment states another number of folds, or has fewer units than folds.
    """
    walks = task.split(SPLIT)
    if task.folds:
        stated = 1 + max(task.folds.values())
        if stated != count:
            raise PdrbenchError(f"{task.id} has {stated} folds, as its surveys are made without one of them: use these")
        return {walk: task.folds[walk] for walk in walks}
    members: dict[str, list[str]] = {}
    for walk in walks:
        members.setdefault(task.units.get(walk, walk), []).append(walk)
    if not 2 <= count <= len(members):
        raise PdrbenchError(f"{task.id} has {len(members)} units in {SPLIT}, for 2 to as many folds; got {count}")
    sizes = [0] * count
    fold: dict[str, int] = {}
    for unit in sorted(members, key=lambda unit: (-len(members[unit]), unit)):
        smallest = sizes.index(min(sizes))
        sizes[smallest] += len(members[unit])
        fold |= dict.fromkeys(members[unit], smallest)
    return {walk: fold[walk] for walk in walks}


def by_fold(results: Results, count: int) -> list[dict[str, Any]]:
    """Mean error of each localizer on each fold: env, localizer, fold, walks, mean_m; NaN where it has none."""
    rows = []
    for (env, localizer), frame in results.walks().groupby(["env", "localizer"], sort=False):
        fold = frame["walk"].map(folds_of(make_task(str(env)), count))
        for k, of_fold in frame.groupby(fold):
            by_walk = of_fold.groupby("walk")["mean_m"].mean()
            mean_m = float(by_walk.mean())
            rows.append({"env": env, "localizer": localizer, "fold": int(k), "walks": len(by_walk), "mean_m": mean_m})
    return rows


def grid(parameters: Mapping[str, Sequence[Any]], most: int | None = None, seed: int = 0) -> tuple[Parameters, ...]:
    """Every combination of the values of some settings, or `most` random ones of them.

    >>> grid({"a": [1, 2], "b.c": ["x"]})
    ({'a': 1, 'b.c': 'x'}, {'a': 2, 'b.c': 'x'})
    """
    every = tuple(dict(zip(parameters, values, strict=True)) for values in itertools.product(*parameters.values()))
    if most is None or most >= len(every):
        return every
    rows = np.random.default_rng(seed).choice(len(every), most, replace=False)
    return tuple(every[row] for row in sorted(rows.tolist()))


def tune(
    localizer: str,
    env: str,
    candidates: Sequence[Parameters],
    *,
    folds: int = 5,
    metric: str = "mean_m",
    advance: Callable[[Parameters], None] = lambda _: None,
    **options: Any,
) -> Tuned:
    """Chooses parameters on the train split, and says what the choice is worth on walks that had no part in it.

    For each fold the candidate with the best mean over the walks of all others is scored on it. With `out`, what is
    stored is not computed again.

    Args:
        localizer: As for `evaluate`.
        env: Environment.
        candidates: Settings by field, as they stand in its name.
        folds: How many; see `folds_of`.
        metric: Of `METRICS`, one whose row is a mean over walks.
        advance: Called with each candidate before it is played.
        options: Of `evaluate`: seeds, jobs, out, isolation, budget, progress.

    Raises:
        PdrbenchError: As `folds_of` and `evaluate`; or no candidate has a score.
    """
    if metric not in METRICS:
        raise unknown_name("metric", metric, METRICS)
    if METRICS[metric].better == "none" or METRICS[metric].over_walks != "mean":
        raise PdrbenchError(f"{metric} cannot be tuned for: its mean over walks is not better when low or high")
    sign = -1.0 if METRICS[metric].better == "higher" else 1.0
    task = make_task(env)
    fold_of = folds_of(task, folds)
    walks, fold = list(fold_of), np.array(list(fold_of.values()))
    rows = []
    for candidate in candidates:
        advance(candidate)
        played = evaluate(with_settings(localizer, candidate), env, split=SPLIT, **options)
        frame = played.walks()
        rows.append(frame.groupby("walk")[metric].mean().reindex(walks).to_numpy(np.float64))
    values = np.array(rows).reshape(len(candidates), len(walks))
    chosen = tuple(_best(sign * values[:, fold != k]) for k in range(folds))
    final = _best(sign * values)
    if final < 0:
        why = next((f": {last_line(r.failure)}" for r in played.results if r.failure), "")
        raise PdrbenchError(
            f"{localizer} has no {metric} on the {SPLIT} split of {env} with any of the parameters{why}"
        )
    left_out = np.array([values[chosen[k], w] if chosen[k] >= 0 else math.nan for w, k in enumerate(fold)])
    units = frame.drop_duplicates("walk").set_index("walk")["unit"].reindex(walks)
    low, high = map(float, mean_interval(left_out, units.tolist(), scale=METRICS[metric].scale))
    value = float(np.nanmean(left_out))
    return Tuned(metric, tuple(candidates), values, fold, chosen, left_out, value, low, high, final)


def _best(values: FloatArray) -> int:
    """Row with the least mean over the walks that all rows with a score have; -1 where none has one."""
    rows = np.flatnonzero(~np.isnan(values).all(axis=1))
    common = ~np.isnan(values[rows]).any(axis=0)
    if not len(rows) or not common.any():
        return -1
    return int(rows[values[rows][:, common].mean(axis=1).argmin()])
