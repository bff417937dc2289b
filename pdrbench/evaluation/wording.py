"""What tables of results show of a row, and what they say in words."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Final

from pdrbench.errors import plain_line, unknown_name
from pdrbench.evaluation.number_text import NOTHING, decimals
from pdrbench.evaluation.rows import RANKING, Row
from pdrbench.metrics import METRICS, POOLED
from pdrbench.metrics.ranking import NUM_ENTRIES, POWER
from pdrbench.metrics.statistics import MIN_UNITS
from pdrbench.result import FAILED, OFFLINE, UNSUITABLE, Result, shown_name

RATIOS: Final = ("ratio_to_best", "ratio_against")
COLUMNS: Final = ("rank", *RATIOS, "p_against", RANKING, "mean_m", "lost")  # of a table where no others are asked for
MORE_COLUMNS: Final = (
    *("p_holm", "pooled_p75_level_penalised_m", "p95_m", "level_hit_rate", "outside_pct", "first_within_5m_s"),
    *("coverage_95", "energy_score_m", "claimed_correct", "availability", "realtime_factor"),
)
ALL_COLUMNS: Final = (*COLUMNS, *MORE_COLUMNS)
KNOWN_START: Final = "pose"  # of `Task.start`: there is no place to find
MAX_NOTES: Final = 2  # of a localizer that are printed
STRATA_COLUMNS: Final = 5  # localizers of a table by stratum, so that it fits

Cell = Callable[[str, Mapping[str, Any] | None], str]  # of a name and an entry of `metrics`, None where there is none


def check_columns(columns: Sequence[str]) -> tuple[str, ...]:
    """The columns that were asked for; raises `UnknownNameError` where one is no metric."""
    known = (*ALL_COLUMNS, *METRICS, *POOLED)
    for name in columns:
        if name not in known:
            raise unknown_name("column", name, dict.fromkeys(known))
    return tuple(dict.fromkeys(columns))


def score_tables(
    rows: Sequence[Row], cell: Cell, columns: Sequence[str] | None = None, *, has_strata: bool = True
) -> list[tuple[str, list[str], list[list[str]]]]:
    """Title, names of the columns, and cells of each table: localizers and values, best first, offline below online.

    Each environment and split has a table, and a second one where its places or walks fall into strata. Localizers that
    declined every walk are left to `footnotes`; of one that lacks walks the name says how many it played.

    Args:
        rows: As `Results.rows` has them.
        cell: Text of an entry of `metrics`.
        columns: Those of `ALL_COLUMNS` that no row has are left out; None: `COLUMNS`.
        has_strata: Whether to make the second table.
    """
    tables: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        if row["metrics"]:
            tables.setdefault((row["env"], row["split"]), []).append(row)
    found = []
    for (env, split), entries in tables.items():
        entries = sorted(entries, key=_place)
        names = [name for name in columns or COLUMNS if _is_shown(name, entries, is_asked=columns is not None)]
        lines = [
            [shown_entry(row)]
            + [rank_text(row["rank"]) if name == "rank" else cell(name, row["metrics"].get(name)) for name in names]
            for row in entries
        ]
        most = max(row["of"] for row in entries)
        intervals = describe_interval(max(row["units"] for row in entries), entries[0]["unit_kind"], most)
        found.append((f"{env}, {split} split, {counted('walk', most)}; {intervals}", ["localizer", *names], lines))
        header, lines = strata_cells(entries)
        if lines and has_strata:
            found.append((f"{env}, {split} split, by kind of walk", header, lines))
    return found


def _is_shown(name: str, rows: Sequence[Row], *, is_asked: bool) -> bool:
    """Whether a column says anything: a rank among several, a metric that applies, a time where a place is sought."""
    if name in ("rank", "ratio_to_best", "p_holm"):
        return len(rows) > 1 and (is_asked or name != "ratio_to_best" or not rows[0].get("against"))
    if name == "first_within_5m_s" and rows[0].get("start", KNOWN_START) == KNOWN_START:
        return False
    return any(row["metrics"].get(name, {}).get("n", 0) for row in rows) or (is_asked and name not in ALL_COLUMNS)


def shown_entry(row: Row) -> str:
    """The name of a row of a table, with the number of walks where some are missing.

    >>> shown_entry({"localizer": "mine", "division": "online", "walks": 1, "of": 3})
    'mine (1 of 3)'
    """
    name = shown_name(row["localizer"], row["division"])
    return name if row["walks"] == row["of"] else f"{name} ({row['walks']} of {row['of']})"


def _place(row: Row) -> tuple[bool, float, int]:
    value = row["metrics"].get(RANKING, {}).get("value")
    return row["division"] == OFFLINE, math.inf if value is None else round(value, 9), row["of"] - row["walks"]


def rank_text(rank: Sequence[int] | None) -> str:
    """An interval of ranks.

    >>> rank_text([1, 1]), rank_text([2, 4]), rank_text(None)
    ('1', '2–4', '–')
    """
    if rank is None:
        return NOTHING
    low, high = rank
    return str(low) if low == high else f"{low}–{high}"


def stacked(name: str, score: Mapping[str, Any] | None) -> str:
    """A value above its interval; a dash where it does not apply, "never" where it would be infinite.

    >>> stacked("mean_m", {"value": 4.3149, "low": 3.9, "high": 4.8}).splitlines()
    ['4.31', '3.90–4.80']
    >>> stacked("lost", {"value": 0.125, "low": float("nan"), "high": float("nan")})
    '12 %'
    >>> stacked("convergence_s", {"value": None, "low": 31.0, "high": None, "n": 8}).splitlines()
    ['never', '31.00–never']
    """
    if score is None or not (_is_number(score["value"]) or score.get("n", 0)):
        return NOTHING
    value = _text(name, score["value"])
    ends = (_text(name, score[end]).removesuffix(" %") for end in ("low", "high"))
    return f"{value}\n{'–'.join(ends)}" if _is_number(score["low"]) else value


def in_a_line(name: str, score: Mapping[str, Any] | None) -> str:
    """A value and its interval.

    >>> in_a_line("mean_m", {"value": 4.3149, "low": 3.9, "high": 4.8, "n": 5})
    '4.31 [3.90, 4.80]'
    """
    value, _, ends = stacked(name, score).partition("\n")
    return f"{value} [{ends.replace('–', ', ')}]" if ends else value


def brief(name: str, score: Mapping[str, Any] | None) -> str:
    """A value, for a narrow column of a paper; only a ratio has its interval.

    >>> brief("mean_m", {"value": 4.3149, "low": 3.9, "high": 4.8, "n": 5})
    '4.31'
    """
    return in_a_line(name, score) if name in RATIOS else stacked(name, score).partition("\n")[0]


def _text(name: str, value: float | None) -> str:
    """A number, a fraction of walks in percent."""
    return f"{100 * value:.0f} %" if name == "lost" and value is not None else decimals(value)


def _is_number(value: float | None) -> bool:
    return value is not None and math.isfinite(value)


def footnotes(rows: Sequence[Row], results: Sequence[Result], columns: Sequence[str] | None = None) -> list[str]:
    """What to know when reading tables: how values are made, what they can tell, and which walks are not complete."""
    played = [row for row in rows if row["metrics"]]
    lines = [powers for powers in dict.fromkeys(map(_power, played)) if powers]
    lines += dict.fromkeys(
        f"ratio_against: error over that of {row['against']} on the same walks, below 1 where smaller; p_against: "
        f"after Holm over these comparisons, in each environment and division"
        for row in played
        if row.get("against")
    )
    if any(row["walks"] != row["of"] for row in played):
        lines.append("(n of N): missing walks are ranked with the worst answer there, and leave the other columns")
    medians = [name for name in columns or COLUMNS if name in METRICS and METRICS[name].over_walks == "median"]
    if medians:
        lines.append(f"median over walks, never where half of them have none: {', '.join(medians)}")
    lines += incidents(results)
    lines += dict.fromkeys(f"{row['env']}: {row['note']}" for row in rows if row["note"])
    machines = dict.fromkeys(machine_text(result.provenance.get("machine")) for result in results)
    return [*lines, *(f"time measured on {machine}" for machine in machines if machine)]


def _power(row: Row) -> str:
    """What the walks of a table can tell."""
    ratio = row.get("smallest_ratio")
    if ratio is None or row["division"] == OFFLINE:
        return ""
    return (
        f"{row['env']}: {counted('walk', row['of'])} tell neighbours apart whose ratio is {ratio:.2f} or more "
        f"({100 * POWER:.0f} % power, Holm over {NUM_ENTRIES} entries)"
    )


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
    notes: Counter[str] = Counter()
    for result in results:
        missing.update(result.missing)
        notes.update(result.notes)
    for text, count in notes.most_common(MAX_NOTES):
        yield f": on {count} of {len(results)} walks: {text}"
    if len(notes) > MAX_NOTES:
        yield f": and {len(notes) - MAX_NOTES} more such notes"
    if missing:
        counts = ", ".join(f"{count} × {reason}" for reason, count in sorted(missing.items()))
        yield f": answers that count as missing: {counts}"


def last_line(failure: str) -> str:
    """The line of a traceback that names the error."""
    lines = failure.strip().splitlines()
    return plain_line(lines[-1]) if lines else "no reason given"


def strata_cells(rows: Sequence[Row]) -> tuple[list[str], list[list[str]]]:
    """Header and lines of a table by stratum: one a line, the first localizers beside each other.

    Args:
        rows: Of one environment and split, as `Results.rows` has them, best first.
    """
    shown = [(row, {of["name"]: of for of in row.get("strata", ())}) for row in rows]
    shown = [(row, parts) for row, parts in shown if parts][:STRATA_COLUMNS]
    lines = []
    for name, part in {name: part for _, parts in shown for name, part in parts.items()}.items():
        metric = RANKING if part["by"] == "group" else "mean_m"
        cells = [brief(metric, parts[name]["metrics"][metric]) if name in parts else "n/a" for _, parts in shown]
        lines.append([f"{name}: {counted('walk', part['walks'])}, {metric}", *cells])
    return ["stratum", *(shown_name(row["localizer"], row["division"]) for row, _ in shown)], lines


def describe_offline(revise_s: float | None) -> str:
    """What to know of a row whose answers were revised; `revise_s` is the mean wall time of that.

    >>> describe_offline(0.01234)
    'offline: answers were revised when the walk was over, in 0.012 s a walk'
    """
    how_long = "" if revise_s is None else f", in {revise_s:.2g} s a walk"
    return f"offline: answers were revised when the walk was over{how_long}"


def describe_interval(num_units: int, kind: str, num_walks: int) -> str:
    """Of what the intervals of a table are, or why it has none.

    >>> describe_interval(60, "session", 90)
    '95 % intervals by the spread of 60 sessions'
    >>> describe_interval(1, "person", 23)
    '95 % intervals by the spread of 23 walks of one person'
    """
    if num_units >= MIN_UNITS:
        return f"95 % intervals by the spread of {counted(kind, num_units)}"
    of = f"one {kind}" if num_units == 1 else counted(kind, num_units)
    if num_walks >= MIN_UNITS:
        return f"95 % intervals by the spread of {num_walks} walks of {of}"
    return f"no intervals: {counted('walk', num_walks)} of {of}, and fewer than {MIN_UNITS} are too few for any"


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
