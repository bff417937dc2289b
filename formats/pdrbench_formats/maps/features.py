"""Features of GeoJSON from strangers: members of files and archives, checked geometry, degrees and metres."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, Final, NoReturn, TypeVar
from xml.etree import ElementTree

import msgspec
import numpy as np

from pdrbench.errors import MapError, RecordingError
from pdrbench.geometry import FloatArray
from pdrbench.io.compressed import plain_name
from pdrbench.io.container import Container, open_container
from pdrbench.io.geo import GeoFrame, frame_at
from pdrbench.io.text import from_utf16

WORDS: Final[Mapping[str, Any]] = tomllib.loads((Path(__file__).parent / "words.toml").read_text(encoding="utf-8"))
MAX_MEMBER_BYTES: Final = 256 << 20
MAX_VERTICES: Final = 500_000
MAX_NAME: Final = 250  # characters
MAX_XML_DEPTH: Final = 100  # GML has 15 levels; what looks below each element takes the square of it
MAX_NUMBER: Final = 1e12  # of a coordinate, in micrometres or degrees: what is larger overflows squares
_DEPTH: Final = {"Point": 0, "MultiPoint": 1, "LineString": 1, "MultiLineString": 2, "Polygon": 2, "MultiPolygon": 3}
_UTF16_DECLARED: Final = re.compile(rb"\A(\s*<\?xml[^>]*?)\s+encoding=.UTF-16(?:LE|BE)?.", re.I)
_MAX_LEVEL: Final = 1000
_Table = TypeVar("_Table")


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


def opened(path: Path) -> Container:
    """A file, folder or archive; `MapError` where it cannot be read."""
    try:
        return open_container(Path(path))
    except RecordingError as error:
        raise MapError(str(error)) from error


def member(container: Container, name: str) -> bytes:
    """The content of a member, UTF-16 as UTF-8 and without a byte-order mark, decompressed where it is compressed.

    Raises:
        MapError: It is missing, too large or damaged.
    """
    if name not in container.sizes and not container.is_file:
        raise MapError(f"{container.path}: holds no {name!r}; it has {', '.join(sorted(container.sizes)[:12])}")
    if container.sizes.get(name, 0) > MAX_MEMBER_BYTES:
        raise MapError(f"{container.label(name)}: more than {MAX_MEMBER_BYTES >> 20} MiB; simplify the plan")
    try:
        content = from_utf16(container.read(name, MAX_MEMBER_BYTES + 1))
    except RecordingError as error:
        raise MapError(str(error)) from error
    if len(content) > MAX_MEMBER_BYTES:
        raise MapError(f"{container.label(name)}: more than {MAX_MEMBER_BYTES >> 20} MiB unpacked; simplify the plan")
    return _UTF16_DECLARED.sub(rb"\1", content, count=1)


def name_of(path: Path) -> str:
    """The name of a file without its endings, for a building that has no other."""
    return Path(plain_name(path.name)).stem


def decoded(content: bytes, kind: Any, where: object) -> Any:
    """JSON of a shape; `MapError` where it is none."""
    try:
        return msgspec.json.decode(content, type=kind)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise MapError(f"{where}: {error}; copy or export the plan again") from error


class _NoEntities(ElementTree.TreeBuilder):
    def doctype(self, *_: object) -> NoReturn:
        raise LookupError("it declares XML entities, which no plan needs")


def xml_root(content: bytes, path: Path) -> ElementTree.Element:
    """The root of an XML document, in whatever encoding it declares; `MapError` where it is none."""
    try:
        root = ElementTree.fromstring(content, ElementTree.XMLParser(target=_NoEntities()))
    except (ElementTree.ParseError, LookupError, ValueError) as error:  # the latter two of encodings
        raise MapError(f"{path}: not XML that can be read ({error}); export it again") from error
    nodes = [root]
    for _ in range(MAX_XML_DEPTH):
        nodes = [child for node in nodes for child in node]
    if nodes:
        raise MapError(f"{path}: XML of more than {MAX_XML_DEPTH} levels; export it again")
    return root


def toml_table(path: Path, kind: type[_Table], needs: str) -> _Table:
    """A TOML file of a shape; `MapError`, which says what it `needs`, where it is none."""
    try:
        return msgspec.convert(tomllib.loads(member(opened(path), path.name).decode()), kind)
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, msgspec.ValidationError) as error:
        raise MapError(f"{path}: {error}; {needs}") from error


def beside(table: Path, name: str) -> Path:
    """The path of a file in the folder of a table that names it; `MapError` where it would lie elsewhere."""
    inside = PurePosixPath(name)
    if inside.is_absolute() or ".." in inside.parts or not 0 < len(name) <= MAX_NAME:
        raise MapError(f"{table}: {name[:80]!r} is no file beside it; copy it there")
    return table.parent / inside


def read_features(container: Container, name: str) -> tuple[list[Feature], list[str]]:
    """Features of a GeoJSON member; and what of them had to be mended, one line each.

    Raises:
        MapError: Names file, feature and remedy.
    """
    where = container.label(name)
    collection: Collection = decoded(member(container, name), Collection, where)
    return features_of(collection, str(where))


def features_of(collection: Collection, where: str) -> tuple[list[Feature], list[str]]:
    """As `read_features`, of a collection that is decoded."""
    found, mended = [], []
    total = 0
    for number, feature in enumerate(collection.features):
        tags = _with_level(feature.properties or {})
        id = str(feature.id if feature.id is not None else tags.get("id", number))
        own = f"{where}: feature {number} ({id})"
        if feature.geometry is None:
            continue  # IMDF has addresses and occupants, which have no place of their own
        shape, dropped = _shape(feature.geometry, own)
        total += _count(shape)
        if total > MAX_VERTICES:
            raise MapError(f"{where}: more than {MAX_VERTICES} vertices; simplify the plan")
        if shape.is_empty:
            mended.append(f"{own}: empty geometry left out")
            continue
        if dropped:
            mended.append(f"{own}: heights of vertices left out")
        found.append(Feature(id, shape, tags, feature.feature_type, own))
    return found, mended


def _with_level(tags: Mapping[str, Any]) -> Mapping[str, Any]:
    """Attributes of a feature; the level as a number where it is the name of a floor, whatever its attribute is."""
    given = {key.lower(): value for key, value in tags.items()}
    named = next((value for name in WORDS["floors"]["names"] if (value := given.get(name)) not in (None, "")), None)
    level = level_number(named) if isinstance(named, str) else named if type(named) in (int, float) else None
    return (
        tags
        if level is None or not abs(level) < _MAX_LEVEL
        else {**tags, "level": int(level) if level == int(level) else level}
    )


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


def _count(shape: Any) -> int:
    import shapely

    return int(shapely.get_num_coordinates(shape))


def _shape(geometry: Mapping[str, Any], where: str) -> tuple[Any, bool]:
    """A shapely geometry, and whether it had a third coordinate."""
    import shapely

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
    import shapely

    match kind:
        case "Point":
            return shapely.Point(nested) if nested is not None else shapely.Point()
        case "MultiPoint":
            return shapely.MultiPoint(nested)
        case "LineString":
            return shapely.LineString(nested) if len(nested) > 1 else shapely.LineString()
        case "MultiLineString":
            return shapely.MultiLineString([line for line in nested if len(line) > 1])
        case "Polygon":
            return _polygon(nested, where)
    return shapely.MultiPolygon([_polygon(rings, where) for rings in nested if rings])


def _polygon(rings: Sequence[Sequence[tuple[float, float]]], where: str) -> Any:
    import shapely

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
    bounds = np.array([feature.shape.bounds for feature in features])
    if len(bounds) and (bounds[:, 2:].max(axis=0) - bounds[:, :2].min(axis=0)).max() > 0.5:
        raise MapError(f"{where}: the plan reaches over more than half a degree; no building does, check for swaps")


def frame_of(features: Sequence[Feature]) -> GeoFrame:
    """A frame in the middle of some features in degrees."""
    bounds = np.array([feature.shape.bounds for feature in features])
    return frame_at(bounds[:, [1, 3]].ravel(), bounds[:, [0, 2]].ravel())


def to_metres(shape: Any, geo: GeoFrame) -> Any:
    """A geometry in degrees, longitude first, in metres of a frame."""
    import shapely

    def convert(degrees: FloatArray) -> FloatArray:
        return geo.to_local(degrees[:, 1], degrees[:, 0])

    return shapely.transform(shape, convert)


def is_degrees(features: Sequence[Feature]) -> bool:
    """Whether coordinates can be degrees: in the range of longitude and latitude, and as close as in one building."""
    bounds = np.array([feature.shape.bounds for feature in features])
    low, high = bounds[:, :2].min(axis=0), bounds[:, 2:].max(axis=0)
    in_range = (np.abs(np.concatenate([low, high])) <= (180.0, 90.0, 180.0, 90.0)).all()
    return bool(in_range and (high - low).max() < 0.05)
