"""Floor plans of the Indoor Location Competition 2.0: `floor_info.json` and `geojson_map.json` in a folder per floor.

The plan holds an outline (first feature) and what one cannot walk through: shops, shafts, voids. There are no walls,
doors or corridors. Walkable is the outline without the union of everything else; each connected part becomes a floor
polygon whose edges, those of its holes included, are walls.

Frame of a level, in which the waypoints of its walks are given: Mercator X = R radians(lon), Y = R ln tan(pi/4 + lat/2)
with R = 6378137 m, scaled by k = width / (X1 - X0) to ground metres and shifted so that the south-west corner of the
outline's bounding box is 0: x east, y north. Every level of a site keeps this origin of its own: nothing in the plans
ties one level to the next, so positions of different levels must not be subtracted.
"""

from __future__ import annotations

import contextlib
import html
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, TypeVar

import msgspec
import numpy as np

from pdrbench.building import WALL, Building, FloorPolygon, Zone
from pdrbench.errors import MapError, RecordingError
from pdrbench.geometry import FloatArray
from pdrbench.io.compressed import found_file, plain_name
from pdrbench.io.geo import GeoFrame
from pdrbench.io.reader import Head, Reader, read_bytes
from pdrbench.io.text import from_utf16
from pdrbench_formats.maps.plan import Plan, Repair

if TYPE_CHECKING:
    import shapely

EARTH_RADIUS_M: Final = 6378137.0  # Web Mercator, EPSG:3857
HALF_EQUATOR_M: Final = math.pi * EARTH_RADIUS_M  # no coordinate of Web Mercator is larger
MAX_LATITUDE: Final = 85.06  # degrees, where Web Mercator ends
MIN_PART_M2: Final = 1.0  # parts smaller than this are gaps between neighbouring shops: no place to stand
MIN_HOLE_M2: Final = 0.01  # smaller holes are rounding where the corners of shops meet
NOMINAL_LEVEL_HEIGHT_M: Final = 5.0  # heights are not in the plans; common between the levels of a shopping centre
MAX_PLAN_BYTES: Final = 64 << 20
MAX_VERTICES: Final = 500_000  # the largest plan of the public set has some 8 000
MAX_ASPECT: Final = 0.01  # width and height of a plan may disagree on the scale by this fraction
PLAN, SIZE = "geojson_map.json", "floor_info.json"

_Kind = TypeVar("_Kind")
_Position = Annotated[list[float], msgspec.Meta(min_length=2)]


class _Geometry(msgspec.Struct):
    type: str
    coordinates: Any


class _Feature(msgspec.Struct):
    geometry: _Geometry | None
    properties: dict[str, Any] | None = None


class _Plan(msgspec.Struct):
    features: list[_Feature]


class _Size(msgspec.Struct):
    width: float
    height: float


class _Info(msgspec.Struct):
    map_info: _Size


@dataclass(frozen=True, slots=True)
class Floor:
    """One level of a site.

    Attributes:
        polygons: What can be walked on, largest first.
        zones: What has a name.
    """

    polygons: tuple[FloorPolygon, ...]
    zones: tuple[Zone, ...]


def read(path: Path | str) -> Building | Plan:
    """Reads every floor of a site, from the folders in it that hold a plan; or one floor, from its folder or its plan.

    Raises:
        MapError: Names file, feature and remedy.
    """
    folder = Path(path)
    if folder.is_file() or found_file(folder / PLAN).is_file():
        return _read_one(folder if folder.is_file() else found_file(folder / PLAN))
    floors = sorted(place.parent.name for place in folder.glob(f"*/{PLAN}"))
    if not floors:
        raise MapError(f"{folder}: no floor plan; expected folders such as F1 that hold {PLAN} and {SIZE}")
    return read_building(folder, floors)


def _read_one(path: Path) -> Plan:
    """One floor; without its `floor_info.json`, in ground metres at the latitude of its middle."""
    features = _read_json(path, _Plan).features
    size_file = found_file(path.parent / SIZE)
    size = _read_json(size_file, _Info).map_info if size_file.is_file() else None
    repairs, name = [], _floor_name(features, path)
    if not name:
        name = "F1"
        repairs.append(Repair("level assumed", "level 0", f"the plan names no floor such as {name}: taken for ground"))
    if size is None:
        what = f"{SIZE} is not beside the plan: lengths follow from its latitude"
        repairs.append(Repair("scale assumed", f"level {level_of_floor(name)}", what))
    floor, corner = _floor(features, size, path, name)
    building = Building(name=name, polygons=floor.polygons, zones=floor.zones)
    return Plan(building, geo=corner, repairs=tuple(repairs), source="ilc20_map")


def _floor_name(features: Sequence[_Feature], path: Path) -> str:
    """What the outline or the folder calls the floor; "" where neither says one."""
    properties = (features[0].properties if features else None) or {}
    for name in (properties.get("name"), properties.get("floor"), path.absolute().parent.name):
        if isinstance(name, str):
            with contextlib.suppress(MapError):
                level_of_floor(name)
                return name
    return ""


def read_building(folder: Path | str, floors: Sequence[str]) -> Building:
    """Reads some floors of a site.

    Args:
        folder: Folder of the site.
        floors: Names of its floors, which are names of folders: "B1", "F1".
    """
    folder = Path(folder)
    levels = [level_of_floor(name) for name in floors]
    if len(set(levels)) != len(levels):
        raise MapError(f"{folder}: two of the floors {list(floors)} are the same level; keep one of them")
    read_floors = [read_floor(folder / name) for name in floors]
    return Building(
        name=folder.name,
        polygons=tuple(polygon for floor in read_floors for polygon in floor.polygons),
        zones=tuple(zone for floor in read_floors for zone in floor.zones),
    )


def read_floor(folder: Path | str) -> Floor:
    """Reads one floor; its folder is named like the floor."""
    folder = Path(folder)
    level_of_floor(folder.name)
    path = folder / PLAN
    features = _read_json(path, _Plan).features
    return _floor(features, _read_json(folder / SIZE, _Info).map_info, path, folder.name)[0]


def _floor(features: Sequence[_Feature], size: _Size | None, path: Path, name: str) -> tuple[Floor, GeoFrame]:
    """A floor of that name, and where its south-west corner is."""
    import shapely

    level = level_of_floor(name)
    if not features:
        raise MapError(f"{path}: no feature; the first must be the outline of the floor")
    shapes = [_mercator_polygons(feature, number, path) for number, feature in enumerate(features)]
    if sum(shapely.get_num_coordinates(shape) for shape in shapes) > MAX_VERTICES:
        raise MapError(f"{path}: more than {MAX_VERTICES} vertices; simplify the plan")
    to_frame = _frame(shapes[0], size, path)
    outline, *others = [shapely.transform(shape, to_frame) for shape in shapes]
    distinct = _without_repeats(others, [_name(feature) for feature in features[1:]])
    free = outline.difference(shapely.union_all([shape for shape, _ in distinct]))
    parts = [part for part in _clean(free) if part.area >= MIN_PART_M2]
    parts.sort(key=lambda part: -part.area)
    if not parts:
        raise MapError(f"{path}: nothing to walk on remains of the outline without the other features")
    floor = Floor(
        polygons=tuple(_floor_polygon(part, f"{name}-{k}", level) for k, part in enumerate(parts)),
        zones=tuple(_zones(distinct, name, level)),
    )
    x0, y0, _, _ = shapes[0].bounds
    return floor, GeoFrame(_latitude_deg(y0), math.degrees(x0 / EARTH_RADIUS_M))


def level_of_floor(name: str) -> int:
    """The level (IMDF ordinal, 0 ground) behind a floor's name.

    >>> [level_of_floor(name) for name in ("B1", "F1", "2F", "LG2", "G")]
    [-1, 0, 1, -2, 0]
    """
    plain = {"G": "F1", "GF": "F1", "BF": "B1", "LG": "B1"}.get(name.strip().upper(), name.strip().upper())
    match = re.fullmatch(r"(B|F|L|P|LG)([1-9]\d?)|([1-9]\d?)([BFL])", plain)
    if match is None:
        raise MapError(f"the floor name {name!r} names no level; expected F1 for the ground floor, F2, ..., B1, ...")
    kind, number = match[1] or match[4], int(match[2] or match[3])
    return -number if kind in ("B", "LG") else number - 1


def _read_json(path: Path, kind: type[_Kind]) -> _Kind:
    try:
        content = from_utf16(read_bytes(found_file(path), MAX_PLAN_BYTES + 1))
    except RecordingError as error:
        raise MapError(f"{error}; a floor needs {PLAN} and {SIZE}") from error
    if len(content) > MAX_PLAN_BYTES:
        raise MapError(f"{path}: more than {MAX_PLAN_BYTES >> 20} MiB; simplify the plan")
    try:
        return msgspec.json.decode(content, type=kind)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise MapError(f"{path}: {error}; copy or download the plan again") from error


def _name(feature: _Feature) -> str:
    """The name of a shop, HTML entities resolved; "" where it has none."""
    name = (feature.properties or {}).get("name")
    return html.unescape(name).strip() if isinstance(name, str) else ""


def _mercator_polygons(feature: _Feature, number: int, path: Path) -> shapely.MultiPolygon:
    """The polygons of a feature in metres of the Mercator projection."""
    import shapely

    geometry, what = feature.geometry, f"{path}: feature {number}"
    if geometry is None or geometry.type not in ("Polygon", "MultiPolygon"):
        came = "no geometry" if geometry is None else geometry.type
        raise MapError(f"{what} has {came}, expected Polygon or MultiPolygon; delete it or make it an area")
    nested = [geometry.coordinates] if geometry.type == "Polygon" else geometry.coordinates
    try:
        polygons = msgspec.convert(nested, type=list[list[list[_Position]]])
    except msgspec.ValidationError as error:
        raise MapError(f"{what}: {error}; expected rings of longitude and latitude") from error
    made = []
    for rings in polygons:
        if not rings:
            raise MapError(f"{what} has a polygon without rings; delete it")
        shell, *holes = [_project(_ring(ring, what)) for ring in rings]
        made.append(shapely.Polygon(shell, holes))
    shape = shapely.MultiPolygon(made)
    if shape.is_empty:
        raise MapError(f"{what} is empty; delete it")
    if not shape.is_valid:  # an outline that crosses or touches itself
        parts = shapely.get_parts(shapely.make_valid(shape))
        areas = [polygon for part in parts for polygon in shapely.get_parts(part) if polygon.geom_type == "Polygon"]
        shape = shapely.MultiPolygon(areas)
        if shape.is_empty:
            raise MapError(f"{what} has no area; delete it")
        shape = shapely.MultiPolygon(shapely.get_parts(shapely.union_all(areas)).tolist())
    return shape


def _ring(ring: list[list[float]], what: str) -> FloatArray:
    """(K, 2) longitude and latitude in degrees, or metres of Web Mercator where one is beyond 180, closed."""
    if any(len(position) != 2 for position in ring):
        raise MapError(f"{what} is three-dimensional; keep longitude and latitude only")
    degrees = np.array(ring, dtype=np.float64).reshape(-1, 2)
    if len(degrees) < 4 or (degrees[0] != degrees[-1]).any():
        raise MapError(f"{what} has a ring that is not closed; repeat its first position at its end")
    largest = float(np.abs(degrees).max())
    if not (180.0 < largest <= HALF_EQUATOR_M or (np.abs(degrees) <= (180.0, MAX_LATITUDE)).all()):
        raise MapError(f"{what} leaves the range of longitude and latitude; are the two swapped?")
    return degrees


def _project(degrees: FloatArray) -> FloatArray:
    """(K, 2) Mercator metres of longitude and latitude in degrees, and of what is in these metres already."""
    if np.abs(degrees).max() > 180.0:
        return degrees
    longitude_rad, latitude_rad = np.radians(degrees).T
    northing = np.log(np.tan(math.pi / 4 + latitude_rad / 2))
    return EARTH_RADIUS_M * np.column_stack([longitude_rad, northing])


def _latitude_deg(northing_m: float) -> float:
    """Of a northing in Mercator metres; the inverse of `_project`."""
    return math.degrees(2.0 * math.atan(math.exp(northing_m / EARTH_RADIUS_M)) - math.pi / 2.0)


def _frame(outline: shapely.MultiPolygon, size: _Size | None, path: Path) -> Any:
    """The map from Mercator metres to the frame of the level, (K, 2) to (K, 2).

    The sizes of all plans of the public set agree with the cosine of the latitude to 4e-6.
    """
    x0, y0, x1, y1 = outline.bounds
    if size is None:
        at_latitude = math.cos(math.radians(_latitude_deg((y0 + y1) / 2.0)))
        return lambda mercator_m: (mercator_m - (x0, y0)) * at_latitude
    scale = size.width / (x1 - x0)
    if not (math.isfinite(scale) and scale > 0 and abs(size.height / (y1 - y0) / scale - 1) <= MAX_ASPECT):
        raise MapError(
            f"{path}: the outline measures {x1 - x0:.1f} by {y1 - y0:.1f} Mercator metres, "
            f"{SIZE} says {size.width:.1f} by {size.height:.1f} m; "
            f"the two do not belong together, or longitude and latitude are swapped"
        )
    return lambda mercator_m: (mercator_m - (x0, y0)) * scale


def _without_repeats(
    shapes: Sequence[shapely.MultiPolygon], names: Sequence[str]
) -> list[tuple[shapely.MultiPolygon, str]]:
    """Each area once, with the last name it is given: site 2 lists most twice, once without or under an older name."""
    kept: dict[bytes, tuple[shapely.MultiPolygon, str]] = {}
    for shape, name in zip(shapes, names, strict=True):
        key = shape.normalize().wkb
        kept[key] = (shape, name or kept.get(key, (shape, ""))[1])
    return list(kept.values())


def _clean(shape: Any) -> Iterator[shapely.Polygon]:
    """The polygons of any geometry: outlines counter-clockwise, holes clockwise, no vertex twice in a row."""
    import shapely

    for part in getattr(shape, "geoms", [shape]):
        if part.geom_type == "Polygon":
            yield shapely.orient_polygons(shapely.remove_repeated_points(part))


def _floor_polygon(part: shapely.Polygon, name: str, level: int) -> FloorPolygon:
    import shapely

    outline = np.asarray(part.exterior.coords)[:-1]
    large = [hole for hole in part.interiors if shapely.Polygon(hole).area >= MIN_HOLE_M2]
    holes = tuple(np.asarray(hole.coords)[:-1] for hole in large)
    return FloorPolygon(
        id=name,
        outline_xy_m=outline,
        neighbour=np.full(len(outline) + sum(map(len, holes)), WALL),
        height_m=level * NOMINAL_LEVEL_HEIGHT_M,
        level=level,
        holes=holes,
    )


def _zones(areas: Sequence[tuple[shapely.MultiPolygon, str]], floor: str, level: int) -> Iterator[Zone]:
    """The areas that have a name."""
    named = [(part, name) for shape, name in areas if name for part in _clean(shape)]
    for number, (part, name) in enumerate(named):
        outline = np.asarray(part.exterior.coords)[:-1]
        yield Zone(id=f"{floor}-zone-{number}", name=name, outline_xy_m=outline, level=level)


def sniff(head: Head) -> bool:
    """True for the folder of a site, and for the plan of one floor or its folder."""
    if head.path.is_dir():
        return found_file(head.path / PLAN).is_file() or any(head.path.glob(f"*/{PLAN}"))
    is_plan = b'"FeatureCollection"' in head.content and b'"feature"' not in head.content
    keys = set(_KEY.findall(head.content))
    return is_plan and (plain_name(head.path.name) == PLAN or any(known <= keys for known in _KEYS))


_KEY: Final = re.compile(rb'"(\w+)"\s*:')
_KEYS: Final = ({b"two_class", b"poi_no"}, {b"display", b"points", b"category"})  # of the two sites of the public set
READER: Final = Reader(read, sniff)
