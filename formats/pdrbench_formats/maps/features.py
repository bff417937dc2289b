"""Features of GeoJSON from strangers: checked geometry, levels by their names, degrees and metres."""

from __future__ import annotations

import itertools
import re
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np
import shapely

from pdrbench.errors import MapError
from pdrbench.io.container import Container
from pdrbench.io.geo import WGS84_A_M, GeoFrame, frame_at
from pdrbench_formats.maps.files import decoded, member

WORDS: Final[Mapping[str, Any]] = tomllib.loads((Path(__file__).parent / "words.toml").read_text(encoding="utf-8"))
MAX_VERTICES: Final = 500_000
MAX_NUMBER: Final = 1e12  # of a coordinate, in micrometres or degrees: what is larger overflows squares
_DEPTH: Final = {"Point": 0, "MultiPoint": 1, "LineString": 1, "MultiLineString": 2, "Polygon": 2, "MultiPolygon": 3}
_MAX_LEVEL: Final = 1000
MIN_SKEW_DEG: Final = 3.0  # corners of houses are right angles
MIN_STRETCH: Final = 0.2  # at 34 degrees of latitude beside the equator; a fourth of it is left where readings differ
MAX_SHORT_M: Final = 2.5  # doors, walls and jambs
MIN_SHORT: Final = 6  # edges along each axis


class _Feature(msgspec.Struct):
    geometry: dict[str, Any] | None = None
    properties: dict[str, Any] | None = None
    id: str | int | float | None = None
    feature_type: str = ""


class Collection(msgspec.Struct):
    """A feature collection as it stands in a file."""

    features: list[_Feature]
    type: str = ""
    name: str | None = None
    crs: Any = None


@dataclass(frozen=True, slots=True)
class Feature:
    """A feature with geometry.

    Attributes:
        id: As in the file, or its number.
        shape: shapely geometry, x and y as in the file; a third coordinate is dropped.
        tags: Properties.
        kind: Member `feature_type` of the feature, as IMDF has it.
        where: Names file and feature in errors.
    """

    id: str
    shape: Any
    tags: Mapping[str, Any]
    kind: str
    where: str

    def text(self, key: str) -> str:
        """A property as text, without blanks around it; "" where it is missing or no text or number."""
        value = self.tags.get(key)
        return str(value).strip() if isinstance(value, (str, int, float)) and not isinstance(value, bool) else ""


def read_features(container: Container, name: str, mended: Callable[[str], object]) -> list[Feature]:
    """Features of a GeoJSON member; `mended` is told what of them had to be.

    Raises:
        MapError: Names file, feature and remedy.
    """
    where = container.label(name)
    collection: Collection = decoded(member(container, name), Collection, where)
    return features_of(collection, str(where), mended)


def features_of(collection: Collection, where: str, mended: Callable[[str], object]) -> list[Feature]:
    """As `read_features`, of a collection that is decoded."""
    found, total = [], 0
    for number, feature in enumerate(collection.features):
        tags = _with_level(feature.properties or {})
        id = str(feature.id if feature.id is not None else tags.get("id", number))
        own = f"{where}: feature {number} ({id})"
        if feature.geometry is None:
            continue  # IMDF has addresses and occupants, which have no place of their own
        shape, dropped = _shape(feature.geometry, own)
        total += int(shapely.get_num_coordinates(shape))
        if total > MAX_VERTICES:
            raise MapError(f"{where}: more than {MAX_VERTICES} vertices; simplify the plan")
        if shape.is_empty:
            mended(f"{own}: empty geometry left out")
            continue
        if dropped:
            mended(f"{own}: heights of vertices left out")
        found.append(Feature(id, shape, tags, feature.feature_type, own))
    return found


def _with_level(tags: Mapping[str, Any]) -> Mapping[str, Any]:
    """Attributes of a feature; the level as a number where it is the name of a floor, whatever its attribute is."""
    given = {key.lower(): value for key, value in tags.items()}
    named = next((value for name in WORDS["floors"]["names"] if (value := given.get(name)) not in (None, "")), None)
    level = level_number(named) if isinstance(named, str) else named if type(named) in (int, float) else None
    if level is None or not abs(level) < _MAX_LEVEL:
        return tags
    return {**tags, "level": int(level) if level == int(level) else level}


def level_number(text: str) -> float | None:
    """The level that the name of a floor says, a half of a mezzanine; None where it says none.

    >>> [level_number(text) for text in ("EG", "1.OG", "B1", "2. UG", "UG", "M", "-1", "L2", "First floor", "0;1")]
    [0.0, 1.0, -1.0, -2.0, -1.0, 0.5, -1.0, 2.0, 1.0, None]
    """
    text, words = " ".join(text.lower().replace("_", " ").split()), WORDS["floors"]
    if re.fullmatch(r"[-+]?\d{1,3}(\.\d+)?", text):
        return float(text)
    for half, name in ((0.0, "ground"), (0.5, "half")):
        if re.fullmatch(words[name], text):
            return half
    for sign, name in ((-1.0, "below"), (1.0, "above")):
        if match := re.fullmatch(words[name], text):
            return sign * float(match["n"] or match["m"] or 1)
    first = text.split(" ")[0]
    return 1.0 + words["ordinals"].index(first) if first in words["ordinals"] else None


def _shape(geometry: Mapping[str, Any], where: str) -> tuple[Any, bool]:
    """A shapely geometry, and whether it had a third coordinate."""
    kind = geometry.get("type")
    if kind == "GeometryCollection":
        members = geometry.get("geometries")
        if not isinstance(members, list):
            raise MapError(f"{where}: a GeometryCollection without geometries; delete it")
        made = [_shape(part, where) for part in members]
        return shapely.GeometryCollection([shape for shape, _ in made]), any(dropped for _, dropped in made)
    if not isinstance(kind, str) or kind not in _DEPTH:
        raise MapError(f"{where}: geometry {kind!r} is none that GeoJSON has; expected {', '.join(_DEPTH)}")
    flat: list[tuple[float, float]] = []
    dropped = False

    def convert(value: Any, depth: int) -> Any:
        nonlocal dropped
        if not isinstance(value, list):
            raise MapError(f"{where}: coordinates of a {kind} are nested wrongly; export the plan again")
        if depth:
            return [convert(part, depth - 1) for part in value]
        if not value and kind == "Point":
            return None
        if len(value) < 2 or not all(isinstance(part, (int, float)) and abs(part) < MAX_NUMBER for part in value):
            raise MapError(f"{where}: position {value!r}; expected two finite numbers")
        dropped = dropped or len(value) > 2
        flat.append((float(value[0]), float(value[1])))
        return flat[-1]

    nested = convert(geometry.get("coordinates"), _DEPTH[kind])
    return _made(kind, nested, where), dropped


def _made(kind: str, nested: Any, where: str) -> Any:
    if kind.endswith("Polygon"):
        made = [_polygon(rings, where) for rings in (nested if kind != "Polygon" else [nested]) if rings]
        return shapely.MultiPolygon(made) if kind != "Polygon" else (made or [shapely.Polygon()])[0]
    if kind.endswith("LineString"):
        made = [shapely.LineString(line) for line in (nested if kind != "LineString" else [nested]) if len(line) > 1]
        return shapely.MultiLineString(made) if kind != "LineString" else (made or [shapely.LineString()])[0]
    return shapely.MultiPoint(nested) if kind == "MultiPoint" else shapely.Point(nested or [])


def _polygon(rings: Sequence[Sequence[tuple[float, float]]], where: str) -> Any:
    if not rings or not rings[0]:
        return shapely.Polygon()
    for ring in rings:
        if len(ring) < 4 or ring[0] != ring[-1]:
            raise MapError(f"{where}: a ring of {len(ring)} positions that is not closed; repeat its first at its end")
    return shapely.Polygon(rings[0], rings[1:])


def check_degrees(features: Iterable[Feature], where: object) -> None:
    """Raises `MapError` where coordinates are no longitude and latitude."""
    for feature in features:
        x0, y0, x1, y1 = feature.shape.bounds
        if max(abs(y0), abs(y1)) > 90.0 or max(abs(x0), abs(x1)) > 180.0:
            why = "longitude and latitude look swapped" if max(abs(x0), abs(x1)) <= 90.0 else "are they metres?"
            raise MapError(
                f"{feature.where}: ({x0:g}, {y0:g}) is no longitude and latitude: {why}; this format has degrees, "
                f"longitude first"
            )
    if extent(feature.shape for feature in features) > 0.5:
        raise MapError(f"{where}: the plan reaches over more than half a degree; no building does, check for swaps")
    for miss, least, what in (
        (_skew_deg, MIN_SKEW_DEG, "its corners miss right angles by {:.1f} degrees, by {:.1f} with the two exchanged"),
        (_stretch, MIN_STRETCH, "its short edges are {:.0%} longer along one axis, {:.0%} with the two exchanged"),
    ):
        given, exchanged = (miss(features, north) for north in (1, 0))
        if given > least and exchanged < given / 4.0:
            seen = what.format(given, exchanged)
            raise MapError(f"{where}: longitude and latitude look swapped: {seen}; write longitude first, or metres")


def _edges(features: Iterable[Feature], north: int) -> Iterator[Any]:
    """Edges of each polygon and line in metres, east + 1j north, if coordinate `north`, 0 or 1, is the latitude."""
    for part in shapely.get_parts([feature.shape for feature in features]):
        if part.geom_type in ("Polygon", "LineString") and not part.is_empty:
            ring = shapely.get_coordinates(part.exterior if part.geom_type == "Polygon" else part)
            east = np.diff(ring[:, 1 - north]) * np.cos(np.radians(ring[0, north]))
            yield (east + 1j * np.diff(ring[:, north])) * (np.pi / 180.0 * WGS84_A_M)


def _skew_deg(features: Iterable[Feature], north: int) -> float:
    """By how much the corners of what is closed usually miss right angles."""
    found = [0.0]
    for edges in _edges(features, north):
        along = edges[edges != 0.0]  # a corner may stand twice
        turn_deg = np.degrees(np.angle(np.append(along[1:], along[:1]) * along.conj()))
        found += np.abs((turn_deg + 45.0) % 90.0 - 45.0).tolist() if abs(along.sum()) < 1e-3 else []
    return float(np.median(found))


def _stretch(features: Iterable[Feature], north: int) -> float:
    """By what fraction short edges are longer along one axis, at the worst of three quartiles.

    A house along the meridian has right angles in either reading, but its doors are as wide to the north as to the
    east. 0 where few edges are short, or many lie askew.
    """
    edges = np.concatenate([np.zeros(0), *_edges(features, north)])
    edges = edges[(np.abs(edges) > 0.05) & (np.abs(edges) < MAX_SHORT_M)]
    both = [one[one > 20.0 * other] for one, other in itertools.permutations((np.abs(edges.real), np.abs(edges.imag)))]
    if min(map(len, both)) < max(MIN_SHORT, len(edges) / 4.0):
        return 0.0
    east, north_m = (np.quantile(one, (0.25, 0.5, 0.75)) for one in both)
    return float(np.exp(np.abs(np.log(east / north_m)).max()) - 1.0)


def frame_of(features: Sequence[Feature]) -> GeoFrame:
    """A frame in the middle of some features in degrees."""
    bounds = np.array([feature.shape.bounds for feature in features])
    return frame_at(bounds[:, [1, 3]].ravel(), bounds[:, [0, 2]].ravel())


def to_metres(shape: Any, geo: GeoFrame) -> Any:
    """A geometry in degrees, longitude first, in metres of a frame."""
    return shapely.transform(shape, lambda degrees: geo.to_local(degrees[:, 1], degrees[:, 0]))


def is_degrees(features: Sequence[Feature]) -> bool:
    """Whether coordinates can be degrees: in the range of longitude and latitude, and as close as in one building."""
    shapes = [feature.shape for feature in features]
    in_range = (np.abs(shapely.total_bounds(shapes)) <= (180.0, 90.0, 180.0, 90.0)).all()
    return bool(in_range and extent(shapes) < 0.05)


def extent(shapes: Iterable[Any]) -> float:
    """The longer side of what shapes cover together; 0 where there are none."""
    x0, y0, x1, y1 = shapely.total_bounds(list(shapes))
    return float(np.nan_to_num(max(x1 - x0, y1 - y0)))
