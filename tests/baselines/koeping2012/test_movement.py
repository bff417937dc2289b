"""The movement table: cells, ways between them, probabilities, draws."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from pdrbench.building import Building
from pdrbench.errors import MapError
from pdrbench.geometry import IntArray
from pdrbench_baselines.koeping2012 import movement_kernels as kernels
from pdrbench_baselines.koeping2012.movement import MovementParams, build_table, movement_table
from pdrbench_baselines.koeping2012.movement_cells import GridCells, cut_floor
from pdrbench_sim.buildings.assembly import Cell, Opening, assemble, rectangle
from pdrbench_sim.buildings.office import make_office

MAX_DETOUR = math.hypot(1.0, math.sqrt(5) - 2) - 1  # 2.75 %: the most that 16 directions make a way longer


def parts(cells: GridCells) -> IntArray:
    """(C,) number of the part of the building of each cell; no way leads from one part to another."""
    size = (len(cells), len(cells))
    graph = coo_array((np.ones(len(cells.pair)), (cells.pair[:, 0], cells.pair[:, 1])), shape=size)
    return np.asarray(connected_components(graph, directed=False)[1])


def make(cells: list[Cell], openings: list[Opening] = []) -> Building:  # noqa: B006
    return Building("toy", assemble(cells, openings))


def hall(size_m: float = 20.0) -> Building:
    return make([Cell("hall", rectangle(0, 0, size_m, size_m), 0.0, 0)])


def two_rooms(*, door: bool = True) -> Building:
    """Two rooms of 4 m x 4 m beside each other; a door of 0.9 m in the wall x = 4, at y = 0.5."""
    rooms = [Cell("a", rectangle(0, 0, 4, 4), 0.0, 0), Cell("b", rectangle(4, 0, 8, 4), 0.0, 0)]
    return make(rooms, [Opening("a", "b", (4.0, 0.5), (4.0, 1.4))] if door else [])


def nearest(table, x_m: float, y_m: float) -> int:
    return int(np.argmin(np.hypot(*(table.cells.xy_m - [x_m, y_m]).T)))


def ways_m(cells, source: int) -> np.ndarray:
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import dijkstra

    graph = csr_array((cells.way_m, cells.pair.T), shape=(len(cells), len(cells)))
    return dijkstra(graph, directed=False, indices=source)


def test_cells_hold_all_floor_and_stand_in_the_middle_of_their_squares() -> None:
    cells = cut_floor(hall(), 0.5)
    assert len(cells) == 40 * 40
    assert cells.area_m2 == pytest.approx(0.25)
    assert np.allclose(np.mod(cells.xy_m, 0.5), 0.25)


def test_distances_in_an_empty_hall_are_straight_within_the_error_of_16_directions() -> None:
    cells = cut_floor(hall(), 0.5)
    source = int(np.argmin(np.hypot(*(cells.xy_m - 10).T)))
    straight_m = np.hypot(*(cells.xy_m - cells.xy_m[source]).T)
    ratio = ways_m(cells, source)[straight_m > 0] / straight_m[straight_m > 0]
    assert ratio.min() >= 1 - 1e-9
    assert ratio.max() <= 1 + MAX_DETOUR + 1e-9
    assert ratio.max() > 1.02  # the bound is near what happens


def test_probabilities_follow_the_law_in_the_open() -> None:
    params = MovementParams(prune=0.0)
    table = build_table(hall(), params)
    source = nearest(table, 10, 10)
    to, probability = table.row(source)
    way_m = ways_m(table.cells, source)[to]
    ring = np.rint(way_m / 0.5).astype(int)
    expected = np.exp(-0.5 * ((way_m - 1.34) / 0.26) ** 2) / np.bincount(ring)[ring]
    assert probability == pytest.approx(expected / expected.sum(), abs=1e-6)
    assert (probability * way_m).sum() == pytest.approx(1.34, abs=0.1)  # rings are half a metre wide


def test_improbable_movements_are_pruned_and_the_rest_sums_to_one() -> None:
    table = build_table(hall(), MovementParams(prune=0.01))
    for cell in (0, nearest(table, 10, 10), table.num_cells - 1):
        _, probability = table.row(cell)
        assert probability.min() >= 0.01
        assert probability.sum() == pytest.approx(1.0)
    assert len(table.to) < len(build_table(hall(), MovementParams(prune=0.0)).to)


def test_walls_are_walked_round_doors_through_and_parts_that_nothing_connects_not_reached() -> None:
    table = build_table(two_rooms())
    at_door, at_wall = nearest(table, 3.75, 0.75), nearest(table, 3.75, 3.25)
    assert (table.cells.xy_m[table.row(at_door)[0], 0] > 4).any()
    assert (table.cells.xy_m[table.row(at_wall)[0], 0] < 4).all()
    way_m = ways_m(table.cells, at_wall)[nearest(table, 4.25, 3.25)]
    shortest_m = math.hypot(3.25 - 1.4, 0.25) * 2  # round the jamb
    assert shortest_m <= way_m <= shortest_m + 2 * 0.5  # round a jamb it goes from cell to cell
    table = build_table(two_rooms(door=False))
    assert np.bincount(parts(table.cells)).tolist() == [64, 64]
    rng = np.random.default_rng(0)
    cell = begun = table.start(rng, 4000)
    for _ in range(20):
        cell = table.move(cell, rng)
    assert (parts(table.cells)[cell] == parts(table.cells)[begun]).all()


def test_rooms_on_both_sides_of_a_wall_in_one_square_are_two_cells() -> None:
    rooms = [Cell("a", rectangle(0, 0, 1.1, 1), 0.0, 0), Cell("b", rectangle(1.1, 0, 2, 1), 0.0, 0)]
    cells = cut_floor(make(rooms), 0.5)
    assert cells.area_m2.sum() == pytest.approx(2.0)
    assert len(cells) == 10 and len(set(parts(cells))) == 2
    assert (make(rooms).locate(cells.xy_m, 0) == cells.polygon).all()


@pytest.mark.parametrize("cell_m", [0.5, 1.0, 3.0])
def test_corridors_narrower_than_a_cell_stay_whole(cell_m: float) -> None:
    """A corridor of 0.4 m that bends, and ends at a door of 0.3 m."""
    bend = [(0.05, 0.05), (6.0, 0.05), (6.0, 7.0), (5.6, 7.0), (5.6, 0.45), (0.05, 0.45)]
    floor = [Cell("bend", bend, 0.0, 0), Cell("room", rectangle(6.0, 4.0, 9.0, 7.0), 0.0, 0)]
    building = make(floor, [Opening("bend", "room", (6.0, 5.1), (6.0, 5.4))])
    cells = cut_floor(building, cell_m)
    assert set(parts(cells)) == {0}
    assert cells.area_m2.sum() == pytest.approx(building.area_m2)
    assert (building.locate(cells.xy_m, 0) == cells.polygon).all()
    assert build_table(building, MovementParams(cell_m=cell_m)).num_cells == len(cells)


@pytest.fixture(scope="module")
def office() -> Building:
    return make_office(np.random.default_rng(4), num_levels=2, area_m2=1200)


def test_stairs_lead_from_level_to_level_and_no_tread_falls_out(office: Building) -> None:
    table = build_table(office)
    assert set(parts(table.cells)) == {0}
    assert table.cells.area_m2.sum() == pytest.approx(office.area_m2, rel=1e-6)
    level = office.level(table.cells.polygon)
    assert set(level) == {0, 1}
    source, end = np.repeat(np.arange(table.num_cells), np.diff(table.first)), table.to
    assert (level[source] != level[end]).any()
    rise_m = np.abs(office.height(table.cells.polygon[source]) - office.height(table.cells.polygon[end]))
    assert rise_m.max() < 2.64  # 2.64 m on the flat in one update, and no flight is steeper than 45 degrees


def test_draws_follow_the_table() -> None:
    table = build_table(two_rooms())
    cell, draws = nearest(table, 3.75, 0.75), 400_000
    to, probability = table.row(cell)
    moved = table.move(np.full(draws, cell), np.random.default_rng(1))
    counts = np.bincount(moved, minlength=table.num_cells)
    assert counts[to].sum() == draws
    sigma = np.sqrt(draws * probability)
    assert (np.abs(counts[to] - draws * probability) < 5 * sigma + 1).all()


def test_the_start_is_even_over_the_floor_of_a_table_made_once_with_cells_of_a_fit_size() -> None:
    table = build_table(make([Cell("a", rectangle(0, 0, 3.1, 2.2), 0.0, 0)]))
    counts = np.bincount(table.start(np.random.default_rng(2), 200_000), minlength=table.num_cells)
    expected = 200_000 * table.cells.area_m2 / table.cells.area_m2.sum()
    assert (np.abs(counts - expected) < 5 * np.sqrt(expected)).all()
    assert movement_table(two_rooms(), MovementParams()) is movement_table(two_rooms(), MovementParams())
    assert movement_table(two_rooms(), MovementParams()) is not movement_table(two_rooms(), MovementParams(cell_m=0.4))
    with pytest.raises(MapError, match="make cell_m larger"):
        build_table(hall(), MovementParams(cell_m=0.005))


def test_sorted_draws_are_multinomial() -> None:
    rng, weight = np.random.default_rng(5), np.array([0.0, 0.5, 0.0, 0.2, 0.3, 0.0])
    drawn = kernels.draw_sorted(weight, rng.standard_exponential(100_001))
    assert (np.diff(drawn) >= 0).all() and len(drawn) == 100_000
    counts = np.bincount(drawn, minlength=6)
    assert counts[weight == 0].tolist() == [0, 0, 0]
    assert (np.abs(counts - 1e5 * weight) < 5 * np.sqrt(1e5 * weight * (1 - weight)) + 1e-9).all()
    # multinomial and not systematic: counts vary as binomial ones do
    tries = [kernels.draw_sorted(np.ones(2), rng.standard_exponential(101)).sum() for _ in range(2000)]
    assert np.var(tries) == pytest.approx(25, rel=0.15)


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ({"cell_m": 0.0}, "cell_m must be positive"),
        ({"update_s": -1.0}, "update_s must be positive"),
        ({"speed_mps": (1.3, 0.0)}, "standard deviation"),
        ({"speed_mps": (1.3,)}, "mean and standard deviation"),
        ({"speed_mps": (float("nan"), 0.2)}, "mean speed"),
        ({"prune": 1.0}, "below 1"),
    ],
)
def test_settings_that_make_no_sense_are_refused(options: dict, why: str) -> None:
    with pytest.raises(MapError, match=why):
        MovementParams(**options)
