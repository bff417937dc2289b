"""One walk on its floor plan: the reference and every localizer, a panel for each level."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pdrbench.geometry import BoolArray, FloatArray
from pdrbench.picture import REFERENCE, draw_level, draw_trail
from pdrbench.picture.plan import MARGIN_M, Bounds
from pdrbench.recording import Recording
from pdrbench.report.cdf import Styles
from pdrbench.result import Result
from pdrbench.trajectory import Estimates, Start, Trajectory

MAX_COLUMNS: Final = 3
PANEL_IN: Final = 6.0
LABELS_IN: Final = 0.75  # of a panel, for the texts at its axes
LEGEND_IN: Final = 0.8  # with the title
START_ZORDER: Final = 12.0  # above every path
WIDE: Final = 0.5  # height over width below which panels take a whole row
CHARACTERS_AN_INCH: Final = 12  # of a title
MIN_FRACTION: Final = 0.02  # a level that holds fewer of a localizer's estimates gets no panel of its own
MAX_DOTS: Final = 60  # surveyed positions that get a dot; a denser reference is a line
SURROUND_M: Final = 10.0
MIN_OUTSIDE_FRACTION: Final = 0.1  # of estimates outside the panels that the title mentions


def levels_to_show(recording: Recording, results: Mapping[str, Result], bounds_m: Bounds) -> tuple[int, ...]:
    """Levels the walk visits, and levels on which a localizer has 2 % of its estimates or more within `bounds_m`."""
    levels = {int(level) for level in recording.reference.level}
    for result in results.values():
        estimates = result.estimates
        values, counts = np.unique(estimates.level[_inside(estimates, bounds_m)], return_counts=True)
        enough = counts >= MIN_FRACTION * np.count_nonzero(estimates.given)
        levels |= {int(level) for level in values[enough]}
    return tuple(sorted(levels))


def draw_walk(
    recording: Recording,
    results: Mapping[str, Result],
    styles: Styles,
    title: str,
    start: Start | None = None,
    kind: type[Figure] = Figure,
) -> Figure:
    """The trajectories of one walk: its reference and one result per localizer, in the order of the legend.

    Args:
        recording: Of the walk.
        results: By localizer.
        styles: By localizer.
        title: Above the panels.
        start: Where a cross marks the start; None for no cross.
        kind: Of the figure.
    """
    bounds_m = bounds_to_show(recording, results)
    levels = levels_to_show(recording, results, bounds_m)
    ratio = _height_over_width(bounds_m)
    columns, panel_in = (1, 2 * PANEL_IN) if ratio < WIDE else (min(MAX_COLUMNS, len(levels)), PANEL_IN)
    rows = -(-len(levels) // columns)
    height_in = (panel_in - LABELS_IN) * min(max(ratio, 0.15), 1.25) + LABELS_IN
    figure = kind(figsize=(panel_in * columns, height_in * rows + LEGEND_IN), layout="constrained")
    for panel, level in enumerate(levels):
        ax = figure.add_subplot(rows, columns, panel + 1)
        ax.set_title(f"level {level}", fontsize=9)
        draw_level(ax, recording.building, level, bounds_m=bounds_m)
        _draw_reference(ax, recording.reference, level)
        if start is not None:
            place = start.xy_m if start.level == level else np.full(2, np.nan)
            ax.plot(*place, linestyle="none", marker="X", color="black", zorder=START_ZORDER, label="start")
        for name, result in results.items():
            estimates = result.estimates
            draw_trail(ax, estimates.xy_m, styles[name], on_level=estimates.level == level, label=name)
    outside = _outside(results, bounds_m)
    if outside:
        title = f"{title}\noutside the picture: {outside}"
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=8)
    width = int(CHARACTERS_AN_INCH * panel_in * columns)
    figure.suptitle("\n".join(textwrap.fill(line, width) for line in title.splitlines()), fontsize=10)
    return figure


def _draw_reference(ax: Axes, reference: Trajectory, level: int) -> None:
    """The line, and a dot at every surveyed position unless they are dense."""
    if not len(reference):
        return
    here = reference.level == level
    draw_trail(ax, reference.xy_m, REFERENCE, on_level=here, label="reference")
    if not 0 < np.count_nonzero(reference.surveyed) <= MAX_DOTS:
        return
    places = reference.xy_m[here & reference.surveyed]
    ax.plot(
        places[:, 0],
        places[:, 1],
        linestyle="none",
        marker="o",
        markersize=3.5,
        markerfacecolor="white",
        markeredgecolor="black",
        zorder=REFERENCE.zorder + 0.5,
        label="surveyed",
    )


def bounds_to_show(recording: Recording, results: Mapping[str, Result]) -> Bounds:
    """What every panel shows: the walk with 10 m of the building around it, and estimates that lie not too far away.

    For these the box grows on each side by at most the larger side that it had; one in fifty may lie beyond each side.
    """
    places = recording.reference.xy_m if len(recording.reference) else _usual_places(results)
    first_m, last_m = places.min(axis=0), places.max(axis=0)
    low_m, high_m = first_m - SURROUND_M, last_m + SURROUND_M
    if recording.building is not None:
        xmin, ymin, xmax, ymax = recording.building.bounds_m()
        low_m = np.minimum(np.maximum(low_m, [xmin, ymin]), first_m)
        high_m = np.maximum(np.minimum(high_m, [xmax, ymax]), last_m)
    reach_m = float((high_m - low_m).max())
    nearest_m, farthest_m = low_m - reach_m, high_m + reach_m
    for result in results.values():
        xy_m = np.clip(result.estimates.xy_m[result.estimates.given], nearest_m, farthest_m)
        if len(xy_m):
            low_m = np.minimum(low_m, np.quantile(xy_m, MIN_FRACTION, axis=0))
            high_m = np.maximum(high_m, np.quantile(xy_m, 1 - MIN_FRACTION, axis=0))
    return float(low_m[0]), float(low_m[1]), float(high_m[0]), float(high_m[1])


def _usual_places(results: Mapping[str, Result]) -> FloatArray:
    """(N, 2) estimates that lie at most three times as far from their first as localizers usually get."""
    paths = [result.estimates.xy_m[result.estimates.given] for result in results.values()]
    paths = [xy_m for xy_m in paths if len(xy_m)]
    if not paths:
        return np.zeros((1, 2))
    reach_m = [np.hypot(*(xy_m - xy_m[0]).T) for xy_m in paths]
    usual_m = 3.0 * float(np.median([of_path.max() for of_path in reach_m]))
    return np.concatenate([xy_m[of_path <= usual_m] for xy_m, of_path in zip(paths, reach_m, strict=True)])


def _outside(results: Mapping[str, Result], bounds_m: Bounds) -> str:
    """Which localizers have a tenth or more of their estimates outside the panels, and how many."""
    notes = []
    for name, result in results.items():
        inside = _inside(result.estimates, bounds_m)[result.estimates.given]
        if len(inside) and inside.mean() <= 1 - MIN_OUTSIDE_FRACTION:
            notes.append(f"{name} {100 * (1 - inside.mean()):.0f} %")
    return ", ".join(notes)


def _inside(estimates: Estimates, bounds_m: Bounds) -> BoolArray:
    """(N,) True where an estimate was given and lies in the picture."""
    xmin, ymin, xmax, ymax = bounds_m
    x_m, y_m = estimates.xy_m.T
    inside: BoolArray = estimates.given & (x_m >= xmin) & (x_m <= xmax) & (y_m >= ymin) & (y_m <= ymax)
    return inside


def _height_over_width(bounds_m: Bounds) -> float:
    xmin, ymin, xmax, ymax = bounds_m
    return (ymax - ymin + 2 * MARGIN_M) / (xmax - xmin + 2 * MARGIN_M)
