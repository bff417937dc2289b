"""Shapefiles (needs `pyshp`), and GeoJSON that GIS programs make of drawings: layers say what a shape is.

A layer is the attribute `Layer`, `type`, `category` or the like, else the name of the file: `walls.shp`, `rooms.shp`.
The level is an attribute as well, or a number in the name: `floor2_walls.shp`; 0 where neither says it. Degrees become
metres; projected coordinates have the unit that the `.prj` beside them states, as far as doors do not contradict it.
"""

from __future__ import annotations

import functools
import io
import re
import struct
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import Any, Final

import numpy as np
import shapely

from pdrbench.errors import MapError
from pdrbench.io.container import Container
from pdrbench.io.reader import Head, Reader
from pdrbench_formats.maps.builder import BuildingBuilder, finished
from pdrbench_formats.maps.features import WORDS, Feature, check_degrees, frame_of, is_degrees, level_number, to_metres
from pdrbench_formats.maps.files import member, name_of, opened
from pdrbench_formats.maps.layers import LAYERS, Drawn, add_levels, in_metres, kind_of
from pdrbench_formats.maps.plan import Plan

MAGIC: Final = b"\0\0\x27\x0a"  # of a .shp, ESRI 1998
NAMED: Final = ("layer", "type", "category", "class", "kind", "feature", "room_type")  # attributes, the best first
_LEVEL_IN_NAME: Final = re.compile(r"(?:floor|level|etage|storey|piso|og)[ _-]*(-?\d+)|(-?\d+)\.?(?:og|etage)", re.I)
_PRJ_UNIT: Final = re.compile(r'UNIT\["[^"]*",\s*([\d.eE+-]+)')


def read(path: Path | str, *, strict: bool = False) -> Plan:
    """Reads a shapefile, or all of a folder or archive.

    Raises:
        MapError: Names file, layers and remedy.
    """
    path = Path(path)
    container = opened(path)
    names = container.names() if container.is_file else container.names(".shp")
    features = [feature for name in names for feature in _features(container, name)]
    projections = {name: _part(container, name, ".prj").decode(errors="replace") for name in names}
    if len(set(projections.values())) > 1:
        raise MapError(f"{path}: its shapefiles have different projections; export all in one")
    return plan_of(path, features, next(iter(projections.values()), ""), strict=strict, source="shapefile")


def plan_of(path: Path, features: Sequence[Feature], projection: str, *, strict: bool, source: str) -> Plan:
    """The plan of features that are known by their layers.

    Args:
        path: Named in errors.
        features: With a layer and a level among their tags, or in their `kind`.
        projection: Text of a `.prj`; "" where none is known.
        strict: As in `BuildingBuilder`.
        source: Format.
    """
    builder, skipped = BuildingBuilder(name_of(path), strict=strict), Counter[str]()
    levels: dict[int, Drawn] = defaultdict(lambda: {name: [] for name in LAYERS})
    names_degrees = projection.lstrip().startswith("GEOGCS")
    geo = None
    if features and (names_degrees or (not projection and is_degrees(features))):
        check_degrees(features, path)
        geo = frame_of(features)
    for feature in features:
        layer, level = layer_of(feature), _level_of(feature)
        shape = feature.shape if geo is None else to_metres(feature.shape, geo)
        if not layer:
            skipped[feature.text("Layer") or feature.kind or shape.geom_type] += 1
        elif level != int(level):
            builder.note_half_level(feature.id, layer, shape, f"{level:g}")
        else:
            levels[int(level)][layer] += _parts(shape)
    if not any(drawn["wall"] or drawn["room"] for drawn in levels.values()):
        raise MapError(
            f"{path}: no layer is named like walls or rooms (layers: {', '.join(sorted(skipped)[:12]) or 'none'}); "
            f"rename the files or the attribute Layer, for instance walls, doors, rooms"
        )
    units = _PRJ_UNIT.findall(projection)
    stated = 1.0 if geo is not None else float(units[-1]) if units else None
    drawn = []
    for level in sorted(levels):
        builder.add_level(level)
        drawn.append((level, in_metres(levels[level], "m" if geo is not None else "", stated, builder, level)))
    add_levels(builder, drawn, path, moves=geo is None)
    return finished(builder, source, geo, skipped)


def layer_of(feature: Feature) -> str:
    """What a feature is, by its attributes, else by the name of its file; a key of `LAYERS`, or ""."""
    tags = {key.lower(): feature.text(key) for key in feature.tags}
    found = (kind_of(tags[name]) for name in NAMED if tags.get(name))
    return next(filter(None, found), "") or kind_of(_LEVEL_IN_NAME.sub("", feature.kind))


def _level_of(feature: Feature) -> float:
    tags = {key.lower(): feature.text(key) for key in feature.tags}
    for text in (tags[name] for name in WORDS["floors"]["names"] if tags.get(name)):
        if (level := level_number(text)) is None:
            raise MapError(f"{feature.where}: level is {text!r}; give a number, 0 for the ground")
        return level
    if named := _LEVEL_IN_NAME.search(feature.kind):
        return float(named[1] or named[2])
    parts = (part for part in re.split(r"[\W_]+", feature.kind) if not part.isdecimal())
    return next((level for part in parts if (level := level_number(part)) is not None), 0.0)


def _parts(shape: Any) -> list[Any]:
    """Simple geometries; closed lines are polygons, as programs for drawing export rooms."""
    parts = shapely.get_parts(shape)
    return [shapely.Polygon(one.coords) if one.geom_type == "LineString" and one.is_closed else one for one in parts]


def _part(container: Container, name: str, suffix: str) -> bytes:
    """The file of the same name with another ending, in the container or beside the file; empty where there is none."""
    if container.is_file:
        beside = [container.path.with_suffix(one) for one in (suffix, suffix.upper())]
        return next((member(opened(path), path.name) for path in beside if path.is_file()), b"")
    stem = str(PurePosixPath(name).with_suffix(""))
    found = next((other for other in container.sizes if other.lower() == (stem + suffix).lower()), "")
    return member(container, found) if found else b""


def _features(container: Container, name: str) -> Iterator[Feature]:
    """Shapes with their attributes; a damaged file raises `MapError`."""
    try:
        import shapefile
    except ImportError:
        raise MapError("reading shapefiles needs pyshp: pip install pdrbench[maps]") from None
    stem = PurePosixPath(name).stem
    parts = {"shp": io.BytesIO(member(container, name))}
    if table := _part(container, name, ".dbf"):
        parts["dbf"] = io.BytesIO(table)
    try:
        with shapefile.Reader(**parts) as found:
            rows: Iterable[Mapping[str, Any]] = (
                (record.as_dict() for record in found.iterRecords()) if "dbf" in parts else iter(dict, None)
            )
            for number, (shape, tags) in enumerate(zip(found.iterShapes(), rows, strict=False)):
                where = f"{container.label(name)}: shape {number}"
                made = _geometry(shape)
                if not made.is_empty:
                    yield Feature(f"{stem}-{number}", made, tags, stem, where)
    except (shapefile.ShapefileException, *DAMAGED) as error:
        raise MapError(f"{container.label(name)}: the shapefile is damaged ({error}); export it again") from error


def _geometry(shape: Any) -> Any:
    """A shapely geometry in the plane; rings count by where they lie, not by the way round that they are drawn."""
    ends = [*list(getattr(shape, "parts", []))[1:], len(shape.points)]
    parts = [np.array(part)[:, :2] for part in np.split(np.array(shape.points), ends[:-1]) if len(part)]
    if not np.isfinite(np.concatenate(parts or [np.zeros((0, 2))])).all():
        raise ValueError("a coordinate is not finite")
    if "POLYGON" in shape.shapeTypeName:
        rings = [shapely.make_valid(shapely.Polygon(part)) for part in parts if len(part) > 3]
        return functools.reduce(shapely.symmetric_difference, rings, shapely.Polygon())
    if "POINT" in shape.shapeTypeName:
        return shapely.MultiPoint(np.concatenate(parts)) if parts else shapely.Point()
    return shapely.MultiLineString([part for part in parts if len(part) > 1])


DAMAGED: Final = (  # what the library raises of bad files
    *(ValueError, KeyError, IndexError, TypeError, AttributeError, AssertionError, OSError, EOFError),
    *(OverflowError, struct.error),
)


def sniff(head: Head) -> bool:
    """True for a shapefile, and for a folder or archive with some."""
    if head.container is not None:
        return any(head.peek(name).startswith(MAGIC) for name in head.members(".shp")[:3])
    return head.content.startswith(MAGIC)


READER: Final = Reader(read, sniff)
