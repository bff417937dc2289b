"""Areas of one level apart from one another: walls taken out, doors put in, common edges made the same."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
import shapely

from pdrbench_formats.maps.assembly.doors import MIN_DOOR_M, door_gaps, doors_of
from pdrbench_formats.maps.assembly.drawing import Cell, Connection, DrawnLevel, RepairLog
from pdrbench_formats.maps.assembly.shafts import open_shafts
from pdrbench_formats.maps.assembly.shapes import eroded, large_parts, touching_vertices, without

SNAP_M: Final = 0.005  # vertices closer than this are one
WIDE_SNAP_M: Final = 0.015  # the same where cells would not hang together otherwise
STRAIGHT_M: Final = 0.002  # vertices that bend an edge by an area below this length squared are left out
GAP_M: Final = 0.03  # enclosed gaps narrower than this are filled, necks of floor narrower than twice this are cut
MIN_PART_M2: Final = 0.3  # smaller parts of a floor that walls cut off are dropped: too small to stand on
MIN_WIDTH_M: Final = 0.25  # narrower ones as well, such as the inside of a wall that is drawn as two lines
MAX_FOUND_DOORS: Final = 250  # of a level: noise has thousands of gaps; those left are floor as before
MAX_BEFORE: Final = 30  # areas beside or below another that are joined for it alone
MAX_CUTS: Final = 4  # rounds in which rings that touch are kept apart


def cells_of(level: DrawnLevel, shafts: Sequence[Connection], door_m: float, repairs: RepairLog) -> list[Cell]:
    """Areas, outlines of shafts and doors of a level, apart from one another."""
    number = level.number
    first = [
        Cell(f"{shaft.id}", shaft.outlines[number], number, "lift" if shaft.kind == "lift" else "floor",
              shaft.is_walled, shaft=k)
        for k, shaft in enumerate(shafts) if number in shaft.outlines
    ]  # fmt: skip
    cells = [*first, *sorted(level.walkable, key=lambda cell: cell.shape.area)]
    cells = _apart(cells)
    walls = shapely.union_all(level.walls) if level.walls else shapely.Polygon()
    if level.walls:
        shapely.prepare(walls)
        for cell in cells:
            if shapely.intersects(walls, cell.shape):
                cell.shape = without(cell.shape, walls)
    cells = _split(cells, number, repairs)
    if not level.doors:
        for cell in cells:
            if cell.shaft < 0 and not cell.is_walled and len(level.doors) < MAX_FOUND_DOORS:
                for line in door_gaps(cell.shape)[: MAX_FOUND_DOORS - len(level.doors)]:
                    level.doors.append((line, door_m, ""))
                    what = f"a gap of {line.length:.2f} m in the walls is taken for a door"
                    place = shapely.get_coordinates(line.centroid)[0]
                    repairs.add("door found", f"level {number}", what, place, number)
    doors = doors_of(level, cells, walls, repairs)
    if doors:
        taken = shapely.union_all([door.shape for door in doors])
        for cell in cells:
            if shapely.intersects(taken, cell.shape):
                cell.shape = without(cell.shape, taken)
        cells = _split(cells, number, repairs)
    cells = [*cells, *doors]
    open_shafts(cells, shafts, number, door_m, repairs)
    order = {cell.id: i for i, cell in enumerate(level.walkable)}
    return sorted(cells, key=lambda cell: (cell.is_door, order.get(cell.id.partition("~")[0], len(order))))


def _split(cells: Sequence[Cell], number: int, repairs: RepairLog) -> list[Cell]:
    """Each connected part a cell of its own, without necks too narrow to pass."""
    found = []
    for cell in cells:
        shape = cell.shape
        inner = shape.buffer(-GAP_M, join_style="mitre", mitre_limit=3.0)
        opened = inner.buffer(GAP_M, join_style="mitre", mitre_limit=3.0)
        if len(large_parts(opened, 0.0)) != len(large_parts(shape, 0.0)) or len(touching_vertices(shape)):
            # A little less than it was: parts that touch at a point would touch again.
            shape = inner.buffer(GAP_M - 0.002, join_style="mitre", mitre_limit=3.0)
            shape = shapely.intersection(shape, cell.shape)
        parts = sorted(large_parts(shape, 0.0), key=lambda part: -part.area)
        kept = [part for part in parts if part.area >= MIN_PART_M2 and not eroded(part, MIN_WIDTH_M / 2).is_empty]
        if cell.shaft >= 0:
            kept = kept or parts[:1]
        for part in parts:
            if part.area > 1e-3 and part not in kept:
                where = f"level {number}, {cell.id!r}"
                place = shapely.get_coordinates(part)[0]
                repairs.add("small part", where, f"{part.area:.2g} m² left out", place, number)
        for k, part in enumerate(kept):
            found.append(replace(cell, id=f"{cell.id}~{k}" if k else cell.id, shape=part))
    return found


def _apart(cells: Sequence[Cell]) -> list[Cell]:
    """Cells without the area of those before them."""
    tree = shapely.STRtree([cell.shape for cell in cells])
    found = []
    joined, members = shapely.Polygon(), set[int]()
    for i, cell in enumerate(cells):
        before = {int(j) for j in tree.query(cell.shape, predicate="intersects") if j < i}
        others = shapely.union_all([cells[j].shape for j in sorted(before)]) if len(before) <= MAX_BEFORE else None
        if others is None:  # copies of one area by the hundred: each is joined once; all joined are before this one
            joined = shapely.union_all([joined, *(cells[j].shape for j in sorted(before - members))])
            others, members = joined, members | before
        found.append(replace(cell, shape=without(cell.shape, others) if before else cell.shape))
    return found


def clean(cells: Sequence[Cell], number: int, repairs: RepairLog) -> list[Cell]:
    """The same cells with the same vertices on both sides of every common edge."""
    if not cells:
        return []
    shapes = np.array([cell.shape for cell in cells])
    cleaned = shapely.coverage_clean(shapes, gap_width=GAP_M, snapping_distance=SNAP_M)
    if _is_torn(cells, cleaned):  # corners of coordinates in degrees with seven decimals are up to a centimetre off
        cleaned = shapely.coverage_clean(shapes, gap_width=GAP_M, snapping_distance=WIDE_SNAP_M)
    _report_moves(shapes, cleaned, number, repairs)
    for _ in range(MAX_CUTS):
        cleaned = shapely.coverage_simplify(cleaned, STRAIGHT_M)
        touching = {k: touching_vertices(shape) for k, shape in enumerate(cleaned)}
        touching = {k: places for k, places in touching.items() if len(places)}
        if not touching:
            break
        # Where rings touch at a point there is no way through; a small piece of wall keeps them apart.
        for k, places in touching.items():
            cleaned[k] = shapely.difference(cleaned[k], shapely.multipoints(places).buffer(GAP_M, quad_segs=1))
        cleaned = shapely.coverage_clean(cleaned, gap_width=0.0, snapping_distance=SNAP_M)
    found = []
    for cell, shape in zip(cells, cleaned, strict=True):
        for k, part in enumerate(sorted(large_parts(shape, 1e-3), key=lambda part: -part.area)):
            if 2 * part.area < 2e-3 * part.length:
                continue
            found.append(replace(cell, id=f"{cell.id}^{k}" if k else cell.id, shape=shapely.orient_polygons(part)))
    return found


def _is_torn(cells: Sequence[Cell], cleaned: Any) -> bool:
    """Whether two cells that people pass between lie side by side, and no common edge is long enough to pass."""
    pairs = shapely.STRtree(cleaned).query(cleaned, predicate="dwithin", distance=WIDE_SNAP_M).T
    for i, j in ((i, j) for i, j in pairs if i < j and cells[i].is_open_to(cells[j])):
        near = shapely.intersection(cleaned[i].boundary, cleaned[j].buffer(WIDE_SNAP_M, cap_style="square"))
        if near.length < MIN_DOOR_M + 4 * WIDE_SNAP_M:
            continue
        if shapely.intersection(cleaned[i].boundary, cleaned[j].boundary).length < MIN_DOOR_M:
            return True
    return False


def _report_moves(before: Any, after: Any, number: int, repairs: RepairLog) -> None:
    """Reports edges that were almost the same and are the same now."""
    from scipy.spatial import KDTree

    old, new = shapely.get_coordinates(before), shapely.get_coordinates(after)
    if not len(new):
        return
    off_m = np.asarray(KDTree(new).query(old)[0])
    moved = off_m > 1e-6
    if moved.any():
        what = f"{int(moved.sum())} vertices joined with others up to {off_m[moved].max() * 1e3:.1f} mm away"
        repairs.add("edges joined", f"level {number}", what, old[off_m.argmax()], number)
