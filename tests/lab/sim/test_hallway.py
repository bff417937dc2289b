from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pdrbench.building import Building
from pdrbench.recording import Recording
from pdrbench_lab.papers.frank2009.experiments import mean_speed_mps
from pdrbench_lab.papers.frank2009.wlan_hallway.hallway import (
    CONCRETE,
    HALLWAY,
    HALLWAY_PEOPLE,
    HALLWAY_WLAN,
    LAP_M,
    LAPS,
    NUM_ACCESS_POINTS,
    NUM_MARKS,
    SCANS_A_POINT,
    calibration_points_m,
    make_hallway,
    make_hallway_radio,
    marks_xy_m,
    record_hallway,
    survey_hallway,
    way_of_laps,
)
from pdrbench_sim.people.person import PersonParams
from pdrbench_sim.record import make_scene, simulate_walk

SEED = [7, 1]


@pytest.fixture(scope="module")
def building() -> Building:
    return make_hallway()


@pytest.fixture(scope="module")
def recording(building: Building) -> Recording:
    return recorded(building)


def recorded(building: Building, people: PersonParams = HALLWAY_PEOPLE) -> Recording:
    scene = make_scene(np.random.default_rng(1), building, magnetic=CONCRETE)
    radio = make_hallway_radio(np.random.default_rng(2), building)
    return record_hallway(scene, radio, SEED, np.random.default_rng(3), people=people)


def test_other_people_pass_the_same_marks_at_their_own_pace(building: Building, recording: Recording) -> None:
    slow, other = recording.reference, recorded(building, PersonParams()).reference
    assert slow.xy_m.tolist() == other.xy_m.tolist()
    slow_mps, other_mps = mean_speed_mps(slow), mean_speed_mps(other)
    assert 0.7 < slow_mps < 0.9 * other_mps < 1.5
    even = replace(other, t_s=np.linspace(0.0, 10.0, len(other.t_s)))
    assert mean_speed_mps(even) == pytest.approx((LAPS - 1 + (NUM_MARKS - 1) / NUM_MARKS) * LAP_M / 10.0, rel=0.02)


def test_every_room_has_a_way_out(building: Building) -> None:
    """All rooms lead to the hallway, and marks and calibration points lie in it."""
    hallway = next(i for i, polygon in enumerate(building.polygons) if polygon.id == "corridor")
    for number, polygon in enumerate(building.polygons):
        if number != hallway:
            assert hallway in polygon.neighbour
    places = np.concatenate([marks_xy_m(), HALLWAY.xy_m(calibration_points_m())])
    assert (building.locate(places, 0) == hallway).all()


def test_the_lap_closes_and_has_the_heading_of_its_path() -> None:
    s_m = np.arange(0.05, LAP_M, 0.1)
    step = np.diff(HALLWAY.xy_m(s_m), axis=0)
    along = np.column_stack([np.cos(HALLWAY.heading_rad(s_m)), np.sin(HALLWAY.heading_rad(s_m))])[:-1]
    straight = np.hypot(*step.T) > 0.0999
    np.testing.assert_allclose((step * along).sum(axis=1)[straight], 0.1, atol=1e-9)
    np.testing.assert_allclose(HALLWAY.xy_m(np.array([LAP_M + 3.0])), HALLWAY.xy_m(np.array([3.0])))


def test_sizes_of_the_paper() -> None:
    points_m = calibration_points_m()
    assert len(marks_xy_m()) == NUM_MARKS
    assert np.diff(points_m) == pytest.approx(2.5, abs=0.05)  # every 2.5 m, the lap divided evenly
    nearest_m = np.hypot(*(marks_xy_m()[:, None] - HALLWAY.xy_m(points_m)).T).min(axis=0)
    assert 0.2 < (nearest_m < 0.5).mean() < 1.0  # some coincide, not all


def test_a_survey_is_what_a_laptop_measures_along_its_route(building: Building) -> None:
    radio = make_hallway_radio(np.random.default_rng(2), building)
    survey = survey_hallway(np.random.default_rng(4), radio)
    places, counts = np.unique(survey.xy_m, axis=0, return_counts=True)
    assert len(places) == len(calibration_points_m()) and (counts == SCANS_A_POINT).all()
    assert len(np.unique(survey.access_point)) <= NUM_ACCESS_POINTS
    assert not survey.age_s.any() and survey.surveyed
    # At each point at least three access points (F3).
    point = survey.walk[np.repeat(np.arange(len(survey)), np.diff(survey.first))]
    num_received = [len(np.unique(survey.access_point[point == p])) for p in range(len(places))]
    assert min(num_received) >= 3


def test_slight_motion_spreads_received_strengths(building: Building) -> None:
    """With neither fading nor rounding there would be one reading; the motion of decimetres leaves a histogram."""
    from dataclasses import replace

    still = replace(HALLWAY_WLAN, fading_sigma_db=0.0, body_loss_db=(5.0, 5.0), shadow_length_m=1.0)
    radio = make_hallway_radio(np.random.default_rng(2), building, still)
    spread = []
    for motion_m in (0.0, 0.2):
        survey = survey_hallway(np.random.default_rng(4), radio, motion_m)
        point = survey.walk[np.repeat(np.arange(len(survey)), np.diff(survey.first))]
        pairs = {(p, a) for p, a in zip(point.tolist(), survey.access_point.tolist(), strict=True)}
        spread.append(np.mean([np.ptp(survey.rssi_dbm[(point == p) & (survey.access_point == a)]) for p, a in pairs]))
    assert spread[0] == 0.0
    assert spread[1] > 0.5


def test_every_mark_is_passed_in_every_lap(recording: Recording) -> None:
    reference = recording.reference
    assert len(reference) == LAPS * NUM_MARKS and reference.surveyed.all()
    for lap in range(1, LAPS):
        rows = slice(lap * NUM_MARKS, (lap + 1) * NUM_MARKS)
        np.testing.assert_allclose(reference.xy_m[rows], reference.xy_m[:NUM_MARKS], atol=1e-9)
    apart_m = np.linalg.norm(reference.xy_m[:NUM_MARKS, None] - marks_xy_m(), axis=2)
    assert apart_m.min(axis=0).max() < 1e-3 and apart_m.min(axis=1).max() < 1e-3  # whole millimetres
    speed_mps = np.hypot(*np.diff(reference.xy_m, axis=0).T) / np.diff(reference.t_s)
    assert 0.7 < np.median(speed_mps) < 1.4


def test_the_pedestrian_is_at_the_mark_at_its_time(recording: Recording, building: Building) -> None:
    """Feet are set down beside the marks: within half a stride along and some decimetres across."""
    scene = make_scene(np.random.default_rng(1), building, magnetic=CONCRETE)
    from pdrbench_lab.papers.frank2009.wlan_hallway.hallway import HALLWAY_PEOPLE, HALLWAY_WALK, ON_FOOT_WITH_FIELD
    from pdrbench_sim.people.person import draw_person

    for_way, for_person, _ = np.random.default_rng(3).spawn(3)
    places = way_of_laps(building, is_clockwise=bool(for_way.random() < 0.5))
    person = draw_person(for_person, HALLWAY_PEOPLE)
    foot = simulate_walk(
        scene, SEED, ON_FOOT_WITH_FIELD, duration_s=3600.0, person=person, places=places, walk=HALLWAY_WALK
    ).reference
    xy_m = np.column_stack([np.interp(recording.reference.t_s, foot.t_s, column) for column in foot.xy_m.T])
    off_m = np.hypot(*(xy_m - recording.reference.xy_m).T)
    assert off_m.max() < 0.5 and off_m.mean() < 0.15


def test_scans_come_every_second_with_nothing_stale(recording: Recording) -> None:
    rows = recording.streams["wifi"].rows
    assert not rows[:, 4].any()
    assert np.diff(np.unique(rows[:, 0])).min() == pytest.approx(1.0)
    assert len(np.unique(rows[:, 0])) > 0.98 * recording.reference.t_s[-1]


def test_no_map_is_handed_out(recording: Recording) -> None:
    """F14."""
    assert recording.building is None
