"""Rows of results as tables for people, and which localizers failed or declined."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

from pdrbench.cli.output import print_table
from pdrbench.evaluation.wording import MORE_COLUMNS, score_tables, stacked
from pdrbench.result import FAILED, ONLINE, UNSUITABLE, Result

DISPENSABLE: Final = (*reversed(MORE_COLUMNS), "mean_m", "lost", "ratio_to_best")  # the first goes first
LONGEST_HEAD: Final = 12  # characters of a line of a head: about as many as an interval has

Row = Mapping[str, Any]


def print_scores(rows: Sequence[Row], columns: Sequence[str] | None = None) -> None:
    """One table per environment and split; localizers that declined every walk are left to the footnotes."""
    for title, names, cells in score_tables(rows, stacked, columns):
        head: dict[str, Mapping[str, Any]] = {_broken(name): {"justify": "right", "no_wrap": True} for name in names}
        head[_broken(names[0])] = {"no_wrap": True}
        print_table(head, cells, title, [_broken(name) for name in DISPENSABLE])


def _broken(name: str) -> str:
    """A long name of a column over lines.

    >>> _broken("p75_geometric_m")
    'p75\\n_geometric_m'
    """
    lines: list[str] = []
    for part in re.split("(?=_)", name):
        fits = lines and len(lines[-1]) + len(part) <= LONGEST_HEAD
        lines = [*lines[:-1], lines[-1] + part] if fits else [*lines, part]
    return "\n".join(lines)


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
