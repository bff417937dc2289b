"""Plans whose parts are known by the names of their layers: drawings, shapefiles, what GIS programs export.

Walls are lines and polygons on layers named so ("A-WALL", "Wand", "mur"). Closed outlines on layers of rooms are rooms;
where there are none, the floor is what the outer walls enclose. Stairs and lifts above one another are joined.

The unit is the stated one where what is drawn can be so large: doors, or treads, or else the whole plan. A unit that a
`plan.toml` names settles it.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
import shapely

from pdrbench.errors import MapError
from pdrbench.geometry import FloatArray
from pdrbench_formats.maps.builder import BuildingBuilder
from pdrbench_formats.maps.features import WORDS, extent
from pdrbench_formats.maps.stacks import Outline, join_stacks

LAYERS: Final = {name: re.compile(text, re.IGNORECASE) for name, text in WORDS["layers"].items()}
Unit = Literal["m", "mm", "cm", "ft", "in", ""]
UNITS: Final = {"m": 1.0, "mm": 0.001, "cm": 0.01, "ft": 0.3048, "in": 0.0254}  # likely ones, the likeliest first
LIKELY_M: Final = (8.0, 600.0)  # the longer side of a building
POSSIBLE_M: Final = (2.0, 1800.0)
DOOR_M: Final = (0.6, 1.5)  # widths of doors, DIN 18100 and of double leaves
DOUBLE_DOOR_M: Final = 3.0
TREAD_M: Final = (0.22, 0.36)  # depth of treads, DIN 18065
MAX_PASSAGE_M: Final = 10.0  # between two parts of a hall
MAX_TREADS: Final = 500  # that are compared, each with each
MIN_TREADS: Final = 4  # parallel lines that are a flight
MIN_LIKELIER: Final = 1.25  # a unit is chosen over another that fits as well by so much
CLOSE_M: Final = 1.3  # half of a gap in the outer walls that is closed to find the floor
_SETTLE: Final = 'a plan.toml with unit = "mm", or whichever is right, settles it'

Drawn = dict[str, list[Any]]  # shapely geometries by what their layer holds: a key of `LAYERS`


def kind_of(layer: str) -> str:
    """What a layer holds, a key of `LAYERS`; "" where its name does not say."""
    return next((name for name, pattern in LAYERS.items() if pattern.search(layer)), "")


def in_metres(drawn: Drawn, unit: Unit, stated: float | None, builder: BuildingBuilder, level: int) -> Drawn:
    """Geometry in metres.

    Args:
        drawn: In units of the drawing.
        unit: That a user names; "" where the drawing has to say it.
        stated: Metres for one unit, as the file says; None where it does not.
        builder: Receives what was assumed.
        level: Named in it.
    """
    scale = UNITS[unit] if unit else _judged(drawn, stated, builder, level)
    return {name: [shapely.transform(shape, lambda xy: xy * scale) for shape in part] for name, part in drawn.items()}


def add_levels(
    builder: BuildingBuilder, levels: Sequence[tuple[int, Drawn]], path: Path, *, moves: bool = True
) -> None:
    """Adds what is drawn on each level, in metres, moved so that (0, 0) is the lower left corner of all."""
    low = np.min([shape.bounds[:2] for _, drawn in levels for part in drawn.values() for shape in part], axis=0) * moves
    outlines: list[Outline] = []
    for level, drawn in levels:
        outlines += _add_level(builder, path, level, drawn, low)
    if len(levels) > 1:
        join_stacks(builder, outlines)
        return
    for outline in outlines:
        builder.add_zone(outline.shape, name=outline.kind, use=outline.kind)


def _add_level(
    builder: BuildingBuilder, path: Path, level: int, drawn: Mapping[str, list[Any]], low: FloatArray
) -> list[Outline]:
    """Adds what is drawn on a level, moved to an origin; returns its stairs and lifts."""
    shapes = {name: [shapely.transform(shape, lambda xy: xy - low) for shape in part] for name, part in drawn.items()}
    rooms = [shape for shape in shapes["room"] if shape.geom_type == "Polygon"]
    if rooms:
        for number, room in enumerate(rooms):
            builder.add_walkable(room, level, id=f"room-{number}", walled=not shapes["wall"])
    else:
        outline = _outline(shapes["wall"])
        if outline is None:
            raise MapError(f"{path}: the walls enclose no floor; draw closed outlines on a layer named A-ROOM")
        builder.add_walkable(outline, level, id="floor", walled=False)
    for wall in shapes["wall"]:
        if not (wall.geom_type == "Polygon" and any(room.equals(wall) for room in rooms)):
            builder.add_wall(wall.exterior if wall.geom_type == "Polygon" and wall.area > 25.0 else wall, level)
    for line in _doors(shapes["door"], shapes["wall"]):
        builder.add_door(line, level)
    return [
        Outline(kind, level, shape, f"{kind}-{number}")
        for kind in ("stairs", "lift")
        for number, shape in enumerate(shape for shape in shapes[kind] if shape.geom_type == "Polygon")
    ]


def _doors(doors: list[Any], walls: list[Any]) -> list[Any]:
    """Lines and polygons of doors; of an arc, the radius that ends at walls."""
    solid = shapely.union_all(walls) if walls else shapely.Polygon()

    def off(line: Any) -> float:
        return float(shapely.distance(solid, shapely.points(line.coords)).sum())

    return [min(shapely.get_parts(door), key=off) if door.geom_type == "MultiLineString" else door for door in doors]


def _judged(shapes: Drawn, stated: float | None, builder: BuildingBuilder, level: int) -> float:
    """Metres for one unit of the drawing: the stated one, unless what is drawn fits another one only."""
    size = extent(shape for part in shapes.values() for shape in part)
    parts = [(name, length) for name, find in (("door", _door), ("tread", _tread)) if (length := find(shapes))]
    return scale_of(size, parts, stated, builder, level)


def scale_of(
    size: float,
    parts: Sequence[tuple[str, float]],
    stated: float | None,
    builder: BuildingBuilder,
    level: int | None = None,
    *,
    keeps_possible: bool = False,
) -> float:
    """Metres for one unit, by the longer side of a plan and the widths of its doors and treads in that unit.

    With `keeps_possible` a stated unit in which the plan can be so large, and what may be a door may be a passage, is
    kept, and doubt is only noted.
    """

    def seen(scale: float) -> str:
        of_parts = "".join(f", a {name} {length * scale:.3g} m" for name, length in parts)
        return f"{size * scale:.3g} m across{of_parts}"

    scales = {name: scale for name, scale in UNITS.items() if _misfit(size * scale, parts, scale) < np.inf}
    likely = min(scales, key=lambda name: _misfit(size * scales[name], parts, scales[name]), default="m")
    if stated is None:
        what = f"the plan names no unit: {size:.4g} units across, taken for {likely}: {seen(UNITS[likely])}"
        builder.note("units assumed", what, level)
        return UNITS[likely]
    is_possible = POSSIBLE_M[0] < size * stated < POSSIBLE_M[1]
    if UNITS[likely] == stated or (is_possible and not parts):
        return stated
    if not scales:
        builder.note("units doubtful", f"by the unit that it states the plan is {seen(stated)}; {_SETTLE}", level)
        return stated
    ours, theirs = (_misfit(size * scale, parts, scale) for scale in (UNITS[likely], stated))
    if theirs < ours + np.log(MIN_LIKELIER):
        return stated
    doors_m = [length * stated for name, length in parts if name == "door"]
    is_kept = keeps_possible and is_possible and all(length * stated <= MAX_PASSAGE_M for _, length in parts)
    chosen = (
        stated if is_kept or (theirs < np.inf and doors_m and DOOR_M[0] <= doors_m[0] <= DOOR_M[1]) else UNITS[likely]
    )
    builder.note(
        "units doubtful",
        f"by the unit that it states the plan is {seen(stated)}; in {likely} it would be {seen(UNITS[likely])}, "
        f"{'and the first is taken' if chosen == stated else 'which is taken'}; {_SETTLE}",
        level,
    )
    return chosen


def _misfit(size_m: float, parts: Sequence[tuple[str, float]], scale: float) -> float:
    """How far sizes are from usual ones, as a logarithm; infinite where one of them cannot be."""
    if not POSSIBLE_M[0] < size_m < POSSIBLE_M[1]:
        return float(np.inf)
    off = 0.0 if LIKELY_M[0] <= size_m <= LIKELY_M[1] else float(np.log(2.0))
    for name, length in parts:
        low, high = DOOR_M if name == "door" else TREAD_M
        width_m = length * scale
        if not low * 0.8 <= width_m <= (DOUBLE_DOOR_M if name == "door" else high * 1.2):
            return float(np.inf)
        off += abs(float(np.log(width_m / (low * high) ** 0.5)))
    return off


def _door(shapes: Mapping[str, list[Any]]) -> float:
    """Median width of what is on layers of doors, in units of the drawing; 0 where there is none."""
    widths = []
    for shape in shapes["door"]:
        line = shapely.get_parts(shape)[0] if shape.geom_type == "MultiLineString" else shape
        corners = shapely.get_coordinates(shapely.oriented_envelope(line))
        widths.append(float(np.hypot(*np.diff(corners[:3], axis=0).T).max()) if len(corners) > 1 else 0.0)
    widths = [width for width in widths if width > 0.0]
    return float(np.median(widths)) if widths else 0.0


def _tread(shapes: Mapping[str, list[Any]]) -> float:
    """Median distance of lines on layers of stairs from the nearest parallel one; 0 where there are few."""
    lines = [np.array(shape.coords)[[0, -1]] for shape in shapes["stairs"] if shape.geom_type == "LineString"]
    lines = lines[:MAX_TREADS]
    if len(lines) < MIN_TREADS:
        return 0.0
    ends = np.array(lines)
    along = ends[:, 1] - ends[:, 0]
    length = np.hypot(*along.T)
    unit = along / np.maximum(length, 1e-9)[:, None]
    middle = ends.mean(axis=1)
    off = middle[:, None] - middle[None]
    across = np.abs(off[..., 0] * unit[:, None, 1] - off[..., 1] * unit[:, None, 0])
    beside = np.abs((off * unit[:, None]).sum(axis=2)) < 0.5 * length[:, None]
    parallel = np.abs(unit @ unit.T) > 0.99
    across[~(beside & parallel) | (across < 1e-6 * length.max())] = np.inf
    nearest = across.min(axis=1)
    nearest = nearest[np.isfinite(nearest)]
    return float(np.median(nearest)) if len(nearest) >= MIN_TREADS else 0.0


def _outline(walls: list[Any]) -> Any:
    """What the outer walls enclose once gaps as wide as doors are closed."""
    drawn = shapely.union_all(
        [wall.exterior if wall.geom_type == "Polygon" and wall.area > 25.0 else wall for wall in walls]
    )
    closed = drawn.buffer(CLOSE_M, join_style="mitre")
    filled = [shapely.Polygon(part.exterior) for part in shapely.get_parts(closed)]
    outline = shapely.union_all(filled).buffer(-CLOSE_M, join_style="mitre")
    return None if outline.area < 2.0 else outline
