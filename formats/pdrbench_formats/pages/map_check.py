"""A plan examined: what it holds, what cannot be reached, which walls a walk crosses."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import shapely

from pdrbench.building import WALL, Building
from pdrbench.building.connectivity import labels_of, lift_shafts, reachable_parts, unconnected_levels
from pdrbench.geometry import BoolArray, FloatArray
from pdrbench.trajectory import Trajectory
from pdrbench_formats.maps.plan import Plan, level_table, unreachable

BETTER: Final = 0.15  # fraction of a walk that has to lie better inside before a plan is called mirrored or scaled
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
    return {
        "name": building.name,
        "format": plan.source,
        "levels": level_table(building),
        "stairs": _stairs(building),
        "lifts": [
            {"levels": _levels(building, shaft), "polygons": len(shaft), **_middle(building, shaft[0])}
            for shaft in lift_shafts(building)
        ],
        "unreachable": _unreachable(building, parts),
        "unconnected_levels": list(unconnected_levels(building)),
        "repairs": dict(Counter(repair.kind for repair in plan.repairs)),
        "warnings": list(plan.warnings),
    }


def _levels(building: Building, polygons: Sequence[int]) -> list[int]:
    return sorted({building.polygons[i].level for i in polygons})


def _middle(building: Building, polygon: int) -> dict[str, float]:
    """Where a floor polygon is."""
    x_m, y_m = building.polygons[polygon].outline_xy_m.mean(axis=0)
    return {"x_m": float(x_m), "y_m": float(y_m)}


def _stairs(building: Building) -> list[dict[str, Any]]:
    """Treads that hang together: levels, number and place."""
    is_stairs = np.array([polygon.kind == "stairs" for polygon in building.polygons])
    neighbour, owner = building.edge_neighbour, building.edge_polygon
    edges = np.flatnonzero((neighbour != WALL) & is_stairs[owner])
    edges = edges[is_stairs[neighbour[edges]]]
    label = labels_of(len(is_stairs), np.column_stack([owner[edges], neighbour[edges]]))
    rows = []
    for one in np.unique(label[is_stairs]):
        members = np.flatnonzero((label == one) & is_stairs)
        rows.append(
            {
                "levels": " to ".join(str(level) for level in _levels(building, members.tolist())),
                "treads": len(members),
                "rise_m": float(np.ptp(building.height(members))),
                **_middle(building, members[0]),
            }
        )
    return rows


def _unreachable(building: Building, parts: Any) -> list[dict[str, Any]]:
    """Parts that no way leads to from the largest one, larger ones first."""
    rows = []
    for part in np.unique(parts[unreachable(building)]):
        members = np.flatnonzero(parts == part)
        largest = max(members, key=lambda i: building.polygons[i].area_m2)
        rows.append(
            {
                "levels": " ".join(str(level) for level in _levels(building, members.tolist())),
                "polygon": building.polygons[largest].id,
                "polygons": len(members),
                "area_m2": sum(building.polygons[i].area_m2 for i in members),
                **_middle(building, int(largest)),
            }
        )
    return rows
