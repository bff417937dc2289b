"""Rows of a table of results: what localizers reached on an environment, over walks, seeds and strata, and ranks."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from pdrbench.evaluation.scoring import Scored
from pdrbench.geometry import FloatArray, IntArray
from pdrbench.metrics import METRICS, POOLED, Metric, pooled
from pdrbench.metrics.ranking import Ranking, rank
from pdrbench.metrics.statistics import MIN_UNITS, SUMMARIES, mean_interval, over_seeds, quantile_interval
from pdrbench.registry import make_task
from pdrbench.result import COMPLETE, FAILED, OFFLINE, UNSUITABLE, Result
from pdrbench.task import Task

Row = Mapping[str, Any]
Place = tuple[str, str, str]  # environment, split, division
WALK_VALUE: Final = "p75_level_penalised_m"  # of a walk: EvAAL
RANKING: Final = "p75_geometric_m"  # of a row: geometric mean of it over walks
DRAW_SEED: Final = 0  # the same results give the same p-values
STRATUM_METRICS: Final = ("mean_m", "p75_m", "p95_m", "p75_level_penalised_m", "level_hit_rate")
SCAN_EDGES_M: Final = (3.0, 10.0)  # of the distance to the nearest scan: beside one, between some, where none was made
SCAN_STRATA: Final = ("scan 0–3 m", "scan 3–10 m", "scan > 10 m")


@dataclass(frozen=True, slots=True)
class Played:
    """What localizers reached side by side on the walks of an environment and a split, in one division.

    Attributes:
        task: The environment.
        log_m: By localizer, (W, S) logarithms of `WALK_VALUE` by walk and seed; NaN where it declined or failed.
        units: (W,) unit of each walk.
    """

    task: Task
    log_m: Mapping[str, FloatArray]
    units: tuple[str, ...]


def side_by_side(pairs: Sequence[tuple[Result, Scored]]) -> dict[Place, Played]:
    """By environment, split and division, what all localizers were played on.

    A localizer with one seed does not draw: its walks count as those of every seed.
    """
    cells: dict[Place, dict[str, dict[tuple[str, int], float]]] = {}
    units: dict[Place, dict[str, str]] = {}
    tasks: dict[Place, Task] = {}
    for result, scored in pairs:
        place = result.env, result.split, result.division
        task = tasks.setdefault(place, make_task(result.task))
        is_complete = result.status == COMPLETE
        value = math.log(max(scored.scores[WALK_VALUE], task.noise_m)) if is_complete else math.nan
        cells.setdefault(place, {}).setdefault(result.localizer, {})[result.walk, result.seed] = value
        units.setdefault(place, {})[result.walk] = scored.unit
    return {place: _shared(task, cells[place], units[place]) for place, task in tasks.items()}


def _shared(task: Task, cells: Mapping[str, Mapping[tuple[str, int], float]], unit: Mapping[str, str]) -> Played:
    """Of the walks and seeds that every localizer was played on."""
    seeds = sorted({seed for of in cells.values() for _, seed in of})
    every = {
        name: {
            (walk, seed): of[walk, key]
            for walk, key in of
            for seed in (seeds if len({s for _, s in of}) == 1 else [key])
        }
        for name, of in cells.items()
    }
    seeds = [seed for seed in seeds if all(any(key == seed for _, key in of) for of in every.values())]
    walks = [walk for walk in unit if all((walk, seed) in of for of in every.values() for seed in seeds)]
    log_m = {name: np.array([[of[walk, seed] for seed in seeds] for walk in walks]) for name, of in every.items()}
    return Played(task, log_m, tuple(unit[walk] for walk in walks))


def ranking_of(played: Played) -> Ranking | None:
    """See `metrics.ranking`; a walk counts where every seed was played to its end. None where there is no such walk."""
    env, noise_m = played.task.id, played.task.noise_m
    values = {name: {env: np.exp(of.mean(axis=1))} for name, of in played.log_m.items() if of.size}
    if not any(np.isfinite(of[env]).any() for of in values.values()):
        return None
    rng = np.random.default_rng(DRAW_SEED)
    return rank(values, units={env: played.units}, noise_m={env: noise_m}, rng=rng)


def rows_of(
    pairs: Sequence[tuple[Result, Scored]], rankings: Mapping[Place, Ranking], against: str | None = None
) -> list[dict[str, Any]]:
    """One row for each environment, split, localizer and division, with its rank, and against another."""
    groups: dict[tuple[Place, str], list[tuple[Result, Scored]]] = {}
    for result, scored in pairs:
        place = result.env, result.split, result.division
        groups.setdefault((place, result.localizer), []).append((result, scored))
    rows = {key: _row(group, make_task(group[0][0].task)) for key, group in groups.items()}
    for place, ranking in rankings.items():
        for of in ranking.standings:
            row, smallest = rows[place, of.name], ranking.smallest_ratio()
            row |= {"rank": list(of.rank), "smallest_ratio": smallest if math.isfinite(smallest) else None}
            row["metrics"] |= {
                RANKING: _number(of.score_m, "m", of.low_m, of.high_m, of.walks),
                "ratio_to_best": _number(of.ratio, "", of.ratio_low, of.ratio_high, of.walks),
                "p_holm": _number(of.p_holm, "", math.nan, math.nan, of.walks if math.isfinite(of.p_holm) else 0),
            }
        for name, (ratio, low, high, p) in ranking.against(against or "").items():
            metrics = rows[place, name]["metrics"]
            metrics["ratio_against"] = _number(ratio, "", low, high, metrics["ratio_to_best"]["n"])
            metrics["p_against"] = _number(p, "", math.nan, math.nan, metrics["ratio_to_best"]["n"])
    return [row | ({"against": against} if against else {}) for row in rows.values()]


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
            "metrics": _metrics(part, [metric for metric in STRATUM_METRICS if metric in part[0][1].scores])
            | ({RANKING: _geometric(part, task.noise_m)} if by == "group" else {}),
        }
        for (by, name), part in parts.items()
    ]


def _geometric(part: Sequence[tuple[Result, Scored]], noise_m: float) -> dict[str, Any]:
    """Geometric mean over walks, and over the seeds of each, of what ranks."""
    unit = {result.walk: scored.unit for result, scored in part}
    log_m = np.log(
        np.maximum(_by_walk_and_seed(part, list(unit), sorted({r.seed for r, _ in part}), WALK_VALUE), noise_m)
    )
    by_walk = np.nanmean(log_m, axis=1)
    low, high = mean_interval(by_walk, list(unit.values()))
    return _number(math.exp(by_walk.mean()), "m", math.exp(low), math.exp(high), len(by_walk))


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
