"""The pieces that a building is made of, each checked for itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from pdrbench.errors import MapError
from pdrbench.geometry import FloatArray, IntArray, read_only

WALL: Final = -1
KINDS: Final = ("floor", "stairs", "ramp", "lift")
MIN_AREA_M2: Final = 1e-6  # a square millimetre: below it is a sliver of rounding, not a floor


@dataclass(frozen=True, slots=True, eq=False)
class FloorPolygon:
    """A planar piece of floor at one height (Woodman & Harle 2008, section on the map; claim W7).

    Edge e runs from vertex e to the next; edges are numbered along the outline first, then hole by hole.

    Attributes:
        id: Unique within the building.
        outline_xy_m: (K, 2) vertices counter-clockwise, the first not repeated.
        neighbour: (E,) index of the polygon across each edge, or `WALL`.
        height_m: Height above level 0.
        level: IMDF ordinal, 0 ground; a stair tread belongs to the level nearer in height.
        kind: "floor", "stairs" (one polygon a tread), "ramp" or "lift".
        holes: (M, 2) each, vertices clockwise, the first not repeated.
    """

    id: str
    outline_xy_m: FloatArray
    neighbour: IntArray
    height_m: float
    level: int
    kind: str = "floor"
    holes: tuple[FloatArray, ...] = ()

    def __post_init__(self) -> None:
        check_text(self.id, "a floor polygon", "id")
        object.__setattr__(self, "outline_xy_m", _ring(self.outline_xy_m, f"polygon {self.id!r}"))
        holes = tuple(_ring(hole, f"hole {i} of polygon {self.id!r}") for i, hole in enumerate(self.holes))
        object.__setattr__(self, "holes", holes)
        object.__setattr__(self, "neighbour", _indices(self.neighbour, f"polygon {self.id!r}"))
        edges = sum(len(ring) for ring in self.rings)
        if self.neighbour.shape != (edges,):
            raise MapError(
                f"polygon {self.id!r} has {edges} edges and `neighbour` of shape {self.neighbour.shape}; give one "
                f"entry per edge, outline first, then hole by hole"
            )
        object.__setattr__(self, "level", _level(self.level, f"polygon {self.id!r}"))
        if not isinstance(self.height_m, (int, float, np.number)) or not np.isfinite(self.height_m):
            raise MapError(f"polygon {self.id!r}: height_m is {self.height_m!r}; give metres above level 0")
        object.__setattr__(self, "height_m", float(self.height_m))
        if self.kind not in KINDS:
            raise MapError(f"polygon {self.id!r}: kind is one of {', '.join(KINDS)}; got {self.kind!r}")
        if signed_area_m2(self.outline_xy_m) < 0:
            raise MapError(f"polygon {self.id!r}: outline runs clockwise; reverse it (and `neighbour` with it)")
        for i, hole in enumerate(self.holes):
            if signed_area_m2(hole) > 0:
                raise MapError(f"polygon {self.id!r}: hole {i} runs counter-clockwise; reverse it")

    @property
    def rings(self) -> tuple[FloatArray, ...]:
        """Outline and holes, in the order in which edges are numbered."""
        return (self.outline_xy_m, *self.holes)

    @property
    def area_m2(self) -> float:
        """Area without the holes."""
        return sum(signed_area_m2(ring) for ring in self.rings)

    def content(self) -> bytes:
        """Bytes that two equal polygons share and two different ones do not."""
        return _content((self.id, self.level, self.kind), np.float64(self.height_m), self.neighbour, *self.rings)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, FloorPolygon) and self.content() == other.content()

    def __hash__(self) -> int:
        return hash(self.content())

    def __repr__(self) -> str:
        return f"FloorPolygon({self.id!r}, {self.kind}, level {self.level}, {len(self.neighbour)} edges)"

    def __reduce__(self) -> tuple[Any, ...]:
        fields = (self.id, self.outline_xy_m, self.neighbour, self.height_m, self.level, self.kind, self.holes)
        return FloorPolygon, fields  # through the constructor: what comes out of a pickle is writeable


@dataclass(frozen=True, slots=True, eq=False)
class Zone:
    """A named area, such as a shop or a room, for pictures and semantics; walking ignores it.

    Attributes:
        id: Unique among the zones of the building.
        name: As on the door.
        outline_xy_m: (K, 2), the first vertex not repeated.
        level: IMDF ordinal.
        kind: Free text, such as "shop".
    """

    id: str
    name: str
    outline_xy_m: FloatArray
    level: int
    kind: str = ""

    def __post_init__(self) -> None:
        check_text(self.id, "a zone", "id")
        check_text(self.name, f"zone {self.id!r}", "name", may_be_empty=True)
        check_text(self.kind, f"zone {self.id!r}", "kind", may_be_empty=True)
        object.__setattr__(self, "outline_xy_m", _ring(self.outline_xy_m, f"zone {self.id!r}"))
        object.__setattr__(self, "level", _level(self.level, f"zone {self.id!r}"))

    def content(self) -> bytes:
        """Bytes that two equal zones share and two different ones do not."""
        return _content((self.id, self.name, self.kind, self.level), self.outline_xy_m)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Zone) and self.content() == other.content()

    def __hash__(self) -> int:
        return hash(self.content())

    def __reduce__(self) -> tuple[Any, ...]:
        return Zone, (self.id, self.name, self.outline_xy_m, self.level, self.kind)


def signed_area_m2(ring: FloatArray) -> float:
    """Area of a ring (K, 2), positive counter-clockwise; taken about its first vertex to keep digits."""
    from_first_m = ring - ring[0]
    (x, y), (next_x, next_y) = from_first_m.T, following(from_first_m).T
    # Edge by edge: two sums of large products would cancel, 1.5e-9 of the area of a disc of a million edges.
    return float(0.5 * (x * next_y - y * next_x).sum())


def following(ring: FloatArray) -> FloatArray:
    """What comes after each row of a ring; numpy.roll takes ten times as long on four rows."""
    return np.concatenate([ring[1:], ring[:1]])


def check_text(text: object, who: str, what: str, *, may_be_empty: bool = False) -> None:
    """Raises `MapError` unless `text` is a string that a file can hold."""
    if not isinstance(text, str) or not (text or may_be_empty):
        raise MapError(f"{who}: {what} is text{'' if may_be_empty else ', not empty'}; got {text!r}")
    try:
        text.encode()
    except UnicodeEncodeError:
        raise MapError(f"{who}: {what} {text!r} holds half a surrogate pair; replace that character") from None


def _level(level: object, who: str) -> int:
    if isinstance(level, bool) or not isinstance(level, (int, np.integer)) or not -(2**31) < int(level) < 2**31:
        raise MapError(f"{who}: level is a whole number (0 ground); got {level!r}")
    return int(level)


def _indices(values: ArrayLike, who: str) -> IntArray:
    """Whole numbers (E,), read-only; an empty list counts as whole."""
    try:
        given = np.asarray(values)
        whole: IntArray = read_only(given, np.int64)
    except (TypeError, ValueError, OverflowError):
        raise MapError(f"{who}: `neighbour` holds polygon indices or WALL ({WALL}); got {values!r}") from None
    if given.size and (given.dtype.kind not in "iuf" or (given != whole).any()):
        raise MapError(f"{who}: `neighbour` holds whole numbers; got {values!r}")
    return whole


def _content(facts: tuple[object, ...], *arrays: Any) -> bytes:
    """Plain values and little-endian arrays, each with its shape, so that no two contents run together."""
    parts = [repr((facts, [np.shape(array) for array in arrays])).encode()]
    parts += [array.astype(array.dtype.newbyteorder("<"), copy=False).tobytes() for array in arrays]
    return b"".join(parts)


def _ring(values: FloatArray, who: str) -> FloatArray:
    """A checked, read-only ring of at least three distinct consecutive vertices."""
    try:
        ring = read_only(values)
    except (TypeError, ValueError, OverflowError):
        raise MapError(f"{who}: expected (K, 2) vertices in metres, pairs of numbers; got something else") from None
    if ring.ndim != 2 or ring.shape[1] != 2:
        raise MapError(f"{who}: expected (K, 2) vertices in metres, got shape {ring.shape}")
    if len(ring) < 3:
        raise MapError(f"{who}: a ring needs three vertices; got {len(ring)}")
    if not np.isfinite(ring).all():
        bad = int(np.isfinite(ring).all(axis=1).argmin())
        raise MapError(f"{who}: vertex {bad} is not finite ({ring[bad].tolist()})")
    same = (ring == following(ring)).all(axis=1)
    if same.any():
        edge = int(same.argmax())
        closing = " (do not repeat the first vertex at the end)" if edge == len(ring) - 1 else ""
        raise MapError(
            f"{who}: edge {edge} has no length: vertices {edge} and {(edge + 1) % len(ring)} coincide{closing}"
        )
    if abs(signed_area_m2(ring)) < MIN_AREA_M2:
        raise MapError(
            f"{who}: area {abs(signed_area_m2(ring)):.2g} m² is a sliver; drop it, and give metres, not degrees"
        )
    return ring


def shapely_polygons(polygons: Sequence[FloorPolygon]) -> Any:
    """(P,) shapely polygons."""
    import shapely

    rings = [ring for polygon in polygons for ring in polygon.rings]
    ring_of_vertex = np.repeat(np.arange(len(rings)), [len(ring) for ring in rings])
    polygon_of_ring = np.repeat(np.arange(len(polygons)), [len(polygon.rings) for polygon in polygons])
    linear: Any = shapely.linearrings(np.concatenate(rings), indices=ring_of_vertex)
    return shapely.polygons(linear, indices=polygon_of_ring)


def triangulated(shapes: Any) -> tuple[FloatArray, IntArray]:
    """Cuts shapely polygons into triangles, without new vertices: (T, 3, 2) corners, and (T,) the polygon of each."""
    import shapely

    triangles, owner = shapely.get_parts(shapely.constrained_delaunay_triangles(shapes), return_index=True)
    return shapely.get_coordinates(triangles).reshape(-1, 4, 2)[:, :3], owner
