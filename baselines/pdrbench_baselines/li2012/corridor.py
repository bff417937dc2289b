"""A floor as tiles of pathway, room and wall, and where the middle of a pathway is (Li et al. 2012, claim L19)."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from pdrbench.building import WALL, Building
from pdrbench.errors import MapError
from pdrbench.geometry import FloatArray, read_only
from pdrbench_baselines.li2012.kernels import approach

WALL_TILE: Final = 0
ROOM_TILE: Final = 1
PATH_TILE: Final = 2
# Kinds of zones, as maps have them, that are ways and not places to be; what other kinds cover is rooms.
WAYS: Final = frozenset(
    {"corridor", "hallway", "pathway", "walkway", "passage", "concourse", "entrance", "lobby", "atrium", "landing"}
)
MAX_TILES: Final = 4_000_000
NEAR_M: Final = 4.0  # walls farther than that from a tile are looked for in a tree


@dataclass(frozen=True, slots=True)
class TileParams:
    """How a floor is cut into tiles.

    Attributes:
        tile_m: Edge of a tile.
        widest_m: Where the map has no kinds of zones, floor between walls nearer than this is one.
        middle_share: Part of the width of a corridor that is its middle.
    """

    tile_m: float = 0.25  # ours: eight across a corridor of 2 m
    widest_m: float = 6.0  # ours: ways through a mall are that wide; a wider place has no middle that people keep to
    middle_share: float = 1.0 / 3.0  # L19

    def __post_init__(self) -> None:
        if not (0 < self.tile_m < math.inf and self.widest_m > 0 and 0 < self.middle_share <= 1):
            raise MapError(f"tiles need an edge and a width above 0 and a share of at most 1; got {self}")


@dataclass(frozen=True, slots=True, eq=False)
class TileMap:
    """Tiles of one level.

    Attributes:
        origin_xy_m: (2,) lower left corner of the first tile.
        tile_m: Edge.
        kind: (rows, columns) uint8: `WALL_TILE`, `ROOM_TILE` or `PATH_TILE`.
        wall_m: (rows, columns) from the middle of a tile to the nearest wall; 0 off the floor.
        half_width_m: (rows, columns) half the width of the floor there: radius of the largest disc that touches no
            wall and covers the tile.
        is_middle: (rows, columns) bool, the middle of a pathway.
    """

    origin_xy_m: FloatArray
    tile_m: float
    kind: NDArray[np.uint8]
    wall_m: FloatArray
    half_width_m: FloatArray
    middle_share: float
    is_middle: NDArray[np.bool_] = field(init=False)

    def __post_init__(self) -> None:
        middle = (self.kind == PATH_TILE) & (self.mid_m <= self.middle_share * self.half_width_m + 1e-9)
        object.__setattr__(self, "is_middle", read_only(middle, np.bool_))

    @property
    def mid_m(self) -> FloatArray:
        """(rows, columns) distance from the mid-line: half the width less the distance from the wall."""
        return self.half_width_m - self.wall_m


@functools.lru_cache(maxsize=16)
def tile_map(building: Building, level: int, params: TileParams | None = None) -> TileMap:
    """Cuts a level into tiles.

    A tile is floor where its middle is; also where floor only touches it, so that a corridor narrower than a tile is
    still there. What is a pathway is taken from the kinds of the zones where the map has them, else from the width.

    Raises:
        MapError: No such level, or too many tiles.
    """

    params = params or TileParams()
    tile_m = params.tile_m
    x0, y0, x1, y1 = building.bounds_m(level)
    columns, rows = math.ceil((x1 - x0) / tile_m) + 2, math.ceil((y1 - y0) / tile_m) + 2
    if rows * columns > MAX_TILES:
        raise MapError(f"level {level} of building {building.name!r} has {rows * columns} tiles; make tile_m larger")
    origin = np.array([x0 - tile_m, y0 - tile_m])
    xs, ys = (origin[i] + tile_m * (np.arange(n) + 0.5) for i, n in ((0, columns), (1, rows)))
    middle = np.stack(np.meshgrid(xs, ys), axis=-1)
    floor = building.walkable(level)
    inside = _inside(floor, xs, ys)
    on_level = building.level(building.edge_polygon) == level
    start, end = building.edge_start_xy_m[on_level], building.edge_end_xy_m[on_level]
    _touch(start, end, floor, tile_m, origin, middle, inside)
    is_wall = building.edge_neighbour[on_level] == WALL
    wall_m = _distance_m(start[is_wall], end[is_wall], origin, tile_m, middle, inside)
    half_width_m = np.where(inside, _half_width_m(wall_m, tile_m, params.widest_m), 0.0)
    kind = np.where(inside, ROOM_TILE, WALL_TILE).astype(np.uint8)
    kind[inside & _is_way(building, level, middle, half_width_m, params)] = PATH_TILE
    return TileMap(
        read_only(origin), tile_m, read_only(kind, np.uint8), read_only(wall_m), read_only(half_width_m),
        params.middle_share,
    )  # fmt: skip


def _inside(floor: Any, xs: FloatArray, ys: FloatArray) -> NDArray[np.bool_]:
    """(rows, columns) which places of a grid are floor: those with an odd number of its edges to their left."""
    import shapely

    corners, ring = shapely.get_coordinates(shapely.get_rings(shapely.get_parts(floor)), return_index=True)
    is_edge = np.diff(ring) == 0
    (x, y), (x_end, y_end) = corners[:-1][is_edge].T, corners[1:][is_edge].T
    first, end = (np.searchsorted(ys, of(y, y_end)) for of in (np.minimum, np.maximum))
    edge = np.repeat(np.arange(len(x)), end - first)
    row = np.arange(len(edge)) - np.repeat(np.cumsum(end - first) - end, end - first)
    crossed = x[edge] + (ys[row] - y[edge]) / (y_end - y)[edge] * (x_end - x)[edge]
    num_left = np.zeros((len(ys), len(xs) + 1), dtype=np.int32)
    np.add.at(num_left, (row, np.searchsorted(xs, crossed)), 1)
    return np.asarray(np.cumsum(num_left, axis=1)[:, :-1] % 2 == 1)


def _touch(
    start: FloatArray, end: FloatArray, floor: Any, tile_m: float, origin: FloatArray, middle: FloatArray, inside: Any
) -> None:
    """Takes in tiles whose middle is off the floor, along edges, where no neighbour stands for the floor in them.

    Sets `inside` (rows, columns) there and moves their `middle` (rows, columns, 2) onto the floor. Floor that reaches
    into a tile from a floor tile beside it is seen there, so that only corridors narrower than a tile are looked for.
    """
    import shapely

    parts = np.ceil(2 * np.hypot(*(end - start).T) / tile_m).astype(np.int64) + 1
    edge = np.repeat(np.arange(len(parts)), parts)
    fraction = (np.arange(len(edge)) - np.repeat(np.cumsum(parts) - parts, parts)) / np.maximum(parts - 1, 1)[edge]
    along = start[edge] + fraction[:, None] * (end - start)[edge]
    column, row = np.unique(np.floor((along - origin) / tile_m).astype(np.int64), axis=0).T
    near = ndimage.binary_dilation(inside, np.ones((3, 3), dtype=bool))
    lonely = ~near[row, column]
    row, column = row[lonely], column[lonely]
    half = tile_m / 2
    x, y = middle[row, column].T
    pieces = shapely.intersection(floor, shapely.box(x - half, y - half, x + half, y + half))
    has_area = shapely.area(pieces) > 0
    row, column = row[has_area], column[has_area]
    middle[row, column] = shapely.get_coordinates(shapely.point_on_surface(pieces[has_area])).reshape(-1, 2)
    inside[row, column] = True


def _distance_m(
    start: FloatArray, end: FloatArray, origin: FloatArray, tile_m: float, middle: FloatArray, inside: NDArray[np.bool_]
) -> FloatArray:
    """(rows, columns) from the middle of a tile to the nearest wall; 0 off the floor, infinite without walls."""
    import shapely

    square_m2 = np.where(inside, np.inf, 0.0)
    approach(start, end, origin, tile_m, middle, inside, NEAR_M, square_m2)
    distance_m = np.sqrt(square_m2)
    far = distance_m > NEAR_M
    if far.any() and len(start):
        tree = shapely.STRtree(shapely.linestrings(np.stack([start, end], axis=1)))
        _, distance_m[far] = tree.query_nearest(shapely.points(middle[far]), return_distance=True, all_matches=False)
    return distance_m


def _half_width_m(wall_m: FloatArray, tile_m: float, most_m: float) -> FloatArray:
    """Radius of the largest disc that keeps off the walls and covers a tile, to half a tile or a tenth of it.

    Only discs of at most `most_m` are looked for; beyond, the distance from the wall stands.
    """
    half_m = wall_m.copy()
    radius_m = tile_m
    while radius_m <= min(most_m, float(np.max(wall_m, initial=0.0))):
        covered = _discs(wall_m >= radius_m, radius_m / tile_m)
        half_m[covered] = np.maximum(half_m[covered], radius_m)
        radius_m += max(tile_m / 2, radius_m / 10)
    return half_m


def _discs(middle: NDArray[np.bool_], radius: float) -> NDArray[np.bool_]:
    """(rows, columns) of discs around tiles, whose radius is in tiles: in a seventh of the time of distances."""
    most, columns = int(radius), middle.shape[1]
    count = np.cumsum(np.pad(middle, ((0, 0), (most + 1, most))), axis=1, dtype=np.int32)  # of tiles to the left
    covered = np.zeros_like(middle)
    for away in range(most + 1):
        wide = int(math.sqrt(radius**2 - away**2))
        run = count[:, most + 1 + wide :][:, :columns] > count[:, most - wide :][:, :columns]
        covered[away:] |= run[: len(run) - away]
        covered[: len(run) - away] |= run[away:]
    return covered


def _is_way(
    building: Building, level: int, middle: FloatArray, half_width_m: FloatArray, params: TileParams
) -> NDArray[np.bool_]:
    """(rows, columns) pathway, by the kinds of zones where there are any, else by the width."""
    zones = [zone for zone in building.zones if zone.level == level and zone.kind]
    if not zones:
        return 2 * half_width_m <= params.widest_m
    is_way = np.array([zone.kind in WAYS for zone in zones])
    outlines = [zone.outline_xy_m for zone in zones]
    stairs = [
        polygon.outline_xy_m for polygon in building.polygons if polygon.level == level and polygon.kind != "floor"
    ]
    # Rooms that a corridor runs around lie inside its outline.
    rooms = _covered([outline for outline, way in zip(outlines, is_way, strict=True) if not way] + stairs, middle)
    if not is_way.any():
        return ~rooms
    return _covered([outline for outline, way in zip(outlines, is_way, strict=True) if way], middle) & ~rooms


def _covered(outlines: list[FloatArray], middle: FloatArray) -> NDArray[np.bool_]:
    import shapely

    if not outlines:
        return np.zeros(middle.shape[:2], dtype=np.bool_)
    area = shapely.union_all(shapely.make_valid(np.array([shapely.Polygon(outline) for outline in outlines])))
    shapely.prepare(area)
    return np.asarray(shapely.intersects_xy(area, middle[..., 0], middle[..., 1]))
