"""Figures of a scorecard: for each block the distribution of every statistic, real beside synthetic."""

from __future__ import annotations

import textwrap
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing

from pdrbench.geometry import FloatArray
from pdrbench.picture import estimate_style
from pdrbench.report.folder import DPI, UNDATED
from pdrbench_lab.drawing.curves import panels
from pdrbench_lab.realism import load_block
from pdrbench_lab.realism.block import Block, Order, RealismStatistic, Within
from pdrbench_lab.realism.criteria import ScorecardRow
from pdrbench_lab.realism.format import UNDECIDED
from pdrbench_lab.realism.measure import MeasuredBlock
from pdrbench_lab.realism.scorecard import Scorecard
from pdrbench_lab.realism.two_samples import HIGH, LOW

PANEL_IN: Final = (2.9, 2.3)
COLUMNS: Final = 4
TITLE_WIDTH: Final = 36  # characters of a line above a panel
TAIL: Final = 0.005  # fraction at either end that may lie outside the panel: one far value does not squeeze the rest
REAL_COLOUR: Final = "black"


def draw_blocks(scorecard: Scorecard, folder: Path) -> list[Path]:
    """Writes `BLOCK.png` for every block that was measured; returns their paths.

    Args:
        scorecard: What to draw.
        folder: Exists.
    """
    files = []
    for name, measured in scorecard.measured.items():
        if measured.real is None or measured.synthetic is None:
            continue
        rows = {row.statistic: row for row in scorecard.rows if row.block == name}
        figure = block_figure(load_block(name), measured, rows)
        if figure is not None:
            path = folder / f"{name.replace(':', '.')}.png"
            figure.savefig(path, dpi=DPI, metadata=UNDATED["png"])
            files.append(path)
    return files


def block_figure(block: Block, measured: MeasuredBlock, rows: dict[str, ScorecardRow]) -> Drawing | None:
    """One panel for each statistic that has a distribution; None where none has.

    Args:
        block: The block.
        measured: Its values.
        rows: Its rows by statistic.
    """
    drawn = [s for s in block.statistics if not isinstance(s.rule, Order) and _synthetic(measured, s).size]
    if not drawn:
        return None
    titles = [textwrap.fill(_title(rows[statistic.name]), TITLE_WIDTH) for statistic in drawn]
    figure, axes = panels(titles, columns=COLUMNS, panel_in=PANEL_IN, y_label="fraction")
    for ax, statistic in zip(axes, drawn, strict=True):
        _draw(ax, statistic, measured)
    axes[0].legend(loc="lower right", fontsize=7, framealpha=0.9)
    figure.suptitle(block.name, fontsize=11)
    return figure


def _title(row: ScorecardRow) -> str:
    if not row.judged:
        return f"{row.what}: {UNDECIDED}"
    return f"{row.what}: {'passes' if row.passed else 'fails'}"


def _synthetic(measured: MeasuredBlock, statistic: RealismStatistic) -> FloatArray:
    values = np.asarray((measured.synthetic or {}).get(statistic.name, ()), dtype=np.float64)
    return values[np.isfinite(values)]


def _draw(ax: Axes, statistic: RealismStatistic, measured: MeasuredBlock) -> None:
    """Step functions of both sides; the middle 80 % of the synthetic side shaded, or the range that was published."""
    synthetic, colour = _synthetic(measured, statistic), estimate_style(0).colour
    stored = measured.real.statistics.get(statistic.name) if measured.real is not None else None
    real = np.array(stored.values if stored is not None else ())
    if isinstance(statistic.rule, Within):
        ax.axvspan(statistic.rule.low, statistic.rule.high, color=REAL_COLOUR, alpha=0.12, linewidth=0)
    else:
        ax.axvspan(*np.quantile(synthetic, (LOW, HIGH)), color=colour, alpha=0.12, linewidth=0)
    ax.ecdf(synthetic, color=colour, label=f"synthetic, {len(synthetic)}")
    if len(real) > 1:
        ax.ecdf(real, color=REAL_COLOUR, label=f"real, {stored.num if stored is not None else 0}")
    if len(real):
        ax.axvline(float(np.median(real)), color=REAL_COLOUR, linewidth=0.8, linestyle="--", label="real median")
    ax.set_xlim(*_limits(statistic, real, synthetic))
    ax.set_xlabel(f"{statistic.unit or 'ratio'}, per {statistic.per}", fontsize=8)


def _limits(statistic: RealismStatistic, real: FloatArray, synthetic: FloatArray) -> tuple[float, float]:
    """Ends of the x-axis: nearly all of both sides, the published range with them."""
    ends = [float(end) for side in (real, synthetic) if len(side) for end in np.quantile(side, (TAIL, 1 - TAIL))]
    if isinstance(statistic.rule, Within):
        ends += [statistic.rule.low, statistic.rule.high]
    low, high = min(ends), max(ends)
    margin = 0.05 * (high - low) or 0.05 * abs(high) or 1.0
    return low - margin, high + margin
