"""Figures with room for a building: one exploded drawing, or a plan for each level."""

from __future__ import annotations

from typing import Final

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from pdrbench.building import Building
from pdrbench.picture.plan import MARGIN_M, Bounds, draw_level
from pdrbench_formats.replays.view import View
from pdrbench_lab.drawing.exploded import draw_exploded

WIDTH_IN: Final = 8.0
TITLE_IN: Final = 0.35
WIDE: Final = 0.6  # height over width below which plans stand above each other


def exploded_figure(
    building: Building, *, title: str = "", width_in: float = WIDTH_IN, view: View | None = None
) -> tuple[Figure, Axes, View]:
    """A figure that holds the exploded building and nothing else; what is to be shown is drawn on its axes.

    >>> import numpy as np
    >>> from pdrbench_sim.buildings.office import make_office
    >>> figure, ax, view = exploded_figure(make_office(np.random.default_rng(0)))
    >>> view.stretch
    10.0
    """
    figure = Figure(figsize=(width_in, width_in))
    FigureCanvasAgg(figure)
    ax = figure.add_axes((0, 0, 1, 1))
    view = draw_exploded(ax, building, view)
    (left, right), (low, high) = ax.get_xlim(), ax.get_ylim()
    drawing_in = width_in * (high - low) / (right - left)
    height_in = drawing_in + (TITLE_IN if title else 0.0)
    figure.set_size_inches(width_in, height_in)
    ax.set_position((0, 0, 1, drawing_in / height_in))
    if title:
        figure.suptitle(title, fontsize=10, y=1 - 0.3 * TITLE_IN / height_in, va="top")
    return figure, ax, view


def level_panels(
    building: Building, *, title: str = "", width_in: float = WIDTH_IN, bounds_m: Bounds | None = None
) -> tuple[Figure, dict[int, Axes]]:
    """A figure with the plan of every level, and the axes of each, lowest first.

    All have the same limits: those of `bounds_m`, of the whole building where it is None.
    """
    xmin, ymin, xmax, ymax = building.bounds_m() if bounds_m is None else bounds_m
    ratio = (ymax - ymin + 2 * MARGIN_M) / (xmax - xmin + 2 * MARGIN_M)
    count = len(building.levels)
    columns = 1 if ratio < WIDE else count
    rows = -(-count // columns)
    height_in = rows * (width_in / columns * ratio + 0.5) + (0.4 if title else 0.1)
    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    FigureCanvasAgg(figure)
    panels: dict[int, Axes] = {}
    places = reversed(range(count)) if columns == 1 else range(count)  # stacked plans: the highest level above
    for place, level in zip(places, building.levels, strict=True):
        ax = figure.add_subplot(rows, columns, place + 1)
        draw_level(ax, building, level, bounds_m=(xmin, ymin, xmax, ymax))
        ax.set_title(f"level {level}", fontsize=9)
        panels[level] = ax
    if title:
        figure.suptitle(title, fontsize=10)
    return figure, panels
