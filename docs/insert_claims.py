"""Puts the last output of `pdrbench reproduce` into the pages of papers: `python docs/insert_claims.py li2012 ...`.

The table of `pdrbench-results/reproduce/NAME/claims.md` replaces that of `docs/NAME.md`, or, of `NAME:PAGE`, the one
below the line `<!-- NAME -->` of `docs/PAGE.md`. What is written about it does not follow: lines whose value or verdict
changed are printed.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Final

HEAD: Final = "| id | what | paper | ours |"
VALUE, VERDICT = 3, 6


def table(lines: list[str], name: str = "") -> slice:
    """Where the table of claims stands: the first, or the first below the mark of a reproduction that shares a page."""
    mark = f"<!-- {name} -->"
    below = lines.index(mark) if mark in lines else 0
    begin = next(row for row, line in enumerate(lines) if row >= below and line.startswith(HEAD))
    end = next((row for row in range(begin, len(lines)) if not lines[row].startswith("|")), len(lines))
    return slice(begin, end)


def insert(name: str, results: Path, page_name: str = "") -> None:
    """Replaces the table of one page, and prints what changed."""
    page = Path(__file__).parent / f"{page_name or name}.md"
    lines = page.read_text(encoding="utf-8").splitlines()
    made = (results / name / "claims.md").read_text(encoding="utf-8").splitlines()
    old = {tuple(line.split(" | ")[:2]): line.split(" | ") for line in lines[table(lines, name)]}
    for new in made[table(made)][2:]:  # below the header and its rule
        before = old.get(tuple(new.split(" | ")[:2]))
        if before is None or any(before[cell] != new.split(" | ")[cell] for cell in (VALUE, VERDICT)):
            was = f"was {before[VALUE]}, {before[VERDICT]}" if before else "is new"
            sys.stdout.write(f"{name}: {new}\n    {was}\n")
    lines[table(lines, name)] = made[table(made)]
    page.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    for paper in sys.argv[1:]:
        reproduced, _, shared_page = paper.partition(":")
        insert(reproduced, Path("pdrbench-results/reproduce"), shared_page)
