"""Mappedin Venue Format 3: an archive with geometry, kinds and walkable areas by floor, and connections between floors.

Rooms are polygons, walls are lines beside them, and gaps between walls are doors.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any, Final

import msgspec

from pdrbench.errors import MapError
from pdrbench.io.container import Container
from pdrbench.io.reader import Head, Reader
from pdrbench_formats.maps.builder import BuildingBuilder, finished
from pdrbench_formats.maps.features import Feature, check_degrees, frame_of, read_features, to_metres
from pdrbench_formats.maps.files import decoded, member, opened
from pdrbench_formats.maps.plan import Plan
from pdrbench_lab.plans.wrld3d import head_member

FLOORS: Final = "floors.geojson"
CONNECTIONS: Final = "connections.json"
BARRIERS: Final = frozenset({"wall", "window", "object", "void"})
OPEN: Final = frozenset({"hallway", "corridor", "area", "walkway"})
KINDS: Final = {"stairs": "stairs", "escalator": "escalator", "elevator": "lift", "ramp": "escalator", "door": "door"}


class _End(msgspec.Struct):
    geometryId: str
    floorId: str


class _Connection(msgspec.Struct):
    id: str
    type: str
    entrances: list[_End] = msgspec.field(default_factory=list)
    exits: list[_End] = msgspec.field(default_factory=list)


def read(path: Path | str, *, strict: bool = False) -> Plan:
    """Reads a folder or archive.

    Raises:
        MapError: Names file, feature and remedy.
    """
    container = opened(Path(path))
    builder = BuildingBuilder(Path(path).stem, strict=strict)
    floors = read_features(container, FLOORS, builder.note_geometry)
    if not floors:
        raise MapError(f"{container.label(FLOORS)}: no floor; export the venue again")
    check_degrees(floors, container.path)
    geo = frame_of(floors)
    levels = {floor.text("id") or floor.id: _elevation(floor) for floor in floors}
    if len(set(levels.values())) != len(levels):
        raise MapError(f"{container.label(FLOORS)}: two floors have one elevation; export one building alone")
    manifest = read_features(container, "manifest.geojson", builder.note_geometry)
    builder.name = (manifest[0].text("name") if manifest else "") or builder.name
    for level in sorted(levels.values()):
        builder.add_level(level)
    skipped: Counter[str] = Counter()
    shapes: dict[tuple[str, str], Any] = {}
    kinds: dict[str, str] = {}
    for id in levels:
        features = read_features(container, f"geometry/{id}.geojson", builder.note_geometry)
        kinds |= decoded(member(container, f"kinds/{id}.json"), dict[str, str], container.label(f"kinds/{id}.json"))
        shapes |= {(id, feature.text("id") or feature.id): to_metres(feature.shape, geo) for feature in features}
    connections = _connections(container)
    used: set[tuple[str, str]] = set()
    for connection in connections:
        used |= _connect(builder, connection, shapes, levels, skipped)
    for (floor, id), shape in shapes.items():
        if (floor, id) not in used:
            _add(builder, id, kinds.get(id, ""), shape, levels[floor], skipped)
    return finished(builder, "mvf", geo, skipped)


def _elevation(floor: Feature) -> int:
    elevation = floor.tags.get("elevation")
    if isinstance(elevation, bool) or not isinstance(elevation, (int, float)) or elevation != int(elevation):
        raise MapError(f"{floor.where}: elevation is {elevation!r}; expected a whole number, 0 for the ground")
    return int(elevation)


def _add(builder: BuildingBuilder, id: str, kind: str, shape: Any, level: int, skipped: Counter[str]) -> None:
    if kind in BARRIERS:
        builder.add_wall(shape, level)
    elif shape.geom_type.endswith("Polygon"):
        builder.add_walkable(shape, level, id=id, walled=kind not in OPEN, use=kind)
    else:
        skipped[kind or shape.geom_type] += 1


def _connections(container: Container) -> list[_Connection]:
    if CONNECTIONS not in container.sizes:
        return []
    found: list[_Connection] = decoded(member(container, CONNECTIONS), list[_Connection], container.label(CONNECTIONS))
    return [connection for connection in found if connection.type in KINDS]


def _connect(
    builder: BuildingBuilder,
    connection: _Connection,
    shapes: dict[tuple[str, str], Any],
    levels: dict[str, int],
    skipped: Counter[str],
) -> set[tuple[str, str]]:
    """Adds a door, a stair or a lift; returns the geometries that it stands for."""
    ends = {(end.floorId, end.geometryId) for end in connection.entrances + connection.exits}
    ends &= shapes.keys()
    if connection.type == "door":
        for floor, id in sorted(ends):
            if shapes[floor, id].geom_type == "LineString":
                builder.add_door(shapes[floor, id], levels[floor], name=connection.id)
        return ends
    outlines = {floor: _outline(shapes, floor, shapes[floor, id]) for floor, id in sorted(ends)}
    found = {levels[floor]: outline[1] for floor, outline in outlines.items() if outline is not None}
    if len(found) < 2:
        skipped[f"{connection.type} without an outline on two floors"] += 1
        return set()
    kind = KINDS[connection.type]
    builder.connect(kind, levels=list(found), polygon=found, id=connection.id, walled=True)  # type: ignore[arg-type]
    return ends | {outline[0] for outline in outlines.values() if outline is not None}


def _outline(shapes: dict[tuple[str, str], Any], floor: str, shape: Any) -> tuple[tuple[str, str], Any] | None:
    """The smallest area of a floor that holds the place of a connection."""
    areas = [(key, area) for key, area in shapes.items() if key[0] == floor and area.geom_type == "Polygon"]
    holding = [(key, area) for key, area in areas if area.intersects(shape.centroid)]
    return min(holding, key=lambda pair: pair[1].area, default=None)


def sniff(head: Head) -> bool:
    """True for a folder or archive with `floors.geojson` and `manifest.geojson`."""
    return bool(head_member(head, "manifest.geojson")) and bool(head_member(head, FLOORS))


READER: Final = Reader(read, sniff)
