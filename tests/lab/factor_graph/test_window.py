"""A window over made-up floors where the right answer is known."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from pdrbench.building import WALL, Building, FloorPolygon
from pdrbench.geometry import FloatArray
from pdrbench_baselines.learned.signals import turned
from pdrbench_lab.factor_graph.chain import ChainParams
from pdrbench_lab.factor_graph.localizer import _rows
from pdrbench_lab.factor_graph.walls import STAIRS_M, distances_of, stairs_of
from pdrbench_lab.factor_graph.window import Window, WindowParams

SECOND_M = 1.2
COVARIANCE_M2 = 0.1**2 * np.eye(2)
# A corridor 2 m wide: 30 m to the east, then 30 m to the north.
ELBOW = np.array([(0, -1), (31, -1), (31, 30), (29, 30), (29, 1), (0, 1)], dtype=float)
WAY = [(1.0, 0.0), (30.0, 0.0), (30.0, 28.0)]


def elbow(angle_rad: float = 0.0, shift_m: tuple[float, float] = (0.0, 0.0)) -> Building:
    ring = turned(ELBOW, angle_rad) + shift_m
    return Building("elbow", (FloorPolygon("elbow", ring, np.full(len(ring), WALL), 0.0, 0),))


def flight() -> Building:
    """A corridor to the east on level 0, stairs at its end, which are on either level by half, and one on level 1."""
    beginnings, levels, kinds = [0, 12, 14, 16, 30], [0, 0, 1, 1], ["floor", "stairs", "stairs", "floor"]
    polygons = []
    for k, (west, east) in enumerate(pairwise(beginnings)):
        ring = np.array([(west, -1), (east, -1), (east, 1), (west, 1)], dtype=float)
        neighbour = np.array([WALL, k + 1 if k < 3 else WALL, WALL, k - 1 if k else WALL])
        polygons.append(FloorPolygon(f"{k}", ring, neighbour, [0.0, 1.0, 2.0, 3.0][k], levels[k], kinds[k]))
    return Building("flight", tuple(polygons))


def walked(building: Building | None, way_m: FloatArray, turned_rad: float, scale: float, **settings: Any) -> Window:
    """Seconds along a way, reported turned and by a factor."""
    floors = {} if building is None else {level: distances_of(building, level, 0.2) for level in building.levels}
    stairs = {} if building is None else stairs_of(building, 0.2)
    window = Window(WindowParams(**settings), floors, stairs, None, remembers=True)
    window.begin(way_m[0], 0, 0.5)
    for start_m, end_m in pairwise(way_m):
        count = round(float(np.hypot(*(end_m - start_m))) / SECOND_M)
        for _ in range(count):
            window.move(turned((end_m - start_m) / count, -turned_rad) / scale, COVARIANCE_M2)
    return window


def test_an_elbow_shows_the_heading_bias_and_the_length_scale() -> None:
    steady = ChainParams(bias_walk_rad=math.radians(1.0), scale_walk=0.003)
    window = walked(elbow(), np.array(WAY), math.radians(12.0), 0.93, chain=steady)
    state, sigma_m = window.last()
    # 24 displacements of 1.2 m +- 0.1 m along each leg of 29 m give the bias to 0.1 sqrt(24) / 29 rad = 1 degree, and
    # the scale to 2 %; the corridor is 2 m wide, which is as much again
    assert state[:2] == pytest.approx([30.0, 28.0], abs=1.0)
    assert state[2] == pytest.approx(math.radians(12.0), abs=math.radians(4.0))
    assert math.exp(state[3]) == pytest.approx(0.93, abs=0.05)
    assert 0.0 < sigma_m < 1.0


def test_without_walls_it_is_dead_reckoning() -> None:
    window = walked(None, np.array(WAY), math.radians(12.0), 1.0)
    expected = turned(np.array(WAY[-1]) - WAY[0], -math.radians(12.0)) + WAY[0]
    assert window.last()[0] == pytest.approx([*expected, 0.0, 0.0], abs=1e-3)


def test_a_turned_and_shifted_building_turns_and_shifts_the_answer() -> None:
    """Distances are kept on squares of 0.2 m, which do not turn: a tenth of a square or two remains."""
    angle_rad, shift_m = 0.5 * math.pi, (100.0, -40.0)
    one = walked(elbow(), np.array(WAY), math.radians(10.0), 0.95)
    other = walked(elbow(angle_rad, shift_m), turned(np.array(WAY), angle_rad) + shift_m, math.radians(10.0), 0.95)
    assert other.last()[0][:2] == pytest.approx(turned(one.last()[0][:2], angle_rad) + shift_m, abs=0.1)
    assert other.last()[0][2:] == pytest.approx(one.last()[0][2:], abs=0.01)


def test_a_lag_changes_little_and_the_past_is_revised_over_all() -> None:
    whole = walked(elbow(), np.array(WAY), math.radians(10.0), 0.95, lag=0)
    short = walked(elbow(), np.array(WAY), math.radians(10.0), 0.95, lag=10)
    assert short.chains.state.shape[1] == 11
    assert whole.chains.state.shape[1] == short.chains.past.shape[1] + 11
    assert short.last()[0][:2] == pytest.approx(whole.last()[0][:2], abs=0.3)
    one, other = short.smoothed(50)[0], whole.smoothed(50)[0]
    assert one.xy_m == pytest.approx(other.xy_m, abs=0.3)
    assert (one.sigma_m > 0).all()


def test_turned_copies_find_the_way_that_one_chain_misses() -> None:
    """A heading 40 degrees off at first ends in a wall of the corridor; the way on is to the left."""
    window = walked(elbow(), np.array(WAY), math.radians(40.0), 1.0)
    assert window.last()[0][:2] == pytest.approx([30.0, 28.0], abs=1.5)


def test_a_way_over_stairs_leads_to_the_level_on_their_other_side() -> None:
    """A length scale 10 % off at first is worth 1.4 m at the stairs, of which walls on either level know nothing."""
    window = walked(flight(), np.array([(1.0, 0.0), (27.0, 0.0)]), 0.0, 0.9)
    assert window.level == 1
    assert window.last()[0][:2] == pytest.approx([27.0, 0.0], abs=3.0)
    (likeliest,) = window.smoothed(50)[:1]
    assert sorted(set(likeliest.level.tolist())) == [0, 1]
    changed = int(np.flatnonzero(np.diff(likeliest.level))[0])
    assert likeliest.xy_m[changed : changed + 2, 0] == pytest.approx(14.0, abs=STAIRS_M)


def test_stairs_that_are_not_reached_are_not_taken() -> None:
    assert walked(flight(), np.array([(1.0, 0.0), (9.0, 0.0)]), 0.0, 1.0).level == 0


def test_stairs_join_levels_both_ways() -> None:
    stairs = stairs_of(flight(), 0.2)
    assert sorted(stairs) == [(0, 1), (1, 0)]
    near_m = stairs[0, 1].at(np.array([(14.0, 0.0), (10.0, 0.0)]))[0]
    assert near_m == pytest.approx([STAIRS_M, STAIRS_M - 4.0], abs=0.2)  # a square
    assert not stairs_of(elbow(), 0.2)


def test_the_same_input_gives_the_same_bytes() -> None:
    one, other = (walked(elbow(), np.array(WAY), 0.2, 0.95) for _ in range(2))
    assert one.chains.state.tobytes() == other.chains.state.tobytes()
    assert one.score.tobytes() == other.score.tobytes()


def test_rows_stand_while_the_walker_stands() -> None:
    xy_m = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]])
    rows = _rows(np.array([1.0, 5.0]), xy_m, np.array([0, 0, 1]), np.array([0.5, 0.6, 0.7]))
    assert (np.diff(rows[:, 0]) > 0).all()
    x_m = np.interp([0.0, 1.0, 1.5, 2.0, 4.0, 5.5, 6.0], rows[:, 0], rows[:, 1])
    assert x_m == pytest.approx([0.0, 0.0, 0.5, 1.0, 1.0, 1.5, 2.0], abs=1e-6)
    assert rows[-1].tolist() == [6.0, 2.0, 0.0, 1.0, 0.7]
