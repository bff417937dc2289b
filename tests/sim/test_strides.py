from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pdrbench_sim.people.person import Person
from pdrbench_sim.people.route import Place, navigation_mesh
from pdrbench_sim.people.strides import (
    NATURAL_GAIT,
    SHORT_STRIDE_M,
    GaitError,
    GaitParams,
    report_times_s,
    stances,
    strides,
)
from pdrbench_sim.people.walker import NATURAL_WALK, WalkParams, walk_through


@pytest.fixture(scope="module")
def feet(walks):
    """Rests of every foot of every walk."""
    return [foot for i, walk in enumerate(walks) for foot in stances(walk, np.random.default_rng([9, i]))]


def test_no_stride_crosses_a_wall_and_the_first_has_no_turn(office, feet):
    for rests in feet:
        reached, is_free = office.move(rests.polygon[:-1], rests.xy_m[:-1], rests.xy_m[1:])
        assert (is_free & (reached == rests.polygon[1:])).all()
        true = strides(office, rests)
        assert true.turn_rad[0] == 0
        assert ((true.length_m == 0) | (true.length_m >= SHORT_STRIDE_M)).all()


def test_adding_up_strides_gives_the_path_of_the_foot(office, feet):
    for rests in feet:
        true = strides(office, rests)
        heading_rad = true.heading_rad[0] + np.cumsum(true.turn_rad)
        direction = np.column_stack([np.cos(heading_rad), np.sin(heading_rad)])
        xy_m = rests.xy_m[0] + np.cumsum(true.length_m[:, None] * direction, axis=0)
        np.testing.assert_allclose(xy_m, rests.xy_m[1:], atol=1e-9)
        z_m = office.height(rests.polygon[:1]) + np.cumsum(true.height_m)
        np.testing.assert_allclose(z_m, office.height(rests.polygon[1:]), atol=1e-9)


def test_a_turn_on_the_spot_is_made_of_strides_without_length(two_rooms, person):
    mesh = navigation_mesh(two_rooms)
    # There and back on one line: 180 degrees while standing at the far end.
    walk = walk_through(
        np.random.default_rng(1), mesh, person, [Place(0, [1, 1.45]), Place(1, [7, 1.45]), Place(0, [1, 1.45])]
    )
    for rests in stances(walk, np.random.default_rng(2)):
        true = strides(two_rooms, rests)
        on_spot = np.flatnonzero(true.length_m == 0)
        assert len(on_spot) == 2
        turn_rad = np.abs(true.turn_rad[on_spot].sum())
        # Heading noise of the swaying body at both ends.
        assert turn_rad == pytest.approx(np.pi, abs=0.5)
        np.testing.assert_array_equal(rests.xy_m[on_spot], rests.xy_m[on_spot + 1])


NEAR = 0.02  # of a riser: heights are whole millimetres, and a riser is 15 cm or more


def test_on_stairs_a_stride_climbs_two_treads(office, feet):
    riser_m = 0.0
    for polygon in office.polygons:
        if polygon.id.endswith("-up-01") and polygon.level == 0:
            riser_m = polygon.height_m
    is_tread = np.array([p.kind == "stairs" and not p.id.endswith("-half") for p in office.polygons])
    climbed = []
    for rests in feet:
        true = strides(office, rests)
        on_treads = is_tread[rests.polygon[:-1]] & is_tread[rests.polygon[1:]]
        risers = true.height_m / riser_m
        np.testing.assert_allclose(risers, np.round(risers), atol=NEAR)
        climbed.append(np.abs(risers[on_treads]))
        inside = on_treads & (np.abs(np.abs(risers) - 2) < NEAR)
        # Two treads of 0.28 to 0.30 m, a slant of the lane, and a foot that is 6.5 cm off the body's line.
        assert (np.abs(true.length_m[inside] - 0.58) < 0.06).mean() > 0.95
    climbed = np.concatenate(climbed)
    assert len(climbed) > 100
    assert np.mean(np.abs(climbed - 2) < NEAR) > 0.85  # the rest passes the landing half way up


def test_feet_alternate_and_stay_beside_the_body(walks):
    left, right = stances(walks[0], np.random.default_rng(3))
    mid_s = np.concatenate([left.mid_s[1:], right.mid_s[1:]])
    side = np.concatenate([np.zeros(len(left) - 1), np.ones(len(right) - 1)])[np.argsort(mid_s)]
    assert np.mean(np.diff(side) != 0) > 0.9  # feet meet where a bout ends, and may start with either
    for bout in walks[0].bouts:
        for rests, offset_m in ((left, 0.065), (right, -0.065)):
            during = (rests.mid_s > bout.t_s[0] + 2) & (rests.mid_s < bout.t_s[-1] - 2)
            body_xy_m, _, heading_rad = bout.place(walks[0].building, bout.way_m(rests.mid_s[during]))
            left_side = np.column_stack([-np.sin(heading_rad), np.cos(heading_rad)])
            np.testing.assert_allclose(((rests.xy_m[during] - body_xy_m) * left_side).sum(axis=1), offset_m, atol=1e-6)


def test_rests_are_reported_for_as_long_as_asked(feet):
    for rests in feet:
        reported = report_times_s(rests, 0.21)
        assert (np.diff(rests.mid_s) > 0.6).all()  # 0.35 of a stride is then 0.21 s
        assert (reported >= rests.begin_s - 1e-9).all()
        assert (reported <= rests.mid_s + 1e-9).all()
        assert (reported[1:] + 0.2 < rests.end_s[1:]).all()


def feet_in(corridor, person, walk, gait=NATURAL_GAIT, seed=0, times=1):
    places = [Place(0, [2, 2]), Place(0, [118, 2])] * times
    way = walk_through(np.random.default_rng(seed), navigation_mesh(corridor), person, places, walk)
    return way, stances(way, np.random.default_rng(seed + 1), gait)


@pytest.mark.parametrize(
    ("cadence_hz", "step_m", "fraction"), [(1.5, 0.55, 0.38), (1.8, 0.67, 0.32), (2.1, 0.85, 0.22)]
)
def test_a_foot_rests_longer_at_lower_speed(corridor, cadence_hz, step_m, fraction):
    person = Person(1.7, cadence_hz, step_m, step_slope_m_per_hz=0.3, asymmetry=0.0)
    steady = WalkParams(speed_sigma=0.0, pause_every_s=1e9)
    _, (left, _) = feet_in(corridor, person, steady)
    rested = ((left.end_s - left.begin_s)[1:-1] / (np.diff(left.mid_s)[1:] + np.diff(left.mid_s)[:-1]) * 2)[5:-5]
    # 0.35 at 1 m/s less 0.16 for every metre per second; the step noise makes 3 % of speed.
    assert 0.35 - 0.16 * (cadence_hz * step_m - 1) == pytest.approx(fraction, abs=0.015)
    assert np.median(rested) == pytest.approx(fraction, abs=0.02)


def test_in_a_pause_the_feet_stay_on_the_floor(corridor, person):
    way, feet = feet_in(corridor, person, replace(NATURAL_WALK, pause_every_s=20.0), times=2)
    assert len(way.bouts) > 3
    for rests in feet:
        away_s = rests.begin_s[1:] - rests.end_s[:-1]
        assert (away_s > 0.2).all()
        assert away_s.max() < 1.6 * 0.85  # a stride of 2 s at most, of which the foot rests a fifth or more
        assert (rests.begin_s <= rests.mid_s).all()
        assert (rests.mid_s <= rests.end_s).all()


def test_where_feet_are_set_down_changes_no_time(corridor, person):
    steady = replace(NATURAL_WALK, pause_every_s=1e9, u_turn_fraction=0.0)
    exact, placed = (
        feet_in(corridor, person, steady, replace(NATURAL_GAIT, placing_sigma_m=sigma_m, unsteady_log_sigma=0.0))[1][0]
        for sigma_m in (0, 0.012)
    )
    assert exact.mid_s.tobytes() == placed.mid_s.tobytes()
    shift_m = np.hypot(*(exact.xy_m - placed.xy_m).T)[1:-1]
    # Some 75 rests: known to 8 %.
    assert np.sqrt((shift_m**2).mean()) == pytest.approx(0.012, rel=0.3)
    reached, is_free = corridor.move(placed.polygon[:-1], placed.xy_m[:-1], placed.xy_m[1:])
    assert (is_free & (reached == placed.polygon[1:])).all()


@pytest.mark.parametrize(
    "wrong", [{"rest_fraction": 0.0}, {"rest_fraction": np.nan}, {"step_sigma": -0.1}, {"waited_s": 0.0}]
)
def test_gaits_that_make_no_sense_are_refused(wrong):
    with pytest.raises(GaitError, match=r"fraction of a stride|step_sigma|waited_s"):
        GaitParams(**wrong)
