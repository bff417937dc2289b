from __future__ import annotations

import gc
import time
import weakref
from pathlib import Path

import numpy as np
import pytest

from pdrbench.building import WALL, Building, FloorPolygon
from pdrbench.radio import Cells, divide
from pdrbench_sim.buildings.office import make_office
from pdrbench_sim.readers import ilc20_map


def rectangle(name, x0, y0, x1, y1, neighbour=(WALL,) * 4, height_m=0.0, kind="floor", level=0) -> FloorPolygon:
    outline = [[x0, y0], [x1, y0], [x1, y1], [x0, y1]]
    return FloorPolygon(name, np.array(outline, dtype=float), np.array(neighbour), height_m, level, kind)


def extents_m(cells: Cells) -> np.ndarray:
    """(C, 2) length of each cell along x and y."""
    low, high = np.full((cells.num_cells, 2), np.inf), np.full((cells.num_cells, 2), -np.inf)
    np.minimum.at(low, cells.cell, cells.region.corners_xy_m.min(axis=1))
    np.maximum.at(high, cells.cell, cells.region.corners_xy_m.max(axis=1))
    return high - low


def rooms_of(cells: Cells) -> set[frozenset[int]]:
    """The polygons of every cell."""
    return {frozenset(cells.region.polygon[cells.cell == c].tolist()) for c in range(cells.num_cells)}


@pytest.mark.parametrize("seed", range(3))
def test_cells_cover_an_office_and_none_is_longer_than_the_paper_says(seed):
    building = make_office(np.random.default_rng(seed), area_m2=2600.0)
    cells = divide(building)
    assert cells.region.area_m2 == pytest.approx(building.area_m2, rel=1e-9)
    assert cells.area_m2().sum() == pytest.approx(building.area_m2, rel=1e-9)
    assert extents_m(cells).max() <= 8.0 + 1e-9
    for polygons in rooms_of(cells):  # one room each, or treads of one flight
        assert len(polygons) == 1 or all(building.polygons[p].kind == "stairs" for p in polygons)
    for polygon, piece in enumerate(building.polygons):
        mine = cells.region.restricted(cells.region.polygon == polygon)
        assert mine.area_m2 == pytest.approx(piece.area_m2, rel=1e-9)
    np.testing.assert_array_equal(building.level(cells.region.polygon), cells.level[cells.cell])


def test_a_rectangle_is_cut_into_equal_pieces_of_the_fewest_number():
    cells = divide(Building("hall", (rectangle("hall", 0, 0, 17, 9),)))
    assert cells.num_cells == 3 * 2
    assert cells.area_m2() == pytest.approx(np.full(6, 17 * 9 / 6))
    assert divide(Building("hall", (rectangle("hall", 0, 0, 17, 9),)), 20.0).num_cells == 1


def test_a_room_that_falls_apart_where_it_is_cut_gives_cells_that_hang_together():
    outline = [[0, 0], [12, 0], [12, 5], [10, 5], [10, 1], [2, 1], [2, 5], [0, 5]]  # a U lying on its back
    cells = divide(Building("U", (FloorPolygon("U", np.array(outline, float), np.full(8, WALL), 0.0, 0),)), 4.0)
    for cell in range(cells.num_cells):
        x_m = cells.region.corners_xy_m[cells.cell == cell][..., 0]
        assert not (x_m.min() < 2 - 1e-9 and x_m.max() > 10 + 1e-9)
    assert cells.area_m2().sum() == pytest.approx(12 + 4 * 2 * 2)
    assert extents_m(cells).max() <= 4.0 + 1e-9


def test_sills_join_the_larger_room_treads_one_flight_and_rising_rows_one_theatre():
    w = WALL
    polygons = (
        rectangle("small", 0, 0, 3, 3, (w, w, w, w)),
        rectangle("sill", 3, 1, 3.3, 2, (w, 2, w, w)),
        FloorPolygon(
            "large",
            np.array([[3.3, 0], [9, 0], [9, 3], [3.3, 3], [3.3, 2], [3.3, 1]], float),
            np.array([w, 3, w, w, 1, w]),
            0.0,
            0,
        ),
        rectangle("tread 1", 9, 0, 9.3, 3, (w, 4, w, 2), 0.16, "stairs"),
        rectangle("tread 2", 9.3, 0, 9.6, 3, (w, w, w, 3), 0.32, "stairs"),
        rectangle("row 1", 0, 9, 9, 10, (w, w, 6, w)),
        rectangle("row 2", 0, 10, 9, 11, (5, w, 7, w), 0.3),
        rectangle("row 3", 0, 11, 9, 12, (6, w, w, w), 0.6),
    )
    rooms = rooms_of(divide(Building("theatre", polygons), 20.0))
    assert rooms == {frozenset([0]), frozenset([1, 2]), frozenset([3, 4]), frozenset([5, 6, 7])}


def test_a_place_is_located_in_the_cell_of_its_level(house: Building, rng: np.random.Generator):
    cells = divide(house)
    triangle = np.repeat(np.arange(len(cells.cell)), 5)
    cell, (polygon, xy_m) = cells.cell[triangle], cells.region.sample_triangles(rng, triangle)
    np.testing.assert_array_equal(cells.locate(house.level(polygon), xy_m), cell)
    assert cells.region.contains(polygon, xy_m).all()
    assert cells.locate(0, [[50.0, 50.0], [2.5, 2.5], [np.nan, 0.0]]).tolist() == [-1, -1, -1]  # outside; a pillar
    assert cells.locate(7, [[1.0, 1.0]]).tolist() == [-1]


def test_a_union_of_cells_is_the_region_of_their_triangles(house: Building):
    cells = divide(house, 3.0)
    chosen = np.arange(cells.num_cells) % 2 == 0
    assert cells.union(chosen).area_m2 == pytest.approx(cells.area_m2()[chosen].sum())
    assert cells.union(~chosen).area_m2 + cells.union(chosen).area_m2 == pytest.approx(house.area_m2)
    assert len(cells.union(np.zeros(cells.num_cells, dtype=bool))) == 0


@pytest.mark.data
def test_plans_with_thousands_of_edges_are_divided_within_seconds(data_root: Path):
    building = ilc20_map.read(data_root / "ilc20" / "site1").building
    start_s = time.process_time()
    cells = divide(building)
    assert time.process_time() - start_s < 5.0  # 0.2 s where it was written
    assert cells.region.area_m2 == pytest.approx(building.area_m2, rel=1e-9)
    assert extents_m(cells).max() <= 8.0 + 1e-9


def test_cells_of_walks_before_are_let_go():
    """Each replay of a recording has a building of its own, and its cells take megabytes."""
    buildings = [make_office(np.random.default_rng(seed), num_levels=1, area_m2=400.0) for seed in range(8)]
    seen = [weakref.ref(divide(building).cell) for building in buildings]
    gc.collect()
    assert sum(of() is not None for of in seen) <= 4
