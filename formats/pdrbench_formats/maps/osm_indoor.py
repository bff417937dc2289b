"""OpenStreetMap Simple Indoor Tagging: `.osm` (XML), the JSON of Overpass, or GeoJSON made from either.

Rooms have walls; areas and corridors are open to one another and walled towards rooms. Doors are nodes on walls. A
stair or lift is an area, a line of steps or a point whose `level` names all levels that it joins. Levels are lists and
ranges ("0;1", "-1-3"), and `repeat_on` puts the same thing on more of them. A door without a level has those of the
walls that it is in.
"""

from __future__ import annotations

import contextlib
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final
from xml.etree import ElementTree

import msgspec
import numpy as np
import shapely

from pdrbench.errors import MapError
from pdrbench.io.geo import GeoFrame
from pdrbench.io.reader import HEAD_BYTES, Head, Reader
from pdrbench_formats.maps import files
from pdrbench_formats.maps.assembly.shapes import thickened
from pdrbench_formats.maps.builder import BuildingBuilder, finished
from pdrbench_formats.maps.features import Feature, check_degrees, frame_of, level_number, read_features, to_metres
from pdrbench_formats.maps.plan import Plan
from pdrbench_formats.maps.stacks import Outline, join_stacks

WALKED: Final = frozenset({"room", "area", "corridor", "yes"})
OPEN: Final = frozenset({"area", "corridor", "yes"})
ON_WALL_DEG: Final = 1e-6  # of a door from the outline that it is in: a tenth of a metre
MAX_LEVELS: Final = 200
LIFT_M: Final = 1.6  # side of the cabin of a lift that is drawn as a point
WIDTHS_M: Final = {"stairs": 2.0, "escalator": 1.0, "lift": 1.6}  # of connections drawn as lines without a width
RAMPS: Final = {"floor": "read as floor without a slope", "escalator": "read as a straight flight of low steps"}
_PBF: Final = b"OSMHeader"
_RANGE: Final = re.compile(r"(-?\d+(?:\.\d+)?)(?:-(-?\d+(?:\.\d+)?))?")


def levels_of(text: str) -> list[int]:
    """Whole levels of a tag; half levels, as of landings, are left out.

    >>> levels_of("0;1"), levels_of("-1-3"), levels_of("0.5"), levels_of("1;3-4")
    ([0, 1], [-1, 0, 1, 2, 3], [], [1, 3, 4])
    """
    found: set[int] = set()
    for part in text.replace(",", ";").split(";"):
        match = _RANGE.fullmatch(part.strip())
        if match is None:
            level = level_number(part)
            found |= {int(level)} if level is not None and level == int(level) else set()
            continue
        low, high = float(match[1]), float(match[2] or match[1])
        if abs(low) > MAX_LEVELS or abs(high) > MAX_LEVELS:
            raise MapError(f"level {part!r} is higher or lower than any building; mend the tag")
        if match[2] is None:
            found |= {int(low)} if low == int(low) else set()
        else:
            found |= set(range(int(np.ceil(low)), int(np.floor(high)) + 1))
    return sorted(found)


def read(path: Path | str, *, strict: bool = False) -> Plan:
    """Reads a file.

    Raises:
        MapError: Names file, feature and remedy.
    """
    path = Path(path)
    container, builder = files.opened(path), BuildingBuilder(files.name_of(path), strict=strict)
    content = files.member(container, path.name)
    if _PBF in content[:100]:
        raise MapError(f"{path}: packed as PBF; unpack it: osmium cat {path.name} -o plan.osm")
    if content.lstrip().startswith(b"<") or b'"elements"' in content[:HEAD_BYTES]:
        features = list(_features(_elements(content, path), path))
    else:
        features = read_features(container, path.name, builder.note_geometry)
    return plan_of(path, features, builder)


def plan_of(path: Path, features: Sequence[Feature], builder: BuildingBuilder) -> Plan:
    """The plan of features with tags of OpenStreetMap, in degrees."""
    features = _with_door_levels([replace(feature, tags=_texts(feature.tags)) for feature in features])
    if not any(one.tags.get("level") for one in features) and any(one.tags.get("indoor") for one in features):
        features = [replace(one, tags={**one.tags, "level": "0"}) for one in features]
        builder.note("levels assumed", "nothing has a tag `level`: all was taken for level 0")
    indoor = [one for one in features if one.tags.get("indoor") in WALKED and one.tags.get("level")]
    if not indoor:
        raise MapError(f"{path}: nothing has the tag indoor=room, area or corridor; the extract has no indoor plan")
    check_degrees(indoor, path)
    geo = frame_of(indoor)
    named = (feature.text("name") for feature in features if feature.text("building"))
    builder.name = next(filter(None, named), builder.name)
    walked = [feature for feature in indoor if _area_kind(feature) == "floor"]
    numbers = sorted({level for feature in walked for level in _levels(feature, feature.tags)})
    if not numbers:
        given = sorted({feature.text("level") for feature in indoor})
        raise MapError(
            f"{path}: no room, area or corridor is on a whole level: level is {', '.join(map(repr, given[:8]))}; the "
            f"tag has numbers, 0 for the ground"
        )
    for number in numbers:
        builder.add_level(number)
    skipped: Counter[str] = Counter()
    outlines: list[Outline] = []
    for feature in features:
        outlines += _add(builder, feature, geo, frozenset(numbers), skipped)
    join_stacks(builder, outlines)
    return finished(builder, "osm_indoor", geo, skipped)


def _texts(tags: Mapping[str, Any]) -> dict[str, str]:
    """Tags whose values are texts or numbers, as texts; they may lie in a member of their own."""
    nested = tags.get("tags")
    tags = {**tags, **nested} if isinstance(nested, Mapping) else tags
    return {key: str(value) for key, value in tags.items() if isinstance(value, (str, int, float))}


def _with_door_levels(features: list[Feature]) -> list[Feature]:
    """The features; doors without a level have those of the walls that they are in."""
    walls = [feature for feature in features if feature.tags.get("indoor") and feature.tags.get("level")]
    outlines = shapely.boundary([wall.shape for wall in walls]) if walls else []
    tree = shapely.STRtree(outlines)

    def levels(door: Feature) -> str:
        near = tree.query(door.shape, predicate="dwithin", distance=ON_WALL_DEG)
        tags = [walls[int(k)].tags for k in near]
        return ";".join({value: 0 for tag in tags for value in (tag["level"], tag.get("repeat_on", "")) if value})

    return [
        replace(feature, tags={**feature.tags, "level": levels(feature)})
        if not feature.tags.get("level") and _is_door(feature.tags)
        else feature
        for feature in features
    ]


def _is_door(tags: Mapping[str, Any]) -> bool:
    return bool(tags.get("door") or tags.get("entrance") or tags.get("indoor") == "door")


def _levels(feature: Feature, tags: Mapping[str, Any]) -> list[int]:
    return sorted({*levels_of(feature.text("level")), *levels_of(str(tags.get("repeat_on") or ""))})


def _area_kind(feature: Feature) -> str:
    """One of "floor", "stairs", "escalator" and "lift", or "" for what people do not walk on."""
    tags, is_area = feature.tags, feature.shape.geom_type.endswith("Polygon")
    if tags.get("highway") == "elevator" or (is_area and "elevator" in (tags.get("room"), tags.get("indoor"))):
        return "lift"
    is_stair = is_area and (tags.get("stairs") == "yes" or "stairs" in (tags.get("room"), tags.get("indoor")))
    if is_stair or tags.get("highway") == "steps":
        return "escalator" if tags.get("conveying") not in (None, "no") else "stairs"
    if _is_ramp(tags) and len(_levels(feature, tags)) > 1:
        return "escalator"  # straight, from end to end
    return "floor" if is_area and tags.get("indoor") in WALKED - {"yes"} else ""


def _is_ramp(tags: Mapping[str, Any]) -> bool:
    return "ramp" in (tags.get("room"), tags.get("indoor")) or tags.get("ramp") == "yes" != tags.get("stairs")


def _outlined(shape: Any, kind: str, width_m: float | None) -> Any:
    """An area for stairs that are drawn as a line, or for a lift that is drawn as a point."""
    if shape.geom_type.endswith("Polygon"):
        return shape
    if shape.geom_type == "Point":
        return shape.buffer(LIFT_M / 2, cap_style="square")
    return thickened(shape, (width_m or WIDTHS_M[kind]) / 2, "flat")


def _add(
    builder: BuildingBuilder, feature: Feature, geo: GeoFrame, known: frozenset[int], skipped: Counter[str]
) -> list[Outline]:
    """Adds a feature; returns outlines of stairs that name one level only."""
    tags = feature.tags
    levels = [level for level in _levels(feature, tags) if level in known]
    area, name = _area_kind(feature), feature.text("name") or feature.text("ref")
    shape = to_metres(feature.shape, geo)
    if not levels:
        if area:
            builder.note_half_level(feature.id, area, shape, feature.text("level") or "none")
        skipped["without a whole level that has floor"] += 1
        return []
    if area and _is_ramp(tags):
        builder.note("ramp", f"{feature.id}: ramp of {shape.area:.1f} m² {RAMPS[area]}", levels[0])
    if area == "floor":
        for level in levels:
            builder.add_walkable(
                shape, level, id=feature.id, name=name, use=str(tags["indoor"]), walled=tags["indoor"] not in OPEN
            )
    elif area and not (len(levels) == 1 and not feature.shape.geom_type.endswith("Polygon")):
        shape = _outlined(shape, area, _width(feature))
        walled = tags.get("indoor") == "room" or (area == "lift" and feature.shape.geom_type != "Point")
        if len(levels) == 1:
            return [Outline(area, levels[0], shape, feature.id, is_walled=walled)]
        builder.connect(
            area,  # type: ignore[arg-type]
            levels=levels,
            polygon=shape,
            id=feature.id,
            walled=walled,
            up=_up(to_metres(feature.shape, geo), tags),
        )
    elif tags.get("indoor") == "wall" and feature.shape.geom_type != "Point":
        for level in levels:
            builder.add_wall(shape, level)
    elif feature.shape.geom_type in ("Point", "LineString") and _is_door(tags):
        for level in levels:
            builder.add_door(shape, level, width_m=_width(feature), name=feature.id)
    else:
        kind = next((f"{key}={tags[key]}" for key in ("indoor", "highway", "building", "amenity") if tags.get(key)), "")
        skipped[kind or feature.shape.geom_type] += 1
    return []


def _up(shape: Any, tags: Mapping[str, Any]) -> tuple[float, float] | None:
    """The direction in which a line of steps leads up; None of an area or a point."""
    if shape.geom_type != "LineString":
        return None
    ends = shapely.get_coordinates(shape)[[0, -1]]
    along = ends[0] - ends[1] if tags.get("incline") == "down" else ends[1] - ends[0]
    return float(along[0]), float(along[1])


def _width(feature: Feature) -> float | None:
    """Width of a door or a stair in metres; None where the tag has none."""
    try:
        width_m = float(feature.text("width"))
    except ValueError:
        return None
    return width_m if 0.4 < width_m < 10.0 else None


# Files: XML and the JSON of Overpass hold the same elements.


class _Member(msgspec.Struct):
    type: str = ""
    ref: int | str = 0
    role: str = ""
    geometry: list[dict[str, float] | None] | None = None


class _Element(msgspec.Struct):
    type: str
    id: int | str
    lat: float | None = None
    lon: float | None = None
    nodes: list[int | str] | None = None
    geometry: list[dict[str, float] | None] | None = None
    members: list[_Member] = msgspec.field(default_factory=list)
    tags: dict[str, str] = msgspec.field(default_factory=dict)


class _Answer(msgspec.Struct):
    elements: list[_Element]
    remark: str = ""


Line = list[tuple[float, float]]


def _elements(content: bytes, path: Path) -> list[_Element]:
    """Nodes, ways and relations of XML or of an answer of Overpass."""
    if not content.lstrip().startswith(b"<"):
        answer: _Answer = files.decoded(content, _Answer, path)
        if not answer.elements:
            raise MapError(
                f"{path}: Overpass found nothing{answer.remark and f', and said {answer.remark!r}'}; ask again"
            )
        return answer.elements
    root = files.xml_root(content, path)
    return [_xml_element(element) for element in root if element.tag in ("node", "way", "relation")]


def _xml_element(element: ElementTree.Element) -> _Element:
    attributes = element.attrib
    found = _Element(str(element.tag), attributes.get("id", ""))
    if attributes.get("action") != "delete":
        with contextlib.suppress(KeyError, ValueError):
            found.lat, found.lon = float(attributes["lat"]), float(attributes["lon"])
        found.tags = {tag.attrib.get("k", ""): tag.attrib.get("v", "") for tag in element.findall("tag")}
        found.nodes = [ref.attrib.get("ref", "") for ref in element.findall("nd")]
        found.members = msgspec.convert([part.attrib for part in element.findall("member")], list[_Member])
    return found


def _features(elements: Sequence[_Element], path: Path) -> Iterator[Feature]:
    """Tagged nodes, ways and multipolygons."""
    nodes: dict[int | str, tuple[float, float]] = {}
    ways: dict[int | str, Line] = {}
    for number, node in enumerate(element for element in elements if element.type == "node"):
        if node.lat is None or node.lon is None:
            if node.tags or node.id == "":
                raise MapError(f"{path}: node {node.id or number} has no id, lon and lat; export the file again")
            continue
        place = nodes[node.id] = (node.lon, node.lat)
        if node.tags:
            yield Feature(f"node/{node.id}", shapely.Point(place), node.tags, "", f"{path}: node {node.id}")
    for way in (element for element in elements if element.type == "way"):
        points = ways[way.id] = _line(way.geometry) or [nodes[ref] for ref in way.nodes or () if ref in nodes]
        if len(points) < 2 or not way.tags:
            continue
        closed = len(points) > 3 and points[0] == points[-1] and way.tags.get("indoor") != "wall"
        shape = shapely.Polygon(points) if closed else shapely.LineString(points)
        yield Feature(f"way/{way.id}", shape, way.tags, "", f"{path}: way {way.id}")
    for relation in (element for element in elements if element.type == "relation"):
        if relation.tags.get("type") == "multipolygon":
            area = _multipolygon(relation, ways)
            if area is not None:
                yield Feature(f"relation/{relation.id}", area, relation.tags, "", f"{path}: relation {relation.id}")


def _line(geometry: Sequence[Mapping[str, float] | None] | None) -> Line:
    """Places of an element that Overpass was asked for `out geom`; it leaves out those beyond its box."""
    return [(place["lon"], place["lat"]) for place in geometry or () if place and {"lon", "lat"} <= place.keys()]


def _multipolygon(relation: _Element, ways: Mapping[int | str, Line]) -> Any:
    """Outer rings without the inner ones; None where they do not close."""

    def area(role: str) -> Any:
        members = [
            _line(part.geometry) or ways.get(part.ref, [])
            for part in relation.members
            if part.type == "way" and (part.role or "outer") == role
        ]
        lines = [shapely.LineString(points) for points in members if len(points) > 1]
        return shapely.union_all(shapely.get_parts(shapely.polygonize(lines))) if lines else shapely.Polygon()

    outer = area("outer")
    return None if outer.is_empty else shapely.difference(outer, area("inner"))


def sniff(head: Head) -> bool:
    """True for OpenStreetMap XML or PBF, answers of Overpass, and GeoJSON whose features have the tag `indoor`."""
    content = head.content.lstrip()
    if content.startswith(b"<"):
        return b"<osm" in content[:2000]
    is_answer = b'"elements"' in content and (b'"osm3s"' in content or b'"nodes"' in content)
    is_geojson = b'"FeatureCollection"' in content and b'"indoor"' in content
    return _PBF in content[:100] or (content.startswith(b"{") and (is_answer or is_geojson))


READER: Final = Reader(read, sniff)
