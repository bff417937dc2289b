"""The overview of all leaderboards in `baselines.md`, taken from the tables that `pdrbench leaderboard build` wrote."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parents[1]
PAGE: Final = ROOT / "docs" / "baselines.md"
BEGIN, END = "<!-- leaderboards -->\n", "<!-- leaderboards end -->"
HEAD: Final = (
    "| environment | ranked | first | score on held-out walks | next | behind | `stay-v0` |",
    "|---|---|---|---|---|---|---|",
)
RANK, NAME, SCORE, _, _, BEHIND = range(6)  # columns of TABLE.md
NO_CLAIM: Final = "stay-v0"


def cells(line: str) -> list[str]:
    """Of one row of a table in Markdown."""
    return [cell.strip().replace("\\|", "|") for cell in re.split(r"(?<!\\)\|", line.strip())[1:-1]]


def lines_of(table: Path) -> list[list[str]]:
    """The rows of a TABLE.md, its head first."""
    text = table.read_text(encoding="utf-8")
    rows = [cells(line) for line in text.splitlines() if line.startswith("| ")]
    return [row for row in rows if not set(row[RANK]) <= set(":-")]


def overview(root: Path = ROOT / "leaderboards") -> Iterator[str]:
    """A row for each leaderboard that ranks two online entries or more, by name."""
    yield from HEAD
    for table in sorted(root.glob("*/TABLE.md")):
        head, *rows = lines_of(table)
        ranked = [row for row in rows if row[RANK].isdigit()]
        if len(ranked) < 2:
            continue
        metric, _ = head[SCORE].split(",")
        first, *others = ranked
        behind = [row for row in others if row[NAME].strip("`") != NO_CLAIM][:1] or [["–"] * len(first)]
        stays = next((row[SCORE] for row in ranked if row[NAME].strip("`") == NO_CLAIM), "–")
        unit = " %" if metric.endswith("_pct") else " m" if metric.endswith("_m") else ""
        score = re.sub(r"^[\d.]+", rf"\g<0>{unit}", first[SCORE])
        env = table.parent.name
        cells = (f"`{env}`", str(len(ranked)), first[NAME], score, behind[0][NAME], behind[0][BEHIND], stays)
        yield f"| {' | '.join(cells)} |"


def page() -> bytes:
    """`baselines.md` with the overview of today."""
    text = PAGE.read_text(encoding="utf-8")
    before, rest = text.split(BEGIN)
    _, after = rest.split(END)
    return (before + BEGIN + "\n".join(overview()) + "\n" + END + after).encode()
