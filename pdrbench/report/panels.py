"""Figures of several panels for what is not on a map: curves over time, tracks without a building."""

from __future__ import annotations

import math
from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure


def panels(
    titles: Sequence[str],
    *,
    columns: int = 2,
    panel_in: tuple[float, float] = (4.4, 3.2),
    x_label: str = "",
    y_label: str = "",
    is_plan: bool = False,
) -> tuple[Figure, list[Axes]]:
    """A figure with one empty panel for each title, row by row.

    Args:
        titles: Above each panel.
        columns: Panels beside one another, at most.
        panel_in: Width and height of a panel in inches.
        x_label: Below every panel.
        y_label: Beside every panel.
        is_plan: A metre is as long to the side as ahead.

    >>> figure, axes = panels(["walk", "run", "crawl"], x_label="seconds")
    >>> len(axes), axes[2].get_title()
    (3, 'crawl')
    """
    columns = min(columns, len(titles))
    rows = math.ceil(len(titles) / columns)
    figure = Figure(figsize=(panel_in[0] * columns, panel_in[1] * rows), layout="constrained")
    axes: list[Axes] = []
    for index, title in enumerate(titles, start=1):
        ax = figure.add_subplot(rows, columns, index)
        ax.set_title(title, fontsize=9)
        ax.set_xlabel(x_label, fontsize=8)
        ax.set_ylabel(y_label, fontsize=8)
        ax.tick_params(labelsize=8)
        if is_plan:
            ax.set_aspect("equal")
        ax.grid(alpha=0.25)
        axes.append(ax)
    return figure, axes
