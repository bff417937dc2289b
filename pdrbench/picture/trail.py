"""Trails of references and estimates that stay apart in grey print and for colour-blind readers."""

from __future__ import annotations

import zlib
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patheffects import Normal, Stroke

from pdrbench.geometry import BoolArray, FloatArray

NUM_MARKS: Final = 12  # markers along one trail: enough to distinguish trails, few enough not to hide the plan


@dataclass(frozen=True, slots=True)
class TrailStyle:
    """How one trail is drawn.

    Attributes:
        colour: Any matplotlib colour.
        dash: Any matplotlib line style.
        marker: Any matplotlib marker, set a few times along the trail; empty for none.
        width_pt: Line width in points.
        casing_pt: White on either side of the line, in points, which lifts it off the walls.
        zorder: Trails with a larger one lie on top.
    """

    colour: str
    dash: str | tuple[float, tuple[float, ...]]
    marker: str
    width_pt: float = 1.5
    casing_pt: float = 0.0
    zorder: float = 10.0


REFERENCE: Final = TrailStyle(colour="black", dash="solid", marker="", width_pt=2.4, casing_pt=0.8, zorder=8.0)

# Okabe & Ito 2008, "Color Universal Design", without black and without the yellow that vanishes on paper; then six that
# stay apart from these and each other, also for the colour-blind (Machado et al. 2009): CIELAB distance 13 or more, 24
# where the dash is the same.
_COLOURS: Final = (
    *("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9"),
    *("#8b0000", "#999933", "#882255", "#3b1f8f", "#666633", "#004488"),
)
_DASHES: Final[tuple[str | tuple[float, tuple[float, ...]], ...]] = (
    "solid",
    (0.0, (5.0, 1.5)),
    (0.0, (1.2, 1.2)),
    (0.0, (6.0, 1.5, 1.2, 1.5)),
    (0.0, (9.0, 2.0)),
)
_MARKERS: Final = ("o", "s", "^", "D", "v", "P", "X")


def estimate_style(index: int) -> TrailStyle:
    """The style of the index-th localizer: twelve colours, and 420 styles before one repeats."""
    return TrailStyle(
        colour=_COLOURS[index % len(_COLOURS)],
        dash=_DASHES[index % len(_DASHES)],
        marker=_MARKERS[index % len(_MARKERS)],
    )


def styles_of(names: Iterable[str]) -> dict[str, TrailStyle]:
    """A style for each name: up to twelve differ in colour, and most names keep theirs whoever stands beside them.

    >>> styles_of(["stay", "mine"]) == styles_of(["mine", "stay"])
    True
    """
    places: dict[str, int] = {}
    for name in sorted(set(names)):
        wanted = sorted(range(len(_COLOURS)), key=lambda place: zlib.crc32(f"{name} {place}".encode()))
        places[name] = next((place for place in wanted if place not in places.values()), len(places))
    return {name: estimate_style(place) for name, place in places.items()}


def draw_trail(
    ax: Axes, xy_m: FloatArray, style: TrailStyle = REFERENCE, *, on_level: BoolArray | None = None, label: str = ""
) -> Line2D:
    """Draws reference or estimated positions (N, 2) as a line.

    A row that is not finite, or not `on_level` (N,), interrupts the line; an empty label stands in no legend.
    """
    shown_xy_m = np.array(xy_m, dtype=np.float64).reshape(-1, 2)
    if on_level is not None:
        shown_xy_m[~np.asarray(on_level, dtype=bool)] = np.nan
    (line,) = ax.plot(
        shown_xy_m[:, 0],
        shown_xy_m[:, 1],
        color=style.colour,
        linestyle=style.dash,
        linewidth=style.width_pt,
        marker=style.marker or "None",
        markersize=4.0,
        markeredgecolor="white",
        markeredgewidth=0.5,
        markevery=_marked(shown_xy_m),
        zorder=style.zorder,
        label=label or "_nolegend_",
    )
    if style.casing_pt > 0:
        width_pt = style.width_pt + 2 * style.casing_pt
        line.set_path_effects([Stroke(linewidth=width_pt, foreground="white"), Normal()])
    return line


def _marked(xy_m: FloatArray) -> list[int]:
    """Rows that get a marker: about `NUM_MARKS`, evenly among the finite ones, the first and the last included."""
    finite = np.flatnonzero(np.isfinite(xy_m).all(axis=1))
    if not len(finite):
        return []
    places = np.unique(np.linspace(0, len(finite) - 1, min(NUM_MARKS, len(finite))).round().astype(int))
    return [int(row) for row in finite[places]]
