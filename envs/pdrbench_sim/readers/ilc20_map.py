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
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any, Final

import msgspec
import numpy as np

from pdrbench.building import WALL, Building, FloorPolygon, Zone
from pdrbench.errors import MapError
from pdrbench.geometry import FloatArray
from pdrbench.io.compressed import found_file, plain_name
from pdrbench.io.container import Container
from pdrbench.io.geo import GeoFrame
from pdrbench.io.reader import Head, Reader
from pdrbench.io.text import from_utf16
from pdrbench_formats.maps.features import Collection, Feature, features_of
from pdrbench_formats.maps.files import decoded, member, opened
from pdrbench_formats.maps.plan import Plan, Repair

if TYPE_CHECKING:
    import shapely

EARTH_RADIUS_M: Final = 6378137.0  # Web Mercator, EPSG:3857
HALF_EQUATOR_M: Final = math.pi * EARTH_RADIUS_M  # no coordinate of Web Mercator is larger
MAX_LATITUDE: Final = 85.06  # degrees, where Web Mercator ends
MIN_PART_M2: Final = 1.0  # parts smaller than this are gaps between neighbouring shops: no place to stand
MIN_HOLE_M2: Final = 0.01  # smaller holes are rounding where the corners of shops meet
NOMINAL_LEVEL_HEIGHT_M: Final = 5.0  # heights are not in the plans; common between the levels of a shopping centre
MAX_ASPECT: Final = 0.01  # width and height of a plan may disagree on the scale by this fraction
PLAN, SIZE = "geojson_map.json", "floor_info.json"


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
        blocks: What the outline is walked without, each area once: shops, shafts, voids.
        corner: The south-west one of the outline.
        mended: What of the features was left out, a sentence each.
    """

    polygons: tuple[FloorPolygon, ...]
    zones: tuple[Zone, ...]
    blocks: tuple[shapely.MultiPolygon, ...]
    corner: GeoFrame
    mended: tuple[str, ...]


def read(path: Path | str) -> Plan:
    """Reads every floor of a site, from a folder or archive that holds their plans; or one floor, from its plan.

    Raises:
        MapError: Names file, feature and remedy.
    """
    container, plans = _plans_at(Path(path))
    places = [container.path.absolute() / container.prefix / plan for plan in plans]
    floors: dict[str, Floor] = {}
    repairs: list[Repair] = []
    for plan, place in zip(plans, places, strict=True):
        size, size_m = str(PurePosixPath(plan).with_name(SIZE)), None
        collection = decoded(member(container, plan), Collection, place)
        name = _floor_name(collection, place.parent.name)
        if not name and len(plans) > 1:
            level_of_floor(place.parent.name)  # says what is expected
        if not name:
            name = "F1"
            repairs.append(Repair("level assumed", "level 0", f"no floor such as {name} is named: taken for ground"))
        if size in container.sizes:
            size_m = decoded(member(container, size), _Info, place.with_name(SIZE)).map_info
        else:
            what = f"{SIZE} is not beside the plan: lengths follow from its latitude"
            repairs.append(Repair("scale assumed", f"level {level_of_floor(name)}", what))
        floors[name] = _floor(collection, size_m, place, name)
        repairs += [Repair("geometry", f"level {level_of_floor(name)}", what) for what in floors[name].mended]
    building = building_of(places[0].parent.parent.name if len(plans) > 1 else next(iter(floors)), floors)
    closed = tuple(polygon for name, floor in floors.items() for polygon in _closed(floor.blocks, name))
    geo = None if len(plans) > 1 else next(iter(floors.values())).corner  # each level has an origin of its own
    return Plan(building, geo=geo, repairs=tuple(repairs), source="ilc20_map", closed=closed)


def _plans_at(path: Path) -> tuple[Container, list[str]]:
    """What holds the plans of one site, and their names in it."""
    container = opened(path)
    if container.is_file:  # its size may lie beside it
        names = [path.name, *([SIZE] if found_file(path.parent / SIZE).is_file() else ())]
        return Container(path.absolute().parent, dict.fromkeys(names, 0), "", is_zip=False), names[:1]
    plans = sorted(name for name in container.sizes if PurePosixPath(name).name == PLAN)
    sites = sorted({PurePosixPath(container.prefix, plan).parent.parent.name for plan in plans})
    if len(sites) != 1:
        which = f"plans of {len(sites)} sites ({', '.join(sites[:3])}, ...)" if sites else "no floor plan"
        raise MapError(f"{path}: {which}; name one site, whose folders such as F1 hold {PLAN} and {SIZE}")
    return container, plans


def _floor_name(collection: Collection, folder: str) -> str:
    """What the folder or the outline calls the floor; "" where neither says one."""
    properties = (collection.features[0].properties if collection.features else None) or {}
    for name in (folder, properties.get("name"), properties.get("floor")):
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
    return building_of(folder.name, {name: read_floor(folder / name) for name in floors})


def building_of(name: str, floors: Mapping[str, Floor]) -> Building:
    """Floors of a site by their names, put together."""
    levels = [level_of_floor(floor) for floor in floors]
    if len(set(levels)) != len(levels):
        raise MapError(f"{name}: two of the floors {list(floors)} are the same level; keep one of them")
    return Building(
        name=name,
        polygons=tuple(polygon for floor in floors.values() for polygon in floor.polygons),
        zones=tuple(zone for floor in floors.values() for zone in floor.zones),
    )


def read_floor(folder: Path | str) -> Floor:
    """Reads one floor; its folder is named like the floor."""
    folder = Path(folder)
    plan, size = (member(opened(found_file(folder / name)), name) for name in (PLAN, SIZE))
    return floor_of(plan, size, folder / PLAN, folder.name)


def floor_of(plan: bytes, size: bytes, path: Path, name: str) -> Floor:
    """The same of the content of both files; `path` of the plan is named in errors."""
    collection = decoded(from_utf16(plan), Collection, path)
    return _floor(collection, decoded(from_utf16(size), _Info, path.with_name(SIZE)).map_info, path, name)


def _floor(collection: Collection, size: _Size | None, path: Path, name: str) -> Floor:
    import shapely

    level = level_of_floor(name)
    mended: list[str] = []
    features = features_of(collection, str(path), mended.append)
    if not features or not features[0].where.startswith(f"{path}: feature 0 "):
        raise MapError(f"{path}: no outline of the floor, which the first feature must be")
    shapes = [_mercator_polygons(feature) for feature in features]
    to_frame = _frame(shapes[0], size, path)
    outline, *others = [shapely.transform(shape, to_frame) for shape in shapes]
    distinct = _without_repeats(others, [_name(feature) for feature in features[1:]])
    blocks = tuple(shape for shape, _ in distinct)
    free = outline.difference(shapely.union_all(blocks))
    parts = [part for part in _clean(free) if part.area >= MIN_PART_M2]
    parts.sort(key=lambda part: -part.area)
    if not parts:
        raise MapError(f"{path}: nothing to walk on remains of the outline without the other features")
    x0, y0, _, _ = shapes[0].bounds
    return Floor(
        polygons=tuple(_floor_polygon(part, f"{name}-{k}", level) for k, part in enumerate(parts)),
        zones=tuple(_zones(distinct, name, level)),
        blocks=tuple(shapely.intersection(shape, outline) for shape in blocks),
        corner=GeoFrame(_latitude_deg(y0), math.degrees(x0 / EARTH_RADIUS_M)),
        mended=tuple(mended),
    )


def _closed(blocks: Sequence[shapely.MultiPolygon], name: str) -> Iterator[FloorPolygon]:
    """A polygon for each block, apart from one another: where two overlap, the smaller has it."""
    import shapely

    blocks = sorted(blocks, key=lambda block: float(block.area))
    tree = shapely.STRtree(blocks)
    for number, block in enumerate(blocks):
        smaller = [blocks[other] for other in tree.query(block, "intersects") if other < number]
        for k, part in enumerate(_clean(block.difference(shapely.union_all(smaller)))):
            if part.area >= MIN_PART_M2:
                yield _floor_polygon(part, f"{name}-block-{number}-{k}", level_of_floor(name))


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


def _name(feature: Feature) -> str:
    """The name of a shop, HTML entities resolved; "" where it has none."""
    name = feature.tags.get("name")
    return html.unescape(name).strip() if isinstance(name, str) else ""


def _mercator_polygons(feature: Feature) -> shapely.MultiPolygon:
    """The polygons of a feature in metres of the Mercator projection, in which its coordinates may be already."""
    import shapely

    shape, corners = feature.shape, shapely.get_coordinates(feature.shape)
    if not shape.geom_type.endswith("Polygon"):
        kind = shape.geom_type
        raise MapError(f"{feature.where} is a {kind}, expected Polygon or MultiPolygon; delete it or make it an area")
    is_mercator = 180.0 < np.abs(corners).max() <= HALF_EQUATOR_M
    if not (is_mercator or (np.abs(corners) <= (180.0, MAX_LATITUDE)).all()):
        raise MapError(f"{feature.where} leaves the range of longitude and latitude; are the two swapped?")
    shape = shapely.MultiPolygon(
        shapely.get_parts(shape if is_mercator else shapely.transform(shape, _project)).tolist()
    )
    if not shape.is_valid:  # an outline that crosses or touches itself
        parts = shapely.get_parts(shapely.make_valid(shape))
        areas = [polygon for part in parts for polygon in shapely.get_parts(part) if polygon.geom_type == "Polygon"]
        if not areas:
            raise MapError(f"{feature.where} has no area; delete it")
        shape = shapely.MultiPolygon(shapely.get_parts(shapely.union_all(areas)).tolist())
    return shape


def _project(degrees: FloatArray) -> FloatArray:
    """(K, 2) Mercator metres of longitude and latitude in degrees."""
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
    """True for what holds the plans of a site, and for the plan of one floor."""
    if head.container is not None:
        return any(PurePosixPath(name).name == PLAN for name in head.container.sizes)
    is_plan = b'"FeatureCollection"' in head.content and b'"feature"' not in head.content
    keys = set(_KEY.findall(head.content))
    return is_plan and (plain_name(head.path.name) == PLAN or any(known <= keys for known in _KEYS))


_KEY: Final = re.compile(rb'"(\w+)"\s*:')
_KEYS: Final = ({b"two_class", b"poi_no"}, {b"display", b"points", b"category"})  # of the two sites of the public set
READER: Final = Reader(read, sniff)
