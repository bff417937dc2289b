from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from pdrbench.errors import PdrbenchError, RecordingError
from pdrbench_lab.papers.frank2009.wlan_hallway.hallway import make_hallway
from pdrbench_lab.papers.li2012.corridor_phone.corridor import (
    CORRIDOR,
    PHONES,
    Laps,
    draw_laps,
    make_corridor,
    make_corridor_scene,
    record_laps,
    start_heading_rad,
    tapped,
)
from pdrbench_lab.papers.li2012.handling import record_handling
from pdrbench_lab.papers.ring_floor import RingFloor, corridor_polygon, make_ring
from pdrbench_sim.people.person import draw_person
from pdrbench_sim.people.route import Place


@pytest.fixture(scope="module")
def scene():
    return make_corridor_scene(np.random.default_rng(0))


@pytest.fixture(scope="module")
def phones(scene):
    """Both phones of one lap."""
    person, laps = draw_person(np.random.default_rng(1)), Laps(10.0, is_clockwise=True)
    return laps, {place: record_laps(scene, [3, 1], laps, person, setup) for place, setup in PHONES.items()}


def test_the_middle_line_is_that_of_the_paper():
    assert CORRIDOR.lap_m == 92.0
    corners = CORRIDOR.xy_m(CORRIDOR.corners_m)
    np.testing.assert_allclose(np.ptp(corners, axis=0), [31.0, 15.0])


def test_places_on_the_middle_line_are_found_again_also_from_beside_it():
    along_m = np.linspace(0.0, 91.9, 300)
    xy_m = CORRIDOR.xy_m(along_m)
    np.testing.assert_allclose(CORRIDOR.along_m(xy_m), along_m, atol=1e-9)
    heading_rad = CORRIDOR.heading_rad(along_m)
    aside = 0.9 * np.column_stack([-np.sin(heading_rad), np.cos(heading_rad)])
    corner_m = np.abs(np.mod(along_m[:, None] - CORRIDOR.corners_m + 46, 92) - 46).min(axis=1)
    straight = corner_m > 1.0
    np.testing.assert_allclose(CORRIDOR.along_m(xy_m + aside)[straight], along_m[straight], atol=1e-9)


def test_the_hallway_of_frank_et_al_is_another_ring():
    ours, theirs = make_ring(RingFloor(36.0, 16.0, 2.4), "hallway"), make_hallway()
    assert [polygon.id for polygon in ours.polygons] == [polygon.id for polygon in theirs.polygons]
    for one, other in zip(ours.polygons, theirs.polygons, strict=True):
        assert one.outline_xy_m.tobytes() == other.outline_xy_m.tobytes()
        assert np.array_equal(one.neighbour, other.neighbour)


def test_closed_doors_are_walls_and_open_ones_are_not():
    is_open = make_ring(dataclasses.replace(CORRIDOR, is_open=True), "open")
    assert len(is_open.polygons) == len(make_corridor().polygons) == 1 + 2 * 8 + 2 * 4 + 2 * 7
    corridor = {building: int(corridor_polygon(building, 1)[0]) for building in (is_open, make_corridor())}
    ways = [int((building.polygons[number].neighbour >= 0).sum()) for building, number in corridor.items()]
    assert ways == [len(is_open.polygons) - 1, 0]


def test_a_plan_that_cannot_be_is_refused():
    with pytest.raises(PdrbenchError, match="wider than its corridor"):
        RingFloor(10.0, 2.0, 2.0)
    with pytest.raises(PdrbenchError, match="rooms of some depth"):
        RingFloor(10.0, 5.0, 2.0, rooms_inside=0)


@pytest.mark.parametrize("is_clockwise", [False, True])
def test_laps_pass_every_corner_and_end_where_they_began(is_clockwise):
    building = make_corridor()
    for count in (1, 3):
        places = Laps(40.0, is_clockwise, count).places(building)
        assert len(places) == 4 * count + 2
        xy_m = np.array([place.xy_m for place in places])
        np.testing.assert_allclose(xy_m[0], xy_m[-1])
        assert np.hypot(*np.diff(xy_m, axis=0).T).sum() == pytest.approx(92.0 * count)
        along_m = np.unwrap(CORRIDOR.along_m(xy_m), period=92.0)
        assert (along_m[-1] < along_m[0]) == is_clockwise


def test_laps_begin_anywhere_but_in_a_corner():
    begin_m = np.array([draw_laps(np.random.default_rng(seed)).begin_m for seed in range(200)])
    assert np.abs(np.mod(begin_m[:, None] - CORRIDOR.corners_m + 46, 92) - 46).min() >= 3.0
    assert len(np.unique(np.searchsorted(CORRIDOR.corners_m, begin_m))) == 4


def test_a_lap_leads_once_round_the_corridor_within_its_walls(phones):
    laps, recordings = phones
    reference = recordings["hand"].reference
    along_m = np.unwrap(CORRIDOR.along_m(reference.xy_m), period=92.0)
    assert along_m[0] == pytest.approx(laps.begin_m, abs=0.3)
    assert along_m[-1] - along_m[0] == pytest.approx(-92.0, abs=1.0)
    middle_m = CORRIDOR.xy_m(along_m)
    # A corner cut by a radius of 1.2 m is 0.5 m off the middle line's corner.
    assert np.hypot(*(reference.xy_m - middle_m).T).max() < CORRIDOR.width_m / 2
    assert reference.t_s[1] - reference.t_s[0] == pytest.approx(0.5)


def test_two_phones_of_a_lap_have_the_same_walk_and_different_measurements(phones):
    _, recordings = phones
    hand, pocket = recordings["hand"], recordings["pocket"]
    assert hand.reference.xy_m.tobytes() == pocket.reference.xy_m.tobytes()
    assert (hand.mounting, pocket.mounting) == ("hand", "pocket")
    for name in ("accel", "gyro", "mag", "rotation"):
        assert hand.streams[name].spec.rate_hz == 50.0
        assert not np.array_equal(hand.streams[name].rows[:, 1:], pocket.streams[name].rows[:, 1:])


def test_taps_are_off_by_half_a_metre_and_stay_in_the_corridor():
    building = make_corridor()
    at_m = CORRIDOR.xy_m(np.array([12.0]))[0]
    taps = [tapped(at_m, np.random.default_rng(seed)) for seed in range(400)]
    xy_m = np.array([tap.xy_m for tap in taps])
    polygon = building.locate(xy_m, np.zeros(len(xy_m), dtype=np.int64))
    assert (polygon == corridor_polygon(building, len(xy_m))).all()
    # Along the corridor nothing is cut off; the standard error of a sigma of 400 is 3.5 %.
    assert np.std(xy_m[:, 0]) == pytest.approx(0.5, rel=0.11)
    assert np.mean(np.hypot(*(xy_m - at_m).T) < taps[0].radius_m) > 0.99


def test_a_heading_is_given_for_a_pocket_only():
    assert start_heading_rad(Laps(10.0), "hand") is None
    assert start_heading_rad(Laps(10.0), "pocket") == pytest.approx(0.0)
    assert start_heading_rad(Laps(40.0, is_clockwise=True), "pocket") == pytest.approx(-math.pi / 2)


def test_a_handled_phone_stays_where_it_is_and_does_not_rest(scene):
    place = Place(int(corridor_polygon(scene.building, 1)[0]), CORRIDOR.xy_m(np.array([20.0]))[0])
    recording = record_handling(scene, [5], place, duration_s=60.0)
    again = record_handling(scene, [5], place, duration_s=60.0)
    assert np.ptp(recording.reference.xy_m, axis=0).tolist() == [0.0, 0.0]
    accel = np.linalg.norm(recording.streams["accel"].rows[:, 1:], axis=1)
    assert accel.mean() == pytest.approx(9.81, abs=0.6)  # bursts of up to 1.5 g lengthen it
    assert accel.std() > 0.2
    for name, stream in recording.streams.items():
        assert stream.rows.tobytes() == again.streams[name].rows.tobytes()
        assert len(stream.rows) == pytest.approx(3000, abs=3)
    with pytest.raises(RecordingError, match="two seconds"):
        record_handling(scene, [5], place, duration_s=math.nan)
