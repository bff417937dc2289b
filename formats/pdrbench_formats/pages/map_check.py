"""A plan examined: what it holds, what cannot be reached, what was repaired, which walls a walk crosses."""

from __future__ import annotations

import html
import io
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from pdrbench.building import WALL, Building
from pdrbench.building.connectivity import lift_shafts, reachable_parts, unconnected_levels, unreachable
from pdrbench.errors import MapError, PdrbenchError
from pdrbench.geometry import BoolArray, FloatArray
from pdrbench.io.plan import Plan, level_table
from pdrbench.picture.plan import draw_level, fill_rings
from pdrbench.trajectory import Trajectory

MAX_DOOR_M: Final = 2.5  # a wider connection between two floors is no door
BETTER: Final = 0.15  # fraction of a walk that has to lie better inside before a plan is called mirrored or scaled
COLOURS: Final = {
    "unreachable": "#d55e00",
    "door": "#009e73",
    "lift": "#0072b2",
    "repair": "#cc79a7",
    "walk": "#56b4e9",
}
NOT_DRAWN: Final = frozenset({"treads made", "edges joined", "height assumed", "door found"})
_CHANGES: Final[Mapping[str, tuple[tuple[float, float], tuple[float, float]]]] = {
    "mirrored left to right": ((-1.0, 0.0), (0.0, 1.0)),
    "mirrored top to bottom": ((1.0, 0.0), (0.0, -1.0)),
    "with x and y swapped": ((0.0, 1.0), (1.0, 0.0)),
    "in feet": ((0.3048, 0.0), (0.0, 0.3048)),
}


@dataclass(frozen=True, slots=True)
class WalkCheck:
    """A walk on a plan.

    Attributes:
        xy_m: (T, 2) places in the frame of the plan.
        level: (T,).
        inside: (T,) True where a place lies on the floor.
        crosses: (T - 1,) True where the straight line to the next place passes a wall.
        warnings: Whether the walk would fit better on the plan changed in some way.
    """

    xy_m: FloatArray
    level: Any
    inside: BoolArray
    crosses: BoolArray
    warnings: tuple[str, ...]

    def facts(self) -> dict[str, Any]:
        """Counts, and where walls are passed."""
        rows = np.flatnonzero(self.crosses)
        return {
            "places": len(self.xy_m),
            "outside": int((~self.inside).sum()),
            "walls_crossed": len(rows),
            "crossed_at": [
                {"level": int(self.level[i]), "x_m": float(middle[0]), "y_m": float(middle[1])}
                for i, middle in ((i, self.xy_m[i : i + 2].mean(axis=0)) for i in rows)
            ],
        }


def check_walk(building: Building, walk: Trajectory) -> WalkCheck:
    """Which walls the straight lines between the places of a walk pass, level by level."""
    import shapely

    inside = building.contains(walk.xy_m, walk.level)
    crosses = np.zeros(max(len(walk) - 1, 0), dtype=np.bool_)
    is_wall = building.edge_neighbour == WALL
    same = np.flatnonzero((np.diff(walk.level) == 0) & (np.hypot(*np.diff(walk.xy_m, axis=0).T) > 1e-6))
    if len(same):
        ends = np.stack([walk.xy_m[same], walk.xy_m[same + 1]], axis=1)
        walls = np.flatnonzero(is_wall)
        lines = np.stack([building.edge_start_xy_m[walls], building.edge_end_xy_m[walls]], axis=1)
        step, wall = shapely.STRtree(shapely.linestrings(lines)).query(
            shapely.linestrings(ends), predicate="intersects"
        )
        on_level = building.level(building.edge_polygon[walls[wall]]) == walk.level[same[step]]
        crosses[np.unique(same[step[on_level]])] = True
    return WalkCheck(walk.xy_m, walk.level, inside, crosses, _fits_better(building, walk, float(inside.mean())))


def _fits_better(building: Building, walk: Trajectory, fraction: float) -> tuple[str, ...]:
    """Says where much more of a walk lies inside once the plan is mirrored or scaled."""
    x0, y0, x1, y1 = building.bounds_m()
    middle = np.array([(x0 + x1) / 2, (y0 + y1) / 2])
    warnings = []
    for name, matrix in _CHANGES.items():
        about = np.zeros(2) if name == "in feet" else middle
        moved = (walk.xy_m - about) @ np.linalg.inv(np.array(matrix)).T + about
        inside = float(building.contains(moved, walk.level).mean())
        if inside > fraction + BETTER and inside > 0.7:
            warnings.append(f"{inside:.0%} of the walk lies inside the plan {name}, {fraction:.0%} as it is")
    return tuple(warnings)


def plan_facts(plan: Plan) -> dict[str, Any]:
    """What a plan holds and what is wrong with it, as tables."""
    building = plan.building
    parts = reachable_parts(building)
    shafts = lift_shafts(building)
    return {
        "name": building.name,
        "format": plan.source,
        "levels": level_table(building),
        "stairs": _stairs(building),
        "lifts": [{"levels": _levels(building, shaft), "polygons": len(shaft)} for shaft in shafts],
        "unreachable": _unreachable(building, parts),
        "unconnected_levels": list(unconnected_levels(building)),
        "repairs": dict(Counter(repair.kind for repair in plan.repairs)),
        "warnings": list(plan.warnings),
    }


def _levels(building: Building, polygons: Sequence[int]) -> list[int]:
    return sorted({building.polygons[i].level for i in polygons})


def _stairs(building: Building) -> list[dict[str, Any]]:
    """Treads that hang together: levels, number and place."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    is_stairs = np.array([polygon.kind == "stairs" for polygon in building.polygons])
    neighbour, owner = building.edge_neighbour, building.edge_polygon
    edges = np.flatnonzero((neighbour != WALL) & is_stairs[owner])
    edges = edges[is_stairs[neighbour[edges]]]
    graph = coo_array((np.ones(len(edges)), (owner[edges], neighbour[edges])), shape=(len(is_stairs),) * 2)
    _, label = connected_components(graph, directed=False)
    rows = []
    for one in np.unique(label[is_stairs]):
        members = np.flatnonzero((label == one) & is_stairs)
        xy_m = building.polygons[members[0]].outline_xy_m.mean(axis=0)
        heights = building.height(members)
        rows.append(
            {
                "levels": " to ".join(str(level) for level in _levels(building, members.tolist())),
                "treads": len(members),
                "rise_m": float(np.ptp(heights)),
                "x_m": float(xy_m[0]),
                "y_m": float(xy_m[1]),
            }
        )
    return rows


def _unreachable(building: Building, parts: Any) -> list[dict[str, Any]]:
    """Parts that no way leads to from the largest one, larger ones first."""
    rows = []
    for part in np.unique(parts[unreachable(building)]):
        members = np.flatnonzero(parts == part)
        largest = max(members, key=lambda i: building.polygons[i].area_m2)
        xy_m = building.polygons[largest].outline_xy_m.mean(axis=0)
        rows.append(
            {
                "levels": " ".join(str(level) for level in _levels(building, members.tolist())),
                "polygon": building.polygons[largest].id,
                "polygons": len(members),
                "area_m2": sum(building.polygons[i].area_m2 for i in members),
                "x_m": float(xy_m[0]),
                "y_m": float(xy_m[1]),
            }
        )
    return rows


def draw_plan(plan: Plan, walk: WalkCheck | None, columns: int = 3) -> Any:
    """A matplotlib figure: every level with its doors, lifts, repairs and unreachable floor, and a walk on it."""
    from matplotlib.figure import Figure

    building = plan.building
    columns = min(columns, len(building.levels))
    rows = -(-len(building.levels) // columns)
    figure = Figure(figsize=(7.0 * columns, 7.0 * rows), layout="constrained")
    is_lost = unreachable(building)
    for number, level in enumerate(building.levels):
        axes = figure.add_subplot(rows, columns, number + 1)
        draw_level(axes, building, level)
        _draw_marks(axes, building, level, is_lost)
        mended = [repair for repair in plan.repairs if repair.level == level and repair.kind not in NOT_DRAWN]
        places = [repair.place_xy_m for repair in mended if repair.place_xy_m is not None]
        if places:
            axes.plot(*np.array(places).T, "x", color=COLOURS["repair"], markersize=5, zorder=6, label="repair")
        if walk is not None:
            _draw_walk(axes, walk, level)
        axes.set_title(f"level {level}")
    figure.suptitle(
        f"{building.name}: doors green, lifts blue, no way leads to what is orange, crosses are repairs"
        + ("" if walk is None else ", walls that the walk crosses red")
    )
    return figure


def _draw_marks(axes: Any, building: Building, level: int, is_lost: BoolArray) -> None:
    from matplotlib.collections import LineCollection

    for i, polygon in enumerate(building.polygons):
        if polygon.level == level and (is_lost[i] or polygon.kind == "lift"):
            colour = COLOURS["unreachable" if is_lost[i] else "lift"]
            fill_rings(axes, polygon.rings, colour, zorder=2.5, alpha=0.4)
    is_floor = np.array([polygon.kind == "floor" for polygon in building.polygons])
    owner, neighbour = building.edge_polygon, building.edge_neighbour
    doors = np.flatnonzero((neighbour != WALL) & is_floor[owner] & (building.level(owner) == level))
    ends = np.stack([building.edge_start_xy_m[doors], building.edge_end_xy_m[doors]], axis=1)
    length_m = np.hypot(*(ends[:, 1] - ends[:, 0]).T)
    keep = is_floor[neighbour[doors]] & (length_m <= MAX_DOOR_M) & (length_m > 0.3)
    axes.add_collection(LineCollection(list(ends[keep]), colors=COLOURS["door"], linewidths=1.6, zorder=5))


def _draw_walk(axes: Any, walk: WalkCheck, level: int) -> None:
    here = walk.level == level
    axes.plot(*walk.xy_m[here].T, ".-", color=COLOURS["walk"], linewidth=1.0, markersize=3, zorder=7)
    for i in np.flatnonzero(walk.crosses & here[:-1]):
        axes.plot(*walk.xy_m[i : i + 2].T, color="red", linewidth=2.0, zorder=8)


def write_picture(plan: Plan, walk: WalkCheck | None, out: Path) -> None:
    """Writes a PNG, SVG or PDF, or an HTML page with the picture and all that is listed.

    Raises:
        MapError: Another ending.
    """
    figure = draw_plan(plan, walk)
    try:
        if out.suffix in (".png", ".svg", ".pdf"):
            figure.savefig(out, dpi=110)
        elif out.suffix in (".html", ".htm"):
            out.write_text(_page(plan, walk, figure), encoding="utf-8")
        else:
            raise MapError(f"{out}: a plan is drawn as .html, .png, .svg or .pdf; name one")
    except OSError as error:
        raise PdrbenchError(f"cannot write {out}: {error.strerror}; choose another place") from error


def _page(plan: Plan, walk: WalkCheck | None, figure: Any) -> str:
    drawn = io.StringIO()
    figure.savefig(drawn, format="svg")
    facts = plan_facts(plan)
    parts = [
        f"<h1>{html.escape(plan.building.name or 'Plan')}</h1>",
        drawn.getvalue().partition("<svg")[2].join(["<svg", ""]),
    ]
    for title in ("levels", "stairs", "lifts", "unreachable"):
        parts.append(_html_table(title, facts[title]))
    repairs = [{"kind": r.kind, "where": r.where, "what": r.what} for r in plan.repairs]
    parts.append(_html_table("repairs", repairs))
    warnings = [*plan.warnings, *(walk.warnings if walk is not None else ())]
    parts.append(_html_table("warnings", [{"warning": text} for text in warnings]))
    style = (
        "body{font-family:sans-serif;margin:2em}svg{max-width:100%;height:auto}td,th{padding:2px 8px;text-align:left}"
    )
    head = (
        f"<!doctype html><meta charset='utf-8'><title>{html.escape(plan.building.name)}</title><style>{style}</style>"
    )
    return head + "\n".join(parts)


def _html_table(title: str, rows: Sequence[Mapping[str, Any]]) -> str:
    if not rows:
        return f"<h2>{title}</h2><p>none</p>"
    head = "".join(f"<th>{html.escape(name)}</th>" for name in rows[0])
    lines = ["".join(f"<td>{html.escape(shown(value))}</td>" for value in row.values()) for row in rows]
    return f"<h2>{title}</h2><table><tr>{head}</tr>" + "".join(f"<tr>{line}</tr>" for line in lines) + "</table>"


def shown(value: object) -> str:
    """A number or text as tables show it."""
    return f"{value:.4g}" if isinstance(value, float) else str(value)
