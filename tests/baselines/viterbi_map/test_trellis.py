"""Survivors on made-up floors where the right answer is known."""

from __future__ import annotations

import dataclasses
import math
from itertools import pairwise

import numpy as np
import pytest

from pdrbench.building import WALL, Building, FloorPolygon
from pdrbench.geometry import FloatArray
from pdrbench_baselines.learned.wlan import ScanPlaces
from pdrbench_baselines.viterbi_map.lattice import lattice_of
from pdrbench_baselines.viterbi_map.trellis import Trellis, TrellisParams

SECOND_M = 1.2
COVARIANCE_M2 = 0.1**2 * np.eye(2)


def floor(name: str, *outlines: list[tuple[float, float]]) -> Building:
    polygons = (
        FloorPolygon(f"{name}{k}", np.array(ring, dtype=float), np.full(len(ring), WALL), 0.0, 0)
        for k, ring in enumerate(outlines)
    )
    return Building(name, tuple(polygons))


# A corridor 2 m wide: 30 m to the east, then 30 m to the north.
ELBOW = floor("elbow", [(0, -1), (31, -1), (31, 30), (29, 30), (29, 1), (0, 1)])
# Two rooms of 10 m x 10 m with a gap of 0.2 m between them, where the plan forgets a door.
ROOMS = floor("rooms", [(0, 0), (10, 0), (10, 10), (0, 10)], [(10.2, 0), (20, 0), (20, 10), (10.2, 10)])


def begun(building: Building, start_m: tuple[float, float], *, lag_s: float = math.inf, **settings: float) -> Trellis:
    params = TrellisParams(**settings)  # type: ignore[arg-type]
    trellis = Trellis(building, np.random.default_rng(1), params, 0, lag_s=lag_s)
    trellis.begin_near(np.array(start_m))
    return trellis


def walk(trellis: Trellis, way_m: list[tuple[float, float]], turned_rad: float = 0.0, scale: float = 1.0) -> FloatArray:
    """Seconds along a way, reported turned and by a factor; where each ended."""
    ended, t_s = [np.array(way_m[0])], 0.0
    c, s = math.cos(turned_rad), math.sin(turned_rad)
    for start_m, end_m in pairwise(np.array(way_m, dtype=float)):
        count = round(float(np.hypot(*(end_m - start_m))) / SECOND_M)
        for _ in range(count):
            step_m = (end_m - start_m) / count
            t_s += 1.0
            ended.append(ended[-1] + step_m)
            trellis.move(np.array([[c, -s], [s, c]]) @ step_m / scale, COVARIANCE_M2, t_s)
    return np.array(ended)


def test_an_elbow_shows_the_error_of_headings_and_the_factor_on_lengths() -> None:
    trellis = begun(ELBOW, (1.0, 0.0))
    truth_m = walk(trellis, [(1.0, 0.0), (30.0, 0.0), (30.0, 28.0)], turned_rad=math.radians(-9.0), scale=0.95)
    spacing_rad = math.radians(9.0) / 2
    assert trellis.mean_bias_rad == pytest.approx(math.radians(9.0), abs=spacing_rad)
    assert trellis.mean_scale == pytest.approx(0.95, abs=0.03)
    assert np.hypot(*(trellis.xy_m - truth_m[-1])) < 1.0  # without a map it would be 6 m off
    assert trellis.resets == 0


def test_the_revised_past_knows_what_the_corner_has_shown() -> None:
    trellis = begun(ELBOW, (1.0, 0.0))
    answers_m = [np.array([1.0, 0.0])]
    real = trellis.move

    def noted(*given: object) -> None:
        real(*given)  # type: ignore[arg-type]
        answers_m.append(trellis.xy_m)

    trellis.move = noted  # type: ignore[method-assign,assignment]
    truth_m = walk(trellis, [(1.0, 0.0), (30.0, 0.0), (30.0, 28.0)], scale=0.9)
    for takes_likeliest in (False, True):
        rows = trellis.path(takes_likeliest=takes_likeliest)
        assert rows[:, 0].tolist() == list(range(len(truth_m)))
        off_m = np.hypot(*(rows[:, 1:3] - truth_m).T)
        before_m = np.hypot(*(np.array(answers_m) - truth_m).T)
        assert off_m.mean() < 0.7 * before_m.mean()


def test_another_level_has_squares_of_its_own() -> None:
    """Levels of a plan that does not compile, since rings touch, are maps of their own."""
    hall = [(0.0, -4.0), (3.0, -4.0), (6.0, -4.0), (6.0, 4.0), (0.0, 4.0)]
    shop = (np.array([[3.0, -4.0], [2.0, -3.0], [4.0, -3.0]]),)
    ground = FloorPolygon("ground", np.array(hall), np.full(8, WALL), 0.0, 0, holes=shop)
    mall = Building("mall", (ground, dataclasses.replace(ELBOW.polygons[0], level=1)))
    trellis = begun(mall, (1.0, 0.0))
    trellis.follow_levels(mall, 0)
    trellis.change_level(1, by_lift=False)
    walk(trellis, [(1.0, 0.0), (12.0, 0.0)])
    assert trellis.level == 1 and trellis.resets == 0
    assert np.ptp(trellis.particles_xy_m[:, 0]) > 4.0  # those beyond the hall below are no one state
    walk(trellis, [(12.0, 0.0), (36.0, 0.0)])  # against its end
    assert trellis.xy_m[0] == pytest.approx(30.5, abs=1.0)


def test_a_fixed_lag_keeps_a_bounded_past_and_agrees_with_the_whole_one_where_that_is_later() -> None:
    way = [(1.0, 0.0), (30.0, 0.0), (30.0, 28.0)]
    whole, short, long = (begun(ELBOW, (1.0, 0.0), lag_s=lag) for lag in (math.inf, 5.0, 1e3))
    for trellis in (whole, short, long):
        walk(trellis, way, scale=0.95)
    rows = [trellis.path(takes_likeliest=False) for trellis in (whole, short, long)]
    assert np.array_equal(rows[0], rows[2])
    assert np.array_equal(rows[0][:, 0], rows[1][:, 0])  # every second once
    assert np.array_equal(rows[0][-6:], rows[1][-6:])  # not final yet
    assert len(short._stages) <= 6 < len(whole._stages)


def test_a_wall_may_be_passed_at_a_price() -> None:
    way = [(2.0, 5.0), (18.0, 5.0)]
    strict, soft = begun(ROOMS, (2.0, 5.0), wall_probability=0.0), begun(ROOMS, (2.0, 5.0))
    for trellis in (strict, soft):
        walk(trellis, way)
    assert np.hypot(*(soft.xy_m - way[-1])) < 1.0
    assert soft.resets == 0
    assert strict.resets > 0  # every path had ended at the wall


def test_survivors_are_of_different_states_and_within_the_limits() -> None:
    trellis = begun(ROOMS, (5.0, 5.0), max_survivors=300)
    walk(trellis, [(5.0, 5.0), (5.0, 8.0), (2.0, 8.0)])
    reached = trellis._reached
    key = lattice_of(ROOMS, 0, TrellisParams().square_m).key(reached.local_m, reached.cell)
    states = np.column_stack([key, reached.scale, reached.bias])
    assert len(np.unique(states, axis=0)) == len(states) <= 300
    assert trellis.fraction.sum() == pytest.approx(1.0)
    assert (reached.log_path <= reached.log_weight + 1e-9).all()  # one of the paths of the sum


def test_a_scan_elsewhere_moves_who_may_be_lost() -> None:
    places = ScanPlaces(np.array([[18.0, 5.0]]), np.zeros(1, dtype=int), np.ones(1), 1.0, 1e-6, 200.0)
    kept, lost = begun(ROOMS, (2.0, 5.0)), begun(ROOMS, (2.0, 5.0))
    for _ in range(6):
        kept.weigh(places, trust=0.5, may_be_lost=False)
        lost.weigh(places, trust=0.5, may_be_lost=True)
    assert kept.xy_m[0] < 10.0
    assert np.hypot(*(lost.xy_m - [18.0, 5.0])) < 2.0


def test_squares_know_the_cell_of_their_middle() -> None:
    lattice = lattice_of(ROOMS, 0, 0.8)
    inside = lattice.cell >= 0
    assert inside.sum() * 0.8**2 == pytest.approx(198.0, rel=0.1)  # area of both rooms
    places_m = np.array([[5.0, 5.0], [15.0, 5.0], [40.0, 40.0]]) - lattice.convex.origin_xy_m
    put_m, cell = lattice.put(places_m, np.zeros(3, dtype=np.int32))
    assert cell[2] == -1
    assert lattice.convex.polygon[cell[:2]].tolist() == [0, 1]
    assert (lattice.convex.outside_m(cell[:2], put_m[:2].astype(np.float32)) <= 0).all()
