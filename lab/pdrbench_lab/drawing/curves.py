"""Figures of several panels for what is not on a map: curves over time, tracks without a building."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pdrbench.geometry import FloatArray
from pdrbench.picture import estimate_style
from pdrbench.report.cdf import LocalizerErrors, draw_cdf


def panels(
    titles: Sequence[str],
    *,
    columns: int = 2,
    panel_in: tuple[float, float] = (4.4, 3.2),
    x_label: str = "",
    y_label: str = "",
    is_plan: bool = False,
) -> tuple[Figure, list[Axes]]:
    """A figure with one empty panel for each title, at most `columns` in a row, each of `panel_in` inches.

    Panels of a plan have equal scales on both axes.

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


def save_figures(figures: Mapping[str, Figure], folder: Path, dpi: int) -> list[Path]:
    """Writes each figure as `<name>.png` into a folder, which is made; returns the files."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / f"{name}.png" for name in figures]
    for path, figure in zip(paths, figures.values(), strict=True):
        figure.savefig(path, dpi=dpi)
    return paths


def cdf_figure(name: str, by_walk: Mapping[str, FloatArray], stated: Mapping[float, float], *, title: str) -> Figure:
    """The errors in metres (n,) of all walks in one curve, with a band by the spread of walks.

    `stated` holds errors in metres by quantile, as a paper states them; they are drawn as crosses.
    """
    figure = Figure(figsize=(5.0, 3.6), layout="constrained")
    ax = figure.add_subplot()
    errors = LocalizerErrors(name, by_walk, {walk: walk for walk in by_walk})
    if stated:
        ax.plot(list(stated.values()), list(stated), "x", color="black", label="the paper", zorder=10)
    draw_cdf(ax, [errors], {name: estimate_style(0)})
    ax.set_title(title, fontsize=10)
    return figure
