"""Plans that people draw themselves: one GeoJSON FeatureCollection in metres, feet or degrees, see docs/buildings.md.

The property `feature` of each feature says what it is: room, area, wall, door, stairs, escalator, lift or zone; `level`
is a whole number, or `levels` a list for what joins them. The collection may name its `units`, and `levels` with
heights.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np

from pdrbench.errors import MapError, unknown_name
from pdrbench.io.geo import GeoFrame
from pdrbench.io.plan import Plan
from pdrbench.io.reader import Head, Reader
from pdrbench_formats.maps.builder import BuildingBuilder, finished
from pdrbench_formats.maps.features import (
    Collection,
    Feature,
    check_degrees,
    decoded,
    features_of,
    frame_of,
    is_degrees,
    member,
    opened,
    to_metres,
)

UNITS_M: Final = {
    "metres": 1.0,
    "meters": 1.0,
    "m": 1.0,
    "feet": 0.3048,
    "ft": 0.3048,
    "centimetres": 0.01,
    "mm": 0.001,
}
DEGREES: Final = "degrees"
KINDS: Final = ("room", "area", "wall", "door", "stairs", "escalator", "lift", "zone")
CONNECTIONS: Final = ("stairs", "escalator", "lift")


class _Level(msgspec.Struct, forbid_unknown_fields=True):
    level: int
    height_m: float | None = None


class _Document(Collection):
    units: str = ""
    levels: list[_Level] = msgspec.field(default_factory=list)


def read(path: Path | str, *, strict: bool = False) -> Plan:
    """Reads a plan.

    Raises:
        MapError: Names file, feature and remedy.
    """
    path = Path(path)
    container = opened(path)
    document: _Document = decoded(member(container, path.name), _Document, path)
    features, mended = features_of(document, str(path))
    if not features:
        raise MapError(f"{path}: no feature with geometry; draw a room, an area or a wall")
    units = document.units or (DEGREES if is_degrees(features) else "metres")
    geo: GeoFrame | None = None
    if units == DEGREES:
        check_degrees(features, path)
        geo = frame_of(features)
    elif units not in UNITS_M:
        raise unknown_name("unit of length", units, [*UNITS_M, DEGREES])
    elif _is_small(features):
        raise MapError(f'{path}: in {units} the plan is smaller than a hand; are they degrees? set "units": "degrees"')
    builder = BuildingBuilder(document.name or path.stem, strict=strict)
    for what in mended:
        builder.note("geometry", what)
    if not document.units:
        builder.note("units assumed", f"the file does not name its units: taken for {units}")
    heights = {level.level: level.height_m for level in document.levels}
    numbers = sorted({*heights, *(level for feature in features for level in _levels(feature))})
    for number in numbers:
        builder.add_level(number, height_m=heights.get(number))
    for id, count in Counter(feature.id for feature in features).items():
        if count > 1:
            builder.note("duplicate id", f"{count} features have the id {id!r}: numbered")
    for feature in features:
        scale = UNITS_M.get(units, 1.0)
        shape = to_metres(feature.shape, geo) if geo is not None else _scaled(feature.shape, scale)
        _add(builder, feature, shape)
    return finished(builder, "geojson_plan", geo)


def _is_small(features: list[Feature]) -> bool:
    bounds = np.array([feature.shape.bounds for feature in features])
    return bool((bounds[:, 2:].max(axis=0) - bounds[:, :2].min(axis=0)).max() < 0.05)


def _scaled(shape: Any, scale: float) -> Any:
    import shapely

    return shape if scale == 1.0 else shapely.transform(shape, lambda xy: xy * scale)


def _levels(feature: Feature) -> list[int]:
    """Levels of a feature; raises `MapError` where it has none."""
    given = feature.tags.get("levels", feature.tags.get("level"))
    levels = given if isinstance(given, list) else [given]
    if not levels or any(isinstance(level, bool) or not isinstance(level, int) for level in levels):
        raise MapError(f"{feature.where}: level is {given!r}; give a whole number (0 ground), or `levels`, a list")
    return levels


def _add(builder: BuildingBuilder, feature: Feature, shape: Any) -> None:
    kind, levels, tags = feature.text("feature"), _levels(feature), feature.tags
    if kind not in KINDS:
        raise MapError(f"{feature.where}: {unknown_name('kind of feature', kind, KINDS)}")
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


def _length(feature: Feature, key: str) -> float | None:
    value = feature.tags.get(key)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0 < value < 100:
        raise MapError(f"{feature.where}: {key} is {value!r}; give metres")
    return float(value)


def sniff(head: Head) -> bool:
    """True for a FeatureCollection whose features say what they are."""
    content = head.content.lstrip()
    return content.startswith(b"{") and b'"FeatureCollection"' in content and b'"feature"' in content and (
        b'"pdrbench-building"' not in content
    )  # fmt: skip


READER: Final = Reader(read, sniff)
