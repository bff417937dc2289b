"""A plan drawn, as a picture or a page: levels with doors, stairs, lifts, repairs and what no way leads to."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from pdrbench.building import WALL, Building
from pdrbench.errors import MapError, PdrbenchError
from pdrbench.geometry import BoolArray, FloatArray
from pdrbench.picture.plan import FLOOR_COLOURS, Bounds, draw_level, fill_rings
from pdrbench.report.pages import render
from pdrbench_formats.maps.openings import is_guessed
from pdrbench_formats.maps.plan import Plan, unreachable
from pdrbench_formats.pages.map_check import WalkCheck, plan_facts

MAX_DOOR_M: Final = 2.5  # a wider connection between two floors is no door
COLOURS: Final = {
    "door": "#009e73",
    "door guessed": "#e69f00",
    "stairs": FLOOR_COLOURS["stairs"],
    "lift": "#0072b2",
    "no way leads here": "#d55e00",
    "repair": "#aa3377",
    "walk": "#56b4e9",
    "walk through a wall": "#ee0000",
}
NOT_DRAWN: Final = frozenset({"treads made", "edges joined", "height assumed", "door found", "door guessed"})
MANY_REPAIRS: Final = 40  # on one level: above it their numbers would hide the plan
SMALL: Final = 0.5  # of the building: a level that is smaller than this both ways is drawn larger than the others
WALK_MARGIN_M: Final = 5.0  # shown about a walk
NUMBER_COLOUR: Final = "#7a2e00"  # of parts that no way leads to


def write_picture(plan: Plan, walk: WalkCheck | None, out: Path) -> None:
    """Writes a PNG, SVG or PDF, or an HTML page with the picture and all that is listed.

    Raises:
        MapError: Another ending.
    """
    try:
        if out.suffix in (".png", ".svg", ".pdf"):
            draw_plan(plan, walk).savefig(out, dpi=110)
        elif out.suffix in (".html", ".htm"):
            out.write_text(_page(plan, walk), encoding="utf-8", newline="\n")
        else:
            raise MapError(f"{out}: a plan is drawn as .html, .png, .svg or .pdf; name one")
    except OSError as error:
        raise PdrbenchError(f"cannot write {out}: {error.strerror}; choose another place") from error


def draw_plan(plan: Plan, walk: WalkCheck | None, columns: int = 3) -> Any:
    """A matplotlib figure with all levels of a plan, a walk on them, and what the colours mean."""
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    levels = plan.building.levels
    columns = min(columns, len(levels))
    rows = -(-len(levels) // columns)
    figure = Figure(figsize=(7.0 * columns, 7.0 * rows), layout="constrained")
    drawing = _Drawing(plan, walk)
    for number, level in enumerate(levels):
        axes = figure.add_subplot(rows, columns, number + 1)
        drawing.draw(axes, level, drawing.bounds_of(level))
        axes.set_title(f"level {level}")
    figure.suptitle(plan.building.name)
    patches = [Patch(color=colour, label=name) for name, colour in drawing.colours().items()]
    figure.legend(handles=patches, loc="outside lower center", ncols=len(patches), frameon=False)
    return figure


class _Drawing:
    """A plan and a walk, drawn level by level; parts and repairs have the numbers of their rows."""

    def __init__(self, plan: Plan, walk: WalkCheck | None) -> None:
        self.plan, self.walk = plan, walk
        self.facts = plan_facts(plan)
        self.is_lost = unreachable(plan.building)
        self.bounds_m: Bounds = plan.building.bounds_m()
        if walk is not None and len(walk.xy_m):
            low, high = walk.xy_m.min(axis=0), walk.xy_m.max(axis=0)
            x0, y0, x1, y1 = self.bounds_m
            self.bounds_m = (min(x0, low[0]), min(y0, low[1]), max(x1, high[0]), max(y1, high[1]))

    def colours(self) -> dict[str, str]:
        """Those that are on the plan, by what they mean."""
        repairs = self.plan.repairs
        kinds = {"door", *(polygon.kind for polygon in self.plan.building.polygons)}
        kinds |= {"no way leads here"} if self.is_lost.any() else set()
        kinds |= {"door guessed"} if any(repair.kind == "door guessed" for repair in repairs) else set()
        kinds |= {"walk", "walk through a wall"} if self.walk is not None else set()
        kinds |= {"repair"} if any(one.kind not in NOT_DRAWN and one.place_xy_m for one in repairs) else set()
        return {name: colour for name, colour in COLOURS.items() if name in kinds}

    def bounds_of(self, level: int) -> Bounds:
        """What is shown of a level: the same as of the others, or that level alone where it is much smaller."""
        x0, y0, x1, y1 = own = self.plan.building.bounds_m(level)
        left, low, right, high = self.bounds_m
        is_small = max((x1 - x0) / (right - left), (y1 - y0) / (high - low)) < SMALL
        return own if is_small and (self.walk is None or not (self.walk.level == level).any()) else self.bounds_m

    def draw(self, axes: Any, level: int, bounds_m: Bounds) -> None:
        """One level, or a part of it."""
        building = self.plan.building
        draw_level(axes, building, level, bounds_m=bounds_m)
        _draw_marks(axes, building, level, self.is_lost)
        for number, row in enumerate(self.facts["unreachable"], start=1):
            if str(level) in row["levels"].split():
                _number(axes, number, (row["x_m"], row["y_m"]), NUMBER_COLOUR)
        self._draw_repairs(axes, level)
        if self.walk is not None:
            _draw_walk(axes, self.walk, level)

    def _draw_repairs(self, axes: Any, level: int) -> None:
        here = [
            (number, repair.place_xy_m)
            for number, repair in enumerate(self.plan.repairs, start=1)
            if repair.level == level and repair.kind not in NOT_DRAWN and repair.place_xy_m is not None
        ]
        for number, place in here:
            axes.plot(*place, "x", color=COLOURS["repair"], markersize=6, markeredgewidth=1.5, zorder=6)
            if len(here) <= MANY_REPAIRS:
                _number(axes, number, place, COLOURS["repair"], offset=(4, 3))


def _number(axes: Any, number: int, place: Sequence[float], colour: str, offset: tuple[int, int] = (0, 0)) -> None:
    from matplotlib.patheffects import Normal, Stroke

    axes.annotate(
        str(number),
        place,
        xytext=offset,
        textcoords="offset points",
        ha="left" if any(offset) else "center",
        va="bottom" if any(offset) else "center",
        fontsize=8,
        color=colour,
        path_effects=[Stroke(linewidth=2, foreground="white"), Normal()],
        zorder=9,
        annotation_clip=True,
    )


def _draw_marks(axes: Any, building: Building, level: int, is_lost: BoolArray) -> None:
    from matplotlib.collections import LineCollection

    for i, polygon in enumerate(building.polygons):
        if polygon.level == level and (is_lost[i] or polygon.kind == "lift"):
            colour = COLOURS["no way leads here" if is_lost[i] else "lift"]
            fill_rings(axes, polygon.rings, colour, zorder=2.5, alpha=0.4)
    is_floor = np.array([polygon.kind == "floor" for polygon in building.polygons])
    owner, neighbour = building.edge_polygon, building.edge_neighbour
    doors = np.flatnonzero((neighbour != WALL) & is_floor[owner] & (building.level(owner) == level))
    ends = np.stack([building.edge_start_xy_m[doors], building.edge_end_xy_m[doors]], axis=1)
    length_m = np.hypot(*(ends[:, 1] - ends[:, 0]).T)
    keep = is_floor[neighbour[doors]] & (length_m <= MAX_DOOR_M) & (length_m > 0.3)
    axes.add_collection(LineCollection(list(ends[keep]), colors=COLOURS["door"], linewidths=1.6, zorder=5))
    guessed = [p.outline_xy_m for p in building.polygons if p.level == level and is_guessed(p)]
    axes.add_collection(LineCollection(guessed, colors=COLOURS["door guessed"], linewidths=2.2, zorder=5.5))


def _draw_walk(axes: Any, walk: WalkCheck, level: int) -> None:
    here = walk.level == level
    axes.plot(*walk.xy_m[here].T, ".-", color=COLOURS["walk"], linewidth=1.2, markersize=4, zorder=7)
    for i in np.flatnonzero(walk.crosses & here[:-1]):
        axes.plot(*walk.xy_m[i : i + 2].T, color=COLOURS["walk through a wall"], linewidth=2.2, zorder=8)


def _page(plan: Plan, walk: WalkCheck | None) -> str:
    drawing = _Drawing(plan, walk)
    facts, building = drawing.facts, plan.building
    summary = [
        f"format {plan.source}",
        f"{len(building.levels)} levels",
        f"{building.area_m2:.0f} m² of floor",
        f"no way leads to {sum(row['area_m2'] for row in facts['unreachable']):.0f} m²",
        f"{len(plan.repairs)} repairs and assumptions",
    ]
    warnings = [*plan.warnings, *(walk.warnings if walk is not None else ())]
    if facts["unconnected_levels"]:
        levels = ", ".join(map(str, facts["unconnected_levels"]))
        warnings.append(f"neither stairs nor lift lead from level {levels} to another")
    figures = []
    for level in building.levels:
        larger = "" if drawing.bounds_of(level) == drawing.bounds_m else ", drawn larger than the others"
        figures.append((f"level {level}{larger}", _level_svg(drawing, level, drawing.bounds_of(level))))
    tables = {title: facts[title] for title in ("levels", "stairs", "lifts")}
    tables["no way leads here"] = _numbered(facts["unreachable"])
    if walk is not None:
        told = walk.facts()
        summary.append(
            f"walk of {told['places']} places, outside the floor: {told['outside']}, "
            f"walls crossed: {told['walls_crossed']}"
        )
        for level in np.unique(walk.level).tolist():
            drawn = _level_svg(drawing, level, _around(walk.xy_m[walk.level == level]))
            figures.append((f"the walk on level {level}", drawn))
        tables["walls crossed by the walk"] = told["crossed_at"]
    repairs = [{"kind": r.kind, "where": r.where, "what": r.what} for r in plan.repairs]
    tables["repairs and assumptions"] = _numbered(repairs)
    if plan.skipped:
        tables["features left out"] = [{"kind": kind, "features": count} for kind, count in plan.skipped.items()]
    return render(
        "map.html",
        package="pdrbench_formats.pages",
        name=building.name or "Plan",
        summary=" · ".join(summary),
        warnings=warnings,
        colours=drawing.colours(),
        figures=figures,
        tables={title: [{key: shown(v) for key, v in row.items()} for row in rows] for title, rows in tables.items()},
    )


def _around(xy_m: FloatArray) -> Bounds:
    """A rectangle about places (N, 2), at most twice as long as wide."""
    low, high = xy_m.min(axis=0), xy_m.max(axis=0)
    grown_m = np.maximum((high - low).max() / 2 - (high - low), 0.0) / 2 + WALK_MARGIN_M
    (x0, y0), (x1, y1) = low - grown_m, high + grown_m
    return float(x0), float(y0), float(x1), float(y1)


def _level_svg(drawing: _Drawing, level: int, bounds_m: Bounds) -> str:
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    x0, y0, x1, y1 = bounds_m
    height = float(np.clip(6.0 * (y1 - y0 + 4.0) / (x1 - x0 + 4.0), 3.0, 9.0))
    figure = Figure(figsize=(6.0, height), layout="constrained")
    drawing.draw(figure.add_subplot(), level, bounds_m)
    drawn = io.StringIO()
    with rc_context({"svg.fonttype": "none"}):  # letters as text, which is small and can be searched
        figure.savefig(drawn, format="svg")
    return "<svg" + drawn.getvalue().partition("<svg")[2]


def _numbered(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    return [{"no.": number, **row} for number, row in enumerate(rows, start=1)]


def shown(value: object) -> str:
    """A number, a list or a text as tables show it."""
    if isinstance(value, list):
        return ", ".join(map(shown, value))
    if not isinstance(value, float):  # as float64 is
        return str(value)
    return f"{value:.0f}" if abs(value) >= 1000.0 else f"{value:.4g}"
