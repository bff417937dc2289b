"""A figure of one distribution of errors, with what a paper states marked in it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from pdrbench.geometry import FloatArray
from pdrbench.picture import estimate_style
from pdrbench.report.cdf import Errors, draw_cdf


def cdf_figure(name: str, by_walk: Mapping[str, FloatArray], stated: Mapping[float, float], *, title: str) -> Figure:
    """The errors of all walks in one curve, with a band from resampled walks.

    Args:
        name: Of the curve.
        by_walk: (n,) errors in metres, by walk.
        stated: Error in metres by share, as a paper states them; drawn as crosses.
        title: Above the figure.
    """
    figure = Figure(figsize=(5.0, 3.6), layout="constrained")
    FigureCanvasAgg(figure)
    ax = figure.add_subplot()
    errors = Errors(name, by_walk, dict.fromkeys(by_walk, ""))
    if stated:
        ax.plot(list(stated.values()), list(stated), "x", color="black", label="the paper", zorder=10)
    draw_cdf(ax, [errors], {name: estimate_style(0)}, np.random.default_rng(0))  # the same results, the same picture
    ax.set_title(title, fontsize=10)
    return figure
