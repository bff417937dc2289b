"""How one score spreads over walks: a box and every walk beside it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes

from pdrbench.geometry import FloatArray
from pdrbench.report.cdf import Styles


def draw_spread(
    ax: Axes, by_localizer: Mapping[str, FloatArray], styles: Styles, label: str, *, is_log: bool = False
) -> None:
    """One box per localizer and one point per walk, of (W,) values by localizer; not finite ones are left out.

    Boxes are quartiles, whiskers reach to the farthest walk within 1.5 times the height of the box; points are
    spread sideways evenly in the order of their value, so the same scores always give the same picture. `label` is the
    name and unit of the value.
    """
    for index, (name, values) in enumerate(by_localizer.items()):
        values = np.sort(values[np.isfinite(values)])
        if not len(values):
            continue
        style = styles[name]
        ax.boxplot(
            [values],
            positions=[index],
            widths=0.6,
            showfliers=False,
            medianprops={"color": "black", "linewidth": 1.5},
            boxprops={"color": style.colour},
            whiskerprops={"color": style.colour},
            capprops={"color": style.colour},
            manage_ticks=False,
        )
        ax.plot(
            index + _sideways(len(values)),
            values,
            linestyle="none",
            marker=style.marker,
            markersize=4,
            color=style.colour,
            alpha=0.7,
            markeredgewidth=0,
        )
    ax.set_xticks(range(len(by_localizer)), list(by_localizer), rotation=20, ha="right", fontsize=8)
    ax.set_xlim(-0.6, len(by_localizer) - 0.4)
    if is_log:
        ax.set_yscale("log")
        ax.yaxis.set_major_formatter("{x:g}")
    else:
        ax.set_ylim(bottom=0.0)
    ax.set_ylabel(label)
    ax.grid(True, axis="y", linewidth=0.3)


def _sideways(count: int) -> FloatArray:
    """(count,) offsets in [-0.2, 0.2] by the golden ratio, which never lines up neighbours."""
    offsets: FloatArray = 0.4 * ((np.arange(count, dtype=np.float64) * 0.6180339887498949) % 1.0) - 0.2
    return offsets
