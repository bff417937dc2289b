"""What is put on a drawn building: paths, an arrow at a place, regions, lines from estimates to the reference."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from numpy.typing import ArrayLike

from pdrbench.building import Building, Zone
from pdrbench.geometry import FloatArray
from pdrbench.picture.plan import fill_rings
from pdrbench.picture.trail import REFERENCE, TrailStyle, draw_trail
from pdrbench_formats.replays.view import PLAN, View, level_height_m
from pdrbench_lab.drawing.cloud import ON_TOP

if TYPE_CHECKING:
    from pdrbench.building.region import FloorRegion

REGION_COLOUR: Final = "#56b4e9"
PAIR_COLOUR: Final = "#d62728"  # Woodman & Harle 2008, Fig. 9: red dots and lines
REGION_OPACITY: Final = 0.55
REGION_ZORDER: Final = ON_TOP - 10
ARROW_PT: Final = 26.0  # length


def draw_path(
    ax: Axes, xy_m: ArrayLike, height_m: ArrayLike, view: View = PLAN, style: TrailStyle = REFERENCE, label: str = ""
) -> None:
    """Draws reference or estimated positions (N, 2) as a line, at `height_m` (N,) as `floor_height_m` gives it.

    A row that is not finite interrupts the line; an empty label stands in no legend.
    """
    line = draw_trail(ax, view.project(np.asarray(xy_m, dtype=np.float64).reshape(-1, 2), height_m), style, label=label)
    line.set_zorder(ON_TOP + style.zorder)


def draw_arrow(ax: Axes, xy_m: ArrayLike, height_m: float, view: View = PLAN) -> None:
    """Draws an arrow that points down at a place (2,), as Woodman & Harle 2008, Fig. 4, at the actual position."""
    u_m, v_m = view.project(np.asarray(xy_m, dtype=np.float64), height_m)
    ax.annotate(
        "",
        (float(u_m), float(v_m)),
        xytext=(0.0, ARROW_PT),
        textcoords="offset points",
        arrowprops={"arrowstyle": "-|>", "color": "black", "linewidth": 1.8, "shrinkA": 0, "shrinkB": 1},
        zorder=ON_TOP + 30,
    )


def draw_region(ax: Axes, building: Building, region: FloorRegion, view: View = PLAN) -> None:
    """Shades the part `region` of the floors of a building, as Woodman & Harle 2008, Fig. 6 and 7."""
    height_m = building.height(region.polygon)
    corners = _counter_clockwise(view.project(region.corners_xy_m, height_m[:, None]))
    fill_rings(ax, [*corners], REGION_COLOUR, zorder=REGION_ZORDER, alpha=REGION_OPACITY)


def draw_zone(ax: Axes, building: Building, zone: Zone, view: View = PLAN) -> None:
    """Shades a zone of a level, as Woodman & Harle 2008, Fig. 8, the part of the building with a reference system."""
    drawn = view.project(zone.outline_xy_m, level_height_m(building, zone.level))
    fill_rings(ax, [drawn], REGION_COLOUR, zorder=REGION_ZORDER, alpha=REGION_OPACITY)


def _counter_clockwise(corners: FloatArray) -> FloatArray:
    """Triangles (T, 3, 2), all the same way round."""
    one, other = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    is_clockwise = one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0] < 0
    return np.where(is_clockwise[:, None, None], corners[:, ::-1], corners)


def draw_pairs(
    ax: Axes, reference_xy_m: ArrayLike, estimate_xy_m: ArrayLike, height_m: ArrayLike = 0.0, view: View = PLAN
) -> None:
    """Draws reference positions (N, 2) as dots, each joined to its estimate (N, 2), as Woodman & Harle 2008, Fig. 9.

    Where an estimate is not finite the dot stands alone; `height_m` is (N,) or one for all.
    """
    reference, estimate = view.project(reference_xy_m, height_m), view.project(estimate_xy_m, height_m)
    joined = np.isfinite(estimate).all(axis=1)
    lines = np.stack([reference, estimate], axis=1)[joined]
    ax.add_collection(LineCollection(list(lines), colors=PAIR_COLOUR, linewidths=1.0, zorder=ON_TOP + 20))
    ax.scatter(reference[:, 0], reference[:, 1], s=10.0, c=PAIR_COLOUR, linewidths=0, zorder=ON_TOP + 21)
