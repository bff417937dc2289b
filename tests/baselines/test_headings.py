"""Headings of particles: kept while the mean of the compass moves, chosen by it, anything for who is carried away."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
import pytest
from sample_buildings import bare_ring

from pdrbench.geometry import FloatArray
from pdrbench.inertial import to_world
from pdrbench.localizer import Briefing
from pdrbench.radio import survey_of_readings
from pdrbench.sensors import sensor_spec
from pdrbench.trajectory import Start
from pdrbench_baselines.fusion.cloud import Cloud
from pdrbench_baselines.fusion.compass import CompassMean, CompassParams
from pdrbench_baselines.fusion.radio import RadioEvidence
from pdrbench_baselines.gp_wifi.localizer import GpWifiParams
from pdrbench_baselines.learned.map_filter import LearnedMapFilterParams, motion_of
from pdrbench_baselines.learned.reckoning import ALIGNED_AFTER_M, Move, Reckoner, WindowAnswer
from pdrbench_baselines.learned.yaw_stabiliser import YawStabiliser

PARAMS = CompassParams()


class Walks:
    """A network that says a metre ahead of every window."""

    def ask(self, features: FloatArray, height_m: float) -> WindowAnswer:
        return WindowAnswer(np.array([1.0, 0.0]), 0.2 * np.eye(2), -9.0)


def briefing(*sensors: str, heading_rad: float | None = None) -> Briefing:
    specs = {name: dataclasses.replace(sensor_spec(name), rate_hz=50.0) for name in sensors}
    return Briefing(bare_ring(), specs, 0.2, Start(np.zeros(2), 0, heading_rad=heading_rad), None)


def disturbed(seconds: float) -> dict[str, FloatArray]:
    """Rows of a flat phone that steps shake, not turn, while its compass runs away by 0.05 rad a second."""
    t_s = np.arange(0.0, seconds, 0.02)
    nothing, half_rad = np.zeros_like(t_s), 0.05 * t_s / 2
    return {
        "accel": np.column_stack([t_s, nothing, nothing, 9.81 + 2.0 * np.sin(11.4 * t_s)]),
        "gyro": np.column_stack([t_s, nothing, nothing, nothing]),
        "rotation": np.column_stack([t_s, np.cos(half_rad), nothing, nothing, np.sin(half_rad)]),
    }


def after(rows: dict[str, FloatArray], parts: Sequence[float]) -> list[Move]:
    reckoner, moves = Reckoner(Walks(), briefing(*rows)), []
    for low, high in zip([0.0, *parts], [*parts, np.inf], strict=True):
        some = {name: one[(one[:, 0] >= low) & (one[:, 0] < high)] for name, one in rows.items()}
        moves += list(reckoner.update(some))
    return moves


def test_the_mean_of_the_compass_is_what_parts_the_steady_yaw_from_the_gyroscope() -> None:
    rows, steady = disturbed(6.0), YawStabiliser()
    given = steady.update(rows["rotation"], rows["gyro"])
    yaw_rad = 2 * np.arctan2(given[:, 4], given[:, 1])
    np.testing.assert_allclose(yaw_rad - steady.means_rad, 0.0, atol=1e-9)  # the gyroscope does not turn
    assert steady.means_rad[0] == 0.0 and steady.means_rad[-1] == pytest.approx(0.05 * 6.0 / 2, rel=0.02)
    assert len(steady.update(np.zeros((0, 5)), np.zeros((0, 4)))) == len(steady.means_rad) == 0


def test_a_second_says_how_far_its_frame_was_turned_to_the_compass_however_rows_come() -> None:
    rows = disturbed(6.0)
    whole, parts = after(rows, []), after(rows, np.arange(0.3, 6.0, 0.31).tolist())
    said_rad = [math.nan if move.compass_rad is None else move.compass_rad for move in whole]
    np.testing.assert_allclose(said_rad, [0.05 * (k + 0.5) / 2 for k in range(len(whole))], atol=2e-3)
    assert len(whole) == 5 and said_rad == [move.compass_rad for move in parts]


@pytest.mark.parametrize(("sensors", "has_compass"), [(("rotation",), True), (("mag",), True), ((), False)])
def test_without_a_compass_no_mean_is_reported(sensors: tuple[str, ...], has_compass: bool) -> None:
    rows = {name: one for name, one in disturbed(5.0).items() if name in ("accel", "gyro", *sensors)}
    if "mag" in sensors:
        rows["mag"] = np.column_stack([rows["accel"][:, 0], np.tile([0.0, 20.0, -40.0], (len(rows["accel"]), 1))])
    reckoner = Reckoner(Walks(), briefing(*rows, heading_rad=0.0))
    moves = list(reckoner.update(rows))
    assert moves and reckoner.has_compass == has_compass
    assert all((move.compass_rad is not None) == has_compass for move in moves)


def test_without_a_compass_the_first_two_metres_lead_along_the_heading_of_the_start() -> None:
    """Wherever the phone points: this one lies turned by 1.2 rad, as in a pocket, and its network says ahead of it."""
    turn = np.array([math.cos(0.6), 0.0, 0.0, math.sin(0.6)])
    rows = {name: one for name, one in disturbed(6.0).items() if name != "rotation"}
    rows = {name: np.column_stack([one[:, 0], to_world(turn, one[:, 1:])]) for name, one in rows.items()}
    reckoner, moves = Reckoner(Walks(), briefing(*rows, heading_rad=2.0)), []
    for begin_s in np.arange(0.0, 6.0, 0.5):
        some = {name: one[(one[:, 0] >= begin_s) & (one[:, 0] < begin_s + 0.5)] for name, one in rows.items()}
        given = list(reckoner.update(some))
        assert not given or begin_s + 0.5 > ALIGNED_AFTER_M  # seconds, of a metre each
        moves += given
    assert len(moves) >= 4
    np.testing.assert_allclose(
        [move.move_m for move in moves], [[math.cos(2.0), math.sin(2.0)]] * len(moves), atol=0.02
    )


def test_what_the_mean_says_of_a_heading_adds_up_to_what_it_says_at_last() -> None:
    """Of headings that the gyroscope keeps, gains of all updates are the density at last over that at first."""
    off_rad, compass, gain = np.radians([-30.0, 0.0, 4.0, 90.0]), CompassMean(PARAMS), np.zeros(4)
    first_rad, at_first_rad = off_rad, compass.spread_rad
    for k, mean_rad in enumerate([0.02, -0.1, 0.05, 0.07]):
        before_rad, off_rad = off_rad, off_rad - compass.update(mean_rad, 4.0 * (k + 1))
        gain += compass.log_gain(before_rad, off_rad)
    np.testing.assert_allclose(off_rad, first_rad - 0.07)

    def log_density(of_rad: FloatArray, spread_rad: float) -> FloatArray:
        return -0.5 * (PARAMS.freedom + 1) * np.log1p((of_rad / spread_rad) ** 2 / PARAMS.freedom)

    expected = log_density(off_rad, compass.spread_rad) - log_density(first_rad, at_first_rad)
    np.testing.assert_allclose(gain, expected, atol=1e-12)
    assert at_first_rad == pytest.approx(math.hypot(PARAMS.sigma_rad, PARAMS.early_sigma_rad))
    assert PARAMS.sigma_rad < compass.spread_rad < at_first_rad


def turned_cloud(mean_rad: float) -> FloatArray:
    """(N,) headings, as the gyroscope has them, of a cloud whose compass has moved by so much within eight seconds."""
    compass = CompassMean(PARAMS)
    params = LearnedMapFilterParams(num_particles=4000, bias_sigma_rad=compass.spread_rad)
    cloud = Cloud(bare_ring(), np.random.default_rng(7), params, 0, None)
    cloud.begin_near(np.zeros(2))
    for k in range(8):
        cloud.turn(compass.update(mean_rad * (k + 1) / 8, k + 1.0), compass)
    return cloud.bias_rad + mean_rad


def test_headings_follow_a_compass_that_settles_and_not_one_that_goes_astray() -> None:
    """By a few degrees, all of the way that Bayes' rule says; by a right angle, hardly at all."""
    for off_deg, low, high in ((3.0, 0.55, 1.1), (90.0, 0.0, 0.3)):
        headings_rad = turned_cloud(math.radians(off_deg))
        assert low < float(np.median(headings_rad)) / math.radians(off_deg) < high
    assert turned_cloud(0.0).std() < math.hypot(PARAMS.sigma_rad, PARAMS.early_sigma_rad)  # the mean is known better


def test_a_motion_ends_where_the_turned_heading_leads() -> None:
    move = Move(1.0, np.array([1.0, 0.0]), 1e-4 * np.eye(2), False, False)
    motion = motion_of(move, LearnedMapFilterParams(near_m=1e-3), 0.3)
    before = np.array([[0.0, 0.0, 0.0, 0.3]])
    straight, bent = np.array([[1.0, 0.0, 0.0, 0.0]]), np.array([[math.cos(0.3), math.sin(0.3), 0.0, 0.3]])
    assert motion(before, straight)[0, 0] == pytest.approx(0.0, abs=1e-9)
    assert motion(before, bent)[0, 0] < -10.0


def test_who_is_carried_away_may_walk_in_any_direction() -> None:
    """Half of those; a mean of headings on both sides of backwards is backwards, not ahead."""
    places_m, readings = np.array([[0.0, 0.0], [10.0, 0.0]]), np.array([[1.0, -50.0, 0.0], [1.0, -70.0, 0.0]])
    survey = survey_of_readings(places_m, np.zeros(2, np.int64), np.arange(2), [1, 1], readings, surveyed=True)
    radio = RadioEvidence(survey, bare_ring(), GpWifiParams(), 1.0)
    nothing = np.zeros((len(radio.xy_m), len(radio.prior)))
    turned = []
    for turned_fraction in (0.0, 0.5):
        params = LearnedMapFilterParams(num_particles=4000, bias_sigma_rad=0.1)
        cloud = Cloud(bare_ring(), np.random.default_rng(3), params, 0, radio)
        cloud.begin_near(np.zeros(2))
        cloud.weigh_by(nothing, 0.4, turned_fraction)
        turned.append(float((np.abs(cloud.bias_rad) > 0.5).mean()))
    expected = 0.4 * 0.5 * (1.0 - 0.5 / math.pi)
    assert turned[0] == 0.0 and turned[1] == pytest.approx(expected, abs=4 * math.sqrt(expected / 4000))
    cloud.bias_rad = np.array([3.0, -3.0])
    assert abs(cloud.mean_bias_rad) == pytest.approx(math.pi)
