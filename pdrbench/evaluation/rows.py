"""Rows of a table of results: what localizers reached on an environment, over walks, seeds and strata, and ranks."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np

from pdrbench.evaluation.scoring import Scored
from pdrbench.geometry import FloatArray, IntArray
from pdrbench.metrics import METRICS, POOLED, Metric, pooled
from pdrbench.metrics.ranking import rank
from pdrbench.metrics.statistics import MIN_UNITS, SUMMARIES, mean_interval, over_seeds, quantile_interval
from pdrbench.registry import make_task
from pdrbench.result import COMPLETE, FAILED, OFFLINE, UNSUITABLE, Result
from pdrbench.task import Task

Row = Mapping[str, Any]
WALK_VALUE: Final = "p75_level_penalised_m"  # of a walk: EvAAL
RANKING: Final = "p75_geometric_m"  # of a row: geometric mean of it over walks
DRAW_SEED: Final = 0  # the same results give the same p-values
STRATUM_METRICS: Final = ("mean_m", "p75_m", "p95_m", "p75_level_penalised_m", "level_hit_rate")
SCAN_EDGES_M: Final = (3.0, 10.0)  # of the distance to the nearest scan: beside one, between some, where none was made
SCAN_STRATA: Final = ("scan 0–3 m", "scan 3–10 m", "scan > 10 m")


def rows_of(pairs: Sequence[tuple[Result, Scored]]) -> list[dict[str, Any]]:
    """One row for each environment, split, localizer and division, with its rank; times may be infinite."""
    groups: dict[tuple[str, str, str, str], list[tuple[Result, Scored]]] = {}
    for result, scored in pairs:
        place = (result.env, result.split, result.division, result.localizer)
        groups.setdefault(place, []).append((result, scored))
    rows = {place: _row(group, make_task(group[0][0].task)) for place, group in groups.items()}
    for board in dict.fromkeys(place[:3] for place in groups):
        of = {place[3]: group for place, group in groups.items() if place[:3] == board}
        for name, added in _ranked(of, make_task(next(iter(of.values()))[0][0].task)).items():
            row = rows[*board, name]
            row |= {**added, "metrics": row["metrics"] | added["metrics"]}
    return list(rows.values())


def _row(group: Sequence[tuple[Result, Scored]], task: Task) -> dict[str, Any]:
    """One localizer on one split of a task in one division."""
    first = group[0][0]
    walks = {result.walk for result, _ in group}
    statuses = Counter(result.status for result, _ in group)
    times_s = [result.revise_s for result, _ in group if first.division == OFFLINE and math.isfinite(result.revise_s)]
    played = [(result, scored) for result, scored in group if result.status != UNSUITABLE]
    num_units = len({scored.unit for _, scored in played})
    if num_units < MIN_UNITS:  # the walks of those people or buildings are the units then, and tables say so
        played = [(result, replace(scored, unit=result.walk)) for result, scored in played]
    return {
        "env": first.env,
        "localizer": first.localizer,
        "split": first.split,
        "division": first.division,
        "walks": len(walks - {result.walk for result, _ in group if result.status != COMPLETE}),
        "of": len(walks),
        "rank": None,
        "smallest_ratio": None,
        "seeds": len({result.seed for result, _ in group}),
        "failed": statuses[FAILED],
        "unsuitable": statuses[UNSUITABLE],
        "revise_s": float(np.mean(times_s)) if times_s else None,
        "units": num_units,
        "unit_kind": task.unit_kind,
        "start": task.start,
        "note": task.note,
        "metrics": _metrics(played, METRICS) if played else {},
        "strata": _strata(played, group, task),
    }


def _ranked(groups: Mapping[str, Sequence[tuple[Result, Scored]]], task: Task) -> dict[str, dict[str, Any]]:
    """What ranking adds to the row of each localizer of an environment, a split and a division; see `metrics.ranking`.

    A walk counts where the localizer played it to its end with every seed.
    """

    def log_m(result: Result, scored: Scored) -> float:
        return math.log(max(scored.scores[WALK_VALUE], task.noise_m)) if result.status == COMPLETE else math.nan

    logs, units = side_by_side(groups, log_m)
    if not any(np.isfinite(of).any() for of in logs.values()):
        return {}
    values = {name: {task.id: np.exp(of)} for name, of in logs.items()}
    rng = np.random.default_rng(DRAW_SEED)
    ranking = rank(values, units={task.id: units}, noise_m={task.id: task.noise_m}, rng=rng)
    smallest = ranking.smallest_ratio()
    return {
        of.name: {
            "rank": list(of.rank),
            "smallest_ratio": smallest if math.isfinite(smallest) else None,
            "metrics": {
                RANKING: _number(of.score_m, "m", of.low_m, of.high_m, of.walks),
                "ratio_to_best": _number(of.ratio, "", of.ratio_low, of.ratio_high, of.walks),
                "p_holm": _number(of.p_holm, "", math.nan, math.nan, of.walks if math.isfinite(of.p_holm) else 0),
            },
        }
        for of in ranking.standings
    }


def side_by_side(
    groups: Mapping[str, Sequence[tuple[Result, Scored]]], value: Callable[[Result, Scored], float]
) -> tuple[dict[str, FloatArray], list[str]]:
    """Per localizer (W,) means over the seeds that all have, on all walks in the same order; and the units.

    A localizer with one seed does not draw: its walks count as those of every seed. NaN where a walk was declined.
    """
    cells = {
        name: {(r.walk, r.seed): value(r, scored) if scored.scores else math.nan for r, scored in group}
        for name, group in groups.items()
    }
    unit = {result.walk: scored.unit for group in groups.values() for result, scored in group}
    seeds = sorted({seed for of in cells.values() for _, seed in of})
    for of in cells.values():
        if len({seed for _, seed in of}) == 1:
            of |= {(walk, seed): number for (walk, _), number in list(of.items()) for seed in seeds}
    shared = [[(walk, seed) for seed in seeds if all((walk, seed) in of for of in cells.values())] for walk in unit]
    walks = [walk for walk, of in zip(unit, shared, strict=True) if of]
    shared = [of for of in shared if of]
    values = {name: np.array([np.mean([cells[name][place] for place in of]) for of in shared]) for name in groups}
    return values, [unit[walk] for walk in walks]


def _number(value: float, unit: str, low: float, high: float, n: int) -> dict[str, Any]:
    return {"value": _known(value), "unit": unit, "low": _known(low), "high": _known(high), "n": n}


def _metrics(played: Sequence[tuple[Result, Scored]], names: Iterable[str]) -> dict[str, dict[str, Any]]:
    """Value, interval and number of walks of some metrics and of the pooled ones."""
    unit = {result.walk: scored.unit for result, scored in played}
    seeds = list(dict.fromkeys(result.seed for result, _ in played))
    codes = np.unique(list(unit.values()), return_inverse=True)[1]
    cubes = ((name, _by_walk_and_seed(played, list(unit), seeds, name)) for name in names)
    return {name: _entry(values, codes, METRICS[name]) for name, values in cubes} | _pooled_entries(played)


def _strata(
    played: Sequence[tuple[Result, Scored]], group: Sequence[tuple[Result, Scored]], task: Task
) -> list[dict[str, Any]]:
    """Results of the groups of walks that a task has, and of places by their distance to the nearest survey scan."""
    parts: dict[tuple[str, str], list[tuple[Result, Scored]]] = {}
    declined = Counter(
        name for result, _ in group if result.status == UNSUITABLE for name in task.groups.get(result.walk, ())
    )
    for result, scored in played:
        for name in task.groups.get(result.walk, ()):
            parts.setdefault(("group", name), []).append((result, scored))
    for number, name in enumerate(SCAN_STRATA):
        for result, scored in played:
            is_here = (np.digitize(scored.scan_m, SCAN_EDGES_M) == number) & ~np.isnan(scored.scan_m)
            errors_m = scored.errors_m[is_here]
            if len(errors_m):
                here = replace(
                    scored,
                    errors_m=errors_m,
                    penalised_m=scored.penalised_m[is_here],
                    scores={"mean_m": float(errors_m.mean())},
                )
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
    return _number(value, metric.unit, low, high, len(present))


def _pooled_entries(played: Sequence[tuple[Result, Scored]]) -> dict[str, dict[str, Any]]:
    by_walk: dict[str, list[Scored]] = {}
    for result, scored in played:
        if len(scored.errors_m):
            by_walk.setdefault(result.walk, []).append(scored)
    samples = [np.concatenate([scored.errors_m for scored in of]) for of in by_walk.values()]
    penalised_m = [np.concatenate([scored.penalised_m for scored in of]) for of in by_walk.values()]
    values = pooled(samples, penalised_m)
    units = [of[0].unit for of in by_walk.values()]
    ends = _pooled_intervals(samples, units) if samples else {}
    if samples:
        ends["pooled_p75_level_penalised_m"] = quantile_interval(penalised_m, 0.75, units)
    entries = {}
    for name, metric in POOLED.items():
        low, high = ends.get(name, (math.nan, math.nan))
        entries[name] = _number(values[name], metric.unit, low, high, len(samples))
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
