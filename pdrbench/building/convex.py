"""The floor as convex cells bounded by half planes: what the fast particle kernels walk on.

A place lies in a cell exactly where no half plane says "outside", so a particle that is alive cannot be outside the
floor, however its coordinates are rounded. That is what "does the step cross this wall" cannot promise at corners.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pdrbench.building.building import Building, snapped_edges
from pdrbench.building.polygons import WALL
from pdrbench.building.region import FloorRegion
from pdrbench.errors import MapError
from pdrbench.geometry import FloatArray, IntArray, read_only

Float32Array = NDArray[np.float32]
Int32Array = NDArray[np.int32]
Point = tuple[float, float]

STRAIGHT_M: Final = 1e-7  # a vertex this close to the line between its neighbours bends nothing
CONVEX: Final = 1e-9  # sine of a bend that still counts as straight when cells are joined
TOLERANCE_ULP: Final = 8.0  # portals end this many float32 roundings before a corner: at a corner the wall wins
MIN_PART_M2: Final = 1e-9  # of a region in a cell: less is rounding
_POLYGON: Final = 3  # shapely's type id
_BOX_ASPECTS: Final = np.exp2(np.linspace(-2.5, 2.5, 11))
_BOX_CENTRES: Final = np.stack(np.meshgrid(*2 * [np.linspace(0.1, 0.9, 7)]), axis=-1).reshape(-1, 2)
_BOUNDS: Final = np.minimum, np.maximum


class World(NamedTuple):
    """The floor of a building as compiled kernels take it: K convex cells, L lines around them, G portals in the lines.

    Coordinates are float32, relative to the origin of the `ConvexMap`: far from an origin float32 would leak.

    Attributes:
        line: (L, 3) outward half plane: n_x x + n_y y > c is outside.
        first_line: (K + 1,) int32, cell k is bounded by the lines `first_line[k]:first_line[k + 1]`.
        first_portal: (L + 1,) int32, line l is passed by the portals `first_portal[l]:first_portal[l + 1]`; the rest
            of it is wall.
        portal: (G, 2) from where to where -n_y x + n_x y may lie in a portal; ascending on each line.
        neighbour: (G, 2) int32, cell behind a portal, and the line through which that cell is entered.
        box_m: (K, 4) x0, y0, x1, y1 of a box inside the cell; most particles end in it and need no further test.
        height_m: (K,) of the floor.
    """

    line: Float32Array
    first_line: Int32Array
    first_portal: Int32Array
    portal: Float32Array
    neighbour: Int32Array
    box_m: Float32Array
    height_m: Float32Array


@dataclass(frozen=True, slots=True)
class ConvexMap:
    """A building cut into K convex cells.

    Attributes:
        origin_xy_m: (2,) float64, to which local coordinates are relative.
        polygon: (K,) floor polygon of each cell; cells of one polygon follow one another.
        level: (K,) int.
        world: Lines and portals, for kernels.
        first_corner: (K + 1,) cell k has the corners `first_corner[k]:first_corner[k + 1]`, counter-clockwise.
        corner_xy_m: (V, 2) float64, local.
        tolerance_m: Half planes and portals are right to within this.
    """

    origin_xy_m: FloatArray
    polygon: Int32Array
    level: IntArray
    world: World
    first_corner: Int32Array
    corner_xy_m: FloatArray
    tolerance_m: float

    def __len__(self) -> int:
        return len(self.polygon)

    def local(self, xy_m: FloatArray) -> Float32Array:
        """(..., 2) float32 relative to the origin."""
        local: Float32Array = (xy_m - self.origin_xy_m).astype(np.float32)
        return local

    def nearest(self, xy_m: FloatArray, level: int) -> tuple[FloatArray, IntArray]:
        """The floor of a level nearest to places (n, 2): (n, 2) these or the nearest ones inside, and their cells (n,).

        Raises:
            MapError: There is no floor on that level.
        """
        import shapely

        on_level = np.flatnonzero(self.level == level)
        if not len(on_level):
            raise MapError(f"no floor on level {level}; the map has {sorted(set(self.level.tolist()))}")
        local_m = self.local(xy_m)
        low_m, high_m = (one.reduceat(self.corner_xy_m, self.first_corner[:-1])[on_level] for one in _BOUNDS)
        within = (local_m[:, None] >= low_m - self.tolerance_m) & (local_m[:, None] <= high_m + self.tolerance_m)
        place, number = np.nonzero(within.all(axis=2))
        inside = self.outside_m(on_level[number], local_m[place]) <= 0
        place, first = np.unique(place[inside], return_index=True)
        nearest_m, cell = np.array(xy_m, dtype=np.float64), np.full(len(xy_m), -1)
        cell[place] = on_level[number[inside][first]]
        off = np.flatnonzero(cell < 0)
        if len(off):
            floor, places = self._shapes()[on_level], shapely.points(xy_m[off] - self.origin_xy_m)
            best = np.full(len(off), len(floor))
            np.minimum.at(best, *shapely.STRtree(floor).query_nearest(places))  # the first of those equally far
            edge_m = shapely.get_coordinates(shapely.shortest_line(floor[best], places))[::2]
            cell[off] = on_level[best]
            sums_m = np.add.reduceat(self.corner_xy_m, self.first_corner[:-1])
            to_middle_m = (sums_m / np.diff(self.first_corner)[:, None])[cell[off]] - edge_m
            away_m = np.maximum(np.hypot(*to_middle_m.T), 1e-9)
            inward_m = edge_m + to_middle_m * np.minimum(0.1 / away_m, 0.5)[:, None]  # no particle can start on a wall
            nearest_m[off] = inward_m + self.origin_xy_m
        return nearest_m, cell

    def outside_m(self, cell: IntArray, local_xy_m: Float32Array) -> FloatArray:
        """(N,) by how much places (N, 2) lie outside their cells (N,); negative inside."""
        worst = np.full(len(cell), -np.inf)
        count = np.diff(self.world.first_line)[cell]
        xy_m = local_xy_m.astype(np.float64)
        for i in range(int(count.max(initial=0))):
            has = np.flatnonzero(count > i)
            n_x, n_y, c = self.world.line[self.world.first_line[cell[has]] + i].T.astype(np.float64)
            worst[has] = np.maximum(worst[has], n_x * xy_m[has, 0] + n_y * xy_m[has, 1] - c)
        return worst

    def _shapes(self) -> Any:
        """(K,) cells as shapely has them."""
        import shapely

        rings = np.repeat(np.arange(len(self)), np.diff(self.first_corner))
        return shapely.polygons(np.asarray(shapely.linearrings(self.corner_xy_m, indices=rings)))

    def cells_of(self, region: FloorRegion) -> tuple[Float32Array, Int32Array]:
        """Cuts a region along the cells.

        Returns:
            corners_xy_m: (T, 3, 2) triangles, local.
            cell: (T,) the cell each lies in, ascending.
        """
        import shapely

        cells = self._shapes()
        triangles = np.asarray(shapely.polygons(region.corners_xy_m - self.origin_xy_m))
        low = np.searchsorted(self.polygon, region.polygon, side="left")
        high = np.searchsorted(self.polygon, region.polygon, side="right")
        triangle = np.repeat(np.arange(len(triangles)), high - low)
        cell = np.arange(len(triangle)) - np.repeat(np.cumsum(high - low) - high, high - low)
        parts = shapely.intersection(triangles[triangle], cells[cell])
        corners, owner = _fan(parts, cell)
        order = np.argsort(owner, kind="stable")
        return corners[order].astype(np.float32), owner[order].astype(np.int32)


class _Side(NamedTuple):
    """One straight side of a face, `face` on its left; `ring` is the number of the side of the outline, or -1."""

    start: Point
    end: Point
    ring: int


class _RingSide(NamedTuple):
    """A straight stretch of an outline and the edges of the building that make it up."""

    start: Point
    end: Point
    edges: tuple[int, ...]


@functools.lru_cache(maxsize=8)
def compile_map(building: Building) -> ConvexMap:
    """Cuts every floor polygon into convex cells; kept for the last few buildings."""
    start, end, *_ = snapped_edges(building)
    x0, y0, x1, y1 = building.bounds_m()
    origin = np.array([(x0 + x1) / 2, (y0 + y1) / 2])
    faces: list[list[_Side]] = []
    owner: list[int] = []
    sides: list[_RingSide] = []
    for polygon, rings in enumerate(_rings_of(building, start - origin)):
        straight = [side for ring in rings for side in ring]
        found = _convex_faces(rings, straight, len(sides), building.polygons[polygon].id)
        sides += straight
        faces += found
        owner += [polygon] * len(found)
    extent_m = float(np.abs(start - origin).max()) + 1.0
    return _pack(building, origin, faces, owner, sides, (start - origin, end - origin), extent_m)


def _rings_of(building: Building, start: FloatArray) -> list[list[list[_RingSide]]]:
    """Per polygon and ring the straight sides."""
    found = []
    edge = 0
    for polygon in building.polygons:
        rings = []
        for ring in polygon.rings:
            rings.append(_straighten([(float(x), float(y)) for x, y in start[edge : edge + len(ring)]], edge))
            edge += len(ring)
        found.append(rings)
    return found


def _straighten(points: Sequence[Point], first_edge: int) -> list[_RingSide]:
    """Sides of a ring without the vertices that lie on a straight line, such as the ends of doors."""
    count = len(points)
    corners = [i for i in range(count) if not _is_straight(points[i - 1], points[i], points[(i + 1) % count])]
    sides = []
    for corner, following in zip(corners, [*corners[1:], corners[0] + count], strict=True):
        edges = tuple(first_edge + i % count for i in range(corner, following))
        sides.append(_RingSide(points[corner], points[following % count], edges))
    return sides


def _is_straight(a: Point, b: Point, c: Point) -> bool:
    """Whether b lies between a and c on the line through them."""
    ahead = (b[0] - a[0]) * (c[0] - b[0]) + (b[1] - a[1]) * (c[1] - b[1])
    return ahead > 0 and abs(_cross(a, b, c)) <= STRAIGHT_M * math.hypot(c[0] - a[0], c[1] - a[1])


def _convex_faces(
    rings: Sequence[Sequence[_RingSide]], sides: Sequence[_RingSide], first_side: int, name: str
) -> list[list[_Side]]:
    """Faces of one polygon: a constrained Delaunay triangulation, joined wherever the union stays convex."""
    import shapely

    outline, *holes = [[side.start for side in ring] for ring in rings]
    triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(shapely.Polygon(outline, holes)))
    number = {(side.start, side.end): first_side + i for i, side in enumerate(sides)}
    faces: dict[int, list[_Side]] = {}
    face_of: dict[tuple[Point, Point], int] = {}
    for face, triangle in enumerate(triangles):
        corners = [(float(x), float(y)) for x, y in shapely.get_coordinates(triangle)[:3]]
        if _cross(*corners) < 0:
            corners.reverse()
        pairs = list(zip(corners, [*corners[1:], corners[0]], strict=True))
        faces[face] = [_Side(a, b, number.get((a, b), -1)) for a, b in pairs]
        face_of.update(dict.fromkeys(pairs, face))
    missing = [side for side in number if side not in face_of]
    if missing:
        raise MapError(f"polygon {name!r}: its triangles miss the edge from {missing[0][0]}; check its outline")
    _join(faces, face_of)
    return list(faces.values())


def _join(faces: dict[int, list[_Side]], face_of: dict[tuple[Point, Point], int]) -> None:
    """Takes diagonals away, longest first, where the union of both faces is convex (Hertel & Mehlhorn 1983)."""
    diagonals = [(a, b) for a, b in face_of if (b, a) in face_of and a < b]
    for a, b in sorted(diagonals, key=lambda side: -math.hypot(side[1][0] - side[0][0], side[1][1] - side[0][1])):
        one, other = face_of[a, b], face_of[b, a]
        if one == other:
            continue
        joined = _joined(faces[one], faces[other], a, b)
        if joined is None:
            continue
        faces[one] = joined
        for side in faces.pop(other):
            if (side.start, side.end) != (b, a):
                face_of[side.start, side.end] = one
        del face_of[a, b], face_of[b, a]


def _joined(one: list[_Side], other: list[_Side], a: Point, b: Point) -> list[_Side] | None:
    """The union of two faces across the diagonal from a to b, or None where it would not be convex."""
    i = next(k for k, side in enumerate(one) if (side.start, side.end) == (a, b))
    j = next(k for k, side in enumerate(other) if (side.start, side.end) == (b, a))
    first, second = one[i + 1 :] + one[:i], other[j + 1 :] + other[:j]
    bends = ((first[-1].start, a, second[0].end), (second[-1].start, b, first[0].end))
    if any(_sine(*bend) < -CONVEX for bend in bends):
        return None
    return first + second


def _cross(a: Point, b: Point, c: Point) -> float:
    return (b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0])


def _sine(a: Point, b: Point, c: Point) -> float:
    """Sine of the bend at b, positive to the left."""
    return _cross(a, b, c) / (math.hypot(b[0] - a[0], b[1] - a[1]) * math.hypot(c[0] - b[0], c[1] - b[1]))


# Packing.


class _Line(NamedTuple):
    """A line of a face and the sides that lie on it."""

    normal: Point
    offset_m: float
    sides: tuple[_Side, ...]


def _lines(face: list[_Side]) -> list[_Line]:
    """Sides in a row that go straight on share a line."""
    bends = [abs(_sine(face[i - 1].start, face[i].start, face[i].end)) > CONVEX for i in range(len(face))]
    first = bends.index(True)
    groups: list[list[_Side]] = []
    for side, is_bend in zip(face[first:] + face[:first], bends[first:] + bends[:first], strict=True):
        if is_bend:
            groups.append([])
        groups[-1].append(side)
    lines = []
    for group in groups:
        (x0, y0), (x1, y1) = group[0].start, group[-1].end
        length_m = math.hypot(x1 - x0, y1 - y0)
        n_x, n_y = (y1 - y0) / length_m, -(x1 - x0) / length_m
        lines.append(_Line((n_x, n_y), n_x * (x0 + x1) / 2 + n_y * (y0 + y1) / 2, tuple(group)))
    return lines


def _pack(
    building: Building,
    origin: FloatArray,
    faces: Sequence[list[_Side]],
    owner: Sequence[int],
    ring_sides: Sequence[_RingSide],
    ends: tuple[FloatArray, FloatArray],
    extent_m: float,
) -> ConvexMap:
    """Numbers lines and finds what lies behind every side that is not wall."""
    tolerance_m = TOLERANCE_ULP * float(np.finfo(np.float32).eps) * extent_m
    lines = [_lines(face) for face in faces]
    first_line = np.concatenate([[0], np.cumsum([len(of_face) for of_face in lines])])
    entered: dict[object, tuple[int, int]] = {}  # face and line by diagonal, or by number of the side of a ring
    for face, of_face in enumerate(lines):
        for i, line in enumerate(of_face):
            for side in line.sides:
                key = side.ring if side.ring >= 0 else (owner[face], side.start, side.end)
                entered[key] = (face, int(first_line[face]) + i)
    side_of_edge = {edge: i for i, side in enumerate(ring_sides) for edge in side.edges}
    portals: list[tuple[float, float, int, int]] = []
    first_portal = [0]
    for face, of_face in enumerate(lines):
        for line in of_face:
            passed: list[tuple[float, float, int, int]] = []
            for side in line.sides:
                if side.ring < 0:
                    open_sides = [(side.start, side.end, entered[owner[face], side.end, side.start])]
                else:
                    open_sides = [
                        ((ends[0][e, 0], ends[0][e, 1]), (ends[1][e, 0], ends[1][e, 1]), entered[side_of_edge[twin]])
                        for e in ring_sides[side.ring].edges
                        if building.edge_neighbour[e] != WALL
                        for twin in [int(building.edge_twin[e])]
                    ]
                for start, end, behind in open_sides:
                    low, high = sorted(-line.normal[1] * x + line.normal[0] * y for x, y in (start, end))
                    passed.append((low + tolerance_m, high - tolerance_m, *behind))
            portals += sorted(passed)
            first_portal.append(len(portals))
    planes = np.array([(*line.normal, line.offset_m) for of_face in lines for line in of_face])
    heights = [building.polygons[polygon].height_m for polygon in owner]
    of_faces = np.split(planes, first_line[1:-1])
    return ConvexMap(
        origin_xy_m=read_only(origin),
        polygon=read_only(owner, np.int32),
        level=building.level(owner),
        world=World(
            line=read_only(planes, np.float32),
            first_line=read_only(first_line, np.int32),
            first_portal=read_only(first_portal, np.int32),
            portal=read_only([portal[:2] for portal in portals] or np.zeros((0, 2)), np.float32),
            neighbour=read_only([portal[2:] for portal in portals] or np.zeros((0, 2)), np.int32),
            box_m=read_only(_inner_boxes(faces, of_faces, tolerance_m), np.float32),
            height_m=read_only(heights, np.float32),
        ),
        first_corner=read_only(np.concatenate([[0], np.cumsum([len(face) for face in faces])]), np.int32),
        corner_xy_m=read_only([side.start for face in faces for side in face]),
        tolerance_m=tolerance_m,
    )


def _inner_boxes(faces: Sequence[Sequence[_Side]], of_faces: Sequence[FloatArray], margin_m: float) -> FloatArray:
    """(K, 4) a large axis-parallel box inside each convex face: the best of a grid of centres and aspect ratios.

    Around a centre p a box with half sides k a, k b fits while k (|n_x| a + |n_y| b) <= c - n p for every plane.
    """
    corners_m = np.array([side.start for face in faces for side in face])
    first, count = np.cumsum([0, *(len(face) for face in faces[:-1])]), np.array([[len(face)] for face in faces])
    low, high = (one.reduceat(corners_m, first) for one in _BOUNDS)
    middle = np.stack([(low + high) / 2, np.add.reduceat(corners_m, first) / count], axis=1)
    centres = np.concatenate([middle, low[:, None] + _BOX_CENTRES * (high - low)[:, None]], axis=1)  # (K, C, 2)
    (wide_m, long_m), usual = (high - low).T, np.broadcast_to(_BOX_ASPECTS, (len(faces), len(_BOX_ASPECTS)))
    aspects = np.column_stack([wide_m / long_m, usual])
    halves = np.stack([np.sqrt(aspects), 1 / np.sqrt(aspects)], axis=2)  # (K, A, 2)
    scale = np.full((*centres.shape[:2], aspects.shape[1]), np.inf)
    for i in range(max(map(len, of_faces))):
        has = np.flatnonzero([len(planes) > i for planes in of_faces])
        planes = np.array([of_faces[k][i] for k in has.tolist()])
        room = planes[:, 2, None] - margin_m - np.einsum("kcx,kx->kc", centres[has], planes[:, :2])
        need = np.einsum("kax,kx->ka", halves[has], np.abs(planes[:, :2]))
        scale[has] = np.minimum(scale[has], room[:, :, None] / need[:, None])
    best = scale.reshape(len(faces), -1).argmax(axis=1)
    centre, aspect = np.divmod(best, aspects.shape[1])
    every = np.arange(len(faces))
    half = np.maximum(scale[every, centre, aspect, None], 0.0) * halves[every, aspect]
    return np.hstack([centres[every, centre] - half, centres[every, centre] + half])


def _fan(parts: Any, owner: IntArray) -> tuple[FloatArray, IntArray]:
    """Triangles (T, 3, 2) of convex parts, and whose each is (T,); points and lines have none."""
    import shapely

    parts, index = shapely.get_parts(parts, return_index=True)
    has_area = (shapely.get_type_id(parts) == _POLYGON) & (shapely.area(parts) > MIN_PART_M2)
    parts, owner = parts[has_area], owner[index[has_area]]
    points, ring = shapely.get_coordinates(parts, return_index=True)
    first = np.searchsorted(ring, np.arange(len(parts)))
    count = np.diff(np.append(first, len(points))) - 3  # rings repeat their first point
    triangle = np.repeat(first, count) + np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    corners = np.stack([points[np.repeat(first, count)], points[triangle + 1], points[triangle + 2]], axis=1)
    return corners, np.repeat(owner, count)
