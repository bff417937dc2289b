"""Rows of results as tables for people, and which localizers failed or declined."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

from pdrbench.cli.output import print_table
from pdrbench.evaluation.wording import score_tables, stacked
from pdrbench.result import FAILED, ONLINE, UNSUITABLE, Result

# How a long name of a column is broken over lines.
LABELS: Final = {
    "p75_geometric_m": "p75_geo\nmetric_m",
    "ratio_to_best": "ratio\nto_best",
    "pooled_mean_m": "pooled\n_mean_m",
    "level_hit_rate": "level\n_hit_rate",
    "convergence_s": "convergence\n_s",
    "energy_score_m": "energy\n_score_m",
    "ate_se2_aligned_m": "ate_se2\n_aligned_m",
    "loop_closure_pct": "loop\n_closure_pct",
}
DISPENSABLE: Final = (
    *("outside_pct", "coverage_95", "energy_score_m", "claimed_correct"),
    "step_p50_ms",
    "availability",
    "pooled_mean_m",
    "p75_m",
    "p50_m",
    "p95_m",
    "level_hit_rate",
    "convergence_s",
    "loop_closure_pct",
    "p_holm",
    "mean_m",
    "ratio_to_best",
)  # the first goes first

Row = Mapping[str, Any]


def print_scores(rows: Sequence[Row]) -> None:
    """One table per environment and split; localizers that declined every walk are left to the footnotes."""
    for title, names, cells in score_tables(rows, stacked):
        labels = [LABELS.get(name, name) for name in names]
        head: dict[str, Mapping[str, Any]] = {label: {"justify": "right", "no_wrap": True} for label in labels}
        head["localizer"] = {"no_wrap": True}
        print_table(head, cells, title, [LABELS.get(name, name) for name in DISPENSABLE])


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


def _groups(results: Iterable[Result]) -> dict[tuple[str, str], list[Result]]:
    groups: dict[tuple[str, str], list[Result]] = {}
    for result in results:
        if result.division == ONLINE:
            groups.setdefault((result.env, result.localizer), []).append(result)
    return groups
