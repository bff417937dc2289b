"""What tables of results show of a row, and what they say in words."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Final

from pdrbench.evaluation.number_text import NOTHING, decimals
from pdrbench.evaluation.rows import RANKING, SCAN_STRATA, Row
from pdrbench.metrics import METRICS
from pdrbench.metrics.statistics import MIN_UNITS
from pdrbench.result import FAILED, OFFLINE, UNSUITABLE, Result, shown_name

COMPARED: Final = ("rank", "ratio_to_best", "p_holm")  # columns that two localizers make
SHOWN: Final = (
    "rank",
    RANKING,
    "ratio_to_best",
    "p_holm",
    "mean_m",
    "pooled_mean_m",
    "p50_m",
    "p75_m",
    "p95_m",
    "level_hit_rate",
    "availability",
    "step_p50_ms",
)
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
NOT_APPLICABLE: Final = "n/a"  # a stratum that a localizer declines


def shown_besides(rows: Sequence[Row]) -> list[str]:
    """Metrics that a table of these rows shows besides `SHOWN`."""
    return [
        name
        for name, applies in SHOWN_WHERE.items()
        if any(applies(row) and row["metrics"].get(name, {}).get("n", 0) for row in rows)
    ]


Cell = Callable[[Mapping[str, Any] | None], str]  # text of an entry of `metrics`, None where there is none


def score_tables(rows: Sequence[Row], cell: Cell) -> list[tuple[str, list[str], list[list[str]]]]:
    """Title, names of the columns, and cells of each table: localizers and values, best first, offline below online.

    Each environment and split has a table, and a second one where its places or walks fall into strata. Localizers that
    declined every walk are left to `footnotes`.
    """
    tables: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        if row["walks"]:
            tables.setdefault((row["env"], row["split"]), []).append(row)
    found = []
    for (env, split), entries in tables.items():
        entries = sorted(entries, key=_place)
        is_compared = any("p_holm" in row["metrics"] for row in entries)
        names = [*(name for name in SHOWN if is_compared or name not in COMPARED), *shown_besides(entries)]
        lines = [
            [shown_name(row["localizer"], row["division"])]
            + [rank_text(row["rank"]) if name == "rank" else cell(row["metrics"].get(name)) for name in names]
            for row in entries
        ]
        intervals = describe_interval(max(row["units"] for row in entries), entries[0]["unit_kind"])
        title = f"{env}, {split} split, {counted('walk', max(row['of'] for row in entries))}; {intervals}"
        found.append((title, ["localizer", *names], lines))
        header, lines = strata_cells(entries, cell)
        if lines:
            found.append((f"{env}, {split} split, by group of walks and distance to the nearest scan", header, lines))
    return found


def _place(row: Row) -> tuple[bool, float]:
    value = row["metrics"].get(RANKING, {}).get("value")
    return row["division"] == OFFLINE, math.inf if value is None else value


def rank_text(rank: Sequence[int] | None) -> str:
    """An interval of ranks.

    >>> rank_text([1, 1]), rank_text([2, 4]), rank_text(None)
    ('1', '2–4', '–')
    """
    if rank is None:
        return NOTHING
    low, high = rank
    return str(low) if low == high else f"{low}–{high}"


def stacked(score: Mapping[str, Any] | None) -> str:
    """A value above its interval; a dash where it does not apply, "never" where it would be infinite.

    >>> stacked({"value": 4.3149, "low": 3.9, "high": 4.8}).splitlines()
    ['4.31', '3.90–4.80']
    >>> stacked({"value": 0.0123, "low": float("nan"), "high": float("nan")})
    '0.012'
    >>> stacked({"value": None, "low": 31.0, "high": None, "n": 8}).splitlines()
    ['never', '31.00–never']
    """
    if score is None or not (_is_number(score["value"]) or score.get("n", 0)):
        return NOTHING
    value = decimals(score["value"])
    return f"{value}\n{decimals(score['low'])}–{decimals(score['high'])}" if _is_number(score["low"]) else value


def in_a_line(score: Mapping[str, Any] | None) -> str:
    """A value and its interval.

    >>> in_a_line({"value": 4.3149, "low": 3.9, "high": 4.8, "n": 5})
    '4.31 [3.90, 4.80]'
    """
    value, _, ends = stacked(score).partition("\n")
    return f"{value} [{ends.replace('–', ', ')}]" if ends else value


def _is_number(value: float | None) -> bool:
    return value is not None and math.isfinite(value)


def footnotes(rows: Sequence[Row], results: Sequence[Result]) -> list[str]:
    """What to know when reading tables: how values are made, and what became of walks that are not complete."""
    played = [row for row in rows if row["walks"]]
    lines = ["mean over walks (seeds averaged first), pooled_ over all positions; percentiles by Hazen"]
    if any("p_holm" in row["metrics"] for row in played):
        lines.append(
            f"rank and ratio_to_best by {RANKING} on the same walks; p_holm: sign-flip test, corrected by division"
        )
    medians = [name for name in shown_besides(rows) if METRICS[name].over_walks == "median"]
    if medians:
        lines.append(f"median over walks, never where half of them have none: {', '.join(medians)}")
    lines += incidents(results)
    lines += dict.fromkeys(f"{row['env']}: {row['note']}" for row in rows if row["note"])
    machines = dict.fromkeys(machine_text(result.provenance.get("machine")) for result in results)
    return [*lines, *(f"time measured on {machine}" for machine in machines if machine)]


def incidents(results: Sequence[Result]) -> list[str]:
    """What became of walks and answers that are not complete, and of those that were revised, a line each."""
    groups: dict[tuple[str, str, str], list[Result]] = {}
    for result in results:
        groups.setdefault((result.env, result.localizer, result.division), []).append(result)
    return [
        f"{localizer} on {env}{line}" for (env, localizer, _), group in groups.items() for line in _incidents(group)
    ]


def _incidents(results: Sequence[Result]) -> Iterator[str]:
    """Of one localizer in one division; what is the same offline is said once."""
    if results[0].division == OFFLINE:
        times_s = [result.revise_s for result in results if math.isfinite(result.revise_s)]
        yield f": {describe_offline(sum(times_s) / len(times_s) if times_s else None)}"
        return
    if (seeds := len({result.seed for result in results})) > 1:
        yield f": {seeds} seeds, averaged within each walk"
    if declined := [result for result in results if result.status == UNSUITABLE]:
        extent = "" if len(declined) == len(results) else f" ({len(declined)} of {len(results)} walks)"
        yield f"{extent}: not applicable: {last_line(declined[0].failure)}"
    if failed := [result for result in results if result.status == FAILED]:
        yield (
            f": failed on {len(failed)} of {len(results)} walks, scored with what was answered before; "
            f"first on walk {failed[0].walk}: {last_line(failed[0].failure)}"
        )
    missing: Counter[str] = Counter()
    for result in results:
        missing.update(result.missing)
    if missing:
        counts = ", ".join(f"{count} × {reason}" for reason, count in sorted(missing.items()))
        yield f": answers that count as missing: {counts}"


def last_line(failure: str) -> str:
    """The line of a traceback that names the error."""
    lines = failure.strip().splitlines()
    return lines[-1] if lines else "no reason given"


def strata_cells(rows: Sequence[Row], cell: Cell) -> tuple[list[str], list[list[str]]]:
    """Header and lines of a table by stratum, two lines a localizer: mean over walks, and over all places together.

    Args:
        rows: Of one environment and split, as `Results.rows` has them.
        cell: Text of an entry of `metrics`.
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


def machine_text(machine: object) -> str:
    """The record of a machine in a line; empty where there is none."""
    if not isinstance(machine, Mapping) or not machine:
        return ""
    return f"{machine.get('cpu', 'unknown')}, {machine.get('cores', '?')} cores, {machine.get('system', '')}"
