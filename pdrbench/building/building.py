"""A building: floor polygons with walls and connections, packed once, checked once."""

from __future__ import annotations

import functools
import hashlib
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from pdrbench.building.polygons import WALL, FloorPolygon, Zone, following, shapely_polygons, triangulated
from pdrbench.building.region import FloorRegion
from pdrbench.building.validation import check_building, check_pieces
from pdrbench.errors import MapError
from pdrbench.geometry import BoolArray, FloatArray, IntArray, read_only
from pdrbench.trajectory import Start

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

NOWHERE = -1
UNNAMED: Final = "building"


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class Building:
    """A 2.5-D map: planar floor polygons, each with a height, joined along connections and closed by walls.

    Attributes:
        name: Name of the building.
        polygons: Floor polygons; everything else refers to them by index.
        zones: Named areas.
        edge_start_xy_m: (E, 2) first vertex of every edge, polygon by polygon.
        edge_end_xy_m: (E, 2) second vertex.
        edge_neighbour: (E,) polygon across the edge, or `WALL`.
        edge_polygon: (E,) polygon the edge belongs to.
        edge_twin: (E,) the edge that leads back, or -1 for a wall.
        first_edge: (P + 1,) polygon p owns the edges `first_edge[p]:first_edge[p + 1]`.
        sha256: Hex digest of everything above; two buildings are equal where it agrees.
    """

    name: str
    polygons: tuple[FloorPolygon, ...]
    zones: tuple[Zone, ...] = ()
    edge_start_xy_m: FloatArray = field(init=False, repr=False)
    edge_end_xy_m: FloatArray = field(init=False, repr=False)
    edge_neighbour: IntArray = field(init=False, repr=False)
    edge_polygon: IntArray = field(init=False, repr=False)
    edge_twin: IntArray = field(init=False, repr=False)
    first_edge: IntArray = field(init=False, repr=False)
    sha256: str = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "polygons", tuple(self.polygons))
        object.__setattr__(self, "zones", tuple(self.zones))
        check_pieces(self.name, self.polygons, self.zones)
        rings = [ring for polygon in self.polygons for ring in polygon.rings]
        counts = np.array([sum(len(ring) for ring in polygon.rings) for polygon in self.polygons])
        packed: dict[str, Any] = {
            "edge_start_xy_m": read_only(np.concatenate(rings)),
            "edge_end_xy_m": read_only(np.concatenate([following(ring) for ring in rings])),
            "edge_neighbour": read_only(np.concatenate([p.neighbour for p in self.polygons]), np.int64),
            "edge_polygon": read_only(np.repeat(np.arange(len(self.polygons)), counts), np.int64),
            "first_edge": read_only(np.concatenate([[0], np.cumsum(counts)]), np.int64),
        }
        for name, value in packed.items():
            object.__setattr__(self, name, value)
        object.__setattr__(self, "edge_twin", read_only(check_building(self), np.int64))
        object.__setattr__(self, "sha256", _digest(self))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Building) and self.sha256 == other.sha256

    def __hash__(self) -> int:
        return hash(self.sha256)

    def __repr__(self) -> str:
        return f"Building({self.name!r}, {len(self.polygons)} polygons, levels {self.levels}, {self.area_m2:.0f} m²)"

    def _repr_svg_(self) -> str:
        """A small plan, at the end of a cell of a notebook: levels side by side, floors light, walls dark."""
        import shapely

        x0, y0, x1, y1 = self.bounds_m()
        wide, high = 1.05 * (x1 - x0), 1.05 * (y1 - y0)
        parts: list[str] = []
        is_wall = self.edge_neighbour == WALL
        walls_m = np.stack([self.edge_start_xy_m, self.edge_end_xy_m], axis=1)[is_wall]
        for place, level in enumerate(self.levels):
            walls = shapely.multilinestrings(walls_m[self.level(self.edge_polygon[is_wall]) == level])
            parts.append(
                f'<g transform="translate({place * wide - x0:.2f} {y1:.2f}) scale(1 -1)"><title>level {level}</title>'
                f"{self.walkable(level).svg(0.05, '#f0ebdf')}{walls.svg(0.1, '#3a3a3a')}</g>"
            )
        size = f'width="{320 * len(parts)}" viewBox="0 0 {wide * len(parts):.2f} {high:.2f}"'
        return f'<svg xmlns="http://www.w3.org/2000/svg" {size}>{"".join(parts)}</svg>'

    def __reduce__(self) -> tuple[Any, ...]:
        return Building, (self.name, self.polygons, self.zones)

    @property
    def levels(self) -> tuple[int, ...]:
        """Levels that have floor, lowest first."""
        return tuple(sorted({polygon.level for polygon in self.polygons}))

    @property
    def area_m2(self) -> float:
        """Area of all floor polygons, stairs included."""
        return sum(polygon.area_m2 for polygon in self.polygons)

    def bounds_m(self, level: int | None = None) -> tuple[float, float, float, float]:
        """Smallest x, smallest y, largest x, largest y of one level or of all."""
        xy_m = self.edge_start_xy_m
        if level is not None:
            xy_m = xy_m[self.level(self.edge_polygon) == self._check_level(level)]
        (x0, y0), (x1, y1) = xy_m.min(axis=0), xy_m.max(axis=0)
        return float(x0), float(y0), float(x1), float(y1)

    def height(self, polygon: ArrayLike) -> FloatArray:
        """(N,) height above level 0 of polygons (N,)."""
        heights: FloatArray = _facts(self)[0][np.asarray(polygon)]
        return heights

    def level(self, polygon: ArrayLike) -> IntArray:
        """(N,) level of polygons (N,)."""
        levels: IntArray = _facts(self)[1][np.asarray(polygon)]
        return levels

    def walkable(self, level: int) -> BaseGeometry:
        """The union of the polygons of a level as a shapely geometry; walls inside it have no area and vanish."""
        return _walkable(self, self._check_level(level))

    def locate(self, xy_m: ArrayLike, level: ArrayLike) -> IntArray:
        """The polygon that each place lies in.

        Where stairs overlap, or a place lies on a shared edge, the lowest index counts: carry the polygon along a
        walk instead of looking it up.

        Args:
            xy_m: (N, 2).
            level: (N,) or one for all.

        Returns:
            (N,) index, or -1 outside; the boundary counts as inside.
        """
        import shapely

        points = np.asarray(xy_m, dtype=np.float64).reshape(-1, 2)
        wanted = np.broadcast_to(np.asarray(level), len(points))
        found = np.full(len(points), len(self.polygons), dtype=np.int64)
        usable = np.isfinite(points).all(axis=1)
        tree = _tree(self)
        point, polygon = tree.query(shapely.points(points[usable]))
        point = np.flatnonzero(usable)[point]
        near = self.level(polygon) == wanted[point]
        point, polygon = point[near], polygon[near]
        inside = shapely.intersects_xy(tree.geometries[polygon], points[point])
        np.minimum.at(found, point[inside], polygon[inside])
        found[found == len(self.polygons)] = NOWHERE
        return found

    def contains(self, xy_m: ArrayLike, level: ArrayLike) -> BoolArray:
        """(N,) True where a place lies on the floor of its level; arguments as in `locate`."""
        found: BoolArray = self.locate(xy_m, level) != NOWHERE
        return found

    def triangles(self) -> tuple[FloatArray, IntArray]:
        """The floor cut into triangles, without new vertices.

        Returns:
            corners_xy_m: (T, 3, 2), either way round.
            polygon: (T,) int, the polygon each belongs to.
        """
        return _triangles(self)

    def sample_uniform(
        self, rng: np.random.Generator, count: int, level: int | None = None
    ) -> tuple[IntArray, FloatArray]:
        """Places drawn uniformly over the floor area.

        Returns:
            polygon: (count,) int.
            xy_m: (count, 2) inside it.
        """
        region = FloorRegion.whole(self)
        if level is not None:
            region = region.restricted(self.level(region.polygon) == self._check_level(level))
        return region.sample(rng, count)

    def centre(self) -> Start:
        """The floor nearest to the middle of the building, on the level nearest to the middle one.

        It keeps half a metre off the walls where the level has room for that. It is not surveyed: its radius reaches
        the farthest floor.
        """
        return _centre(self)

    def move(self, polygon: ArrayLike, start_xy_m: ArrayLike, end_xy_m: ArrayLike) -> tuple[IntArray, BoolArray]:
        """Walks segments through the floor polygons (Woodman & Harle 2008, Algorithm 1; claim W6).

        Args:
            polygon: (N,) int, floor polygon each segment starts in.
            start_xy_m: (N, 2), inside its polygon or on its edge.
            end_xy_m: (N, 2).

        Returns:
            polygon: (N,) int, polygon reached; unchanged where the segment hit a wall.
            alive: (N,) bool, False where it hit a wall; where wall and connection meet, the wall wins. A segment that
                is not finite is not alive, one without length is.
        """
        from pdrbench.building.kernels import move

        start = np.ascontiguousarray(start_xy_m, dtype=np.float64).reshape(-1, 2)
        end = np.ascontiguousarray(end_xy_m, dtype=np.float64).reshape(-1, 2)
        begun_in = np.ascontiguousarray(polygon, dtype=np.int64).reshape(-1)
        if not len(begun_in) == len(start) == len(end):
            raise MapError(f"move: {len(begun_in)} polygons, {len(start)} starts and {len(end)} ends; give one each")
        if len(begun_in) and (begun_in.min() < 0 or begun_in.max() >= len(self.polygons)):
            raise MapError(
                f"move: polygon must lie in 0..{len(self.polygons) - 1}; locate() gives -1 outside the floor"
            )
        return move(begun_in, start, end, snapped_edges(self))

    def unnamed(self) -> Building:
        """The same building without its name: what a localizer is given, since a name may tell of which split it is."""
        return _unnamed(self)

    def _check_level(self, level: int) -> int:
        if level not in self.levels:
            raise MapError(f"building {self.name!r} has no level {level}; levels: {', '.join(map(str, self.levels))}")
        return level


def _digest(building: Building) -> str:
    """Hex sha256 over names, kinds and the bits of every number."""
    contents = [polygon.content() for polygon in building.polygons] + [zone.content() for zone in building.zones]
    digest = hashlib.sha256(repr((building.name, len(building.polygons), len(building.zones))).encode())
    for content in contents:
        digest.update(hashlib.sha256(content).digest())
    return digest.hexdigest()


# What is derived on demand is kept per content: buildings are equal where their content is, so copies share it.
@functools.lru_cache(maxsize=64)
def _facts(building: Building) -> tuple[FloatArray, IntArray]:
    """Height and level of every polygon."""
    height_m = [polygon.height_m for polygon in building.polygons]
    return read_only(height_m), read_only([polygon.level for polygon in building.polygons], np.int64)


@functools.lru_cache(maxsize=64)
def _unnamed(building: Building) -> Building:
    copy = object.__new__(Building)  # what was checked once is not checked again
    for item in fields(Building):
        object.__setattr__(copy, item.name, getattr(building, item.name))
    object.__setattr__(copy, "name", UNNAMED)
    object.__setattr__(copy, "sha256", _digest(copy))
    return copy


@functools.lru_cache(maxsize=64)
def _tree(building: Building) -> Any:
    import shapely

    geometries = shapely_polygons(building.polygons)
    shapely.prepare(geometries)  # a point against a polygon of thousands of edges in a microsecond
    return shapely.STRtree(geometries)


@functools.lru_cache(maxsize=64)
def _centre(building: Building) -> Start:
    import shapely

    level = building.levels[(len(building.levels) - 1) // 2]
    x0, y0, x1, y1 = building.bounds_m()
    middle = shapely.Point((x0 + x1) / 2, (y0 + y1) / 2)
    floor = building.walkable(level)
    inner = floor.buffer(-0.5)
    place = floor.point_on_surface() if inner.is_empty else shapely.shortest_line(inner, middle).interpolate(0.0)
    xy_m = np.array([place.x, place.y])
    return Start(xy_m=xy_m, level=level, radius_m=float(np.hypot(*(building.edge_start_xy_m - xy_m).T).max()))


class Edges(NamedTuple):
    """Walls and connections as compiled kernels take them; arrays as in `Building`, vertices snapped."""

    start_xy_m: FloatArray
    end_xy_m: FloatArray
    neighbour: IntArray
    twin: IntArray
    first: IntArray


@functools.lru_cache(maxsize=64)
def snapped_edges(building: Building) -> Edges:
    """Edges for kernels: vertices that connections declare to be one are equal to the last bit.

    Connected edges may differ by a tolerance; a segment that leaves through one and enters beside the other would slip
    past the corner of a wall. All vertices that are one take the place of the first.
    """
    start, end, twin = building.edge_start_xy_m, building.edge_end_xy_m, building.edge_twin
    joined = np.flatnonzero(twin >= 0)
    across = twin[joined]
    if (start[joined] == end[across]).all():
        return Edges(start, end, building.edge_neighbour, twin, building.first_edge)
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    sizes = [len(ring) for polygon in building.polygons for ring in polygon.rings]
    following = np.arange(1, len(twin) + 1)
    following[np.cumsum(sizes) - 1] = np.cumsum(sizes) - sizes
    same = (np.concatenate([joined, following[joined]]), np.concatenate([following[across], across]))
    graph = coo_array((np.ones(len(same[0]), dtype=np.int8), same), shape=(len(twin), len(twin)))
    _, place = connected_components(graph, directed=False)
    _, first, which = np.unique(place, return_index=True, return_inverse=True)
    start = read_only(start[first[which]])
    return Edges(start, read_only(start[following]), building.edge_neighbour, twin, building.first_edge)


@functools.lru_cache(maxsize=64)
def _walkable(building: Building, level: int) -> BaseGeometry:
    import shapely

    geometries = shapely_polygons([p for p in building.polygons if p.level == level])
    union: BaseGeometry = shapely.union_all(geometries)
    return union


@functools.lru_cache(maxsize=16)  # of 2 MB each in a shopping centre
def _triangles(building: Building) -> tuple[FloatArray, IntArray]:
    corners_xy_m, polygon = triangulated(shapely_polygons(building.polygons))
    return read_only(corners_xy_m), read_only(polygon, np.int64)
