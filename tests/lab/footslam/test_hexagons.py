"""Hexagons: closed forms of the tiling, and ways through it against a fine sampling of them."""

from __future__ import annotations

import numpy as np
import pytest

from pdrbench.geometry import FloatArray, IntArray
from pdrbench_lab.footslam.hexagons import centre_m, corners_m, crossings, hexagon_of, neighbour

RADIUS_M = 0.7


@pytest.fixture
def grid() -> IntArray:
    return np.stack(np.meshgrid(np.arange(-5, 6), np.arange(-5, 6)), axis=-1).reshape(-1, 2)


def test_a_place_is_in_the_hexagon_with_the_nearest_centre(rng: np.random.Generator, grid: IntArray) -> None:
    xy_m = rng.uniform(-2.0, 2.0, (500, 2))
    gap_m = np.linalg.norm(xy_m[:, None] - centre_m(grid, RADIUS_M), axis=2)
    assert np.array_equal(hexagon_of(xy_m, RADIUS_M), grid[gap_m.argmin(axis=1)])
    assert gap_m.min(axis=1).max() <= RADIUS_M


@pytest.mark.parametrize("edge", range(6))
def test_edges_face_neighbours_at_sixty_degrees(edge: int) -> None:
    away_m = centre_m(neighbour([2, -3], edge), RADIUS_M) - centre_m([2, -3], RADIUS_M)
    towards = np.array([np.cos(edge * np.pi / 3), np.sin(edge * np.pi / 3)])
    assert away_m == pytest.approx(np.sqrt(3) * RADIUS_M * towards)
    corners = corners_m([2, -3], RADIUS_M)
    middle_m = (corners[edge] + corners[(edge + 1) % 6]) / 2
    assert middle_m == pytest.approx(centre_m([2, -3], RADIUS_M) + away_m / 2)
    assert np.array_equal(neighbour(neighbour([2, -3], edge), (edge + 3) % 6), [2, -3])


@pytest.mark.parametrize("edge", range(6))
def test_a_way_from_centre_to_centre_crosses_one_edge_for_each_hexagon(edge: int) -> None:
    towards = np.array([np.cos(edge * np.pi / 3), np.sin(edge * np.pi / 3)])
    (crossed,) = crossings(np.zeros((1, 2)), np.sqrt(3) * RADIUS_M * 7 * towards[None], RADIUS_M)
    assert crossed.tolist() == [edge] * 7


def test_ways_cross_what_a_fine_sampling_of_them_crosses(rng: np.random.Generator) -> None:
    start_m, end_m = rng.uniform(-4.0, 4.0, (2, 200, 2))
    for start, end, crossed in zip(start_m, end_m, crossings(start_m, end_m, RADIUS_M), strict=True):
        on_the_way = hexagon_of(start + np.linspace(0, 1, 20_001)[:, None] * (end - start), RADIUS_M)
        seen = on_the_way[np.concatenate([[True], (np.diff(on_the_way, axis=0) != 0).any(axis=1)])]
        passed = _hexagons(start, crossed)
        # 0.6 mm apart, the sampling may pass over the tip of a hexagon that a way cuts; it sees no other hexagons
        assert {tuple(h) for h in seen} <= {tuple(h) for h in passed}
        assert len(passed) - len(seen) <= 1
        assert passed[-1].tolist() == hexagon_of(end, RADIUS_M).tolist()


def test_the_way_back_crosses_the_same_edges(rng: np.random.Generator) -> None:
    start_m, end_m = rng.uniform(-4.0, 4.0, (2, 50, 2))
    for out, back in zip(crossings(start_m, end_m, 0.5), crossings(end_m, start_m, 0.5), strict=True):
        assert back.tolist() == ((out[::-1] + 3) % 6).tolist()


def test_pieces_of_a_way_cross_what_the_whole_crosses(rng: np.random.Generator) -> None:
    start_m, end_m, part = rng.uniform(-4.0, 4.0, (50, 2)), rng.uniform(-4.0, 4.0, (50, 2)), rng.random((50, 1))
    half_m = start_m + part * (end_m - start_m)
    whole = crossings(start_m, end_m, 0.5)
    for one, first, second in zip(whole, crossings(start_m, half_m, 0.5), crossings(half_m, end_m, 0.5), strict=True):
        assert one.tolist() == [*first, *second]


def test_a_way_within_a_hexagon_crosses_nothing() -> None:
    assert [len(edges) for edges in crossings(np.zeros((2, 2)), np.array([[0.1, 0.2], [0.0, 0.0]]), 0.5)] == [0, 0]


def _hexagons(start_m: FloatArray, crossed: IntArray) -> IntArray:
    found = [hexagon_of(start_m, RADIUS_M)]
    for edge in crossed:
        found.append(neighbour(found[-1], edge))
    return np.array(found)
