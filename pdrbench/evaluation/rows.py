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
from pdrbench.metrics.statistics import SUMMARIES, compare_pairs, mean_interval, over_seeds, quantile_interval
from pdrbench.registry import make_task
from pdrbench.result import FAILED, OFFLINE, UNSUITABLE, Result
from pdrbench.task import Task

Row = Mapping[str, Any]
WALK_VALUE: Final = "p75_level_penalised_m"  # of a walk: EvAAL
RANKING: Final = "p75_geometric_m"  # of a row: geometric mean of it over walks
MIN_RANKED_M: Final = 0.01  # no walk counts as better: surveyed positions are no more exact
SIGNIFICANT: Final = 0.05  # p-value, corrected, below which two localizers are told apart
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
        for name, (rank, metrics) in _ranked(of).items():
            rows[*board, name]["rank"] = rank
            rows[*board, name]["metrics"] |= metrics
    return list(rows.values())


def _row(group: Sequence[tuple[Result, Scored]], task: Task) -> dict[str, Any]:
    """One localizer on one split of a task in one division."""
    first = group[0][0]
    statuses = Counter(result.status for result, _ in group)
    times_s = [result.revise_s for result, _ in group if first.division == OFFLINE and math.isfinite(result.revise_s)]
    played = [(result, scored) for result, scored in group if result.status != UNSUITABLE]
    return {
        "env": first.env,
        "localizer": first.localizer,
        "split": first.split,
        "division": first.division,
        "walks": len({result.walk for result, _ in played}),
        "of": len({result.walk for result, _ in group}),
        "rank": None,
        "seeds": len({result.seed for result, _ in group}),
        "failed": statuses[FAILED],
        "unsuitable": statuses[UNSUITABLE],
        "revise_s": float(np.mean(times_s)) if times_s else None,
        "units": len({scored.unit for _, scored in played}),
        "unit_kind": task.unit_kind,
        "start": task.start,
        "note": task.note,
        "metrics": _metrics(played, METRICS) if played else {},
        "strata": _strata(group, task) if played else [],
    }


def _ranked(groups: Mapping[str, Sequence[tuple[Result, Scored]]]) -> dict[str, tuple[list[int], dict[str, Any]]]:
    """Rank and metrics of ranking of each localizer of an environment, a split and a division.

    Localizers are ranked by the geometric mean over walks of the third quartile of the level-penalised error, and told
    apart by the logarithms of those on the same walks and seeds. The rank is an interval: of the places that the paired
    tests cannot exclude.
    """
    values, units = side_by_side(groups, lambda scored: math.log(max(scored.scores[WALK_VALUE], MIN_RANKED_M)))
    values = {name: of for name, of in values.items() if np.isfinite(of).any()}
    if not values:
        return {}
    means = {name: float(np.nanmean(of)) for name, of in values.items()}
    best = min(means, key=means.__getitem__)
    found = compare_pairs(values, rng=np.random.default_rng(DRAW_SEED), units=units) if len(values) > 1 else ()
    ahead, behind = Counter[str](), Counter[str]()
    to_best: dict[str, tuple[float, float, float, int, float]] = {}
    for pair in found:
        if pair.p_holm < SIGNIFICANT and math.isfinite(pair.low):
            ahead[pair.second if pair.effect < 0 else pair.first] += 1
            behind[pair.first if pair.effect < 0 else pair.second] += 1
        if best in (pair.first, pair.second) and pair.num_walks:
            is_first = best == pair.first
            ends = (-pair.effect, -pair.high, -pair.low) if is_first else (pair.effect, pair.low, pair.high)
            effect, low, high = map(math.exp, ends)
            to_best[pair.second if is_first else pair.first] = effect, low, high, pair.num_walks, pair.p_holm
    ranked = {}
    for name, of in values.items():
        low, high = map(math.exp, mean_interval(of, units))
        metrics = {RANKING: _number(math.exp(means[name]), "m", low, high, int(np.isfinite(of).sum()))}
        if name == best:
            metrics["ratio_to_best"] = _number(1.0, "", math.nan, math.nan, int(np.isfinite(of).sum()))
        elif name in to_best:
            ratio, low, high, num_walks, p_holm = to_best[name]
            metrics["ratio_to_best"] = _number(ratio, "", low, high, num_walks)
            is_tested = math.isfinite(low)  # too few units say nothing
            p_value = p_holm if is_tested else math.nan
            metrics["p_holm"] = _number(p_value, "", math.nan, math.nan, num_walks if is_tested else 0)
        ranked[name] = [1 + ahead[name], len(values) - behind[name]], metrics
    return ranked


def side_by_side(
    groups: Mapping[str, Sequence[tuple[Result, Scored]]], value: Callable[[Scored], float]
) -> tuple[dict[str, FloatArray], list[str]]:
    """Per localizer (W,) values on all walks in the same order, over the seeds that all have; and the units.

    A localizer with one seed does not draw: its walks count as those of every seed. NaN where a walk was declined.
    """
    cells = {
        name: {(result.walk, result.seed): value(scored) if scored.scores else math.nan for result, scored in group}
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
    values = {name: np.array([_mean(cells[name][place] for place in of) for of in shared]) for name in groups}
    return values, [unit[walk] for walk in walks]


def _mean(numbers: Iterable[float]) -> float:
    """Of the numbers that are not NaN."""
    known = [number for number in numbers if not math.isnan(number)]
    return sum(known) / len(known) if known else math.nan


def _number(value: float, unit: str, low: float, high: float, n: int) -> dict[str, Any]:
    return {"value": _known(value), "unit": unit, "low": _known(low), "high": _known(high), "n": n}


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
        for name in task.groups.get(result.walk, ()):
            if result.status == UNSUITABLE:
                declined[name] += 1
            else:
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
    return _number(value, metric.unit, low, high, len(present))


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
