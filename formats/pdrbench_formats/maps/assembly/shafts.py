"""Stairs, escalators and lifts: outlines above one another, ways in, and where the treads lie."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
import shapely

from pdrbench_formats.maps.assembly.doors import MIN_DOOR_M, doorway_beside
from pdrbench_formats.maps.assembly.drawing import Cell, Connection, RepairLog
from pdrbench_formats.maps.assembly.flights import StairLayout, lay_out, parts_on_level
from pdrbench_formats.maps.assembly.shapes import SLIT_M, common, large_parts, sound, without

MIN_OVERLAP: Final = 0.5  # of the smaller outline: two outlines of a shaft on different levels
MIN_COMFORT: Final = 0.4  # of a stair that joins all levels: below it, one of them may be left out
NEAR_M: Final = 0.03  # from the outline of a shaft to floor that it is open to


def shafts_of(connections: Sequence[Connection]) -> list[Connection]:
    """Connections, those with a common outline on a common level made one."""
    shafts: list[Connection] = []
    for one in sorted(connections, key=lambda connection: connection.levels):
        for k, other in enumerate(shafts):
            shared = set(one.levels) & set(other.levels)
            if one.kind == other.kind and shared and all(
                common(one.outlines[level], other.outlines[level]).area
                > MIN_OVERLAP * min(one.outlines[level].area, other.outlines[level].area)
                for level in shared
            ):  # fmt: skip
                outlines = one.outlines | other.outlines
                shafts[k] = replace(other, outlines=outlines, levels=tuple(sorted(outlines)))
                break
        else:
            shafts.append(one)
    return shafts


def lay_out_shaft(
    k: int, shaft: Connection, by_level: Mapping[int, list[Cell]], height_m: Mapping[int, float], repairs: RepairLog
) -> StairLayout | None:
    """Where the treads of a stair lie; None, with a repair, where there is no room for them."""
    outlines = [sound(shaft.outlines[level], slit_m=SLIT_M) for level in shaft.levels]
    core = sound(functools.reduce(common, outlines), slit_m=SLIT_M)
    middle = shapely.get_coordinates(shaft.outlines[shaft.levels[0]].centroid)[0]
    smallest = min(outline.area for outline in shaft.outlines.values())
    where = f"{shaft.kind} {shaft.id!r}, levels {', '.join(map(str, shaft.levels))}"
    tidy = sound(shapely.simplify(core.buffer(-NEAR_M, join_style="mitre").buffer(NEAR_M, join_style="mitre"), 0.004))
    if core.area < MIN_OVERLAP * smallest or tidy.is_empty:
        what = f"its outlines on these levels share {core.area:.1f} of {smallest:.1f} m²: left as floor, not joined"
        repairs.add("stairs not joined", where, what, middle, shaft.levels[0])
        return None
    accesses = [_access(k, by_level[level]) for level in shaft.levels]
    heights_m = [height_m[level] for level in shaft.levels]
    if shaft.kind == "escalator" or shaft.up is not None:
        layout = lay_out(tidy, accesses, heights_m, straight_only=True, up=shaft.up)
    else:
        layout = lay_out(tidy, accesses, heights_m)
        while (layout is None or layout.comfort < MIN_COMFORT) and len(shaft.levels) > 2:
            # The way in of the lowest or highest level lies at another end than those of the others.
            ends = [(slice(1, None), shaft.levels[0]), (slice(None, -1), shaft.levels[-1])]
            tried = [(lay_out(tidy, accesses[part], heights_m[part]), part, level) for part, level in ends]
            best, part, level = max(tried, key=lambda one: 0.0 if one[0] is None else one[0].comfort)
            if best is None or best.comfort < MIN_COMFORT:
                break
            repairs.add("level not joined", where, f"no good stair reaches level {level} as well", middle, level)
            layout, accesses, heights_m = best, accesses[part], heights_m[part]
            shaft.levels = shaft.levels[part]
            where = f"{shaft.kind} {shaft.id!r}, levels {', '.join(map(str, shaft.levels))}"
    if layout is None:
        what = "no room for treads between the ways in: left as floor, not joined"
        repairs.add("stairs not joined", where, what, middle, shaft.levels[0])
    else:
        risers = ", ".join(
            f"{abs(rise) / count:.2f}" for rise, count in zip(np.diff(heights_m), layout.num_risers, strict=True)
        )
        shape = layout.form.replace("_", " ") + (", turning" if layout.frame.radius_m else "")
        what = f"drawn as an outline: treads laid out ({shape}, {layout.tread_m:.2f} m deep, {risers} m high)"
        repairs.add("treads made", where, what, middle, shaft.levels[0])
    return layout


def _access(k: int, cells: Sequence[Cell]) -> Any:
    """Lines where the outline of a shaft is open to the floor of a level."""
    own = [cell for cell in cells if cell.shaft == k]
    others = [
        cell.shape
        for cell in cells
        if cell.shaft != k and (cell.is_door or not (cell.is_walled or any(c.is_walled for c in own)))
    ]
    if not own or not others:
        return shapely.LineString()
    near = shapely.union_all(others).buffer(NEAR_M)
    return shapely.intersection(shapely.union_all([cell.shape for cell in own]).boundary, near)


def place_parts(cells: list[Cell], shafts: Sequence[Connection], layouts: Mapping[int, StairLayout]) -> None:
    """Puts landings, and what flights take, in the place of the outlines of stairs."""

    for cell in [cell for cell in cells if cell.shaft >= 0]:
        layout = layouts.get(cell.shaft)
        if layout is None:
            continue
        cells.remove(cell)
        levels = shafts[cell.shaft].levels
        if cell.level not in levels:
            cells.append(cell)
            continue
        leaves, arrives = cell.level < levels[-1], cell.level > levels[0]
        for name, part in parts_on_level(layout, cell.shape, leaves=leaves, arrives=arrives).items():
            is_taken = name in ("up", "down")
            for piece in large_parts(common(part, cell.shape), 0.05):
                cells.append(replace(cell, id=f"{cell.id} {name}", shape=piece, is_taken=is_taken, kind="floor"))


def open_shafts(
    cells: list[Cell], shafts: Sequence[Connection], number: int, door_m: float, repairs: RepairLog
) -> None:
    """Gives a stair or lift without any way in on this level a doorway through the thinnest wall beside it."""
    for k, shaft in enumerate(shafts):
        own = [cell for cell in cells if cell.shaft == k]
        if not own or _access(k, cells).length >= MIN_DOOR_M:
            continue
        shape = max((cell.shape for cell in own), key=shapely.area)
        where, place = f"level {number}, {shaft.kind} {shaft.id!r}", shapely.get_coordinates(shape.centroid)[0]
        others = [cell for cell in cells if cell.shaft != k]
        doorway = doorway_beside(shape, [cell.shape for cell in others], door_m)
        if doorway is None:
            repairs.add("no way in", where, "no door and no floor beside it: cannot be reached", place, number)
            continue
        what = f"no door leads to it: opened a doorway of {door_m:g} m through the thinnest wall"
        repairs.add("doorway made", where, what, shapely.get_coordinates(doorway.centroid)[0], number)
        for cell in cells:
            if shapely.intersects(doorway, cell.shape):
                cell.shape = sound(without(cell.shape, doorway))
        cells.append(Cell(f"doorway-{shaft.id}", doorway, number, is_walled=False, is_door=True))
