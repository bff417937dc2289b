"""Displacements of a network second by second."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest
from sample_buildings import bare_ring

from pdrbench.building import WALL, Building, FloorPolygon
from pdrbench.geometry import FloatArray
from pdrbench.localizer import Briefing, Observation
from pdrbench.radio import survey_of_readings
from pdrbench.sensors import sensor_spec
from pdrbench.trajectory import Start
from pdrbench_baselines.fusion.localizer import Fusion
from pdrbench_baselines.learned.reckoning import FADES, GAP_FRACTION, Move, Reckoner, WindowAnswer
from pdrbench_baselines.learned.signals import HORIZON


class Says:
    """A network that says displacements, ahead, one after the other, and then the last one of every window."""

    def __init__(self, *x_m: float) -> None:
        self._x_m = list(x_m)

    def ask(self, features: FloatArray, height_m: float) -> WindowAnswer:
        x_m = self._x_m.pop(0) if len(self._x_m) > 1 else self._x_m[0]
        return WindowAnswer(np.array([x_m, 0.0]), 0.2 * np.eye(2), -9.0)


def level_rows(seconds: float, shaking_mps2: float = 2.0) -> dict[str, FloatArray]:
    """Of a level phone, ahead along x, that steps shake up and down with a period of 0.55 s."""
    t_s = np.arange(0.0, seconds, 0.02)
    columns = {"accel": [0.0, 0.0, 9.81], "gyro": [0.0, 0.0, 0.0], "rotation": [1.0, 0.0, 0.0, 0.0]}
    rows = {name: np.column_stack([t_s, np.tile(row, (len(t_s), 1))]) for name, row in columns.items()}
    rows["accel"][:, 3] += shaking_mps2 * np.sin(2 * np.pi * 2 / 1.1 * t_s)
    return rows


@pytest.mark.parametrize("shaking_mps2", [0.2, 2.0])
def test_a_phone_that_hardly_shakes_is_at_rest_whatever_a_network_says(shaking_mps2: float) -> None:
    moves = list(Reckoner(Says(1.0), briefing()).update(level_rows(3.5, shaking_mps2)))
    assert [(move.stands, move.move_m[0]) for move in moves] == [(shaking_mps2 < 1.0, shaking_mps2 > 1.0)] * 3


@pytest.mark.parametrize(("strength_ut", "part"), [(50.0, 0.5), (400.0, 0.0)])
def test_half_of_the_compass_is_the_field_where_that_is_the_earths(strength_ut: float, part: float) -> None:
    """A field that lies 0.6 rad west of the rotation vector's north; a magnet in the phone says nothing."""
    rows = level_rows(3.5)
    t_s = rows["accel"][:, 0]
    north = strength_ut * np.array([-np.sin(0.6), np.cos(0.6), -1.0]) / np.sqrt(2.0)
    rows["mag"] = np.column_stack([t_s, np.tile(north, (len(t_s), 1))])
    with_field = dataclasses.replace(briefing(), sensors=dict(briefing().sensors) | {"mag": sensor_spec("mag")})
    for move in Reckoner(Says(1.0), with_field).update(rows):
        assert np.arctan2(move.move_m[1], move.move_m[0]) == pytest.approx(-part * 0.6, abs=1e-6)
        assert move.compass_rad == pytest.approx(-part * 0.6, abs=1e-6)


class Rocks:
    """A network that says the root mean square of what rocks the phone in the last second, ahead."""

    def ask(self, features: FloatArray, height_m: float) -> WindowAnswer:
        x_m = float(np.sqrt((features[:3, -HORIZON:] ** 2).mean()))
        return WindowAnswer(np.array([x_m, 0.0]), 0.2 * np.eye(2), -9.0)


def rocking_rows(seconds: float, *gaps_s: tuple[float, float]) -> dict[str, FloatArray]:
    """Of a level phone that rocks with a period of 1.1 s and half of it, without samples in the gaps."""
    rows = level_rows(seconds)
    t_s = rows["accel"][:, 0]
    rows["accel"][:, 1] += 0.5 * np.sin(2 * np.pi / 1.1 * t_s)
    kept = np.logical_and.reduce([(t_s < begin_s) | (t_s > end_s) for begin_s, end_s in gaps_s])
    return {name: one[kept] for name, one in rows.items()}


def rocked(*gaps_s: tuple[float, float]) -> list[Move]:
    reckoner, rows = Reckoner(Rocks(), briefing()), rocking_rows(20.5, *gaps_s)
    moves: list[Move] = []
    for now_s in np.arange(0.2, 20.6, 0.2):
        moves += reckoner.update(
            {name: one[(one[:, 0] > now_s - 0.2) & (one[:, 0] <= now_s)] for name, one in rows.items()}
        )
    return moves


def test_what_a_gap_hides_goes_on_as_before() -> None:
    """A gait of one period is restored: the same displacement within 5 cm, and a covariance that grows by the gap."""
    whole, bridged = rocked((99, 100)), rocked((9.3, 10.0))
    assert [len(each) for each in (whole, bridged)] == [20, 20]
    assert not any(move.is_guess for move in whole)
    for number, (move, usual) in enumerate(zip(bridged, whole, strict=True)):
        assert move.is_guess == (number == 9)
        np.testing.assert_allclose(move.move_m, usual.move_m, atol=0.05)
    doubt_m2 = bridged[9].covariance_m2 - whole[9].covariance_m2
    np.testing.assert_allclose(doubt_m2, 0.7 * GAP_FRACTION * bridged[9].move_m[0] ** 2 * np.eye(2), rtol=0.1)


def test_a_gap_that_leaves_too_little_to_go_on_from_fades_slowly() -> None:
    """A second of the window has to come before the gap; before the first second that is known all fade backwards."""
    early, usual = rocked((0.6, 2.4)), rocked((99, 100))
    assert [move.end_s for move in early] == [move.end_s for move in usual]
    assert [number for number, move in enumerate(early) if move.is_guess] == [0, 1, 2]
    for before, move in itertools.pairwise(early[:4]):
        np.testing.assert_allclose(before.move_m, FADES * move.move_m)
    np.testing.assert_allclose([move.move_m for move in early[3:]], [move.move_m for move in usual[3:]], atol=0.05)
    moves = rocked((9.05, 16.45))
    spread_m2 = [move.covariance_m2[0, 0] for move in moves]
    assert [number for number, move in enumerate(moves) if move.is_guess] == [9, 10, 11, 12, 13, 14, 15, 16]
    np.testing.assert_allclose([move.move_m[0] for move in moves[9:11]], moves[8].move_m[0], atol=0.05)
    for before, move in itertools.pairwise(moves[11:16]):
        assert move.move_m[0] == pytest.approx(FADES * before.move_m[0])
    assert (np.diff(spread_m2[8:16]) > 0).all() and not moves[17].is_guess


def test_lengths_are_multiplied() -> None:
    (move,) = Reckoner(Says(1.2), briefing(), length_factor=0.5).update(level_rows(1.5))
    np.testing.assert_allclose(move.move_m, (0.6, 0.0))


def briefing(*, rotation: bool = True, surveyed: bool | None = None) -> Briefing:
    """A phone in the corridor, from a known start; a survey of two places, surveyed or interpolated, or None."""
    names = ("accel", "gyro", "rotation" if rotation else "mag")
    sensors = {name: dataclasses.replace(sensor_spec(name), rate_hz=50.0) for name in names}
    radio_map = None
    if surveyed is not None:
        sensors["wifi"] = sensor_spec("wifi")
        readings, nothing = np.array([[1.0, -50.0, 0.0], [1.0, -70.0, 0.0]]), np.zeros(2, dtype=np.int64)
        places_m = np.array([[0.0, 0.0], [10.0, 0.0]])
        radio_map = survey_of_readings(places_m, nothing, np.arange(2), [1, 1], readings, surveyed=surveyed)
    return Briefing(bare_ring(), sensors, 0.2, Start(np.zeros(2), 0), radio_map)


def test_a_level_that_changes_before_the_first_scan_is_no_evidence() -> None:
    from_nowhere = briefing(surveyed=True)
    sensors = dict(from_nowhere.sensors) | {"level_change": sensor_spec("level_change")}
    from_nowhere = dataclasses.replace(from_nowhere, start=None, sensors=sensors)
    widths = {"accel": 4, "gyro": 4, "rotation": 5, "wifi": 5, "level_change": 4}
    empty = {name: np.zeros((0, width)) for name, width in widths.items()}
    answers_m = []
    for changes in (np.array([[0.5, 1.0, 3.0, 0.0]]), empty["level_change"]):
        localizer = Fusion()
        localizer.reset(from_nowhere, np.random.default_rng(0))
        localizer.step(Observation(0.6, empty | {"level_change": changes}))
        scan = np.array([[0.8, 1.0, -50.0, 0.0, 0.0]])
        answers_m.append(localizer.step(Observation(1.0, empty | {"wifi": scan})).xy_m)
    np.testing.assert_array_equal(answers_m[0], answers_m[1])


def test_the_radio_map_covers_all_floor_where_the_start_is_known_and_is_fitted_anew_for_another_survey() -> None:
    ring = np.array([(0.0, 0.0), (90.0, 0.0), (90.0, 6.0), (0.0, 6.0)])
    hall = Building("hall", (FloorPolygon("hall", ring, np.full(4, WALL), 0.0, 0),))
    localizer, reach_m = Fusion(), []
    for places in (2, 3):
        xy_m, level, counts = np.tile([5.0, 3.0], (places, 1)), np.zeros(places, np.int64), [1] * places
        survey = survey_of_readings(xy_m, level, level, counts, np.tile([1.0, -50.0, 0.0], (places, 1)), surveyed=False)
        known = dataclasses.replace(briefing(surveyed=False), building=hall, radio_map=survey)
        for one in (known, dataclasses.replace(known, start=None), known):
            localizer.reset(one, np.random.default_rng(0))
            assert localizer._radio is not None and localizer._radio.radio_map is survey
            reach_m.append(float(localizer._radio.xy_m[:, 0].max()))
    assert all(reach > 86.0 for reach in (*reach_m[::3], *reach_m[2::3])) and all(
        reach < 30.0 for reach in reach_m[1::3]
    )
