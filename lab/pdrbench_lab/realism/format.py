"""A scorecard as cells of a table, as a page, as JSON; and failures, line by line."""

from __future__ import annotations

import json
import math
from typing import Final

from pdrbench_lab.realism.criteria import ScorecardRow, Triple
from pdrbench_lab.realism.scorecard import GATE, ControlResult, Scorecard

HEAD: Final = ("block", "what", "per", "real", "synthetic", "distance", "found", "pass", "why")
YES: Final = {True: "yes", False: "no"}
UNDECIDED: Final = "cannot tell"


def shown(value: float) -> str:
    """Three significant digits, without an exponent where it can be read without one.

    >>> shown(1234.5), shown(0.01234), shown(5.0)
    ('1234', '0.0123', '5')
    """
    if value and not 1e-4 <= abs(value) < 1e6:
        return f"{value:.2e}"
    digits = 3 if not value else max(3, math.ceil(math.log10(abs(value))))
    return f"{value:.{digits}g}"


def cells(row: ScorecardRow) -> list[str]:
    """Cells of a row: block, what, per, real, synthetic, distance, shift with the chance to find it, pass, why."""
    unit = f", {row.unit}" if row.unit else ""
    return [
        row.title,
        f"{row.what}{unit}",
        row.per,
        _between(row.real),
        _between(row.synthetic),
        "" if math.isnan(row.distance) else f"{row.distance:.2f}",
        "" if math.isnan(row.power) else f"{shown(row.size)}: {row.power:.0%}",
        YES[row.passed] if row.judged else UNDECIDED,
        row.why,
    ]


def _between(triple: Triple | None) -> str:
    """The median and what lies around it; a single figure where nothing does."""
    if triple is None:
        return "–"
    low, middle, high = (shown(value) for value in triple)
    return middle if low == middle == high else f"{middle} ({low} to {high})"


def control_line(control: ControlResult) -> str:
    """The result of a control, in a line."""
    reported = f"{control.row.title}: {control.what} -> {control.row.statistic} fails: {YES[control.fails]}"
    if not control.row.judged:
        return f"{reported} (not judged: {control.row.why})"
    return reported if control.passes_without else f"{reported} (and fails without it)"


def summary(found: Scorecard) -> str:
    """How many rows pass and how many controls fail, in a line."""
    line = f"{found.num_passed} of {len(found.rows)} rows pass ({found.fraction:.0%}; the gate is {GATE:.0%})"
    undecided = sum(not row.judged for row in found.rows)
    if undecided:
        decided = len(found.rows) - undecided
        line += f"; {undecided} are undecided and do not pass, {found.num_passed} of the other {decided} do"
    if not found.controls:
        return line
    failing = sum(control.fails for control in found.controls)
    return f"{line}; {failing} of {len(found.controls)} negative controls fail, as they must"


def footnotes(found: Scorecard) -> list[str]:
    """What the table does not show, a line each."""
    lines = []
    for name, result in found.measured.items():
        lines += [f"{name}, {what}: {why}" for what, why in result.failures.items()]
    for name, names in found.differs.items():
        if names:
            lines.append(
                f"{name}: the recordings give other values than are stored, of {', '.join(names)}; run `pdrbench data "
                f"verify`, and where the statistic itself was changed, write the targets anew"
            )
    return lines


def to_json(found: Scorecard) -> str:
    """The scorecard for machines."""
    return json.dumps(found.plain(), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def to_markdown(found: Scorecard) -> str:
    """The table, the controls and what failed, as a page."""
    lines = ["# Synthetic recordings beside real ones", "", summary(found), ""]
    lines += [f"| {' | '.join(HEAD)} |", "|" + "---|" * len(HEAD)]
    for row in found.rows:
        lines.append(f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells(row))} |")
    reported = [*map(control_line, found.controls), *footnotes(found)]
    return "\n".join([*lines, "", *(f"* {line}" for line in reported)]).rstrip() + "\n"
