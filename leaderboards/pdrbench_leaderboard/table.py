"""`<board>/README.md`: one board as Markdown, made of nothing but entries."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from typing import Final

from pdrbench.errors import plain_line
from pdrbench.evaluation.number_text import NOTHING, page_decimals
from pdrbench.evaluation.wording import counted
from pdrbench.result import ONLINE
from pdrbench_leaderboard.boards import P75, Board
from pdrbench_leaderboard.standings import Row, Table

FILE_NAME: Final = "README.md"
SCORE: Final = "off by, m"
FOUND: Final = "found after, s"  # of boards on which no start is given
PRIVATE_RATIO: Final = "private / public"  # of boards with private recordings
HEAD: Final = (
    "rank",
    "entry",
    SCORE,
    "times the first",
    "walks",
    "mean, m",
    "pooled p75, m",
    "pooled p95, m",
    "lost, %",
    "in the 95 % disc, %",
    "outside, %",
    FOUND,
    "processor, % of real time",
    "public p75, m",
    PRIVATE_RATIO,
    "uses",
)
LEFT: Final = frozenset({"entry", "uses"})
DIVISION_TITLES: Final = {"online": "As it was answered", "offline": "As it was revised when the walk was over"}


def page(board: Board, tables: Sequence[Table]) -> str:
    """A board as Markdown; the same entries give the same bytes."""
    lines = [f"# {board.title}", "", plain(board.summary), ""]
    if not tables:
        return "\n".join([*lines, f"Nothing was played yet: `pdrbench leaderboard run {board.name}`.", ""])
    head = ["environment", "held-out walks", "public walks", "units"]
    lines += [*_grid(head, environment_lines(tables[0]), {"environment"}), ""]
    for table in tables:
        head = shown_head(table)
        titles = [board.score_title if name == SCORE else name for name in head]
        rows = [[value for name, value in cells(row).items() if name in head] for row in table.rows]
        lines += [f"## {DIVISION_TITLES[table.division]}", "", *_grid(titles, rows, LEFT), ""]
        lines += [f"* {text}" for text in notes(table)] + [""]
        head, strata = strata_of(table)
        if strata:
            score = "Off by, in metres" if board.metric == P75 else board.metric
            lines += [f"{score}, by environment and kind of walk:", "", *_grid(head, strata, {"walks"}), ""]
    return "\n".join(lines)


def environment_lines(table: Table) -> list[list[str]]:
    """A line for each environment: walks and units."""
    found = []
    for listed in table.environments():
        walks = table.walks[listed.env, "held-out"].walks
        public = table.walks.get((listed.env, "public"))
        units = str(len({walk.unit for walk in walks}))
        if table.ranking is not None and listed.env in table.ranking.by_walk:
            units = "its walks: one person or building"
        found.append([listed.env, str(len(walks)), str(len(public.walks)) if public else NOTHING, units])
    return found


def shown_head(table: Table) -> list[str]:
    """Columns of a table."""
    shown = {FOUND: table.is_lost, PRIVATE_RATIO: bool(table.private_ratios)}
    return [name for name in HEAD if shown.get(name, True)]


def cells(row: Row) -> dict[str, str]:
    """One entry by column, as in `HEAD`."""
    of = row.standing
    values = [
        rank_text(row),
        f"`{row.name}`",
        f"{page_decimals(of.score_m)} ({span(of.low_m, of.high_m)})",
        ratio_text(row),
        walks_text(row),
        *(number(value) for value in (row.mean_m, row.p75_m, row.p95_m)),
        percent(row.lost),
        percent(row.coverage),
        number(row.outside_pct),
        "never" if math.isinf(row.found_s) else number(row.found_s),
        percent(row.load),
        number(row.public_m),
        number(row.private_ratio),
        uses(row),
    ]
    return dict(zip(HEAD, values, strict=True))


def rank_text(row: Row) -> str:
    """The places that the tests leave: 1, or 2–4."""
    low, high = row.standing.rank
    return str(low) if low == high else f"{low}–{high}"


def ratio_text(row: Row) -> str:
    """How many times the score of the first it has, with its interval."""
    of = row.standing
    return "1" if math.isnan(of.ratio_low) else f"{of.ratio:.2f} ({of.ratio_low:.2f}–{of.ratio_high:.2f})"


def walks_text(row: Row) -> str:
    """How many walks it played, of how many where it did not play all."""
    of = row.standing
    return str(of.of) if row.is_complete else f"{of.walks} of {of.of}"


def uses(row: Row) -> str:
    """What it makes use of, by its card."""
    card = row.entry.card
    more = [name for name, used in (("map", card.map_used), ("survey", card.survey_used)) if used]
    return ", ".join([*card.sensors_used, *more]) or NOTHING


def number(value: float) -> str:
    """Three digits; a dash where there is none."""
    return page_decimals(value) if math.isfinite(value) else NOTHING


def percent(value: float) -> str:
    """A fraction in percent."""
    return number(100.0 * value)


def span(low: float, high: float) -> str:
    """An interval."""
    return f"{number(low)}–{number(high)}" if math.isfinite(low) else "no interval"


def notes(table: Table) -> Iterator[str]:
    """What to know when reading a table."""
    ranking = table.ranking
    if ranking is None:
        return
    if table.division == ONLINE:
        yield from _general_notes(table)
    yield f"{table.num_apart} of {counted('pair', table.num_pairs)} are separated."
    if ranking.ties:
        tied = "; ".join(", ".join(f"`{name}`" for name in tie) for tie in ranking.ties)
        yield f"Not separated: {tied}."
    smallest = ranking.smallest_ratio()
    if math.isfinite(smallest):
        yield f"The smallest ratio between neighbours that the board can tell is {smallest:.2f}."
    if table.private_ratios:
        yield (
            "Private / public: off by on recordings whose truth is with the host alone, over that on walks of the same "
            "environment whose truth is public. What was learned by heart is much worse on the former."
        )
    orders = {"public and on held-out walks": table.agreement, "two random halves of the units": table.halves_agree}
    for on, (apart, every) in orders.items():
        if math.isfinite(every):
            tau = f"Kendall's tau of the orders on {on}: {every:.2f} over all pairs"
            yield f"{tau}, {number(apart)} over those separated."
    every, low, high = table.generated_agrees
    if math.isfinite(every):
        yield (
            f"Kendall's tau of the orders on generated and on recorded walks: {every:.2f} over all pairs, "
            f"{low:.2f} to {high:.2f} on random halves of the units."
        )
    for row in table.rows:
        if not row.is_complete:
            reasons = sorted({reason for of in table.divisions(row.entry).values() for reason in of.failures})
            why = f": {plain(reasons[0])}" if reasons else ""
            yield f"`{row.name}` played {walks_text(row)} walks; on others the worst answer of any entry counts{why}."


def _general_notes(table: Table) -> Iterator[str]:
    """What holds of every division of a board."""
    numbers = sorted({of.round for of in table.walks.values()})
    public = all(table.board.round(of).secret for of in numbers)
    yield (
        f"Held-out walks of round {', '.join(map(str, numbers))} rank"
        f"{', whose secret is published: any user can play them' if public else ''}. "
        "Recorded walks are replayed in another frame. Their truth is public: memorising is detected by canary and "
        "review, not excluded."
    )
    of = "the third quartile of the error (p75), 15 m added for each wrong level"
    is_usual = table.board.metric == P75
    score = (
        f"Off by: geometric mean over walks of {of}" if is_usual else f"{table.board.metric}: geometric mean over walks"
    )
    yield (
        f"{score}, in brackets its 95 % interval; environments count alike, below 30 units by their number. The rank "
        "is an interval: the places that paired tests cannot exclude (sign flips by unit, Holm over all pairs, 5 %)."
    )


def strata_of(table: Table) -> tuple[list[str], list[list[str]]]:
    """Header and lines of scores by environment and by group of walks: a line for each, a column for each entry."""
    envs = [listed.env for listed in table.environments()] if len(table.environments()) > 1 else []
    lines = [[env, *(number(row.by_env.get(env, math.nan)) for row in table.rows)] for env in envs]
    groups = table.by_group.items()
    lines += [[name, *(number(of.get(row.name, math.nan)) for row in table.rows)] for name, of in groups]
    return ["walks", *(f"`{row.name}`" for row in table.rows)], lines


def _grid(
    head: Sequence[str], lines: Iterator[list[str]] | Sequence[list[str]], left: frozenset[str] | set[str]
) -> list[str]:
    rule = [":--" if name in left else "--:" for name in head]
    return ["| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in (head, rule, *lines)]


def plain(text: str) -> str:
    """Untrusted text in one line of Markdown, every sign that would mean something escaped.

    >>> plain("a|b <script> [x](y)\\u202e")
    'a\\\\|b \\\\<script\\\\> \\\\[x\\\\](y)?'
    """
    return re.sub(r"([\\|<>&*_`\[\]!#~])", r"\\\1", re.sub(r"\s+", " ", plain_line(text)))
