"""Many results as tables: scores by walk, means over walks with intervals, paired comparisons."""

from __future__ import annotations

import functools
import json
import math
import re
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from pdrbench.errors import PdrbenchError, ResultError, unknown_name
from pdrbench.evaluation import store
from pdrbench.evaluation.looks import look_notes
from pdrbench.evaluation.number_text import NOTHING, decimals
from pdrbench.evaluation.scoring import Scored, score_all
from pdrbench.geometry import FloatArray, IntArray
from pdrbench.metrics import METRICS, POOLED, Metric, pooled
from pdrbench.metrics.statistics import (
    MIN_UNITS,
    SUMMARIES,
    TESTS,
    compare_pairs,
    mean_interval,
    over_seeds,
    quantile_interval,
    spread,
)
from pdrbench.registry import make_task
from pdrbench.result import FAILED, OFFLINE, ONLINE, UNSUITABLE, Result, shown_name
from pdrbench.task import Task

if TYPE_CHECKING:
    import pandas as pd

IDENTITY: Final = ("env", "localizer", "split", "walk", "seed")
SHOWN: Final = (
    "mean_m",
    "pooled_mean_m",
    "p50_m",
    "p75_m",
    "p95_m",
    "p75_level_penalised_m",
    "level_hit_rate",
    "availability",
    "step_p50_ms",
)
Row = Mapping[str, Any]
KNOWN_START: Final = "pose"  # of `Task.start`: there is no place to find


def _is_without_map(row: Row) -> bool:
    """Whether no localizer is given a map: the only frame is the one in which the walk began."""
    return bool(row.get("start") == KNOWN_START and not row["metrics"].get("outside_pct", {}).get("n", 0))


def _is_aligned(row: Row) -> bool:
    """Whether there is no map, and the walks were turned onto their references: one place fixes no direction."""
    unturned = row["metrics"].get("ate_se2_translation_only", {}).get("value")
    return _is_without_map(row) and unturned is not None and unturned < 1


# What a table shows besides, where one of its rows has a value, and when.
SHOWN_WHERE: Final[Mapping[str, Callable[[Row], bool]]] = {
    "convergence_s": lambda row: row.get("start", KNOWN_START) != KNOWN_START,
    "ate_se2_aligned_m": _is_aligned,
    "loop_closure_pct": _is_without_map,
    "claimed_correct": lambda _: True,
    "energy_score_m": lambda _: True,
    "coverage_95": lambda _: True,
    "outside_pct": lambda _: True,
}
# What has to agree for results of one localizer on one environment to belong in one row.
VARIANT: Final = (
    *("task_sha256", "environment_sha256", "core_sha256", "localizer_sha256", "parameters", "budget", "versions"),
)
STRATUM_METRICS: Final = ("mean_m", "p75_m", "p95_m", "p75_level_penalised_m", "level_hit_rate")
SCAN_EDGES_M: Final = (3.0, 10.0)  # of the distance to the nearest scan: beside one, between some, where none was made
SCAN_STRATA: Final = ("scan 0–3 m", "scan 3–10 m", "scan > 10 m")
DRAW_SEED: Final = 0  # the same results give the same intervals


@dataclass(frozen=True)
class Results:
    """What came of a sweep; scores are computed when they are first asked for.

    Attributes:
        results: In the order of environments, walks, localizers, seeds.
        jobs: Processes that compute the scores.
        secret: Behind the walks, where they are held out.
    """

    results: tuple[Result, ...]
    jobs: int = 1
    secret: str | None = field(default=None, repr=False)

    def __len__(self) -> int:
        return len(self.results)

    def __repr__(self) -> str:
        counts = Counter(result.status for result in self.results)
        return f"Results({', '.join(f'{count} {status}' for status, count in counts.items()) or 'none'})"

    @functools.cached_property
    def scored(self) -> tuple[Scored, ...]:
        """Scores of each result."""
        return tuple(score_all(self.results, self.jobs, self.secret))

    def walks(self) -> pd.DataFrame:
        """One row for each environment, localizer, walk and seed, with every metric; NaN where it does not apply."""
        import pandas as pd

        rows = [
            {name: getattr(result, name) for name in IDENTITY}
            | {"status": result.status, "division": result.division, "building": scored.building, "unit": scored.unit}
            | {name: scored.scores.get(name, math.nan) for name in METRICS}
            for result, scored in zip(self.results, self.scored, strict=True)
        ]
        return pd.DataFrame(rows, columns=[*IDENTITY, "status", "division", "building", "unit", *METRICS])

    def rows(self) -> list[dict[str, Any]]:
        """The summary as `compare --json` prints it: one entry for each environment, split and localizer.

        `value` is the mean over walks of the mean over seeds, or the median of the median where the metric says so;
        `low` and `high` bound its 95 % interval by the spread of whole units (`metrics.statistics.mean_interval`), None
        below four; `units` and `unit_kind` say of how many of what. `n` is the number of walks that have the metric,
        `served` that of the walks that were not declined. Names with `pooled_` are over all positions of all walks and
        seeds together. What does not apply is None; so is a time that is infinite, which `n` shows: a value that is
        None for more than 0 walks.

        `strata` holds the same of parts of the results: walks of one of the task's groups (`by` "group"), places by
        their distance to the nearest scan of a recorded survey ("radio"); `declined` counts runs that were declined.

        `division` is "offline" where estimates of any walk were revised when it was over; `revise_s` is the mean wall
        time which that took, None where it was not done.
        """
        return [_finite(row) for row in self._rows]

    @functools.cached_property
    def _rows(self) -> list[dict[str, Any]]:
        groups: dict[tuple[str, str, str], list[tuple[Result, Scored]]] = {}
        for result, scored in zip(self.results, self.scored, strict=True):
            groups.setdefault((result.env, result.split, result.localizer), []).append((result, scored))
        return [_row(group) for group in groups.values()]

    def frame(self) -> pd.DataFrame:
        """The summary, one line for each environment, split, localizer and metric; infinite is what never happened."""
        import pandas as pd

        columns = ["env", "localizer", "split", "walks", "stratum", "metric"]
        columns += ["value", "unit", "low", "high", "n", "division"]
        lines = [
            {name: row[name] for name in ("env", "localizer", "split", "walks", "division")}
            | {"stratum": name, "metric": metric, **entry}
            for row in self._rows
            for name, part in (("", row), *((of["name"], of) for of in row["strata"]))
            for metric, entry in part["metrics"].items()
        ]
        frame = pd.DataFrame(lines, columns=columns)
        return frame.astype(dict.fromkeys(("value", "low", "high"), np.float64))

    def pairs(self, metric: str = "mean_m", *, test: str = "sign-flip") -> pd.DataFrame:
        """Every two localizers on the same walks and seeds, for each environment and split.

        Args:
            metric: Of `METRICS`.
            test: "sign-flip" or "wilcoxon"; p-values are adjusted by Holm within each environment and split.

        Returns:
            env, split, metric, and the fields of `metrics.statistics.Comparison`.
        """
        import pandas as pd

        if metric not in METRICS:
            raise unknown_name("metric", metric, METRICS)
        better = METRICS[metric].better
        if better == "none":
            raise PdrbenchError(f"{metric} is neither better when low nor when high: there is nothing to compare")
        if METRICS[metric].over_walks != "mean":
            raise PdrbenchError(
                f"{metric} may be infinite, and infinite times have no differences; compare a share, as converged_60s"
            )
        if test not in TESTS:
            raise unknown_name("paired test", test, TESTS)
        found = []
        for (env, split), walks in self.walks().groupby(["env", "split"], sort=False):
            values, units = _side_by_side(walks, metric)
            rng = np.random.default_rng(DRAW_SEED)
            for pair in compare_pairs(values, rng=rng, units=units, better=better, test=test):
                found.append({"env": env, "split": split, "metric": metric} | asdict(pair))
        return pd.DataFrame(found)

    def table(self) -> str:
        """Plain text: one line for each environment, split and localizer, and what to know when reading it."""
        text = []
        for header, lines in self._tables():
            widths = [max(len(line[column]) for line in [header, *lines]) for column in range(len(header))]
            rule = ["-" * width for width in widths]
            padded = [[cell.ljust(w) for cell, w in zip(line, widths, strict=True)] for line in (header, rule, *lines)]
            text += [*("  ".join(line).rstrip() for line in padded), ""]
        return "\n".join([*text, *self._notes()])

    def to_markdown(self) -> str:
        """The tables in Markdown."""
        text = []
        for header, lines in self._tables():
            table = [header, [":--"] * NUM_NAMES + ["--:"] * (len(header) - NUM_NAMES), *lines]
            text += ["| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in table] + [""]
        return "\n".join([*text, *(f"* {note}" for note in self._notes()), ""])

    def to_latex(self) -> str:
        """The tables in LaTeX, for the package booktabs."""
        text = []
        for header, lines in self._tables():
            text += [
                rf"\begin{{tabular}}{{{'l' * NUM_NAMES}{'r' * (len(header) - NUM_NAMES)}}}",
                r"\toprule",
                " & ".join(_latex(cell) for cell in header) + r" \\",
                r"\midrule",
                *(" & ".join(_latex(cell) for cell in line) + r" \\" for line in lines),
                r"\bottomrule",
                r"\end{tabular}",
            ]
        return "\n".join([*text, *(f"% {note}" for note in self._notes()), ""])

    def to_csv(self, path: Path | str | None = None) -> str:
        """`frame` as CSV; also written to `path` where one is given."""
        return _written(str(self.frame().to_csv(index=False)), path)

    def to_json(self, path: Path | str | None = None) -> str:
        """`{"rows": rows()}` as JSON; also written to `path` where one is given."""
        return _written(json.dumps({"rows": self.rows()}, indent=2, allow_nan=False) + "\n", path)

    def _tables(self) -> list[tuple[list[str], list[list[str]]]]:
        """The summary, and for each environment and split with strata another table."""
        by_split: dict[tuple[str, str], list[Row]] = {}
        for row in self._rows:
            by_split.setdefault((row["env"], row["split"]), []).append(row)
        found = [self._cells()]
        for (env, split), rows in by_split.items():
            header, lines = strata_cells(rows, _cell)
            if lines:
                found.append((["env", "split", *header], [[env, split, *line] for line in lines]))
        return found

    def _cells(self) -> tuple[list[str], list[list[str]]]:
        names = [*SHOWN, *shown_besides(self._rows)]
        lines = [
            [row["env"], row["split"], shown_name(row["localizer"], row["division"]), _walks(row)]
            + [_cell(row["metrics"].get(name)) for name in names]
            for row in self._rows
        ]
        return ["env", "split", "localizer", "walks", *names], lines

    def _notes(self) -> list[str]:
        """What to know when reading the table."""
        notes = [
            "mean over walks (seeds averaged first), pooled_ over all positions; percentiles by Hazen",
            *dict.fromkeys(f"{r['env']}: {describe_interval(r['units'], r['unit_kind'])}" for r in self._rows),
        ]
        medians = [name for name in shown_besides(self._rows) if METRICS[name].over_walks == "median"]
        if medians:
            notes.append(f"median over walks, never where half of them have none: {', '.join(medians)}")
        for row in self._rows:
            who = f"{row['localizer']} on {row['env']}"
            if row["division"] == OFFLINE:
                notes.append(f"{who}: {describe_offline(row['revise_s'])}")
            if row["seeds"] > 1:
                notes.append(f"{who}: {row['seeds']} seeds")
            if row["failed"]:
                notes.append(f"{who}: {row['failed']} runs failed and are scored with what was answered before")
            if row["unsuitable"]:
                notes.append(f"{who}: {row['unsuitable']} runs declined and not scored")
        notes += dict.fromkeys(f"{row['env']}: {row['note']}" for row in self._rows if row["note"])
        notes += look_notes(result.provenance for result in self.results)
        machines = dict.fromkeys(machine_text(result.provenance.get("machine")) for result in self.results)
        return [*notes, *(f"time measured on {machine}" for machine in machines if machine)]


NUM_NAMES: Final = 3  # env, split, localizer
NOT_APPLICABLE: Final = "n/a"  # a stratum that a localizer declines


def strata_cells(
    rows: Sequence[Row], cell: Callable[[dict[str, Any] | None], str]
) -> tuple[list[str], list[list[str]]]:
    """Header and lines of a table by stratum, two lines a localizer: mean over walks, and over all places together.

    Args:
        rows: Of one environment and split, as `Results.rows` has them.
        cell: Text of an entry of `metrics`, None where the localizer was not scored there.
    """
    every = [(row, {of["name"]: of for of in row.get("strata", ())}) for row in rows]
    sizes: dict[str, tuple[int, int]] = {}
    for part in (part for _, parts in every for part in parts.values()):
        sizes[part["name"]] = max((part["walks"], part["places"]), sizes.get(part["name"], (0, 0)))
    names = [name for name in sizes if name not in SCAN_STRATA] + [name for name in SCAN_STRATA if name in sizes]
    header = [f"{name}: {counted('walk', sizes[name][0])}, {counted('place', sizes[name][1])}" for name in names]
    lines = [
        [shown_name(row["localizer"], row["division"]), metric]
        + [cell(parts[name]["metrics"][metric]) if name in parts else NOT_APPLICABLE for name in names]
        for row, parts in every
        for metric in ("mean_m", "pooled_mean_m")
        if parts
    ]
    return ["localizer", "metric", *header], lines


def _walks(row: Row) -> str:
    """Number of walks of a row, and how many of them the localizer did not decline."""
    return str(row["walks"]) if row["served"] == row["walks"] else f"{row['served']} of {row['walks']}"


def describe_offline(revise_s: float | None) -> str:
    """What to know of a row whose answers were revised; `revise_s` is the mean wall time of that.

    >>> describe_offline(0.01234)
    'offline: answers were revised when the walk was over, in 0.012 s a walk'
    """
    how_long = "" if revise_s is None else f", in {revise_s:.2g} s a walk"
    return f"offline: answers were revised when the walk was over{how_long}"


def describe_interval(num_units: int, kind: str) -> str:
    """Of what the intervals of a table are, or why it has none.

    >>> describe_interval(60, "session")
    '95 % intervals by the spread of 60 sessions'
    >>> describe_interval(1, "person")
    'no intervals: 1 person, and fewer than 4 are too few for any'
    """
    if num_units >= MIN_UNITS:
        return f"95 % intervals by the spread of {counted(kind, num_units)}"
    return f"no intervals: {counted(kind, num_units)}, and fewer than {MIN_UNITS} are too few for any"


def counted(noun: str, count: int) -> str:
    """So many of something.

    >>> counted("session", 1), counted("person", 3)
    ('1 session', '3 people')
    """
    return f"1 {noun}" if count == 1 else f"{count} people" if noun == "person" else f"{count} {noun}s"


def revision_of(results: Iterable[Result]) -> tuple[str, float | None]:
    """The division of some walks, offline where any of them is, and the mean wall time of `revise`; None if none."""
    revised = [result for result in results if result.division == OFFLINE]
    times_s = [result.revise_s for result in revised if math.isfinite(result.revise_s)]
    return OFFLINE if revised else ONLINE, float(np.mean(times_s)) if times_s else None


def shown_besides(rows: Sequence[Row]) -> list[str]:
    """Metrics that a table of these rows shows besides `SHOWN`."""
    return [
        name
        for name, applies in SHOWN_WHERE.items()
        if any(applies(row) and row["metrics"].get(name, {}).get("n", 0) for row in rows)
    ]


def load_results(folder: Path | str) -> Results:
    """Reads a folder of stored results, or one result file.

    Where a folder holds results of several versions of a localizer, of its parameters or of an environment, those
    stored last are taken, and a warning says how many were left out.

    Raises:
        ResultError: There is none, or one is torn.
    """
    folder = Path(folder)
    paths = [folder] if folder.is_file() else sorted(folder.glob(f"*{store.SUFFIX}"))
    if not paths:
        raise ResultError(
            f"no results in {folder}; evaluate(..., out=folder) or `pdrbench run --out` stores them there"
        )
    stored = [(path.stat().st_mtime_ns, store.load(path)) for path in paths]
    newest: dict[tuple[str, str], tuple[int, str]] = {}
    for time_ns, result in stored:
        place = (result.env, result.localizer)
        newest[place] = max(newest.get(place, (0, "")), (time_ns, _variant(result)))
    kept = [result for _, result in stored if newest[result.env, result.localizer][1] == _variant(result)]
    if len(kept) < len(stored):
        left_out = len(stored) - len(kept)
        warnings.warn(f"{left_out} results in {folder} are of older versions and are left out", stacklevel=2)
    return Results(tuple(_in_order(kept)))


def _in_order(results: Sequence[Result]) -> list[Result]:
    """Walks in the order of their split where the environment is known, else by name."""

    def place(result: Result) -> tuple[Any, ...]:
        walks = make_task(result.task).walks.get(result.split, ())
        rank = walks.index(result.walk) if result.walk in walks else len(walks)
        return result.env, result.split, rank, result.walk, result.localizer, result.seed

    return sorted(results, key=place)


def _variant(result: Result) -> str:
    return json.dumps({name: result.provenance.get(name) for name in VARIANT}, sort_keys=True)


def _row(group: Sequence[tuple[Result, Scored]]) -> dict[str, Any]:
    first = group[0][0]
    task = make_task(first.task)
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


def _finite(row: Row) -> dict[str, Any]:
    """A row as JSON can hold it, which has no infinite numbers."""
    metrics = {
        name: {key: None if value in (math.inf, -math.inf) else value for key, value in entry.items()}
        for name, entry in row["metrics"].items()
    }
    return {**row, "metrics": metrics} | ({"strata": [_finite(of) for of in row["strata"]]} if "strata" in row else {})


def _side_by_side(walks: pd.DataFrame, metric: str) -> tuple[dict[str, FloatArray], list[str]]:
    """Per localizer (W,) values on all walks in the same order, over the seeds that all have; and the units.

    A localizer with one seed does not draw: its walks count as those of every seed.
    """
    wide = walks.pivot(index=["walk", "seed"], columns="localizer", values=metric)
    tried = walks.assign(tried=True).pivot(index=["walk", "seed"], columns="localizer", values="tried")
    num_seeds = walks.groupby("localizer")["seed"].nunique()
    for name in num_seeds.index[num_seeds == 1]:
        wide[name], tried[name] = (of.groupby(level="walk")[name].transform("first") for of in (wide, tried))
    by_walk = wide[tried.notna().all(axis=1)].groupby(level="walk", sort=True).mean()
    unit = walks.drop_duplicates("walk").set_index("walk")["unit"]
    values = {name: by_walk[name].to_numpy(np.float64) for name in dict.fromkeys(walks["localizer"])}
    return values, [str(unit[walk]) for walk in by_walk.index]


def _cell(entry: dict[str, Any] | None) -> str:
    if entry is None or entry["value"] is None:
        return NOTHING
    if entry["low"] is None or entry["high"] is None:
        return decimals(entry["value"])
    return f"{decimals(entry['value'])} [{decimals(entry['low'])}, {decimals(entry['high'])}]"


def machine_text(machine: object) -> str:
    """The record of a machine in a line; empty where there is none."""
    if not isinstance(machine, Mapping) or not machine:
        return ""
    return f"{machine.get('cpu', 'unknown')}, {machine.get('cores', '?')} cores, {machine.get('system', '')}"


def _latex(text: str) -> str:
    return re.sub(r"([&%$#_{}])", r"\\\1", text).replace("–", "--")


def _written(text: str, path: Path | str | None) -> str:
    if path is not None:
        Path(path).write_text(text, encoding="utf-8")
    return text
