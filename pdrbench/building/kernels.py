"""Compiled map walk in float64: the simple kernel that faster ones are held against."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from pdrbench.compiled import compiled
from pdrbench.geometry import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    from pdrbench.building.building import Edges

MAX_CROSSINGS: Final = 64  # claim W6: more polygons than that in one stride are no walk
PROGRESS: Final = 1e-9  # claim W6: contacts closer than this fraction of the segment, or of a wall, are one


@compiled
def move(polygon: IntArray, start_xy_m: FloatArray, end_xy_m: FloatArray, edges: Edges) -> tuple[IntArray, BoolArray]:
    """Walks N segments one after the other; see `Building.move`."""
    count = len(polygon)
    reached = polygon.copy()
    alive = np.ones(count, dtype=np.bool_)
    for i in range(count):
        reached[i], alive[i] = walk_segment(
            polygon[i], start_xy_m[i, 0], start_xy_m[i, 1], end_xy_m[i, 0], end_xy_m[i, 1], edges
        )
    return reached, alive


@compiled
def walk_segment(polygon: int, x: float, y: float, end_x: float, end_y: float, edges: Edges) -> tuple[int, bool]:
    """Algorithm 1: to the first edge on the way; stop at a wall, go on beyond a connection.

    Only edges that the segment leaves through count, so a start on an edge is free to step inwards and not to step
    outwards. The side of the segment on which a vertex lies follows from the vertex alone: edges that share a vertex
    agree on it, and nothing slips between them. Where the paper sets A to C, this keeps A and the fraction `done` of
    AB.
    """
    edge_start, edge_end, neighbour, twin, first_edge = edges
    dx, dy = end_x - x, end_y - y
    length2 = dx * dx + dy * dy
    if not np.isfinite(length2):
        return polygon, False
    here, entered, done = polygon, -1, 0.0
    for _ in range(MAX_CROSSINGS):
        to_wall, to_connection, crossed = np.inf, np.inf, -1
        for edge in range(first_edge[here], first_edge[here + 1]):
            px, py = edge_start[edge, 0] - x, edge_start[edge, 1] - y
            qx, qy = edge_end[edge, 0] - x, edge_end[edge, 1] - y
            side_p = dx * py - dy * px
            side_q = dx * qy - dy * qx
            outward = side_q - side_p  # positive where the segment leaves the floor, which lies to the left of the edge
            if outward <= 0.0 or edge == entered:
                continue
            across = -side_p / outward
            is_wall = neighbour[edge] < 0
            if is_wall:
                if across < -PROGRESS or across > 1.0 + PROGRESS:
                    continue
            elif not (side_p < 0.0 and side_q >= 0.0):
                continue
            along = ((px + across * (qx - px)) * dx + (py + across * (qy - py)) * dy) / length2
            if along < done - PROGRESS or along > 1.0:
                continue
            if is_wall:
                to_wall = min(to_wall, along)
            elif along < to_connection:
                to_connection, crossed = along, edge
        if to_wall < np.inf and to_wall <= to_connection + PROGRESS:
            return polygon, False
        if crossed < 0:
            return here, True
        here, entered, done = neighbour[crossed], twin[crossed], to_connection
    return polygon, False
