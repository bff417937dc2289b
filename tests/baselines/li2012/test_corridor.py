from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from pdrbench.building import WALL, Building, FloorPolygon, Zone
from pdrbench.errors import MapError
from pdrbench_baselines.li2012.corridor import PATH_TILE, ROOM_TILE, WALL_TILE, TileMap, TileParams, tile_map

# A hall of 12 m by 12 m with a corridor 2 m wide and 20 m long to the east, and a slot 0.1 m wide to the north.
OUTLINE = [
    [0, 0],
    [12, 0],
    [12, 5],
    [32, 5],
    [32, 7],
    [12, 7],
    [12, 12],
    [6.1, 12],
    [6.1, 20],
    [6, 20],
    [6, 12],
    [0, 12],
]


@pytest.fixture(scope="module")
def plan() -> Building:
    return Building("plan", (FloorPolygon("floor", OUTLINE, [WALL] * len(OUTLINE), 0.0, 0),))  # type: ignore[arg-type]


def tile_of(tiles: TileMap, xy_m: np.ndarray) -> np.ndarray:
    """(2, N) rows and columns of places (N, 2)."""
    return np.floor((xy_m - tiles.origin_xy_m) / tiles.tile_m).astype(np.int64).T[::-1]


def at(tiles: TileMap, field: np.ndarray, *xy_m: float) -> float:
    row, column = tile_of(tiles, np.array([xy_m]))
    return float(field[row[0], column[0]])


def test_width_separates_corridors_from_rooms(plan: Building) -> None:
    tiles = tile_map(plan, 0)
    assert at(tiles, tiles.kind, 22.0, 6.0) == PATH_TILE
    assert at(tiles, tiles.kind, 3.0, 3.0) == ROOM_TILE
    assert at(tiles, tiles.kind, 22.0, 9.0) == WALL_TILE
    assert at(tiles, tiles.half_width_m, 22.0, 6.1) == pytest.approx(1.0, abs=0.125)


def test_the_middle_third_of_a_corridor_is_its_middle(plan: Building) -> None:
    tiles = tile_map(plan, 0, TileParams(tile_m=0.1))
    y = np.arange(5.05, 7.0, 0.1)
    row, column = tile_of(tiles, np.column_stack([np.full_like(y, 22.0), y]))
    middle = tiles.is_middle[row, column]
    off_m = np.abs(y - 6.0)
    assert middle[off_m < 0.25].all()  # a third of 2 m is 0.33 m to each side, to within a tile
    assert not middle[off_m > 0.45].any()
    assert tiles.mid_m[row, column][off_m < 0.06] == pytest.approx(0.05, abs=0.1)


def test_a_corridor_narrower_than_a_tile_is_still_there(plan: Building) -> None:
    tiles = tile_map(plan, 0, TileParams(tile_m=0.5))
    y = np.arange(13.0, 19.5, 0.5)
    row, column = tile_of(tiles, np.column_stack([np.full_like(y, 6.05), y]))
    assert (tiles.kind[row, column] == PATH_TILE).all()
    assert tiles.is_middle[row, column].all()
    assert tiles.wall_m[row, column].max() <= 0.05 + 1e-9


def test_a_polygon_labelled_corridor_is_a_corridor(plan: Building) -> None:
    hall = Zone("z", "hall", np.array([[0, 0], [12, 0], [12, 12], [0, 12]]), 0, "corridor")
    tiles = tile_map(dataclasses.replace(plan, zones=(hall,)), 0)
    assert at(tiles, tiles.kind, 3.0, 3.0) == PATH_TILE
    assert at(tiles, tiles.kind, 22.0, 6.0) == ROOM_TILE
    assert not tiles.is_middle[tiles.kind != PATH_TILE].any()
    rooms = tile_map(dataclasses.replace(plan, zones=(dataclasses.replace(hall, kind="shop"),)), 0)
    assert at(rooms, rooms.kind, 3.0, 3.0) == ROOM_TILE
    assert at(rooms, rooms.kind, 22.0, 6.0) == PATH_TILE


@pytest.mark.parametrize("wrong", [{"tile_m": 0.0}, {"widest_m": -1.0}, {"middle_share": 1.5}])
def test_bad_settings_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(MapError, match="tiles need"):
        TileParams(**wrong)


def test_too_many_tiles_and_no_such_level(plan: Building) -> None:
    with pytest.raises(MapError, match="make tile_m larger"):
        tile_map(plan, 0, TileParams(tile_m=0.001))
    with pytest.raises(MapError, match="no level 3"):
        tile_map(plan, 3)
