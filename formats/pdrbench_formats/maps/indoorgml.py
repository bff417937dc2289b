"""IndoorGML 1.0 and 1.1: cell spaces as solids or surfaces, and transitions between them that pass its doors.

The floor of a solid is made of its level faces at the bottom. Cells whose class or name says door, and boundaries that
are connections, are doors; where a file has none, each transition between two cells of a level is a door where it
leaves the one and enters the other. A transition between levels is a stair in the area that its two cells share.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final
from xml.etree import ElementTree

import numpy as np
import shapely

from pdrbench.errors import MapError
from pdrbench.geometry import FloatArray
from pdrbench.io.reader import Head, Reader
from pdrbench_formats.maps.builder import BuildingBuilder, finished
from pdrbench_formats.maps.features import MAX_VERTICES
from pdrbench_formats.maps.files import member, name_of, opened, xml_root
from pdrbench_formats.maps.plan import Plan

MIN_SIZE_M: Final = 0.5  # of all cells: no building is as small
MIN_COVERED: Final = 0.7  # of the area of the cells of a level: less where they lie upon one another
FLAT_M: Final = 0.02  # heights of a face that is a floor
LEVEL_GAP_M: Final = 1.5  # floors closer in height belong to one level
MAX_DOOR_GAP_M: Final = 0.8  # between two cells that a transition joins by a door
_FACES: Final = ("Polygon", "PolygonPatch", "Rectangle", "Triangle")
_DOOR: Final = re.compile(r"\b(door|tuer|tür|porte|opening|entrance)", re.IGNORECASE)


@dataclass(slots=True)
class _Space:
    """A cell space: floor faces in the plane, the height of its floor, and whether it is a door."""

    id: str
    name: str
    shape: Any
    z_m: float
    is_door: bool
    level: int = 0


@dataclass(slots=True)
class _Graph:
    spaces: dict[str, _Space] = field(default_factory=dict)
    state_of: dict[str, str] = field(default_factory=dict)  # cell by state
    transitions: list[tuple[str, str, FloatArray]] = field(default_factory=list)  # states, (N, 3)
    doors: list[FloatArray] = field(default_factory=list)  # (N, 3) of boundaries that are connections
    ground_m: float = 0.0
    open_rings: int = 0  # that do not end where they begin
    places: list[FloatArray] = field(default_factory=list)  # (N, 3) of all rings


def read(path: Path | str, *, strict: bool = False) -> Plan:
    """Reads a file; coordinates are taken for metres.

    Raises:
        MapError: Names file, element and remedy.
    """
    path = Path(path)
    content = member(opened(path), path.name)
    root = xml_root(content, path)
    if _CITYGML.decode() in root.tag:
        raise MapError(f"{path}: CityGML, which has no ways between rooms; export the plan as IndoorGML 1.0")
    if any("indoorgml/2" in element.tag for element in root.iter()):
        raise MapError(f"{path}: IndoorGML 2.0; versions 1.0 and 1.1 are read, export one of them")
    graph = _read_graph(root, path)
    if graph.places and np.ptp(np.concatenate(graph.places)[:, :2], axis=0).max() < MIN_SIZE_M:
        raise MapError(f"{path}: its cells reach over less than {MIN_SIZE_M} m; are they degrees? export metres")
    if not graph.spaces:
        raise MapError(f"{path}: no cell space has a geometry with a floor; a topological graph alone is no plan")
    heights = _number_levels(graph)
    _check_overlaps(graph, path)
    builder = BuildingBuilder(name_of(path), strict=strict)
    origin = np.floor(np.min([space.shape.bounds[:2] for space in graph.spaces.values()], axis=0))
    if np.abs(origin).max() > 10_000:
        builder.note("origin moved", f"coordinates begin at {origin.tolist()}: moved to 0")
    else:
        origin = np.zeros(2)
    for level, height_m in heights.items():
        builder.add_level(level, height_m=height_m)
    if graph.open_rings:
        builder.note("ring closed", f"{graph.open_rings} rings do not end where they begin: closed")
    has_doors = any(space.is_door for space in graph.spaces.values())
    stairs = _stairs(graph)
    halls = {id for _, _, ids in stairs for id in ids}
    for space in graph.spaces.values():
        shape = _moved(space.shape, origin)
        if space.is_door:
            builder.add_door(shape, space.level, name=space.name)
        else:
            builder.add_walkable(shape, space.level, id=space.id, name=space.name, walled=space.id not in halls)
    for number, (levels, shape, _) in enumerate(stairs):
        builder.connect("stairs", levels=levels, polygon=_moved(shape, origin), id=f"stairs-{number}")
    for line, z_m in (_ground_line(places) for places in graph.doors):
        level = min(heights, key=lambda level: abs(heights[level] + graph.ground_m - z_m))
        builder.add_door(_moved(line, origin), level)
    if not has_doors and not graph.doors:
        for level, place in _doors(graph):
            builder.add_door(_moved(place, origin), level)
    return finished(builder, "indoorgml")


def _check_overlaps(graph: _Graph, path: Path) -> None:
    """Raises `MapError` where cells of one level cover one another, as those of several levels without heights do."""
    for level in {space.level for space in graph.spaces.values()}:
        shapes = [space.shape for space in graph.spaces.values() if space.level == level and not space.is_door]
        total_m2, covered_m2 = sum(shape.area for shape in shapes), shapely.union_all(shapes).area
        if covered_m2 < MIN_COVERED * total_m2:
            raise MapError(
                f"{path}: cells at one height cover one another ({total_m2:.0f} m² on {covered_m2:.0f} m²): several "
                f"levels without heights? export it with a third coordinate"
            )


def _moved(shape: Any, origin: FloatArray) -> Any:
    return shapely.transform(shape, lambda xy: xy - origin)


def _without_namespaces(root: ElementTree.Element) -> None:
    """Leaves names without their namespaces, which differ by version."""
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]
        element.attrib = {key.rpartition("}")[2]: value for key, value in element.attrib.items()}


def _all(element: ElementTree.Element, *names: str) -> Iterator[ElementTree.Element]:
    return (child for child in element.iter() if child.tag in names)


def _target(element: ElementTree.Element) -> str:
    """The id of what an element refers to."""
    return element.get("href", "").lstrip("#")


def _read_graph(root: ElementTree.Element, path: Path) -> _Graph:
    _without_namespaces(root)
    graph, total = _Graph(), 0
    known: dict[ElementTree.Element, list[FloatArray]] = {}
    by_id = {element.get("id", ""): element for element in _all(root, *_FACES, "Surface", "OrientableSurface")}
    for cell in _all(root, "CellSpace", "GeneralSpace", "TransitionSpace", "ConnectionSpace", "AnchorSpace"):
        id = cell.get("id", "")
        name = cell.findtext("name") or ""
        faces = []
        for polygon in _faces_of(cell, by_id):
            rings = known[polygon] = known.get(polygon) or _face(polygon, path, id)  # cells share faces
            total += sum(map(len, rings)) or 1
            if total > MAX_VERTICES:
                raise MapError(f"{path}: more than {MAX_VERTICES} vertices; simplify the plan")
            faces += [rings] if rings else []
        graph.places += [face[0] for face in faces]
        graph.open_rings += sum(np.abs(ring[0] - ring[-1]).max() > 1e-3 for face in faces for ring in face)
        kinds = " ".join(child.text or "" for child in cell if child.tag in ("class", "function", "usage"))
        is_door = cell.tag in ("ConnectionSpace", "AnchorSpace") or bool(_DOOR.search(f"{name} {kinds}"))
        space = _space(id, name.strip(), faces, is_door)
        if space is not None:
            graph.spaces[id] = space
            for duality in _all(cell, "duality"):
                graph.state_of[_target(duality)] = id
    for state in _all(root, "State"):
        for duality in _all(state, "duality"):
            graph.state_of.setdefault(state.get("id", ""), _target(duality))
    for boundary in _all(root, "ConnectionBoundary", "AnchorBoundary"):
        places = _positions(boundary, path, "a boundary")
        if len(places) > 1:
            graph.doors.append(places)
    for transition in _all(root, "Transition"):
        ends = [_target(child) for child in transition if child.tag == "connects"]
        line = next((_positions(found, path, "a transition") for found in _all(transition, "LineString")), None)
        if len(ends) == 2 and line is not None and len(line) > 1 and np.ptp(line, axis=0).any():
            graph.transitions.append((ends[0], ends[1], line))
    return graph


def _faces_of(cell: ElementTree.Element, by_id: Mapping[str, ElementTree.Element]) -> Iterator[ElementTree.Element]:
    """Faces of a cell, also those that it shares with another one and only refers to."""
    yield from _all(cell, *_FACES)
    for part in _all(cell, "surfaceMember", "baseSurface"):
        shared = by_id.get(_target(part))
        if shared is not None:
            yield from _all(shared, *_FACES)


def _positions(element: ElementTree.Element, path: Path, where: str) -> FloatArray:
    """(N, 3) positions below an element, two-dimensional ones at height 0."""
    flat: list[float] = []
    for node in _all(element, "pos", "posList"):
        try:
            numbers = [float(word) for word in (node.text or "").split()]
            size = int(node.attrib.get("srsDimension", 3 if len(numbers) % 3 == 0 else 2))
        except ValueError:
            raise MapError(f"{path}: {where}: {(node.text or '')[:40]!r} holds no numbers; export it again") from None
        if not numbers or size not in (2, 3) or len(numbers) % size or not all(map(math.isfinite, numbers)):
            raise MapError(f"{path}: {where}: positions of {len(numbers)} numbers; expected threes; export it again")
        flat += numbers if size == 3 else [x for k in range(0, len(numbers), 2) for x in (*numbers[k : k + 2], 0.0)]
    return np.array(flat).reshape(-1, 3)


def _face(polygon: ElementTree.Element, path: Path, id: str) -> list[FloatArray]:
    """Rings (N, 3) of a face."""
    rings = [_positions(ring, path, f"cell {id!r}") for ring in _all(polygon, "LinearRing")]
    return [ring for ring in rings if len(ring) >= 4]


def _space(id: str, name: str, faces: list[list[FloatArray]], is_door: bool) -> _Space | None:
    """The floor of a cell: its lowest faces that are level."""
    level = [face for face in faces if np.ptp(face[0][:, 2]) < FLAT_M]
    if not level:
        return None
    bottom_m = min(float(face[0][:, 2].mean()) for face in level)
    shapes = [shapely.Polygon(face[0][:, :2], [ring[:, :2] for ring in face[1:]]) for face in level
              if face[0][:, 2].mean() < bottom_m + 0.5]  # fmt: skip
    shape = shapely.union_all(shapely.make_valid(shapes))
    return _Space(id, name, shape, bottom_m, is_door) if shape.area > 1e-3 else None


def _number_levels(graph: _Graph) -> dict[int, float]:
    """Numbers the levels by the heights of floors, 0 the one nearest to height 0; heights above that one."""
    heights = sorted(space.z_m for space in graph.spaces.values() if not space.is_door)
    groups: list[list[float]] = []
    for z_m in heights or [space.z_m for space in graph.spaces.values()]:
        if not groups or z_m - groups[-1][0] > LEVEL_GAP_M:
            groups.append([])
        groups[-1].append(z_m)
    middle = np.array([np.median(group) for group in groups])
    ground = int(np.abs(middle).argmin()) if middle[0] <= 1.0 else 0
    graph.ground_m = float(middle[ground])
    for space in graph.spaces.values():
        space.level = int(np.abs(middle - space.z_m).argmin()) - ground
    return {k - ground: float(z_m - middle[ground]) for k, z_m in enumerate(middle)}


def _ground_line(places: FloatArray) -> tuple[Any, float]:
    """The line in the plane that a boundary stands on, between its farthest places, and the height of its foot."""
    xy = places[:, :2]
    first = int(np.hypot(*(xy - xy.mean(axis=0)).T).argmax())
    last = int(np.hypot(*(xy - xy[first]).T).argmax())
    return shapely.LineString([xy[first], xy[last]]), float(places[:, 2].min())


def _joined(graph: _Graph) -> Iterator[tuple[_Space, _Space, FloatArray]]:
    """Pairs of cells that a transition joins, each once, and its line."""
    seen = set()
    for one, other, line in graph.transitions:
        a, b = (graph.spaces.get(graph.state_of.get(state, "")) for state in (one, other))
        if a is None or b is None or frozenset((a.id, b.id)) in seen:
            continue
        seen.add(frozenset((a.id, b.id)))
        yield a, b, line


def _doors(graph: _Graph) -> Iterator[tuple[int, Any]]:
    """Level and place where a transition passes from one cell to another."""
    for a, b, line in _joined(graph):
        if a.level != b.level:
            continue
        if not np.ptp(line[:, :2], axis=0).any():
            continue
        points = shapely.points(shapely.get_coordinates(shapely.segmentize(shapely.LineString(line[:, :2]), 0.05)))
        gap_m = shapely.distance(points, a.shape) + shapely.distance(points, b.shape)
        best = int(gap_m.argmin())
        if gap_m[best] <= MAX_DOOR_GAP_M:
            tied = np.flatnonzero(gap_m <= gap_m[best] + 1e-9)
            yield a.level, points[tied[len(tied) // 2]]


def _stairs(graph: _Graph) -> list[tuple[list[int], Any, set[str]]]:
    """Levels, outline and cells of each stair: cells above one another that transitions join."""
    columns: list[dict[str, _Space]] = []
    for a, b, _ in _joined(graph):
        if a.level == b.level:
            continue
        both = {a.id: a, b.id: b}
        for column in [column for column in columns if column.keys() & both.keys()]:
            columns.remove(column)
            both |= column
        columns.append(both)
    doors = shapely.MultiPoint([shapely.get_coordinates(place)[0] for _, place in _doors(graph)])
    found = []
    for column in columns:
        common = shapely.intersection_all([space.shape for space in column.values()])
        parts = [part for part in shapely.get_parts(common) if part.geom_type == "Polygon"]
        outline = _stair_in(max(parts, key=shapely.area), doors) if parts else None
        if outline is not None:
            found.append((sorted({space.level for space in column.values()}), outline, set(column)))
    return found


def _stair_in(common: Any, doors: Any) -> Any:
    """A rectangle for a stair in a cell, off its doors, that leaves the rest of the cell in one part; or None.

    A file says that one gets from a hall to the hall above, and not where in it the stair is.
    """
    if common.area < 12.0 and not shapely.intersects(common.buffer(0.2), doors):
        return common
    corners = shapely.get_coordinates(shapely.oriented_envelope(common))
    sides = np.diff(corners, axis=0)[:2]
    lengths = np.hypot(*sides.T)
    axes = sides / lengths[:, None]
    inside = common.buffer(0.05)
    for long_m, short_m in ((3.6, 2.2), (3.0, 1.8), (2.6, 1.4), (2.2, 1.1), (2.0, 1.0)):
        for u, v in ((axes[0], axes[1]), (axes[1], axes[0])):
            spans = [abs(float((corners[2] - corners[0]) @ axis)) for axis in (u, v)]
            for along in np.arange(0.0, spans[0] - long_m + 0.1, 0.2):
                for across in np.arange(0.0, spans[1] - short_m + 0.1, 0.2):
                    low = corners[0] + along * u + across * v
                    ring = [low, low + long_m * u, low + long_m * u + short_m * v, low + short_m * v]
                    outline = shapely.Polygon(ring)
                    if not inside.covers(outline) or outline.distance(doors) < 0.6:
                        continue
                    rest = shapely.difference(common, outline).buffer(-0.25)
                    if rest.geom_type == "Polygon" and not rest.is_empty:
                        return shapely.intersection(outline, common)
    return None


def sniff(head: Head) -> bool:
    """True for XML in a namespace of IndoorGML, or of CityGML, which is refused."""
    content = head.content.lstrip()
    return content.startswith(b"<") and (b"opengis.net/indoorgml" in content or _CITYGML in content)


_CITYGML: Final = b"opengis.net/citygml"
READER: Final = Reader(read, sniff)
