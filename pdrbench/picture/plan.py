"""The floor plan of one level, drawn to scale."""

from __future__ import annotations

from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from matplotlib.patheffects import Normal, Stroke

from pdrbench.building import WALL, Building, FloorPolygon
from pdrbench.geometry import FloatArray

FLOOR_COLOURS: Final = {"floor": "#f0ebdf", "stairs": "#dad3c3", "ramp": "#e4ddcd", "lift": "#cfd6dc"}
WALL_COLOUR: Final = "#3a3a3a"
TREAD_COLOUR: Final = "#8f8a7d"
ZONE_COLOUR: Final = "#56b4e9"
MARGIN_M: Final = 2.0

Bounds = tuple[float, float, float, float]  # xmin, ymin, xmax, ymax in metres


def draw_level(ax: Axes, building: Building, level: int, *, zones: bool = False, scale_bar: bool = True) -> None:
    """Draws the floor polygons of one level: floors light, walls dark, connections as gaps, every tread of a stair.

    The axes get equal scales, metres on both, and limits that hold the whole level with a margin of 2 m.

    Args:
        ax: Where to draw.
        building: The map.
        level: IMDF ordinal; a level without polygons gives empty axes with the limits of the building.
        zones: Whether to outline and name the zones of this level.
        scale_bar: Whether to draw a bar of a round length into the lower left corner.
    """
    indices = [i for i, polygon in enumerate(building.polygons) if polygon.level == level]
    polygons = [building.polygons[i] for i in indices]
    _fill_floors(ax, polygons)
    _draw_edges(ax, building, np.asarray(indices, dtype=np.int64))
    if zones:
        _draw_zones(ax, building, level)
    frame_bounds(ax, building.bounds_m(level) if polygons else building.bounds_m())
    if scale_bar:
        draw_scale_bar(ax)


def frame_bounds(ax: Axes, bounds_m: Bounds, margin_m: float = MARGIN_M) -> None:
    """Limits that hold `bounds_m` and a margin; equal scales; metres named on both axes."""
    xmin, ymin, xmax, ymax = bounds_m
    ax.set_xlim(xmin - margin_m, xmax + margin_m)
    ax.set_ylim(ymin - margin_m, ymax + margin_m)
    ax.set_aspect("equal", adjustable="box")
    ax.set_xlabel("x in m")
    ax.set_ylabel("y in m")


def scale_length_m(width_m: float) -> float:
    """The largest of 1, 2, 5, 10, 20, ... metres that is at most a quarter of `width_m`.

    >>> scale_length_m(100.0), scale_length_m(79.0)
    (20.0, 10.0)
    """
    wanted = width_m / 4
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(max(factor * power for factor in (1.0, 2.0, 5.0) if factor * power <= wanted * (1 + 1e-9)))


def draw_scale_bar(ax: Axes) -> None:
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


def _fill_floors(ax: Axes, polygons: list[FloorPolygon]) -> None:
    """One path per kind: neighbours in one path leave no hairline between them, and holes stay empty."""
    for kind, colour in FLOOR_COLOURS.items():
        rings = [ring for p in polygons if p.kind == kind for ring in (p.outline_xy_m, *p.holes)]
        if rings:
            ax.add_patch(PathPatch(_compound(rings), facecolor=colour, edgecolor="none", linewidth=0, zorder=1))


def _compound(rings: list[FloatArray]) -> Path:
    """Rings, outlines ccw and holes cw, as one path; filled by the non-zero rule."""
    return Path.make_compound_path(*(Path(np.vstack([ring, ring[:1]]), closed=True) for ring in rings))


def _draw_edges(ax: Axes, building: Building, indices: np.ndarray) -> None:
    """Walls dark, edges between two treads thin; every other connection is a gap."""
    here = np.isin(building.edge_polygon, indices)
    segments = np.stack([building.edge_start_xy_m, building.edge_end_xy_m], axis=1)
    is_wall = here & (building.edge_neighbour == WALL)
    is_stair = np.array([polygon.kind for polygon in building.polygons]) == "stairs"
    is_tread = here & ~is_wall & is_stair[building.edge_polygon]
    ax.add_collection(LineCollection(list(segments[is_tread]), colors=TREAD_COLOUR, linewidths=0.5, zorder=2))
    ax.add_collection(
        LineCollection(list(segments[is_wall]), colors=WALL_COLOUR, linewidths=0.9, capstyle="projecting", zorder=3)
    )


def _draw_zones(ax: Axes, building: Building, level: int) -> None:
    for zone in building.zones:
        if zone.level != level:
            continue
        ring = np.vstack([zone.outline_xy_m, zone.outline_xy_m[:1]])
        ax.fill(ring[:, 0], ring[:, 1], facecolor=ZONE_COLOUR, alpha=0.15, edgecolor=ZONE_COLOUR, zorder=2)
        x_m, y_m = zone.outline_xy_m.mean(axis=0)
        ax.text(x_m, y_m, zone.name, ha="center", va="center", fontsize=5, clip_on=True, zorder=4)
