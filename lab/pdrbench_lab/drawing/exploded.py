"""All levels of a building in one picture, drawn apart, as in Woodman & Harle 2008, Fig. 4."""

from __future__ import annotations

from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection

from pdrbench.building import WALL, Building
from pdrbench.geometry import BoolArray, FloatArray
from pdrbench.picture.plan import FLOOR_COLOURS, RISER_COLOUR, TREAD_COLOUR, WALL_COLOUR, fill_rings, is_stairs
from pdrbench_formats.replays.view import View, exploded_view, level_height_m

GRID_COLOUR: Final = "#d9dde1"
CONNECTION_COLOUR: Final = "#7a9a6a"
GRID_M: Final = 10.0
SURROUND_M: Final = 2.0  # of the grid around a level
LABEL_FRACTION: Final = 0.06  # of the width, left of the building, for the names of the levels


def draw_exploded(ax: Axes, building: Building, view: View | None = None, *, grid_m: float = GRID_M) -> View:
    """Draws every level: floors light, walls dark, connections dashed, every tread at its height.

    The axes get equal scales and limits that hold the building, and lose their ticks: lengths are to scale across only,
    and along the grid.

    Args:
        ax: Where to draw.
        building: The map.
        view: From where; None: from as high as possible without one level hiding another.
        grid_m: Distance of the lines below each level; 0 for none.

    Returns:
        The view, for what is to be drawn on it.
    """
    view = exploded_view(building) if view is None else view
    for place, level in enumerate(building.levels):
        if grid_m > 0:
            _draw_grid(ax, building, view, level, grid_m, zorder=place)
        _draw_level(ax, building, view, level, zorder=place)
    _draw_stairs(ax, building, view, zorder=len(building.levels))
    _frame(ax, building, view)
    if grid_m > 0:
        ax.annotate(f"grid {grid_m:g} m", (1, 0), xycoords="axes fraction", ha="right", va="bottom", fontsize=7)
    return view


def _frame(ax: Axes, building: Building, view: View) -> None:
    """Limits that hold the grid below every level, a name beside each, equal scales, no ticks."""
    corners = [view.project(_box(building, level), level_height_m(building, level)) for level in building.levels]
    treads = view.project(building.edge_start_xy_m, building.height(building.edge_polygon))
    drawn = np.concatenate([*corners, treads])
    (left, low), (right, high) = drawn.min(axis=0), drawn.max(axis=0)
    ax.set_xlim(left - LABEL_FRACTION * (right - left), right + SURROUND_M)
    ax.set_ylim(low - SURROUND_M, high + SURROUND_M)
    ax.set_aspect("equal", adjustable="box")
    ax.set_axis_off()
    for level, corner in zip(building.levels, corners, strict=True):
        ax.annotate(
            f"level {level}",
            tuple(corner[corner[:, 0].argmin()]),
            xytext=(-2, 0),
            textcoords="offset points",
            ha="right",
            fontsize=7,
        )


def _box(building: Building, level: int) -> FloatArray:
    """(4, 2) corners of the grid of a level."""
    xmin, ymin, xmax, ymax = building.bounds_m(level)
    xmin, ymin, xmax, ymax = xmin - SURROUND_M, ymin - SURROUND_M, xmax + SURROUND_M, ymax + SURROUND_M
    return np.array([[xmin, ymin], [xmax, ymin], [xmax, ymax], [xmin, ymax]])


def _draw_grid(ax: Axes, building: Building, view: View, level: int, grid_m: float, zorder: float) -> None:
    (xmin, ymin), _, (xmax, ymax), _ = _box(building, level)
    x_m = np.arange(np.ceil(xmin / grid_m), xmax / grid_m) * grid_m
    y_m = np.arange(np.ceil(ymin / grid_m), ymax / grid_m) * grid_m
    lines = [[[x, ymin], [x, ymax]] for x in x_m] + [[[xmin, y], [xmax, y]] for y in y_m]
    if lines:
        drawn = view.project(np.array(lines), level_height_m(building, level))
        ax.add_collection(LineCollection(list(drawn), colors=GRID_COLOUR, linewidths=0.5, zorder=zorder))


def _draw_level(ax: Axes, building: Building, view: View, level: int, zorder: float) -> None:
    """Floors of a level, one path per kind so that no hairline is left between neighbours, and their edges."""
    for kind, colour in FLOOR_COLOURS.items():
        rings = [
            view.project(ring, polygon.height_m)
            for polygon in building.polygons
            if polygon.level == level and polygon.kind == kind != "stairs"
            for ring in polygon.rings
        ]
        fill_rings(ax, rings, colour, zorder=zorder + 0.1)
    here = (building.level(building.edge_polygon) == level) & ~is_stairs(building)[building.edge_polygon]
    _draw_edges(ax, building, view, here, zorder + 0.2)


def _draw_stairs(ax: Axes, building: Building, view: View, zorder: float) -> None:
    """Flights of stairs, above all levels: what is drawn on a tread always has the tread below it.

    The upright face below every connection that leads up joins treads to a flight.
    """
    stairs = [polygon for polygon in building.polygons if polygon.kind == "stairs"]
    treads = [view.project(polygon.outline_xy_m, polygon.height_m) for polygon in stairs]
    neighbour, foot_m = np.maximum(building.edge_neighbour, 0), building.height(building.edge_polygon)
    over_m = building.height(neighbour) - foot_m
    stepped = is_stairs(building)
    is_riser = (building.edge_neighbour != WALL) & (over_m > 0) & (stepped[building.edge_polygon] | stepped[neighbour])
    start_xy_m, end_xy_m = building.edge_start_xy_m[is_riser], building.edge_end_xy_m[is_riser]
    foot_m, head_m = foot_m[is_riser], (foot_m + over_m)[is_riser]
    below = [view.project(start_xy_m, foot_m), view.project(end_xy_m, foot_m)]
    above = [view.project(end_xy_m, head_m), view.project(start_xy_m, head_m)]
    faces = list(np.stack([*below, *above], axis=1))
    ax.add_collection(PolyCollection(faces, facecolors=RISER_COLOUR, edgecolors="none", zorder=zorder))
    ax.add_collection(
        PolyCollection(treads, facecolors=FLOOR_COLOURS["stairs"], edgecolors="none", zorder=zorder + 0.1)
    )
    _draw_edges(ax, building, view, stepped[building.edge_polygon], zorder + 0.2)


def _draw_edges(ax: Axes, building: Building, view: View, chosen: BoolArray, zorder: float) -> None:
    """Walls and the edges between treads as lines, other connections dashed; `chosen` (E,) says which."""
    height_m = building.height(building.edge_polygon)
    segments = np.stack(
        [view.project(building.edge_start_xy_m, height_m), view.project(building.edge_end_xy_m, height_m)], axis=1
    )
    is_wall = chosen & (building.edge_neighbour == WALL)
    is_step = chosen & ~is_wall & (height_m != building.height(np.maximum(building.edge_neighbour, 0)))
    is_first = np.arange(len(chosen)) < building.edge_twin  # of two edges: dashes that are drawn twice run together
    is_door = chosen & ~is_wall & ~is_step & is_first
    layers = (
        (is_step, TREAD_COLOUR, 0.4, "solid"),
        (is_door, CONNECTION_COLOUR, 0.5, (0.0, (2.0, 1.5))),
        (is_wall, WALL_COLOUR, 0.5, "solid"),
    )
    for place, (lines, colour, width_pt, dash) in enumerate(layers):
        ax.add_collection(
            LineCollection(
                list(segments[lines]),
                colors=colour,
                linewidths=width_pt,
                linestyles=[dash],
                capstyle="projecting" if dash == "solid" else "butt",
                zorder=zorder + 0.1 * place,
            )
        )
