"""The project's own building format: one GeoJSON FeatureCollection in metres, walls and connections explicit.

A file holds one feature per floor polygon and per zone. Coordinates are metres of the building frame, not longitude and
latitude. `leads_to` lists, ring by ring, the id of the polygon across each edge or null for a wall. Numbers are written
with the shortest digits that read back to the same bits, so a round trip changes nothing.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final, NoReturn

import numpy as np

from pdrbench.building import WALL, Building, FloorPolygon, Zone
from pdrbench.errors import MapError
from pdrbench.geometry import FloatArray
from pdrbench.io.reader import Reader

FORMAT: Final = "pdrbench-building"
VERSION: Final = 1
MAX_FILE_BYTES: Final = 1 << 30


def write(building: Building, path: str | Path) -> None:
    """Writes a building, whole or not at all."""
    path = Path(path)
    document = {
        "type": "FeatureCollection",
        "format": FORMAT,
        "version": VERSION,
        "name": building.name,
        "units": "metres in the building frame, z up",
        "features": [
            *(_polygon_feature(building, polygon) for polygon in building.polygons),
            *(
                _feature(z.id, [z.outline_xy_m], {"feature": "zone", "level": z.level, "name": z.name, "kind": z.kind})
                for z in building.zones
            ),
        ],
    }
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        temporary.write_bytes(json.dumps(document, ensure_ascii=False, allow_nan=False).encode() + b"\n")
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def read(path: str | Path) -> Building:
    """Reads a building; raises `MapError` naming the file and what to mend."""
    path = Path(path)
    document = _read_json(path)
    try:
        return _read_building(document)
    except MapError as error:
        raise MapError(f"{path}: {error}") from None


def _polygon_feature(building: Building, polygon: FloorPolygon) -> dict[str, Any]:
    names = [None if index == WALL else building.polygons[index].id for index in polygon.neighbour.tolist()]
    leads_to, first = [], 0
    for ring in polygon.rings:
        leads_to.append(names[first : first + len(ring)])
        first += len(ring)
    properties = {
        "feature": "floor_polygon",
        "level": polygon.level,
        "height_m": polygon.height_m,
        "kind": polygon.kind,
        "leads_to": leads_to,
    }
    return _feature(polygon.id, polygon.rings, properties)


def _feature(name: str, rings: Iterable[FloatArray], properties: Mapping[str, Any]) -> dict[str, Any]:
    closed = [[*ring.tolist(), ring[0].tolist()] for ring in rings]
    geometry = {"type": "Polygon", "coordinates": closed}
    return {"type": "Feature", "id": name, "geometry": geometry, "properties": properties}


def _read_json(path: Path) -> Mapping[str, Any]:
    try:
        if path.stat().st_size > MAX_FILE_BYTES:
            raise MapError(f"{path}: larger than {MAX_FILE_BYTES} bytes; no building is, split it by part")
        text = path.read_bytes().decode("utf-8-sig")
    except OSError as error:
        raise MapError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise MapError(f"{path}: byte {error.start} is not UTF-8; save it as UTF-8") from None
    if not text.strip():
        raise MapError(f"{path}: is empty; write it with pdrbench_formats.maps.geojson.write")
    try:
        document = json.loads(text, parse_constant=_refuse_constant, object_pairs_hook=_unique)
    except MapError as error:
        raise MapError(f"{path}: {error}") from None
    except json.JSONDecodeError as error:
        raise MapError(f"{path}: line {error.lineno}: not JSON: {error.msg}; is the file cut off?") from None
    except ValueError:
        raise MapError(f"{path}: holds a number of thousands of digits; give metres") from None
    except RecursionError:
        raise MapError(f"{path}: nested too deeply to be a building") from None
    if not isinstance(document, dict):
        raise MapError(f"{path}: expected a FeatureCollection, got {type(document).__name__}")
    return document


def _refuse_constant(name: str) -> NoReturn:
    raise MapError(f"{name} is not a number that JSON allows; give finite metres")


def _unique(members: list[tuple[str, Any]]) -> dict[str, Any]:
    """A JSON object; the second of two members of one name would win in silence."""
    record = dict(members)
    if len(record) != len(members):
        names = [name for name, _ in members]
        twice = next(name for name in names if names.count(name) > 1)
        raise MapError(f"member {twice!r} stands twice in one object; drop one")
    return record


def _read_building(document: Mapping[str, Any]) -> Building:
    if document.get("type") != "FeatureCollection" or document.get("format") != FORMAT:
        raise MapError(
            f"type {document.get('type')!r} and format {document.get('format')!r}: expected a FeatureCollection of "
            f"format {FORMAT!r}; convert other maps with their own reader"
        )
    if document.get("version") != VERSION:
        raise MapError(f"version {document.get('version')!r}: this pdrbench reads version {VERSION}")
    features = document.get("features")
    if not isinstance(features, list) or not all(isinstance(feature, dict) for feature in features):
        raise MapError("features is not a list of features")
    by_type: dict[str, list[Mapping[str, Any]]] = {"floor_polygon": [], "zone": []}
    for number, feature in enumerate(features):
        kind = _properties(feature, number).get("feature")
        if not isinstance(kind, str) or kind not in by_type:
            raise MapError(f"feature {number}: unknown type {kind!r}; known: {', '.join(by_type)}")
        by_type[kind].append(feature)
    ids = [_text(feature, "id", f"floor polygon {i}") for i, feature in enumerate(by_type["floor_polygon"])]
    index = {name: i for i, name in enumerate(ids)}
    return Building(
        name=_text(document, "name", "the building"),
        polygons=tuple(
            _read_polygon(feature, name, index) for name, feature in zip(ids, by_type["floor_polygon"], strict=True)
        ),
        zones=tuple(_read_zone(feature, i) for i, feature in enumerate(by_type["zone"])),
    )


def _read_polygon(feature: Mapping[str, Any], name: str, index: Mapping[str, int]) -> FloorPolygon:
    who = f"polygon {name!r}"
    properties = _known(_properties(feature, name), {"feature", "level", "height_m", "kind", "leads_to"}, who)
    rings = _read_rings(feature, who)
    leads_to = properties["leads_to"]
    if not isinstance(leads_to, list) or [len(ring) for ring in rings] != [
        len(ring) if isinstance(ring, list) else None for ring in leads_to
    ]:
        raise MapError(f"{who}: leads_to needs one list per ring with one entry per edge")
    targets = []
    for edge, target in enumerate(entry for ring in leads_to for entry in ring):
        if target is not None and not (isinstance(target, str) and target in index):
            raise MapError(f"edge {edge} of {who} leads to {target!r}, which is not a polygon of this file")
        targets.append(WALL if target is None else index[target])
    return FloorPolygon(
        id=name,
        outline_xy_m=rings[0],
        neighbour=np.array(targets, dtype=np.int64),
        height_m=_number(properties["height_m"], f"height_m of {who}"),
        level=properties["level"],
        kind=properties["kind"],
        holes=tuple(rings[1:]),
    )


def _read_zone(feature: Mapping[str, Any], number: int) -> Zone:
    name = _text(feature, "id", f"zone {number}")
    properties = _known(_properties(feature, name), {"feature", "level", "name", "kind"}, f"zone {name!r}")
    rings = _read_rings(feature, f"zone {name!r}")
    if len(rings) != 1:
        raise MapError(f"zone {name!r}: a zone has no holes")
    return Zone(name, properties["name"], rings[0], properties["level"], properties["kind"])


def _properties(feature: Mapping[str, Any], who: object) -> Mapping[str, Any]:
    properties = feature.get("properties")
    if feature.get("type") != "Feature" or not isinstance(properties, dict):
        raise MapError(f"feature {who}: expected type 'Feature' with properties")
    return properties


def _known(properties: Mapping[str, Any], names: set[str], who: str) -> Mapping[str, Any]:
    """The properties, if they are exactly the known ones."""
    missing, unknown = sorted(names - set(properties)), sorted(set(properties) - names)
    if missing:
        raise MapError(f"{who}: property {missing[0]!r} is missing")
    if unknown:
        raise MapError(f"{who}: unknown property {unknown[0]!r}; known: {', '.join(sorted(names))}")
    return properties


def _read_rings(feature: Mapping[str, Any], who: str) -> list[FloatArray]:
    geometry = feature.get("geometry")
    if not isinstance(geometry, dict) or geometry.get("type") != "Polygon":
        kind = geometry.get("type") if isinstance(geometry, dict) else geometry
        raise MapError(f"{who}: geometry is {kind!r}, expected 'Polygon'; split a MultiPolygon into its parts")
    rings = geometry.get("coordinates")
    if not isinstance(rings, list) or not rings:
        raise MapError(f"{who}: geometry is empty")
    return [_read_ring(ring, f"ring {i} of {who}") for i, ring in enumerate(rings)]


def _read_ring(ring: object, who: str) -> FloatArray:
    if not isinstance(ring, list) or len(ring) < 4:
        raise MapError(f"{who}: a ring needs four positions, the last equal to the first")
    for vertex, position in enumerate(ring):
        if not isinstance(position, list) or len(position) != 2:
            raise MapError(f"{who}: position {vertex} is {position!r}, expected [x, y]; height belongs into height_m")
        for value in position:
            _number(value, f"position {vertex} of {who}")
    if ring[0] != ring[-1]:
        raise MapError(f"{who}: is not closed: it starts at {ring[0]} and ends at {ring[-1]}")
    return np.array(ring[:-1], dtype=np.float64)


def _number(value: object, who: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise MapError(f"{who}: {value!r} is not a number")
    try:
        return float(value)
    except OverflowError:
        raise MapError(f"{who}: a number of {len(str(value))} digits is no length; give metres") from None


def _text(record: Mapping[str, Any], key: str, who: str) -> str:
    value = record.get(key)
    if not isinstance(value, str):
        raise MapError(f"{who}: {key} is {value!r}, expected text")
    return value


READER: Final = Reader(read, lambda head: head.content.lstrip().startswith(b"{") and FORMAT.encode() in head.content)
