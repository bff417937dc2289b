"""How far the walls are from a path that knows which floor polygons it passes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pdrbench.building import WALL, Building
from pdrbench.geometry import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, slots=True)
class NearWalls:
    """Pairs of a point of a path and a wall near it."""

    point: IntArray  # (K,) int, index on the path
    start_xy_m: FloatArray  # (K, 2) of the wall
    end_xy_m: FloatArray  # (K, 2)
    num_points: int  # points of the path

    def distance_m(self, xy_m: FloatArray, max_m: float) -> FloatArray:
        """(N,) to the nearest wall, `max_m` where none is that near."""
        nearest = np.full(self.num_points, max_m)
        np.minimum.at(nearest, self.point, np.hypot(*self.offsets_m(xy_m)))
        return nearest

    def offsets_m(self, xy_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(K,) x and (K,) y from the path, moved to `xy_m` (N, 2), to the nearest place of each wall.

        By columns, which is four times as fast as by rows of two.
        """
        x_m, y_m = xy_m[:, 0][self.point], xy_m[:, 1][self.point]
        start_x, start_y = self.start_xy_m.T
        along_x, along_y = (self.end_xy_m - self.start_xy_m).T
        fraction = ((x_m - start_x) * along_x + (y_m - start_y) * along_y) / (along_x**2 + along_y**2)
        fraction = np.clip(fraction, 0.0, 1.0)
        return start_x + fraction * along_x - x_m, start_y + fraction * along_y - y_m


def walls_along(building: Building, xy_m: FloatArray, polygon: IntArray, reach_m: float, window: int) -> NearWalls:
    """Walls within reach of a path, of the floor polygons that it passes shortly before and after each point.

    Walls of other polygons do not count: stairs overlap, and a wall behind a wall does not affect the path.

    Args:
        building: The map.
        xy_m: (N, 2).
        polygon: (N,) int.
        reach_m: Farther walls are left out.
        window: A polygon counts from this many points before the path enters it to as many after it leaves.
    """
    import shapely

    near = _polygons_around(polygon, window, len(building.polygons))
    is_passed: BoolArray = np.asarray(near.any(axis=0))
    walls = np.flatnonzero((building.edge_neighbour == WALL) & is_passed[building.edge_polygon])
    ends = np.stack([building.edge_start_xy_m[walls], building.edge_end_xy_m[walls]], axis=1)
    point, line = shapely.STRtree(np.asarray(shapely.linestrings(ends))).query(
        shapely.points(xy_m), predicate="dwithin", distance=reach_m
    )
    keep = near[point, building.edge_polygon[walls[line]]]
    point, wall = point[keep], walls[line[keep]]
    # Columns lie together in memory, since all that follows works on columns.
    start, end = (np.asfortranarray(ends[wall]) for ends in (building.edge_start_xy_m, building.edge_end_xy_m))
    return NearWalls(point, start, end, len(xy_m))


def _polygons_around(polygon: IntArray, window: int, num_polygons: int) -> BoolArray:
    """(N, P) True where the path is in a polygon within `window` points of each point."""
    inside = np.zeros((len(polygon) + 2 * window + 1, num_polygons), dtype=np.int64)
    inside[np.arange(len(polygon)) + window + 1, polygon] = 1
    total = np.cumsum(inside, axis=0)
    around: BoolArray = total[2 * window + 1 :] > total[: len(polygon)]
    return around
