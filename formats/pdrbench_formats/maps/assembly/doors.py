"""Doors: drawn as lines, polygons or points, found as gaps in walls, or made beside a stair that has none."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
import shapely
from shapely import ops

from pdrbench.geometry import FloatArray
from pdrbench_formats.maps.assembly.drawing import Cell, DrawnLevel, RepairLog
from pdrbench_formats.maps.assembly.shapes import common, eroded, large_parts, without

MIN_DOOR_M: Final = 0.3  # a narrower opening is no door
DOOR_REACHES_M: Final = (0.05, 0.12, 0.25, 0.45, 0.7)  # from the line of a door to the floor on both sides
MAX_THIN_WALL_M: Final = 0.5  # a stair without a door is opened through a wall up to this thick
PLACE_M: Final = 0.4  # between places along an outline where a stair may be opened
MAX_PLACES: Final = 5000  # of an outline: one of kilometres has them farther apart
MAX_FOUND_DOOR_M: Final = 1.3  # a wider gap between two parts of a floor is no door
MAX_FOUND_NECK_M: Final = 0.5  # nor is one that is longer: that is a corridor
SMOOTH_M: Final = 0.001  # by which an arc of what a disc sweeps may be off


def doors_of(level: DrawnLevel, cells: Sequence[Cell], walls: Any, repairs: RepairLog) -> list[Cell]:
    """A cell for every door that leads from one area to another, or through a wall within one."""
    tree = shapely.STRtree([cell.shape for cell in cells])
    doors: list[Cell] = []
    for geometry, width_m, name in level.doors:
        shape = (
            _door_in_polygon(geometry, cells, tree, walls)
            if geometry.geom_type == "Polygon"
            else _door_on_line(geometry, width_m, cells, tree)
        )
        where = f"level {level.number}, door {name or len(doors)!r}"
        place = shapely.get_coordinates(geometry.centroid)[0]
        if shape is None:
            what = "leads from no area to another: left out"
            repairs.add("door left out", where, what, place, level.number)
            continue
        doors.append(Cell(f"door-{len(doors)}", shape, level.number, is_walled=False, is_door=True))
    shapes = np.array([door.shape for door in doors], dtype=object)
    pairs = shapely.STRtree(shapes).query(shapes, predicate="intersects").T
    for i, k in sorted((i, k) for i, k in pairs.tolist() if k < i):  # leaves of a double door may overlap
        if shapely.intersects(doors[i].shape, doors[k].shape):
            doors[i].shape = without(doors[i].shape, doors[k].shape)
    parts = [large_parts(door.shape, 1e-3) for door in doors]
    return [replace(door, shape=max(of, key=shapely.area)) for door, of in zip(doors, parts, strict=True) if of]


def door_gaps(shape: Any) -> list[Any]:
    """Lines from jamb to jamb across the gaps of a floor that are as narrow and as short as a door.

    Rooms are what a disc wider than a door can sweep; a gap is where two of them meet or almost meet.
    """
    half_m = MAX_FOUND_DOOR_M / 2
    cores = large_parts(eroded(shape, half_m), 0.0)
    # Grown in two steps, and without points that bend nothing, for time: see `eroded`.
    rooms = [core.simplify(SMOOTH_M).buffer(half_m / 6).buffer(5 * half_m / 6) for core in cores]
    found: list[Any] = []
    if len(rooms) < 2:
        return found
    for i, j in shapely.STRtree(rooms).query(rooms, predicate="dwithin", distance=MAX_FOUND_NECK_M).T:
        if i >= j:
            continue
        meeting = large_parts(common(rooms[i], rooms[j]), 1e-6)
        for part in meeting or [shapely.shortest_line(rooms[i], rooms[j])]:
            line = _across(part.centroid, cores[i], cores[j], shape)
            if line is not None:
                found.append(line)
    return found


def _across(middle: Any, one: Any, other: Any, shape: Any) -> Any:
    """The line through a place, across the way from one part of a floor to another, from wall to wall; or None."""
    ways = [shapely.get_coordinates(shapely.shortest_line(part, middle))[0] for part in (one, other)]
    along = ways[1] - ways[0]
    length_m = float(np.hypot(*along))
    if not length_m or not shape.covers(shapely.LineString([ways[0], shapely.get_coordinates(middle)[0], ways[1]])):
        return None
    across = np.array([-along[1], along[0]]) / length_m * MAX_FOUND_DOOR_M
    place = shapely.get_coordinates(middle)[0]
    pieces = shapely.get_parts(shapely.intersection(shape, shapely.LineString([place - across, place + across])))
    line = min(pieces, key=lambda piece: shapely.distance(piece, middle))
    if not MIN_DOOR_M <= line.length <= MAX_FOUND_DOOR_M:
        return None
    ends = shapely.get_coordinates(line)[[0, -1]]
    beyond = 0.01 * (ends[1] - ends[0]) / line.length  # into the jambs, so that no slit is left beside it
    return shapely.LineString([ends[0] - beyond, ends[1] + beyond])


def _door_in_polygon(shape: Any, cells: Sequence[Cell], tree: Any, walls: Any) -> Any:
    """The part of a door's polygon that is no wall, or all of it where that touches less floor; None without floor."""
    free = without(shape, walls)
    parts = large_parts(free, 0.02)
    if parts and sum(part.area for part in parts) > 0.5 * shape.area:
        return max(parts, key=shapely.area)
    near = [cells[int(i)].shape for i in tree.query(shape.buffer(0.05))]
    touched = sum(shapely.intersection(shape.buffer(0.05), other).area > 0.005 for other in near)
    return shape if touched else None


def _door_on_line(geometry: Any, width_m: float, cells: Sequence[Cell], tree: Any) -> Any:
    """A rectangle about the line of a door, deep enough to reach the floor on both sides; None where there is none."""
    if geometry.geom_type == "Point":
        geometry = _line_through(geometry, width_m, cells, tree)
        if geometry is None:
            return None
    ends = shapely.get_coordinates(geometry)[[0, -1]]
    along = ends[1] - ends[0]
    length_m = float(np.hypot(*along))
    if length_m < MIN_DOOR_M:
        return None
    normal = np.array([-along[1], along[0]]) / length_m
    for reach_m in DOOR_REACHES_M:
        if all(_floor_at_end(ends, sign * reach_m * normal, cells, tree) for sign in (1.0, -1.0)):
            return shapely.union(*(_strip(ends, sign * reach_m * normal) for sign in (1.0, -1.0)))
    return None


def _strip(ends: FloatArray, across: FloatArray) -> Any:
    return shapely.Polygon([ends[0], ends[1], ends[1] + across, ends[0] + across])


def _floor_at_end(ends: FloatArray, across: FloatArray, cells: Sequence[Cell], tree: Any) -> bool:
    """Whether there is floor along most of the far side of a strip."""
    far = shapely.LineString(
        [ends[0] + across + 0.1 * (ends[1] - ends[0]), ends[1] + across - 0.1 * (ends[1] - ends[0])]
    )
    near = [cells[int(i)].shape for i in tree.query(far)]
    covered = sum(shapely.intersection(far, shape).length for shape in near)
    return bool(covered > 0.6 * far.length)


def _line_through(point: Any, width_m: float, cells: Sequence[Cell], tree: Any) -> Any:
    """The line of a door at a point: along the nearest wall, moved off its corners."""
    found: list[Any] = []
    for cell in (cells[int(i)] for i in tree.query(point.buffer(DOOR_REACHES_M[-1]))):
        for ring in (cell.shape.exterior, *cell.shape.interiors):
            points = shapely.get_coordinates(shapely.simplify(ring, 0.01))
            edges = shapely.linestrings(np.stack([points[:-1], points[1:]], axis=1))
            off_m = shapely.distance(edges, point)
            found += list(edges[off_m <= min(off_m.min() + 0.05, DOOR_REACHES_M[-1])])
    wall = min(found, key=lambda edge: (round(edge.distance(point) / 0.1), -edge.length), default=None)
    if wall is None:
        return None
    half_m = min(width_m, wall.length) / 2
    middle_m = float(np.clip(wall.project(point), half_m, wall.length - half_m))
    return ops.substring(wall, middle_m - half_m, middle_m + half_m)


def doorway_beside(shape: Any, others: Sequence[Any], width_m: float) -> Any:
    """A rectangle from an outline through the thinnest wall to the floor behind it; None where no floor is near."""
    if not others:
        return None
    tree, ring = shapely.STRtree(others), shapely.get_coordinates(shape.exterior)
    wide = np.hypot(*np.diff(ring, axis=0).T) >= width_m
    starts, along = ring[:-1][wide], np.diff(ring, axis=0)[wide]
    units = along / (lengths_m := np.hypot(*along.T))[:, None]
    counts = np.maximum(1, lengths_m / max(PLACE_M, lengths_m.sum() / MAX_PLACES)).astype(int)
    edge = np.repeat(np.arange(len(counts)), counts)
    number = np.arange(len(edge)) - np.repeat(np.cumsum(counts) - counts, counts)
    middle_m = width_m / 2 + number * ((lengths_m - width_m) / np.maximum(counts - 1, 1))[edge]
    outs = np.stack([units[:, 1], -units[:, 0]], axis=1) * (1.0 if shape.exterior.is_ccw else -1.0)
    middles = starts[edge] + middle_m[:, None] * units[edge]
    rays = shapely.linestrings(np.stack([middles, middles + MAX_THIN_WALL_M * outs[edge]], axis=1))
    ray, other = tree.query(rays, predicate="intersects")
    gaps_m = np.full(len(rays), math.inf)
    hits = shapely.intersection(rays[ray], np.array(others)[other])
    np.minimum.at(gaps_m, ray, shapely.distance(shapely.points(middles[ray]), hits))
    best: tuple[float, Any] = math.inf, None
    for k in np.flatnonzero(np.isfinite(gaps_m)):
        if gaps_m[k] >= best[0] - 1e-3:
            continue
        out, half = outs[edge[k]], width_m / 2 * units[edge[k]]
        ends = np.array([middles[k] - half, middles[k] + half])
        far = shapely.LineString(ends + (gaps_m[k] + 0.04) * out)
        if sum(shapely.intersection(far, others[int(i)]).length for i in tree.query(far)) > 0.8 * width_m:
            best = float(gaps_m[k]), shapely.orient_polygons(_strip(ends - 0.05 * out, (gaps_m[k] + 0.1) * out))
    return best[1]
