"""Pictures of the pages as SVG: plans with tracks, and entries in their order with their intervals."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from markupsafe import Markup, escape

from pdrbench.building import WALL, Building
from pdrbench.geometry import FloatArray
from pdrbench_leaderboard.standings import Table

ROW: Final = 22  # pixels of an entry
NAMES: Final = 170  # pixels for names on the left
SCALE: Final = 430  # pixels of the axis
TIE: Final = 12  # pixels between bars of ties
MARGIN_M: Final = 2.0
MAX_POINTS: Final = 240


def order_picture(table: Table) -> Markup:
    """Entries by score on a logarithmic axis, intervals as lines; a bar joins those that are not separated."""
    ranking = table.ranking
    if ranking is None:
        return Markup("")
    standings = ranking.standings
    ends = [value for of in standings for value in (of.score_m, of.low_m, of.high_m) if math.isfinite(value)]
    low, high = min(ends), max(max(ends), min(ends) * 1.1)

    def x(value: float) -> float:
        return NAMES + SCALE * math.log(value / low) / math.log(high / low)

    place = {of.name: number for number, of in enumerate(standings)}
    height = ROW * len(standings) + 34
    width = NAMES + SCALE + 20 + TIE * len(ranking.ties)
    parts = [f'<svg class="order" viewBox="0 0 {width} {height}" role="img" aria-label="entries in their order">']
    for tick in ticks(low, high):
        parts.append(f'<path class="grid" d="M{x(tick):.1f} 0V{height - 24}"/>')
        parts.append(f'<text x="{x(tick):.1f}" y="{height - 8}" text-anchor="middle">{tick:g} m</text>')
    for number, of in enumerate(standings):
        y = ROW * number + 14
        parts.append(f'<text x="{NAMES - 10}" y="{y + 4}" text-anchor="end">{escape(of.name)}</text>')
        if math.isfinite(of.low_m):
            parts.append(f'<path class="interval" d="M{x(of.low_m):.1f} {y}H{x(of.high_m):.1f}"/>')
        parts.append(f'<circle cx="{x(of.score_m):.1f}" cy="{y}" r="4"/>')
    for number, tie in enumerate(ranking.ties):
        first, last = place[tie[0]], place[tie[-1]]
        at = NAMES + SCALE + 14 + TIE * number
        parts.append(f'<path class="tie" d="M{at} {ROW * first + 8}V{ROW * last + 20}"/>')
    return Markup("".join([*parts, "</svg>"]))


def ticks(low: float, high: float) -> list[float]:
    """Round numbers between two ends, 1, 2 and 5 in each decade."""
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    return [step for decade in decades for factor in (1, 2, 5) if low <= (step := factor * 10.0**decade) <= high]


def plan_picture(building: Building | None, level: int, tracks: Mapping[str, FloatArray], *, label: str) -> Markup:
    """A level of a building with tracks on it.

    Args:
        building: None where there is no plan.
        level: That is drawn.
        tracks: (T, 2) by class of the line.
        label: What a screen reader says.
    """
    corners_m = np.concatenate(list(tracks.values()))
    walls = ""
    if building is not None:
        here = np.array([polygon.level == level for polygon in building.polygons])[building.edge_polygon]
        is_wall = (building.edge_neighbour == WALL) & here
        start_m, end_m = building.edge_start_xy_m[is_wall], building.edge_end_xy_m[is_wall]
        corners_m = np.concatenate([start_m, end_m])
        pairs = zip(start_m.tolist(), end_m.tolist(), strict=True)
        walls = "".join(f"M{x0:.1f} {-y0:.1f}L{x1:.1f} {-y1:.1f}" for (x0, y0), (x1, y1) in pairs)
    low_m, high_m = corners_m.min(axis=0) - MARGIN_M, corners_m.max(axis=0) + MARGIN_M
    size_m = high_m - low_m
    box = f"{low_m[0]:.1f} {-high_m[1]:.1f} {size_m[0]:.1f} {size_m[1]:.1f}"
    stroke = float(size_m.max()) / 300.0
    lines = "".join(f'<path class="{name}" d="{path(xy_m)}"/>' for name, xy_m in tracks.items())
    spots = "".join(f'<circle class="spot {name}" r="{4 * stroke:.2f}" hidden/>' for name in tracks)
    return Markup(
        f'<svg class="plan" viewBox="{box}" style="--stroke:{stroke:.2f}" role="img" aria-label="{escape(label)}">'
        f'<path class="wall" d="{walls}"/>{lines}{spots}</svg>'
    )


def path(xy_m: FloatArray) -> str:
    """A line through (T, 2) places, thinned out."""
    rows = np.unique(np.linspace(0, len(xy_m) - 1, min(len(xy_m), MAX_POINTS)).round()).astype(np.int64)
    return "M" + "L".join(f"{x:.1f} {-y:.1f}" for x, y in xy_m[rows].tolist())


def rounded(xy_m: FloatArray) -> Sequence[Sequence[float]]:
    """Places for a script, y downwards."""
    return np.round(xy_m * [1.0, -1.0], 2).tolist()  # type: ignore[no-any-return]
