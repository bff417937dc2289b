"""Whether the estimated path is one that a pedestrian can walk in this building.

No reference is needed: what is looked at are the answers, at the time of every observation that was answered. An answer
that counts as missing holds the one before it.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from pdrbench.building import WALL, Building
from pdrbench.building.polygons import shapely_polygons
from pdrbench.geometry import BoolArray, FloatArray, IntArray
from pdrbench.metrics.hold import Held

TOLERANCE_M: Final = 0.001  # how far an estimate may lie outside the floor and still count as on its edge
OVERLAP_M: Final = 0.01  # floors that overlap by less share an edge
CHUNK: Final = 256  # steps looked at together: bounds the memory that long steps across a large plan take


def outside_pct(answered: Held, building: Building | None, *, tolerance_m: float = TOLERANCE_M) -> float:
    """Fraction of answers outside the walkable floor of their level in percent; NaN without a building or an answer.

    Outside is farther than `tolerance_m` from every floor polygon of the level, or on a level that there is not.

    Args:
        answered: Held at the time of every answer.
        building: The map.
        tolerance_m: Rounding.
    """
    if building is None or not answered.is_answer.any():
        return math.nan
    xy_m, level = _answers(answered)
    outside = np.flatnonzero(~building.contains(xy_m, level))
    if len(outside):
        outside = outside[~_near_edge(xy_m[outside], level[outside], building, tolerance_m)]
    return 100.0 * len(outside) / len(level)


def crossings_per_100m(answered: Held, building: Building | None, *, tolerance_m: float = TOLERANCE_M) -> float:
    """Walls crossed per 100 m of estimated path: 100 C / L; NaN without a building or where the estimate stands still.

    The path is made of the straight lines between consecutive answers on the same level, L is their length; a step to
    another level belongs to neither. C counts how often a line leaves a floor polygon through a wall: a wall between
    two rooms counts once, coming in from where there is no floor does not count. Inside another floor polygon of the
    level, as under a flight of stairs, a wall is none.

    Args:
        answered: Held at the time of every answer.
        building: The map.
        tolerance_m: A wall is crossed where the path gets farther beyond it than this.
    """
    if building is None or not answered.is_answer.any():
        return math.nan
    xy_m, level = _answers(answered)
    step_m = np.hypot(*np.diff(xy_m, axis=0).T)
    walked = np.flatnonzero((np.diff(level) == 0) & (step_m > 0))
    if not len(walked):
        return math.nan
    return 100.0 * _num_crossed(xy_m, level, walked, building, tolerance_m) / float(step_m[walked].sum())


@dataclass(frozen=True, slots=True)
class _Edges:
    """Edges of floor polygons, as far as they do not lie inside another floor polygon of their level.

    Attributes:
        start_m: (E, 2) the floor lies to the left.
        end_m: (E, 2).
        level: (E,) int.
        is_wall: (E,) bool.
        tree: Of shapely over all of them.
    """

    start_m: FloatArray
    end_m: FloatArray
    level: IntArray
    is_wall: BoolArray
    tree: Any

    def side(self, xy_m: FloatArray, edge: IntArray, tolerance_m: float) -> FloatArray:
        """(M,) 1 left of the line through an edge (M,), where the floor is, -1 right of it, 0 within a tolerance."""
        along_m = self.end_m[edge] - self.start_m[edge]
        area_m2 = _cross(along_m, xy_m - self.start_m[edge])
        return np.asarray(np.sign(area_m2) * (np.abs(area_m2) > tolerance_m * np.hypot(*along_m.T)))


@functools.lru_cache(maxsize=64)
def _edges(building: Building) -> _Edges:
    """Kept per content, as what `Building` derives."""
    import shapely

    start_m, end_m = building.edge_start_xy_m, building.edge_end_xy_m
    lines = shapely.linestrings(np.stack([start_m, end_m], axis=1))
    lines, edge = shapely.get_parts(_uncovered(lines, building), return_index=True)
    lines, edge = lines[~shapely.is_empty(lines)], edge[~shapely.is_empty(lines)]
    pieces_m = np.stack([shapely.get_coordinates(shapely.get_point(lines, end)) for end in (0, -1)], axis=1)
    along = np.sum((pieces_m[:, 1] - pieces_m[:, 0]) * (end_m - start_m)[edge], axis=1)
    pieces_m = np.where((along < 0)[:, None, None], pieces_m[:, ::-1], pieces_m)
    level = building.level(building.edge_polygon)[edge]
    is_wall = building.edge_neighbour[edge] == WALL
    return _Edges(pieces_m[:, 0], pieces_m[:, 1], level, is_wall, shapely.STRtree(lines))


def _uncovered(lines: Any, building: Building) -> Any:
    """Edges (E,) of a building without what lies inside another floor polygon of their level."""
    import shapely

    floors = np.asarray(shapely_polygons(building.polygons))
    covering, covered = shapely.STRtree(floors).query(floors, predicate="intersects")
    pairs = (covering != covered) & (building.level(covering) == building.level(covered))
    covering, covered = covering[pairs], covered[pairs]
    overlap = shapely.relate_pattern(floors[covering], floors[covered], "T********")
    for over, under in zip(covering[overlap], covered[overlap], strict=True):
        inner = shapely.buffer(floors[over], -OVERLAP_M, join_style="mitre")
        own = slice(building.first_edge[under], building.first_edge[under + 1])
        lines[own] = shapely.difference(lines[own], inner)
    return lines


def _answers(answered: Held) -> tuple[FloatArray, IntArray]:
    """(N, 2) places and (N,) levels from the first answer on."""
    return answered.xy_m[answered.is_answer], answered.level[answered.is_answer].astype(np.int64)


def _near_edge(xy_m: FloatArray, level: IntArray, building: Building, distance_m: float) -> BoolArray:
    """(N,) True where an edge of the level is within a distance."""
    import shapely

    edges = _edges(building)
    point, edge = edges.tree.query(shapely.points(xy_m), predicate="dwithin", distance=distance_m)
    near = np.zeros(len(xy_m), dtype=np.bool_)
    near[point[edges.level[edge] == level[point]]] = True
    return near


def _num_crossed(xy_m: FloatArray, level: IntArray, walked: IntArray, building: Building, tolerance_m: float) -> int:
    """How often the steps from `walked` (M,) to the answer after it leave a floor of their level through a wall."""
    edges = _edges(building)
    crossed = 0
    for step, edge in _close_pairs(xy_m, walked, edges.tree, tolerance_m):
        meets = edges.is_wall[edge] & (edges.level[edge] == level[step])
        step, edge = step[meets], edge[meets]
        passes = _passes(xy_m[step], xy_m[step + 1], edges.start_m[edge], edges.end_m[edge])
        step, edge = step[passes], edge[passes]
        leaves = edges.side(xy_m[step + 1], edge, tolerance_m) < 0
        crossed += int(np.count_nonzero(_came_from_floor(xy_m, level, step[leaves], edge[leaves], edges, tolerance_m)))
    return crossed


def _close_pairs(xy_m: FloatArray, walked: IntArray, tree: Any, margin_m: float) -> Iterator[tuple[IntArray, IntArray]]:
    """Steps and edges whose boxes are within a margin, some steps at a time."""
    import shapely

    low_m = np.minimum(xy_m[walked], xy_m[walked + 1]) - margin_m
    high_m = np.maximum(xy_m[walked], xy_m[walked + 1]) + margin_m
    boxes = shapely.box(low_m[:, 0], low_m[:, 1], high_m[:, 0], high_m[:, 1])
    for first in range(0, len(boxes), CHUNK):
        line, edge = tree.query(boxes[first : first + CHUNK])
        yield walked[first + line], edge


def _passes(start_m: FloatArray, end_m: FloatArray, p_m: FloatArray, q_m: FloatArray) -> BoolArray:
    """(M,) True where a line passes between the vertices of an edge, from its left to its right.

    The side of the line on which a vertex lies follows from the vertex alone, so a line through the vertex of two edges
    passes one of them.
    """
    step_m = end_m - start_m
    return np.asarray((_cross(step_m, p_m - start_m) < 0) & (_cross(step_m, q_m - start_m) >= 0))


def _came_from_floor(
    xy_m: FloatArray, level: IntArray, step: IntArray, edge: IntArray, edges: _Edges, tolerance_m: float
) -> BoolArray:
    """(M,) True where the path was on the floor side of an edge when it was last off its line.

    A path that halts on a wall so crosses it once where it goes on to the other side, and never where it turns back.
    """
    side = edges.side(xy_m[step], edge, tolerance_m)
    step = step.copy()
    while True:
        on_line = np.flatnonzero((side == 0) & (step > 0))
        on_line = on_line[level[step[on_line] - 1] == level[step[on_line]]]
        if not len(on_line):
            return np.asarray(side > 0)
        step[on_line] -= 1
        side[on_line] = edges.side(xy_m[step[on_line]], edge[on_line], tolerance_m)


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
