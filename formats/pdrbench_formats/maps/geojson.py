"""The project's own building format: one GeoJSON FeatureCollection in metres, walls and connections explicit.

A file holds one feature per floor polygon and per zone. Coordinates are metres of the building frame, not longitude and
latitude. `leads_to` lists, ring by ring, the id of the polygon across each edge or null for a wall. Numbers are written
with the shortest digits that read back to the same bits, so a round trip changes nothing.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Final, Literal

import msgspec
import numpy as np

from pdrbench.building import WALL, Building, FloorPolygon, Zone
from pdrbench.errors import MapError
from pdrbench.geometry import FloatArray
from pdrbench.io.reader import Reader
from pdrbench_formats.maps.files import decoded, member, opened

FORMAT: Final = "pdrbench-building"
_Ring = Annotated[list[tuple[float, float]], msgspec.Meta(min_length=4)]


class _Properties(msgspec.Struct, tag_field="feature", forbid_unknown_fields=True):
    level: int
    kind: str


class _Floor(_Properties, tag="floor_polygon"):
    height_m: float
    leads_to: list[list[str | None]]


class _Zone(_Properties, tag="zone"):
    name: str


class _Geometry(msgspec.Struct):
    coordinates: Annotated[list[_Ring], msgspec.Meta(min_length=1)]
    type: Literal["Polygon"] = "Polygon"


class _Feature(msgspec.Struct):
    id: str
    properties: _Floor | _Zone
    geometry: _Geometry
    type: Literal["Feature"] = "Feature"

    def rings(self) -> list[FloatArray]:
        """Open rings (K, 2); `MapError` where one does not end where it begins."""
        for number, ring in enumerate(self.geometry.coordinates):
            if ring[0] != ring[-1]:
                raise MapError(f"ring {number} of {self.id!r} is not closed: {ring[0]} to {ring[-1]}; repeat its first")
        return [np.array(ring[:-1]) for ring in self.geometry.coordinates]


class _Document(msgspec.Struct):
    format: Literal["pdrbench-building"]
    version: Literal[1]
    name: str
    features: list[_Feature]
    units: str = "metres in the building frame, z up"
    type: Literal["FeatureCollection"] = "FeatureCollection"


def write(building: Building, path: str | Path) -> None:
    """Writes a building, whole or not at all."""
    path = Path(path)
    features = [_feature(building, polygon) for polygon in building.polygons]
    for zone in building.zones:
        facts = _Zone(zone.level, zone.kind, zone.name)
        features.append(_Feature(zone.id, facts, _geometry([zone.outline_xy_m])))
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        temporary.write_bytes(msgspec.json.encode(_Document(FORMAT, 1, building.name, features)) + b"\n")
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def _feature(building: Building, polygon: FloorPolygon) -> _Feature:
    names = [None if index == WALL else building.polygons[index].id for index in polygon.neighbour.tolist()]
    ends = np.cumsum([len(ring) for ring in polygon.rings]).tolist()
    leads_to = [names[end - len(ring) : end] for ring, end in zip(polygon.rings, ends, strict=True)]
    facts = _Floor(polygon.level, polygon.kind, polygon.height_m, leads_to)
    return _Feature(polygon.id, facts, _geometry(polygon.rings))


def _geometry(rings: list[FloatArray] | tuple[FloatArray, ...]) -> _Geometry:
    return _Geometry([[*ring.tolist(), ring[0].tolist()] for ring in rings])


def read(path: str | Path) -> Building:
    """Reads a building; raises `MapError` naming the file and what to mend."""
    path = Path(path)
    document: _Document = decoded(member(opened(path), path.name), _Document, path)
    floors = [feature for feature in document.features if isinstance(feature.properties, _Floor)]
    index = {feature.id: number for number, feature in enumerate(floors)}
    try:
        zones = [_read_zone(one) for one in document.features if isinstance(one.properties, _Zone)]
        return Building(document.name, tuple(_read_floor(one, index) for one in floors), tuple(zones))
    except MapError as error:
        raise MapError(f"{path}: {error}") from None


def _read_floor(feature: _Feature, index: dict[str, int]) -> FloorPolygon:
    rings, facts = feature.rings(), feature.properties
    assert isinstance(facts, _Floor)
    if [len(ring) for ring in rings] != [len(names) for names in facts.leads_to]:
        raise MapError(f"polygon {feature.id!r}: leads_to needs one list per ring with one entry per edge")
    targets = []
    for edge, target in enumerate(name for names in facts.leads_to for name in names):
        if target is not None and target not in index:
            raise MapError(f"edge {edge} of {feature.id!r} leads to {target!r}, which is not a polygon of this file")
        targets.append(WALL if target is None else index[target])
    return FloorPolygon(
        feature.id, rings[0], np.array(targets), facts.height_m, facts.level, facts.kind, tuple(rings[1:])
    )


def _read_zone(feature: _Feature) -> Zone:
    (ring, *holes), facts = feature.rings(), feature.properties
    assert isinstance(facts, _Zone)
    if holes:
        raise MapError(f"zone {feature.id!r}: a zone has no holes")
    return Zone(feature.id, facts.name, ring, facts.level, facts.kind)


READER: Final = Reader(read, lambda head: head.content.lstrip().startswith(b"{") and FORMAT.encode() in head.content)
