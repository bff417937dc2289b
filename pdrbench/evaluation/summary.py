"""One row of a table of results: what a localizer reached on an environment, over walks, seeds and strata."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np

from pdrbench.evaluation.scoring import Scored
from pdrbench.geometry import FloatArray, IntArray
from pdrbench.metrics import METRICS, POOLED, Metric, pooled
from pdrbench.metrics.statistics import SUMMARIES, mean_interval, over_seeds, quantile_interval, spread
from pdrbench.result import FAILED, OFFLINE, ONLINE, UNSUITABLE, Result
from pdrbench.task import Task

Row = Mapping[str, Any]
STRATUM_METRICS: Final = ("mean_m", "p75_m", "p95_m", "p75_level_penalised_m", "level_hit_rate")
SCAN_EDGES_M: Final = (3.0, 10.0)  # of the distance to the nearest scan: beside one, between some, where none was made
SCAN_STRATA: Final = ("scan 0–3 m", "scan 3–10 m", "scan > 10 m")


def summary_row(group: Sequence[tuple[Result, Scored]], task: Task) -> dict[str, Any]:
    """The results of one localizer on one split of a task as an entry of `Results.rows`; times may be infinite."""
    first = group[0][0]
    statuses = Counter(result.status for result, _ in group)
    walks = list(dict.fromkeys(result.walk for result, _ in group))
    seeds = list(dict.fromkeys(result.seed for result, _ in group))
    division, revise_s = revision_of(result for result, _ in group)
    row: dict[str, Any] = {
        "env": first.env,
        "localizer": first.localizer,
        "split": first.split,
        "walks": len(walks),
        "served": len({result.walk for result, _ in group if result.status != UNSUITABLE}),
        "seeds": len(seeds),
        "failed": statuses[FAILED],
        "unsuitable": statuses[UNSUITABLE],
        "division": division,
        "revise_s": revise_s,
        "units": len({scored.unit for result, scored in group if result.status != UNSUITABLE}),
        "unit_kind": task.unit_kind,
        "start": task.start,
        "note": task.note,
        "metrics": {},
        "strata": [],
    }
    played = [(result, scored) for result, scored in group if result.status != UNSUITABLE]
    if not played:
        return row
    row["metrics"] = _metrics(played, METRICS)
    row["strata"] = _strata(group, task)
    if len(seeds) > 1:
        by_mean = [name for name, metric in METRICS.items() if metric.over_walks == "mean"]
        spreads = {name: spread(_by_walk_and_seed(played, walks, seeds, name)) for name in by_mean}
        row["spread"] = {
            name: {"over_walks": _known(of.over_walks), "over_seeds": _known(of.over_seeds)}
            for name, of in spreads.items()
        }
    return row


def _metrics(played: Sequence[tuple[Result, Scored]], names: Iterable[str]) -> dict[str, dict[str, Any]]:
    """Value, interval and number of walks of some metrics and of the pooled ones."""
    unit = {result.walk: scored.unit for result, scored in played}
    seeds = list(dict.fromkeys(result.seed for result, _ in played))
    codes = np.unique(list(unit.values()), return_inverse=True)[1]
    cubes = ((name, _by_walk_and_seed(played, list(unit), seeds, name)) for name in names)
    return {name: _entry(values, codes, METRICS[name]) for name, values in cubes} | _pooled_entries(played)


def _strata(group: Sequence[tuple[Result, Scored]], task: Task) -> list[dict[str, Any]]:
    """Results of the groups of walks that a task has, and of places by their distance to the nearest survey scan."""
    parts: dict[tuple[str, str], list[tuple[Result, Scored]]] = {}
    declined: Counter[str] = Counter()
    for result, scored in group:
        name = task.groups.get(result.walk)
        if result.status == UNSUITABLE:
            declined.update({name} if name else ())
        elif name:
            parts.setdefault(("group", name), []).append((result, scored))
    for number, name in enumerate(SCAN_STRATA):
        for result, scored in group:
            is_here = (np.digitize(scored.scan_m, SCAN_EDGES_M) == number) & ~np.isnan(scored.scan_m)
            errors_m = scored.errors_m[is_here]
            if len(errors_m):
                here = replace(scored, errors_m=errors_m, scores={"mean_m": float(errors_m.mean())})
                parts.setdefault(("radio", name), []).append((result, here))
    return [
        {
            "by": by,
            "name": name,
            "walks": len({result.walk for result, _ in part}),
            "places": sum(len(scored.errors_m) for _, scored in part) // len({result.seed for result, _ in part}),
            "declined": declined[name] if by == "group" else 0,
            "metrics": _metrics(part, [metric for metric in STRATUM_METRICS if metric in part[0][1].scores]),
        }
        for (by, name), part in parts.items()
    ]


def _by_walk_and_seed(
    played: Sequence[tuple[Result, Scored]], walks: Sequence[str], seeds: Sequence[int], name: str
) -> FloatArray:
    """(W, S) values of one metric."""
    values = np.full((len(walks), len(seeds)), np.nan)
    walk_row = {walk: row for row, walk in enumerate(walks)}
    seed_column = {seed: column for column, seed in enumerate(seeds)}
    for result, scored in played:
        values[walk_row[result.walk], seed_column[result.seed]] = scored.scores[name]
    return values


def _entry(values: FloatArray, units: IntArray, metric: Metric) -> dict[str, Any]:
    summary = SUMMARIES[metric.over_walks]
    by_walk = over_seeds(values, summary.statistic)
    present = by_walk[~np.isnan(by_walk)]
    value = float(summary.statistic(present)) if len(present) else math.nan
    low, high = summary.interval(by_walk, units, metric.scale)
    return {"value": _known(value), "unit": metric.unit, "low": _known(low), "high": _known(high), "n": len(present)}


def _pooled_entries(played: Sequence[tuple[Result, Scored]]) -> dict[str, dict[str, Any]]:
    by_walk: dict[str, list[FloatArray]] = {}
    for result, scored in played:
        if len(scored.errors_m):
            by_walk.setdefault(result.walk, []).append(scored.errors_m)
    unit = {result.walk: scored.unit for result, scored in played}
    samples = [np.concatenate(errors) for errors in by_walk.values()]
    values = pooled(samples)
    ends = _pooled_intervals(samples, [unit[walk] for walk in by_walk]) if samples else {}
    entries = {}
    for name, metric in POOLED.items():
        low, high = (_known(end) for end in ends.get(name, (math.nan, math.nan)))
        entries[name] = {"value": _known(values[name]), "unit": metric.unit, "low": low, "high": high}
        entries[name]["n"] = len(samples)
    return entries


def _pooled_intervals(samples: Sequence[FloatArray], units: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Of the means and the percentiles of pooled samples; a largest error has none."""
    weights = [len(of) for of in samples]
    low, high = mean_interval([of.mean() for of in samples], units, weights=weights, scale="size")
    squares = mean_interval([np.mean(of**2) for of in samples], units, weights=weights, scale="size")
    return {
        "pooled_mean_m": (float(low), float(high)),
        "pooled_rmse_m": (float(np.sqrt(squares[0])), float(np.sqrt(squares[1]))),
        **{f"pooled_p{nth}_m": quantile_interval(samples, nth / 100, units) for nth in (50, 75, 90, 95)},
    }


def _known(value: float) -> float | None:
    return None if math.isnan(value) else float(value)


def finite(row: Row) -> dict[str, Any]:
    """A row as JSON can hold it, which has no infinite numbers."""
    metrics = {
        name: {key: None if value in (math.inf, -math.inf) else value for key, value in entry.items()}
        for name, entry in row["metrics"].items()
    }
    return {**row, "metrics": metrics} | ({"strata": [finite(of) for of in row["strata"]]} if "strata" in row else {})


def revision_of(results: Iterable[Result]) -> tuple[str, float | None]:
    """The division of some walks, offline where any of them is, and the mean wall time of `revise`; None if none."""
    revised = [result for result in results if result.division == OFFLINE]
    times_s = [result.revise_s for result in revised if math.isfinite(result.revise_s)]
    return OFFLINE if revised else ONLINE, float(np.mean(times_s)) if times_s else None
