"""Rows of results as tables for people, and footnotes on what the tables do not show."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

from pdrbench.cli.output import print_table
from pdrbench.evaluation.number_text import NOTHING, decimals
from pdrbench.evaluation.wording import BEHIND, RANKING
from pdrbench.result import FAILED, OFFLINE, UNSUITABLE, Result, shown_name

# What every table shows, and how a long name is broken over lines; `SHOWN_WHERE` comes on top where it applies.
COLUMNS: Final = {
    "mean_m": "mean_m",
    "pooled_mean_m": "pooled\n_mean_m",
    "p50_m": "p50_m",
    "p75_m": "p75_m",
    "p95_m": "p95_m",
    "p75_level_penalised_m": "p75_level\n_penalised_m",
    "behind_best_m": "behind\n_best_m",
    "p_holm": "p_holm",
    "level_hit_rate": "level\n_hit_rate",
    "availability": "availability",
    "step_p50_ms": "step_p50_ms",
}
LABELS: Final = {
    **COLUMNS,
    "convergence_s": "convergence\n_s",
    "energy_score_m": "energy\n_score_m",
    "ate_se2_aligned_m": "ate_se2\n_aligned_m",
    "loop_closure_pct": "loop\n_closure_pct",
}
DISPENSABLE: Final = (
    *("outside_pct", "coverage_95", "energy_score_m", "claimed_correct"),
    "step_p50_ms",
    "availability",
    "p75_m",
    "p50_m",
    "p95_m",
    "pooled_mean_m",
    "level_hit_rate",
    "convergence_s",
    "loop_closure_pct",
    *BEHIND[::-1],
    "mean_m",
)  # the first goes first

Row = Mapping[str, Any]


def print_scores(rows: Iterable[Row], results: Sequence[Result]) -> None:
    """One table per environment and split; localizers that declined every walk are left to the footnotes."""
    for title, names, cells in score_tables(rows, results):
        labels = [LABELS.get(name, name) for name in names]
        head: dict[str, Mapping[str, Any]] = {label: {"justify": "right", "no_wrap": True} for label in labels}
        head["localizer"] = {"no_wrap": True}
        print_table(head, cells, title, [LABELS.get(name, name) for name in DISPENSABLE])


def score_tables(rows: Iterable[Row], results: Sequence[Result]) -> list[tuple[str, list[str], list[list[str]]]]:
    """Title, names of the columns, and cells of each table: the localizer and its values, best first."""
    from pdrbench.evaluation.wording import behind_cells, describe_interval, shown_besides, strata_cells

    declined = {pair for pair, group in _groups(results).items() if is_declined(group)}
    tables: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        if (row["env"], row["localizer"]) not in declined:
            tables.setdefault((row["env"], row["split"]), []).append(row)
    found = []
    for (env, split), entries in tables.items():
        is_compared = any("value" in (row.get("behind") or ()) for row in entries)
        names = [*(name for name in COLUMNS if is_compared or name not in BEHIND), *shown_besides(entries)]
        walks = max(row["walks"] for row in entries)
        cells = [
            [shown_name(row["localizer"], row["division"])]
            + [behind.get(name) or cell(row["metrics"].get(name)) for name in names]
            for row in sorted(entries, key=_rank)
            for behind in [dict(zip(BEHIND, behind_cells(row, cell), strict=True))]
        ]
        intervals = describe_interval(max(row["units"] for row in entries), entries[0]["unit_kind"])
        title = f"{env}, {split} split, {walks} walks; {intervals}"
        found.append((title, ["localizer", *names], cells))
        header, lines = strata_cells(sorted(entries, key=_rank), cell)
        if lines:
            found.append((f"{env}, {split} split, by group of walks and distance to the nearest scan", header, lines))
    return found


def cell(score: Mapping[str, Any] | None) -> str:
    """A value above its interval; a dash where it does not apply, "never" where it would be infinite.

    >>> cell({"value": 4.3149, "low": 3.9, "high": 4.8}).splitlines()
    ['4.31', '3.90–4.80']
    >>> cell({"value": 0.0123, "low": float("nan"), "high": float("nan")})
    '0.012'
    >>> cell({"value": None, "low": 31.0, "high": None, "n": 8}).splitlines()
    ['never', '31.00–never']
    """
    if score is None or not (_is_number(score["value"]) or score.get("n", 0)):
        return NOTHING
    value = decimals(score["value"])
    if not _is_number(score["low"]):
        return value
    return f"{value}\n{decimals(score['low'])}–{decimals(score['high'])}"


def footnotes(results: Sequence[Result]) -> list[str]:
    """What became of walks and answers that are not complete, and of those that were revised, a line each."""
    from pdrbench.evaluation.summary import revision_of
    from pdrbench.evaluation.wording import describe_offline

    lines: list[str] = []
    for (env, localizer), group in _groups(results).items():
        name = f"{localizer} on {env}"
        division, revise_s = revision_of(group)
        if division == OFFLINE:
            lines.append(f"{name}: {describe_offline(revise_s)}")
        if (seeds := len({result.seed for result in group})) > 1:
            lines.append(f"{name}: {seeds} seeds, averaged within each walk")
        if declined := [result for result in group if result.status == UNSUITABLE]:
            extent = "" if is_declined(group) else f" ({len(declined)} of {len(group)} walks)"
            lines.append(f"{name}{extent}: not applicable: {last_line(declined[0].failure)}")
        if failed := [result for result in group if result.status == FAILED]:
            lines.append(
                f"{name}: failed on {len(failed)} of {len(group)} walks, scored with what was answered before; "
                f"first on walk {failed[0].walk}: {last_line(failed[0].failure)}"
            )
        missing: Counter[str] = Counter()
        for result in group:
            missing.update(result.missing)
        if missing:
            counts = ", ".join(f"{count} × {reason}" for reason, count in sorted(missing.items()))
            lines.append(f"{name}: answers that count as missing: {counts}")
    return lines


def warnings_of(envs: Iterable[str]) -> list[str]:
    """What environments want to be read beside their scores, a line each."""
    from pdrbench.registry import make_task

    tasks = [make_task(name) for name in envs]
    return [f"{task.id}: {task.note}" for task in tasks if task.note]


def is_declined(results: Sequence[Result]) -> bool:
    """True where no walk was played because the localizer declined every one."""
    return bool(results) and all(result.status == UNSUITABLE for result in results)


def failures(results: Sequence[Result], *, strict: bool = False) -> list[str]:
    """A line for each localizer that failed on every walk of an environment that it took; on any where `strict`."""
    lines = []
    for (env, localizer), group in _groups(results).items():
        played = [result.status for result in group if result.status != UNSUITABLE]
        if (num := played.count(FAILED)) and (strict or num == len(played)):
            lines.append(f"failed: {localizer} on {num} of {len(played)} walks of {env}")
    return lines


def last_line(failure: str) -> str:
    """The line of a traceback that names the error."""
    lines = failure.strip().splitlines()
    return lines[-1] if lines else "no reason given"


def _groups(results: Iterable[Result]) -> dict[tuple[str, str], list[Result]]:
    groups: dict[tuple[str, str], list[Result]] = {}
    for result in results:
        groups.setdefault((result.env, result.localizer), []).append(result)
    return groups


def _rank(row: Row) -> float:
    score = row["metrics"].get(RANKING)
    return float(score["value"]) if score is not None and _is_number(score["value"]) else math.inf


def _is_number(value: float | None) -> bool:
    return value is not None and math.isfinite(value)
