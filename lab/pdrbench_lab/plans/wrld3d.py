"""Indoor maps of WRLD 3D, as that of Westport House: `main.json` names the levels, each a file of GeoJSON.

A level is its outline without walls, windows, openings of the floor and what is not accessible. Doors fill gaps in
walls. Stairs and lifts are outlines on each level: those above one another on neighbouring levels are one, since the
format does not say which levels they join. Rooms are names only: their walls are drawn.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any, Final

import msgspec

from pdrbench.errors import MapError
from pdrbench.io.geo import GeoFrame
from pdrbench.io.reader import Head, Reader
from pdrbench_formats.maps.builder import BuildingBuilder, finished
from pdrbench_formats.maps.features import Feature, check_degrees, frame_of, read_features, to_metres
from pdrbench_formats.maps.files import decoded, member, opened
from pdrbench_formats.maps.plan import Plan
from pdrbench_formats.maps.stacks import Outline, join_stacks
from pdrbench_sim.resolution import in_steps

MAIN: Final = "main.json"
OUTLINE: Final = "building_outline"
BARRIERS: Final = frozenset({"wall", "window", "inaccessible_space"})
NAMED: Final = frozenset({"room", "bathroom", "hallway", "unit", "garden"})
CONNECTIONS: Final = {"stairs": "stairs", "escalator": "escalator", "elevator": "lift"}
SNAP_M: Final = 1e-6  # far below what a plan knows, far above the last bit of a cosine
MIN_WALL_M: Final = 0.02  # between the wall of a plan and a line that it was drawn with


class _Level(msgspec.Struct):
    z_order: int
    filename: str
    id: str = ""


class _Main(msgspec.Struct):
    levels: list[_Level]
    name: str = ""
    entrance_level: int = 0


def read(path: Path | str, *, strict: bool = False) -> Plan:
    """Reads a folder or archive.

    Raises:
        MapError: Names file, feature and remedy.
    """
    container = opened(Path(path))
    main: _Main = decoded(member(container, MAIN), _Main, container.label(MAIN))
    if not main.levels:
        raise MapError(f"{container.label(MAIN)}: names no level; each needs z_order and filename")
    orders = [level.z_order for level in main.levels]
    if len(set(orders)) != len(orders):
        raise MapError(f"{container.label(MAIN)}: two levels have z_order {max(orders, key=orders.count)}; number them")
    ground = sorted(orders)[min(max(main.entrance_level, 0), len(orders) - 1)]
    levels: dict[int, list[Feature]] = {}
    builder = BuildingBuilder(main.name or Path(path).stem, strict=strict)
    for level in sorted(main.levels, key=lambda level: level.z_order):
        levels[level.z_order - ground] = read_features(container, level.filename, builder.note_geometry)
    everything = [feature for features in levels.values() for feature in features]
    check_degrees(everything, container.path)
    geo = frame_of(everything)
    skipped: Counter[str] = Counter()
    outlines: list[Outline] = []
    for number, features in levels.items():
        builder.add_level(number)
        outlines += _add_level(builder, number, features, geo, skipped)
    join_stacks(builder, outlines)
    return finished(builder, "wrld3d", geo, skipped)


def _snapped(shape: Any) -> Any:
    """A geometry to the micrometre, so that the plan falls into the same pieces on every processor."""
    import shapely

    return shapely.transform(shape, lambda xy_m: in_steps(xy_m, SNAP_M))


def _add_level(
    builder: BuildingBuilder, number: int, features: list[Feature], geo: GeoFrame, skipped: Counter[str]
) -> list[Outline]:
    outlines = []
    floors = 0
    for feature in features:
        kind, shape = feature.text("type"), _snapped(to_metres(feature.shape, geo))
        name = feature.text("name") or feature.id
        if kind == OUTLINE:
            builder.add_walkable(shape, number, id=f"floor-{floors}", walled=False)
            floors += 1
        elif kind in BARRIERS:
            builder.add_wall(shape, number)
        elif kind == "door":
            builder.add_door(shape, number, name=feature.id)
        elif kind in CONNECTIONS:
            outlines.append(Outline(CONNECTIONS[kind], number, shape, feature.id))
        elif kind == "floor_opening":
            outlines.append(Outline("stairs", number, shape, feature.id, is_opening=True))
        elif kind in NAMED:
            builder.add_zone(shape, number, name=name, use=kind)
        else:
            skipped[kind or "without a type"] += 1
    if not floors:
        raise MapError(f"level {number} has no {OUTLINE}; without it nothing can be walked on")
    return outlines


def sniff(head: Head) -> bool:
    """True for a folder or archive with a `main.json` that lists levels."""
    content = head_member(head, MAIN)
    return b'"levels"' in content and b'"z_order"' in content


def head_member(head: Head, name: str) -> bytes:
    """The content of a member of a folder or archive; empty where there is none or it is damaged."""
    if head.container is None or name not in head.container.sizes:
        return b""
    try:
        return member(head.container, name)
    except MapError:
        return b""


READER: Final = Reader(read, sniff)
