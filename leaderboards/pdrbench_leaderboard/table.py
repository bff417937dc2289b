"""`TABLE.md`: one leaderboard as Markdown, made from nothing but estimates and cards."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from pdrbench.evaluation.number_text import NOTHING, page_decimals
from pdrbench.evaluation.wording import counted, describe_interval, strata_cells
from pdrbench.metrics import METRICS
from pdrbench.metrics.statistics import MIN_UNITS, Comparison
from pdrbench.result import OFFLINE
from pdrbench_leaderboard.ranking import Board, Standing

BESIDES: Final = ("mean_m", "pooled_mean_m", "p95_m", "level_hit_rate")  # shown beside the metric that ranks
BEHIND: Final = "Behind the first of the division: mean difference on the same held-out walks, and its interval."
RANKED: Final = (
    "Held-out walks rank: they are drawn from a secret, and no sender has seen them. Public: the same score on the "
    "public test walks. Gap: held-out minus public; a gap far from that of the others shows an entry made for the "
    "public walks. In all three, a run that failed or was declined counts as the worst answer, the diagonal of the "
    "building and the penalty for every level, and no run counts as worse. The other columns are of public walks."
)
REPLAYS: Final = (
    "The truth of the public walks is public: they were recorded, and anybody may have it. The held-out walks are such "
    "walks turned and moved, map and truth with them, with sensors noised anew and other names."
)
STRATA: Final = "By group of walks and by distance to the nearest scan of the survey:"
FILE_NAME: Final = "TABLE.md"


def table(board: Board) -> str:
    """The leaderboard as Markdown, with what to know when reading it; the same entries give the same bytes."""
    others = [name for name in BESIDES if name != board.metric]
    head = ["#", "localizer", f"{board.metric}, held-out", "public", "gap", "behind the first", "ahead of", *others]
    head += ["tier", "division", "sensors", "map", "survey"]
    lines = [_line(board, standing, others) for standing in board.standings]
    left = {"localizer", "tier", "division", "sensors", "map", "survey", "ahead of"}
    rule = [":--" if name in left else "--:" for name in head]
    grid = ["| " + " | ".join(cells) + " |" for cells in (head, rule, *lines)]
    remarks = [f"* {_note(text)}" for text in (RANKED, BEHIND, *notes(board))]
    head, lines = strata(board)
    if lines:
        rule = [":--"] * 2 + ["--:"] * (len(head) - 2)
        cells = [[plain(cell) for cell in head], rule, *([plain(name), *rest] for name, *rest in lines)]
        grid += ["", STRATA, "", *("| " + " | ".join(line) + " |" for line in cells)]
    return "\n".join([f"# {board.task.id}", "", plain(board.task.summary), "", *grid, "", *remarks, ""])


def strata(board: Board) -> tuple[list[str], list[list[str]]]:
    """Header and lines of the table by stratum; no line where there is none."""
    rows = [standing.row for standing in board.standings]
    return strata_cells(rows, lambda entry: NOTHING if entry is None else with_interval(entry))


def _line(board: Board, standing: Standing, others: Sequence[str]) -> list[str]:
    card = board.card(standing)
    return [
        standing.label,
        f"`{standing.name.replace('`', '')}`".replace("|", "\\|"),
        with_interval(standing.held_out),
        with_interval(standing.public),
        gap_text(standing),
        behind(board, standing),
        ", ".join(labels(board, board.beaten_by(standing.name))) or NOTHING,
        *(with_interval(standing.metric(name)) for name in others),
        standing.entry.tier,
        standing.row["division"],
        ", ".join(card.sensors_used) or NOTHING,
        "yes" if card.map_used else "no",
        "yes" if card.survey_used else "no",
    ]


def _note(text: str) -> str:
    """A note in Markdown: what stands between backticks stays as it is."""
    parts = text.split("`")
    return "".join(f"`{part}`" if index % 2 else _escaped(part) for index, part in enumerate(parts))


def notes(board: Board) -> Iterator[str]:
    """What to know when reading the table, one or two sentences each; names stand between backticks."""
    metric = METRICS[board.metric]
    yield f"{len(board.walks)} test walks. `{board.metric}`: {metric.what} {metric.better.capitalize()} is better."
    if board.task.dataset is not None:
        yield REPLAYS
    if board.held_out_units:
        records = (standing.entry.verification for standing in board.ranked)
        digests = sorted({found.held_out.round[:16] for found in records if found and found.held_out})
        yield (f"{len(board.held_out_units)} held-out walks, drawn from the secret with sha256 `{', '.join(digests)}`.")
    num_units, kind = len(set(board.units)), board.task.unit_kind
    intervals = describe_interval(num_units, kind)
    yield f"In brackets: {intervals}." if num_units >= MIN_UNITS else f"{intervals.capitalize()}."
    yield (
        f"Ahead of: ranks from which it differs significantly (sign-flip test by {kind}, Holm over all pairs, 5 %). "
        "Between others no difference is shown, whatever their order."
    )
    if board.is_too_small:
        num_units = len(set(board.held_out_units))
        few = f"{counted(kind, num_units)} are" if num_units != 1 else f"1 {kind} is"
        yield f"No difference can be significant: {few} too few for {len(board.pairs)} pairs."
    if any(standing.row["division"] == OFFLINE for standing in board.standings):
        yield "o1, o2, …: offline, answers were revised when the walk was over; ranked by themselves."
    for standing in board.standings:
        if standing.why_unranked:
            yield f"`{standing.name}` is not ranked: {standing.why_unranked}."
        if standing.row["failed"]:
            runs = counted("run", standing.row["failed"])
            yield f"`{standing.name}`: {runs} failed and scored with what was answered before."
        if counts := held_out_failures(standing):
            yield f"`{standing.name}`: on held-out walks, {counts}, each counted as the worst answer."
    if board.task.note:
        yield board.task.note.replace("`", "")
    yield f"Data: {board.task.licence.replace('`', '')}."


def held_out_failures(standing: Standing) -> str:
    """Runs on held-out walks that failed or were declined; empty where there are none."""
    found = standing.entry.verification and standing.entry.verification.held_out
    if not found:
        return ""
    counts = [(found.failed, "failed"), (found.declined, "were declined" if found.declined > 1 else "was declined")]
    return " and ".join(f"{counted('run', count)} {what}" for count, what in counts if count)


def gap_text(standing: Standing) -> str:
    """Held-out score minus public score, with its sign."""
    gap = standing.gap
    if gap is None:
        return NOTHING
    return f"{'+' if gap > 0 else ''}{page_decimals(gap)}"


def with_interval(entry: Mapping[str, Any]) -> str:
    """A value and its interval.

    >>> with_interval({"value": 1.234, "low": 1.0, "high": 2.0}), with_interval({"value": 0.01234, "low": None})
    ('1.23 (1.00–2.00)', '0.012')
    >>> with_interval({"value": -1.0, "low": -2.0, "high": 0.0})
    '−1.00 (−2.00 to 0.00)'
    """
    if entry.get("value") is None:
        return NOTHING
    low, high = entry.get("low"), entry.get("high")
    if low is None or high is None:
        return page_decimals(entry["value"])
    return f"{page_decimals(entry['value'])} ({page_decimals(low)}{' to ' if low < 0 else '–'}{page_decimals(high)})"


def behind(board: Board, standing: Standing) -> str:
    """How far an entry is behind the first one of its division, with the interval of the difference."""
    division = standing.row["division"]
    first = next((other.name for other in board.ranked if other.row["division"] == division), "")
    pair = board.pairs.get((first, standing.name))
    if pair is None or math.isnan(pair.effect):
        return NOTHING
    # The effect is first minus this one, negative where lower is better: turned round, so that behind is positive.
    return with_interval(effect_of(pair, 1.0 if METRICS[board.metric].better == "higher" else -1.0))


def effect_of(pair: Comparison, sign: float) -> dict[str, float]:
    """Difference and its interval, turned round where the sign is -1."""
    low, high = sorted((sign * pair.low, sign * pair.high))
    return {"value": sign * pair.effect} | ({} if math.isnan(low) else {"low": low, "high": high})


def labels(board: Board, names: Sequence[str]) -> list[str]:
    """Ranks of entries as a short list: runs of whole ranks are joined."""
    wanted = set(names)
    chosen = [standing for standing in board.standings if standing.name in wanted]
    found = []
    for division in ("online", OFFLINE):
        letter = "o" if division == OFFLINE else ""
        ranks = sorted({s.rank for s in chosen if s.row["division"] == division and s.rank is not None})
        found += [letter + run for run in _runs(ranks)]
    return found


def _runs(ranks: Sequence[int]) -> Iterator[str]:
    """Whole numbers in order, neighbours joined.

    >>> list(_runs([1, 3, 4, 5, 8, 9]))
    ['1', '3–5', '8', '9']
    """
    for _, group in itertools.groupby(enumerate(ranks), key=lambda item: item[1] - item[0]):
        run = [rank for _, rank in group]
        if len(run) > 2:
            yield f"{run[0]}–{run[-1]}"
        else:
            yield from map(str, run)


def plain(text: str) -> str:
    """Untrusted text in one line of Markdown, every sign that would mean something escaped.

    >>> plain("a|b <script> [x](y)")
    'a\\\\|b \\\\<script\\\\> \\\\[x\\\\](y)'
    """
    return _escaped(text.strip())


def _escaped(text: str) -> str:
    return re.sub(r"([\\|<>&*_`\[\]!#~])", r"\\\1", re.sub(r"\s+", " ", text))
