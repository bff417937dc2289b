"""The floor plan of one level, drawn to scale."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from matplotlib.patheffects import Normal, Stroke

from pdrbench.building import WALL, Building
from pdrbench.geometry import BoolArray, FloatArray

FLOOR_COLOURS: Final = {"floor": "#f0ebdf", "stairs": "#dad3c3", "ramp": "#e4ddcd", "lift": "#cfd6dc"}
WALL_COLOUR: Final = "#3a3a3a"
TREAD_COLOUR: Final = "#8f8a7d"
RISER_COLOUR: Final = "#ece7db"
MARGIN_M: Final = 2.0

Bounds = tuple[float, float, float, float]  # xmin, ymin, xmax, ymax in metres


def draw_level(
    ax: Axes, building: Building | None, level: int, *, scale_bar: bool = True, bounds_m: Bounds | None = None
) -> None:
    """Draws the floor polygons of one level: floors light, walls dark, connections as gaps, every tread of a stair.

    The axes get equal scales, metres on both, and limits that hold `bounds_m` with a margin of 2 m.

    Args:
        ax: Where to draw.
        building: The map; None: only a frame, for which `bounds_m` is needed.
        level: IMDF ordinal; a level without polygons gives empty axes.
        scale_bar: Whether to draw a bar of a round length into the lower left corner.
        bounds_m: What to show; None: the whole level, or the whole building where the level has no polygons.
    """
    if building is not None:
        for kind, colour in FLOOR_COLOURS.items():
            rings = [ring for p in building.polygons if p.level == level and p.kind == kind for ring in p.rings]
            fill_rings(ax, rings, colour, zorder=1)
        _draw_edges(ax, building, building.level(building.edge_polygon) == level)
        if bounds_m is None:
            bounds_m = building.bounds_m(level) if level in building.levels else building.bounds_m()
    assert bounds_m is not None
    xmin, ymin, xmax, ymax = bounds_m
    ax.set_xlim(xmin - MARGIN_M, xmax + MARGIN_M)
    ax.set_ylim(ymin - MARGIN_M, ymax + MARGIN_M)
    ax.set_aspect("equal", adjustable="box")
    ax.set_xlabel("x in m")
    ax.set_ylabel("y in m")
    if scale_bar:
        _draw_scale_bar(ax)


def scale_length_m(width_m: float) -> float:
    """The largest of 1, 2, 5, 10, 20, ... metres that is at most a quarter of `width_m`.

    >>> scale_length_m(100.0), scale_length_m(79.0)
    (20.0, 10.0)
    """
    wanted = width_m / 4
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(max(factor * power for factor in (1.0, 2.0, 5.0) if factor * power <= wanted * (1 + 1e-9)))


def _draw_scale_bar(ax: Axes) -> None:
    """A bar of a round length with its length in metres above it, in the lower left corner."""
    (xmin, xmax), (ymin, ymax) = ax.get_xlim(), ax.get_ylim()
    length_m = scale_length_m(xmax - xmin)
    x_m, y_m = xmin + 0.02 * (xmax - xmin), ymin + 0.02 * (ymax - ymin)
    ax.plot([x_m, x_m + length_m], [y_m, y_m], color="black", linewidth=3, solid_capstyle="butt", zorder=5)
    ax.annotate(
        f"{length_m:g} m",
        (x_m + length_m / 2, y_m),
        xytext=(0, 3),
        textcoords="offset points",
        ha="center",
        va="bottom",
        fontsize=7,
        path_effects=[Stroke(linewidth=2, foreground="white"), Normal()],
        zorder=5,
    )


def fill_rings(ax: Axes, rings: Sequence[FloatArray], colour: str, *, zorder: float, alpha: float = 1.0) -> None:
    """Fills rings (K, 2) without an edge: outlines counter-clockwise, holes clockwise.

    They form one path, filled by the non-zero rule: neighbours leave no hairline between them, and holes stay empty.
    """
    if rings:
        path = Path.make_compound_path(*(Path(np.vstack([ring, ring[:1]]), closed=True) for ring in rings))
        ax.add_patch(PathPatch(path, facecolor=colour, edgecolor="none", linewidth=0, alpha=alpha, zorder=zorder))


def _draw_edges(ax: Axes, building: Building, here: BoolArray) -> None:
    """Walls dark, edges between two treads thin; every other connection is a gap; `here` (E,) says which edges."""
    segments = np.stack([building.edge_start_xy_m, building.edge_end_xy_m], axis=1)
    is_wall = here & (building.edge_neighbour == WALL)
    is_tread = here & ~is_wall & is_stairs(building)[building.edge_polygon]
    ax.add_collection(LineCollection(list(segments[is_tread]), colors=TREAD_COLOUR, linewidths=0.5, zorder=2))
    ax.add_collection(
        LineCollection(list(segments[is_wall]), colors=WALL_COLOUR, linewidths=0.9, capstyle="projecting", zorder=3)
    )


def is_stairs(building: Building) -> BoolArray:
    """(P,) True for the polygons that are treads and landings."""
    return np.array([polygon.kind == "stairs" for polygon in building.polygons])
