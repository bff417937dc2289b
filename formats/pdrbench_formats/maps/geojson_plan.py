"""Plans that people draw themselves: GeoJSON in metres, feet or degrees, in one file or one for each level.

The property `feature` of each feature says what it is: room, area, wall, door, stairs, escalator, lift or zone; `level`
is a whole number, or `levels` a list for what joins them. The collection may name its `units`, and `levels` with
heights. See docs/buildings.md.
"""

from __future__ import annotations

import csv
import dataclasses
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np
import shapely

from pdrbench.errors import MapError, unknown_name
from pdrbench.io.container import Container
from pdrbench.io.geo import WGS84_A_M, GeoFrame
from pdrbench.io.reader import Head, Reader
from pdrbench_formats.maps import files, osm_indoor, shapefile
from pdrbench_formats.maps.builder import BuildingBuilder, finished
from pdrbench_formats.maps.features import (
    WORDS,
    Collection,
    Feature,
    check_degrees,
    extent,
    features_of,
    frame_of,
    is_degrees,
    to_metres,
)
from pdrbench_formats.maps.layers import scale_of
from pdrbench_formats.maps.plan import Plan

USUAL_DOOR_M: Final = (0.7, 1.15)  # median width of the doors of a plan
MAX_LOCAL_M: Final = 2e5  # further from the origin a plan has coordinates of the Earth
UNITS_M: Final[Mapping[str, float]] = WORDS["units"]
DEGREES: Final = "degrees"
MERCATOR: Final = "web mercator"
KINDS: Final = ("room", "area", "wall", "door", "stairs", "escalator", "lift", "zone")
CONNECTIONS: Final = ("stairs", "escalator", "lift")
AREAS: Final = ("room", "area", "zone", *CONNECTIONS)
_DEGREES_CRS: Final = ("CRS84", "EPSG::4326", "EPSG:4326")
_MERCATOR_CRS: Final = ("3857", "900913", "3785")  # a metre of it is no metre


_WKT: Final = re.compile(  # bounded: a search for spaces without end takes the square of their number
    rb"\W{0,8}(?:SRID=\d{1,9};)?(?:MULTI)?(?:POLYGON|LINESTRING|POINT)\s{0,8}[ZM]{0,2}\s{0,8}\(.*", re.I | re.S
)
_NUMBER: Final = re.compile(r"-?\d+(\.\d+)?")
_RECORD_MARK: Final = b"\x1e"  # before each feature, RFC 8142


class _Level(msgspec.Struct, forbid_unknown_fields=True):
    level: int
    height_m: float | None = None
    name: str | None = None


class _Document(Collection):
    units: str = ""
    levels: list[_Level] = msgspec.field(default_factory=list)


def read(path: Path | str, *, strict: bool = False) -> Plan:
    """Reads a plan: a file, or all files of a folder or archive.

    Raises:
        MapError: Names file, feature and remedy.
    """
    path = Path(path)
    container = files.opened(path)
    names = container.names() if container.is_file else _collections(container)
    contents = {name: files.member(container, name).replace(_RECORD_MARK, b"") for name in names}
    documents = {name: _document(content, container.label(name)) for name, content in contents.items()}
    frames = sorted({f"units {one.units!r}, crs {_crs_name(one.crs)!r}" for one in documents.values()})
    if len(frames) > 1:
        raise MapError(f"{path}: its files have {' and '.join(frames)}; name the same in each")
    document = next(iter(documents.values()))
    builder = BuildingBuilder(document.name or files.name_of(path), strict=strict)
    of_files = (features_of(one, str(container.label(name)), builder.note_geometry) for name, one in documents.items())
    features = [feature for found in of_files for feature in found]
    if not features:
        raise MapError(f"{path}: no feature with geometry; draw a room, an area or a wall")
    crs = _crs_name(document.crs)
    named = document.units or (DEGREES if crs.endswith(_DEGREES_CRS) else "")
    if named == MERCATOR or crs.endswith(_MERCATOR_CRS) or (not (named or crs) and _is_mercator(features, builder)):
        features, named = [dataclasses.replace(one, shape=_in_degrees(one.shape)) for one in features], DEGREES
    if any(feature.tags.get("indoor") for feature in features) and not _says_what(features):
        return osm_indoor.plan_of(path, features, builder)  # tags far behind the beginning of the file, or in a table
    if not _says_what(features) and any(shapefile.layer_of(feature) for feature in features):
        return shapefile.plan_of(path, features, "", strict=strict, source="geojson_plan")
    if not _says_what(features):
        seen = ", ".join(sorted({key for feature in features for key in feature.tags})[:12]) or "missing"
        raise MapError(
            f"{path}: no feature has the property `feature`, which says what it is: {', '.join(KINDS)}; its properties "
            f"are {seen}; rename one, or convert the plan to Simple Indoor Tagging or IMDF"
        )
    units = named or (DEGREES if is_degrees(features) else "metres")
    geo: GeoFrame | None = None
    if units == DEGREES:
        check_degrees(features, path)
        geo = frame_of(features)
    elif units not in UNITS_M:
        raise MapError(f"{path}: {unknown_name('unit of length', units, [*UNITS_M, DEGREES, MERCATOR])}")
    elif extent(feature.shape for feature in features) < 0.05:
        raise MapError(f'{path}: in {units} the plan is smaller than a hand; are they degrees? set "units": "degrees"')
    doors = [one.shape.length for one in features if one.tags.get("feature") == "door" and one.shape.length]
    if not named and (units == DEGREES or not doors):
        builder.note("units assumed", f"the file does not name its units: taken for {units}")
    heights = {level.level: level.height_m for one in documents.values() for level in one.levels}
    numbers = sorted({*heights, *(level for feature in features for level in _levels(feature))})
    for number in numbers:
        builder.add_level(number, height_m=heights.get(number))
    for id, count in Counter(feature.id for feature in features).items():
        if count > 1:
            builder.note("duplicate id", f"{count} features have the id {id!r}: numbered")
    scale = UNITS_M.get(units, 1.0)
    if not named and units != DEGREES:
        size = extent(feature.shape for feature in features)
        scale = scale_of(size, [("door", float(np.median(doors)))] if doors else [], None if doors else 1.0, builder)
    for feature in features:
        scaled = shapely.transform(feature.shape, lambda xy: xy * scale)
        _add(builder, feature, scaled if geo is None else to_metres(feature.shape, geo))
    return finished(builder, "geojson_plan", geo)


def _is_mercator(features: Sequence[Feature], builder: BuildingBuilder) -> bool:
    """Whether coordinates without a name, as far out as those of the Earth, are Web Mercator by the widths of doors."""
    low = np.abs(features[0].shape.bounds[:2])
    if not MAX_LOCAL_M < low.max() <= np.pi * WGS84_A_M:
        return False
    size, longer = extent(feature.shape for feature in features), float(np.cosh(low[1] / WGS84_A_M))
    doors = [one.shape.length for one in features if one.tags.get("feature") == "door" and one.shape.length]
    width = float(np.median(doors)) if doors else 0.0
    is_mercator = width > USUAL_DOOR_M[1] and USUAL_DOOR_M[0] <= width / longer <= USUAL_DOOR_M[1]
    seen = [f"{size / by:.3g} m across, its doors {width / by:.2g} m wide" for by in (1.0, longer)]
    taken = f'the {"second" if is_mercator else "first"} is taken: "units": "metres" or "{MERCATOR}" settles it'
    builder.note("units doubtful", f"in metres {seen[0]}, in Web Mercator {seen[1]}; {taken}")
    return is_mercator


def _in_degrees(shape: Any) -> Any:
    """A geometry in Web Mercator, EPSG:3857, as longitude and latitude."""
    x_y = shapely.transform(shape, lambda xy: xy / WGS84_A_M)
    return shapely.transform(x_y, lambda xy: np.degrees(np.column_stack([xy[:, 0], np.arctan(np.sinh(xy[:, 1]))])))


def _collections(container: Container) -> list[str]:
    """Members of a folder or archive that hold GeoJSON, by their names."""
    return sorted(container.names(".geojson") or container.names(".json"))


def _document(content: bytes, path: Path) -> _Document:
    """The collection, also of a feature on each line, or of a table; one feature or a geometry alone is refused."""
    if not _begins_json(content):
        return _of_rows(content.decode(errors="replace"), path)
    if len(content.split(b"\n{", 2)) > 1 and b'"features"' not in content:
        content = b'{"features": [' + content.strip().replace(b"\n{", b",{") + b"]}"
    if b'"features"' not in content:
        kind = files.decoded(content, _Typed, path).type
        raise MapError(f"{path}: a {kind or 'JSON object'} alone; put it into the features of a FeatureCollection")
    found: _Document = files.decoded(content, _Document, path)
    return found


def _begins_json(content: bytes) -> bool:
    return content.lstrip().startswith(b"{")


def _of_rows(text: str, path: Path) -> _Document:
    """Rows with a geometry in WKT, as QGIS and PostGIS write them; without a header, such a text on each line."""
    lines = text.splitlines() or [""]
    marks = Counter(mark for mark in ",;\t|" for _ in range(lines[0].count(mark)))
    has_header = not _WKT.match(lines[0].encode())
    mark = marks.most_common(1)[0][0] if marks and has_header else "\0"
    try:
        rows = list(csv.DictReader(lines, None if has_header else ["wkt"], delimiter=mark))
    except csv.Error as error:
        raise MapError(f"{path}: no table that can be read ({error}); export it as GeoJSON") from error
    features, frame = [], ""
    for number, row in enumerate(rows, 1):
        given = {key: value for key, value in row.items() if key and isinstance(value, str) and value.strip()}
        key = next((key for key, value in given.items() if _WKT.fullmatch(value.encode())), "")
        srid, _, wkt = given.pop(key, "").rpartition(";")
        shape = shapely.from_wkt(wkt, on_invalid="ignore") if wkt else None
        if wkt and (shape is None or not np.isfinite(shapely.get_coordinates(shape)).all()):
            raise MapError(f"{path}: row {number}: {wkt[:60]!r} is no geometry in WKT; export the table again")
        geometry = None if shape is None else msgspec.json.decode(shapely.to_geojson(shape))
        numbers = {name: float(value) for name, value in given.items() if _NUMBER.fullmatch(value)}
        features.append({"geometry": geometry, "properties": {**given, **numbers}})
        frame = frame or srid
    crs = {"properties": {"name": frame.replace("SRID=", "EPSG:")}}
    return msgspec.convert({"features": features, "crs": crs}, _Document)


class _Typed(msgspec.Struct):
    type: str = ""


def _crs_name(crs: object) -> str:
    """The name of a coordinate reference system as GeoJSON of 2008 has it; "" where it has none."""
    properties = crs.get("properties") if isinstance(crs, dict) else None
    name = properties.get("name") if isinstance(properties, dict) else None
    return name.strip() if isinstance(name, str) else ""


def _says_what(features: list[Feature]) -> bool:
    return any("feature" in feature.tags for feature in features)


def _levels(feature: Feature) -> list[int]:
    """Levels of a feature; raises `MapError` where it has none."""
    given = feature.tags.get("levels", feature.tags.get("level"))
    levels = given if isinstance(given, list) else [given]
    is_whole = [isinstance(one, (int, float)) and not isinstance(one, bool) and one == int(one) for one in levels]
    if not levels or not all(is_whole):
        raise MapError(f"{feature.where}: level is {given!r}; give a whole number (0 ground), or `levels`, a list")
    return [int(level) for level in levels]


def _add(builder: BuildingBuilder, feature: Feature, shape: Any) -> None:
    kind, levels, tags = feature.text("feature"), _levels(feature), feature.tags
    if kind not in KINDS:
        raise MapError(f"{feature.where}: {unknown_name('kind of feature', kind, KINDS)}")
    if kind in AREAS:
        shape = _area(shape, feature)
    if kind in CONNECTIONS:
        walled = tags.get("walled") is True
        builder.connect(kind, levels=levels, polygon=shape, id=feature.id, walled=walled)  # type: ignore[arg-type]
        return
    for level in levels:
        name, use = feature.text("name"), feature.text("use")
        if kind in ("room", "area"):
            walled = bool(tags.get("walled", kind == "room"))
            builder.add_walkable(shape, level, id=feature.id, name=name, use=use, walled=walled)
        elif kind == "wall":
            builder.add_wall(shape, level, thickness_m=_length(feature, "thickness_m"))
        elif kind == "door":
            builder.add_door(shape, level, width_m=_length(feature, "width_m"), name=feature.id)
        else:
            builder.add_zone(shape, level, name=name or feature.id, use=use)


def _area(shape: Any, feature: Feature) -> Any:
    """The shape; closed lines become polygons, as programs for drawing export them."""
    parts = shapely.get_parts(shape)
    if all(part.geom_type == "LineString" and part.is_closed for part in parts):
        return shapely.MultiPolygon([shapely.Polygon(part.coords) for part in parts])
    if not all(part.geom_type.endswith("Polygon") for part in parts):
        kind = feature.text("feature")
        raise MapError(f"{feature.where}: a {kind} drawn as a {shape.geom_type}; draw it as a polygon or a closed line")
    return shape


def _length(feature: Feature, key: str) -> float | None:
    value = feature.tags.get(key)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0 < value < 100:
        raise MapError(f"{feature.where}: {key} is {value!r}; give metres")
    return float(value)


def sniff(head: Head) -> bool:
    """True for GeoJSON that no other reader knows; what its features say that they are is checked on reading."""
    if head.container is not None:
        names = _collections(head.container)
        return bool(names) and all(b'"FeatureCollection"' in head.peek(name) for name in names)
    content = head.content.replace(_RECORD_MARK, b"").lstrip()
    if not _begins_json(content):
        return any(_WKT.search(line) for line in content.split(b"\n", 2)[:2])
    has_type = any(b'"' + name + b'"' in content for name in (b"FeatureCollection", b"Feature", *_GEOMETRIES))
    return has_type and (b'"features"' in content or b'"coordinates"' in content)


_GEOMETRIES: Final = (b"Polygon", b"MultiPolygon", b"LineString", b"MultiLineString", b"GeometryCollection")
READER: Final = Reader(read, sniff, fallback=True)
