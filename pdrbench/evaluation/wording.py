"""What tables of results show of a row, and what they say in words."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from pdrbench.evaluation.number_text import NOTHING
from pdrbench.evaluation.summary import SCAN_STRATA, Row
from pdrbench.metrics.statistics import MIN_UNITS
from pdrbench.result import shown_name

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
RANKING: Final = "p75_level_penalised_m"  # EvAAL: it ranks the leaderboards
BEHIND: Final = ("behind_best_m", "p_holm")  # columns on the paired difference from the best
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


def behind_cells(row: Row, cell: Callable[[dict[str, Any] | None], str]) -> list[str]:
    """The columns `BEHIND` of a row; dashes where nothing can be compared."""
    behind = row.get("behind")
    if behind is None:
        return [NOTHING, NOTHING]
    if behind["best"] == row["localizer"]:
        return ["best", NOTHING]
    is_tested = behind["p_holm"] is not None and behind["low"] is not None  # too few units say nothing
    return [cell(behind), f"{behind['p_holm']:.2g}" if is_tested else NOTHING]


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
