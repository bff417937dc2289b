"""The same walks under two surveys, compared walk by walk."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from pdrbench.evaluation.tables import Results
from pdrbench.geometry import FloatArray
from pdrbench.registry import make_task
from pdrbench_envs.malls.environment import played_walks
from pdrbench_envs.malls.splits import walks


def paired(env: str, other: str, play: Callable[[str], Results]) -> dict[str, Any]:
    """Mean errors of a localizer on an environment and on another with the same walks, and their difference.

    Args:
        env: Whose surveys lack the session of a walk.
        other: `path/to/file.py:function` of the one whose surveys hold it.
        play: Plays a split of the environment that it is given.
    """
    without, within = (_errors(play(place)) for place in (env, other))
    both = [walk for walk in without if walk in within]
    task = make_task(env)
    sessions = Counter(walk.session for walk in walks())
    shared = [walk for walk in both if sessions[played_walks()[walk].session] > 1]
    difference_m = np.array([without[walk] - within[walk] for walk in both])
    return {
        "env": env,
        "walks": len(both),
        "of longer sessions": len(shared),
        "own session in": round(float(np.mean([within[walk] for walk in both])), 2),
        "left out": round(float(np.mean([without[walk] for walk in both])), 2),
        "difference": round(float(difference_m.mean()), 2),
        "standard error": round(clustered_mean(difference_m, [task.units[walk] for walk in both])[1], 2),
        "outings": len({task.units[walk] for walk in both}),
    }


def _errors(results: Results) -> dict[str, float]:
    """Mean error in metres by walk, of the walks that were answered."""
    frame = results.walks()
    played = frame[np.isfinite(frame["mean_m"])]
    return dict(zip(played["walk"], played["mean_m"], strict=True))


def clustered_mean(values: FloatArray, units: Sequence[str], weights: FloatArray | None = None) -> tuple[float, float]:
    """Weighted mean of (W,) values, which depend on each other where they share a unit, and its standard error.

    sqrt(K / (K - 1) sum_u (sum_{i in u} w_i (x_i - mean))^2) / sum_i w_i with K units: the cluster-robust variance of a
    mean (Liang & Zeger 1986) with its small-sample factor; NaN below two units.
    """
    weight = np.ones(len(values)) if weights is None else weights
    mean = float(np.average(values, weights=weight))
    residual = weight * (values - mean)
    sums = np.array([residual[[unit == each for each in units]].sum() for unit in sorted(set(units))])
    if len(sums) < 2:
        return mean, math.nan
    return mean, math.sqrt(len(sums) / (len(sums) - 1) * float((sums**2).sum())) / float(weight.sum())
