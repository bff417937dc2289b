"""Learned stride and heading: frames, gaps, units, weights, the map, WLAN."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from sample_buildings import bare_ring

from pdrbench.errors import RecordingError, UnsuitableError
from pdrbench.geometry import FloatArray
from pdrbench.inertial import to_world
from pdrbench.inertial.quaternions import multiply
from pdrbench.localizer import Briefing, Observation
from pdrbench.recording import RadioMap
from pdrbench.sensors import sensor_spec
from pdrbench.trajectory import Start
from pdrbench_baselines.gp_wifi.scan_places import ScanLocator
from pdrbench_baselines.learned.compiled import compiled_network
from pdrbench_baselines.learned.localizer import Learned
from pdrbench_baselines.learned.map_filter import LearnedMapFilter, LearnedMapFilterParams
from pdrbench_baselines.learned.reckoning import Reckoner
from pdrbench_baselines.learned.row_checks import check_rows
from pdrbench_baselines.learned.signals import grid_signals, turned

SENSORS = ("accel", "gyro", "rotation")


def phone(rng: np.random.Generator, seconds: float = 9.0, rate_hz: float = 50.0) -> dict[str, FloatArray]:
    """Rows of a phone that is shaken about a tilted attitude."""
    t_s = np.arange(0, seconds, 1 / rate_hz)
    swing = [np.sin(2 * np.pi * f * t_s[:, None] + rng.uniform(0, 6, 3)) for f in (0.9, 1.8, 3.6)]
    accel = np.array([0.0, 4.0, 9.0]) + sum(swing)
    gyro = 0.5 * swing[0]
    half = 0.2 + 0.05 * np.sin(t_s)
    rotation = np.column_stack([np.cos(half), np.sin(half), 0.1 * np.sin(half), 0.3 * np.ones(len(t_s))])
    rotation /= np.linalg.norm(rotation, axis=1, keepdims=True)
    return {
        "accel": np.column_stack([t_s, accel]),
        "gyro": np.column_stack([t_s, gyro]),
        "rotation": np.column_stack([t_s, rotation]),
    }


def briefing(rate_hz: float = 50.0, sensors: tuple[str, ...] = SENSORS) -> Briefing:
    return Briefing(None, {name: dataclasses.replace(sensor_spec(name), rate_hz=rate_hz) for name in sensors}, 0.2)


def moves(rows: dict[str, FloatArray], rate_hz: float = 50.0, chunk_s: float = 0.2):
    reckoner, found = Reckoner(compiled_network(), briefing(rate_hz)), []
    for until_s in np.arange(chunk_s, max(one[-1, 0] for one in rows.values()) + chunk_s, chunk_s):
        new = {name: one[(one[:, 0] > until_s - chunk_s) & (one[:, 0] <= until_s)] for name, one in rows.items()}
        if until_s == chunk_s:
            new = {name: one[one[:, 0] <= until_s] for name, one in rows.items()}
        found += list(reckoner.update(new))
    return found


def test_rotating_the_walk_rotates_the_estimate(rng: np.random.Generator) -> None:
    rows, angle_rad = phone(rng), 2.1
    by = np.array([math.cos(angle_rad / 2), 0.0, 0.0, math.sin(angle_rad / 2)])
    about = rows | {"rotation": np.column_stack([rows["rotation"][:, 0], multiply(by, rows["rotation"][:, 1:])])}
    one, two = moves(rows), moves(about)
    assert len(one) == len(two) >= 8
    for before, after in zip(one, two, strict=True):
        np.testing.assert_allclose(after.move_m, turned(before.move_m, angle_rad), atol=1e-5)
        turn = np.array([turned(np.array([1.0, 0.0]), angle_rad), turned(np.array([0.0, 1.0]), angle_rad)]).T
        np.testing.assert_allclose(after.covariance_m2, turn @ before.covariance_m2 @ turn.T, atol=1e-5)


def test_chunks_do_not_matter(rng: np.random.Generator) -> None:
    rows = phone(rng)
    one, two = moves(rows, chunk_s=0.2), moves(rows, chunk_s=0.5)
    assert [move.end_s for move in one] == [move.end_s for move in two]
    np.testing.assert_allclose([move.move_m for move in one], [move.move_m for move in two], atol=1e-6)


@pytest.mark.parametrize("rate_hz", [25.0, 100.0, 200.0])
def test_other_rates_give_nearly_the_same_detections(rate_hz: float) -> None:
    usual, other = (
        grid_signals(*(phone(np.random.default_rng(3), rate_hz=hz)[name] for name in SENSORS), 1.0, 7.0)
        for hz in (50.0, rate_hz)
    )
    np.testing.assert_allclose(other.accel, usual.accel, atol=0.25)
    np.testing.assert_allclose(other.up, usual.up, atol=1e-3)


def test_a_gap_of_one_sensor_is_bridged(rng: np.random.Generator) -> None:
    rows = phone(rng, 12.0)
    rows["gyro"] = rows["gyro"][(rows["gyro"][:, 0] < 5.5) | (rows["gyro"][:, 0] > 8.2)]
    guessed = {move.end_s: move.is_guess for move in moves(rows)}
    assert [end_s for end_s, is_guess in guessed.items() if is_guess] == [6.0, 7.0, 8.0, 9.0]
    assert all(np.isfinite(move.move_m).all() for move in moves(rows))


def test_other_units_are_refused(rng: np.random.Generator) -> None:
    in_g = phone(rng)
    in_g["accel"][:, 1:] /= 9.81
    with pytest.raises(RecordingError, match=r"multiply by 9\.81"):
        moves(in_g)
    without_gravity = phone(rng)
    without_gravity["accel"][:, 1:] -= [0.0, 4.0, 9.0]
    with pytest.raises(RecordingError, match="gravity has to be in it"):
        moves(without_gravity)
    gentle_in_degrees = phone(rng)
    gentle_in_degrees["gyro"][:, 1:] *= 0.3 * 57.3
    with pytest.raises(RecordingError, match=r"divide degrees/s by 57\.3"):
        moves(gentle_in_degrees)


def test_times_that_go_back_and_attitudes_the_other_way_round_are_refused(rng: np.random.Generator) -> None:
    rows = phone(rng)
    rows["rotation"][:, 2:] *= -1.0
    with pytest.raises(RecordingError, match="w, x, y, z"):
        moves(rows)
    rows = phone(rng)
    jumped = rows["accel"].copy()
    jumped[200:, 0] -= 1.0
    with pytest.raises(RecordingError, match="goes back"):
        moves(rows | {"accel": jumped})


def test_a_phone_in_a_swinging_hand_is_not_refused() -> None:
    """Centripetal force, by 0.6 rad at 0.9 Hz on an arm of 0.65 m: 12.7 m/s2 in the mean, of which 9.8 are vertical."""
    t_s = np.arange(0.0, 10.0, 0.01)
    angle_rad = 0.6 * np.sin(2 * np.pi * 0.9 * t_s)
    at_m = 0.65 * np.column_stack([np.sin(angle_rad), 0 * t_s, -np.cos(angle_rad)])
    force = np.gradient(np.gradient(at_m, 0.01, axis=0), 0.01, axis=0) + np.array([0.0, 0.0, 9.81])
    attitude = np.column_stack([np.cos(angle_rad / 2), 0 * t_s, -np.sin(angle_rad / 2), 0 * t_s])
    accel = to_world(attitude * [1, -1, -1, -1], force)
    gyro = np.column_stack([0 * t_s, -np.gradient(angle_rad, 0.01), 0 * t_s])
    assert np.linalg.norm(accel.mean(axis=0)) > 9.81 / 0.8
    rows = {name: np.column_stack([t_s, one]) for name, one in zip(SENSORS, (accel, gyro, attitude), strict=True)}
    check_rows(rows)
    with pytest.raises(RecordingError, match="w, x, y, z"):
        check_rows(rows | {"rotation": rows["rotation"][:, [0, 4, 1, 2, 3]]})


def test_a_gap_in_a_turn_is_no_other_unit() -> None:
    """Who turns when samples stop, and stands when they come again, has not turned all the while."""
    t_s = np.concatenate([np.arange(0.0, 1.0, 0.02), np.arange(7.0, 8.0, 0.02)])
    turns_radps = np.where((t_s > 0.9) & (t_s <= 7.0), 1.2, 0.0)
    angle_rad = np.where(t_s < 2.0, 1.2 * np.maximum(t_s - 0.9, 0.0), 0.2)
    accel = np.tile([0.0, 0.0, 9.81], (len(t_s), 1))
    gyro = np.column_stack([0 * t_s, 0 * t_s, turns_radps])
    attitude = np.column_stack([np.cos(angle_rad / 2), 0 * t_s, 0 * t_s, np.sin(angle_rad / 2)])
    columns = (accel, gyro, attitude)
    check_rows({name: np.column_stack([t_s, one]) for name, one in zip(SENSORS, columns, strict=True)})


def test_slow_or_missing_sensors_are_unsuitable(rng: np.random.Generator) -> None:
    with pytest.raises(UnsuitableError, match="20 Hz or more"):
        Reckoner(compiled_network(), briefing(10.0))
    with pytest.raises(UnsuitableError, match="'gyro'"):
        Reckoner(compiled_network(), briefing(sensors=("accel", "rotation")))
    with pytest.raises(RecordingError, match="comes at 10 Hz"):
        moves(phone(rng, rate_hz=10.0))  # briefed as 50 Hz


def test_samples_that_are_no_numbers_are_left_out(rng: np.random.Generator) -> None:
    rows = phone(rng)
    torn = {name: one.copy() for name, one in rows.items()}
    torn["accel"][100:104, 2] = np.nan
    without = rows | {"accel": np.delete(rows["accel"], slice(100, 104), axis=0)}
    for one, two in zip(moves(torn), moves(without), strict=True):
        np.testing.assert_array_equal(one.move_m, two.move_m)


def test_walls_reveal_heading_and_length(rng: np.random.Generator) -> None:
    true_m = np.concatenate([np.tile([1.0, 0.0], (29, 1)), np.tile([0.0, 1.0], (15, 1)), np.tile([-1.0, 0.0], (20, 1))])
    measured_m = 1.05 * turned(true_m, math.radians(7.0))
    end_m = np.array([2.0, 0.0]) + true_m.sum(axis=0)
    cloud = LearnedMapFilter(bare_ring(), rng, LearnedMapFilterParams(), 0)
    cloud.begin_near(np.array([2.0, 0.0]))
    for move_m in measured_m:
        cloud.move(move_m, 0.05**2 * np.eye(2))
    assert np.hypot(*(np.array([2.0, 0.0]) + measured_m.sum(axis=0) - end_m)) > 1.5
    assert np.hypot(*(cloud.xy_m - end_m)) < 1.0
    assert math.degrees(cloud.bias_rad.mean()) == pytest.approx(-7.0, abs=3.0)
    assert cloud.resets == 0


def briefing_with(**changes: Any) -> Briefing:
    """The corridor, a phone with WLAN, a start at its corner and a survey."""
    specs = {name: dataclasses.replace(sensor_spec(name), rate_hz=50.0) for name in SENSORS}
    specs["wifi"] = sensor_spec("wifi")
    usual = {"start": Start(np.array([0.0, 0.0]), 0), "radio_map": survey_of(RING_M)}
    return Briefing(bare_ring(), specs, 0.2, **(usual | changes))


def received_dbm(xy_m: FloatArray) -> FloatArray:
    """(S, A) of access points in the corners and the middles of the sides."""
    away_m = np.linalg.norm(xy_m[:, None] - SENDERS_M[None], axis=2)
    return -35.0 - 30.0 * np.log10(np.maximum(away_m, 1.0))


def survey_of(xy_m: FloatArray, received_at_m: FloatArray | None = None, *, surveyed: bool = True) -> RadioMap:
    """A scan at each place, each a walk of its own."""
    count, senders = len(xy_m), len(SENDERS_M)
    return RadioMap(
        xy_m=xy_m,
        level=np.zeros(count, dtype=np.int64),
        walk=np.arange(count),
        first=np.arange(count + 1) * senders,
        access_point=np.tile(np.arange(senders), count),
        rssi_dbm=received_dbm(xy_m if received_at_m is None else received_at_m).ravel(),
        age_s=np.zeros(count * senders),
        surveyed=surveyed,
    )


def scan_at(xy_m: list[float], t_s: float = 0.1) -> FloatArray:
    """(A, 5) rows."""
    dbm = received_dbm(np.array([xy_m]))[0]
    return np.column_stack([np.full(len(dbm), t_s), np.arange(len(dbm)), dbm, np.full(len(dbm), 2412.0), 0 * dbm])


SENDERS_M = np.array([[0.0, 0.0], [31.0, 0.0], [31.0, 15.0], [0.0, 15.0], [15.0, 0.0], [15.0, 15.0]])
RING_M = np.array(
    [[x, y] for x in range(0, 32, 2) for y in (0.0, 15.0)] + [[x, y] for x in (0.0, 31.0) for y in (5, 10)]
)


def test_a_survey_estimates_its_own_error(rng: np.random.Generator) -> None:
    spec = sensor_spec("wifi")
    within_3_m = []
    for sigma_m in (0.0, 6.0):
        survey = ScanLocator(survey_of(RING_M, RING_M + sigma_m * rng.standard_normal(RING_M.shape)), spec)
        within_3_m.append((1.0 - survey.astray) * (1.0 - math.exp(-0.5 * (3.0 / survey.spread_m) ** 2)))
    assert within_3_m[0] > 0.65 > 0.5 > within_3_m[1]


def test_densities_of_a_scan_add_up_to_one() -> None:
    survey = ScanLocator(survey_of(RING_M), sensor_spec("wifi"))
    (places,) = survey.update(scan_at([15.0, 0.0]))
    x, y = (one.ravel() for one in np.meshgrid(np.arange(-40, 70, 0.5), np.arange(-40, 55, 0.5)))
    density = places.density_per_m2(np.column_stack([x, y]), np.zeros(len(x), dtype=np.int64))
    scan_density = density - places.astray / places.area_m2
    assert scan_density.sum() * 0.25 == pytest.approx(1.0 - places.astray, abs=0.01)
    assert np.hypot(x[np.argmax(density)] - 15.0, y[np.argmax(density)]) < 3.0
    elsewhere = places.density_per_m2(np.array([[15.0, 0.0]]), np.array([1]))
    assert elsewhere[0] == pytest.approx(places.astray / places.area_m2)


def test_a_scan_in_parts_is_one_scan_and_unknown_access_points_are_ignored() -> None:
    whole, parts = (ScanLocator(survey_of(RING_M), sensor_spec("wifi")) for _ in range(2))
    rows = scan_at([31.0, 5.0])
    (expected,) = whole.update(rows)
    list(parts.update(rows[:2]))
    (last,) = parts.update(rows[2:])
    np.testing.assert_array_equal(last.xy_m, expected.xy_m)
    assert list(parts.update(rows[:0])) == []
    unknown_rows = rows + np.array([1.0, 100.0, 0.0, 0.0, 0.0])
    assert list(parts.update(unknown_rows)) == []


def windows_of_sources(rows: dict[str, FloatArray]) -> Iterator[tuple[float, dict[str, FloatArray]]]:
    """Observations every 0.2 s, with a scan every 2 s."""
    for k in range(1, 41):
        now_s = 0.2 * k
        part = {name: one[(one[:, 0] > now_s - 0.2) & (one[:, 0] <= now_s)] for name, one in rows.items()}
        yield now_s, part | {"wifi": scan_at([20.0, 0.0], now_s) if k % 10 == 0 else np.zeros((0, 5))}


def test_the_claim_grows_with_the_way(rng: np.random.Generator) -> None:
    localizer = Learned()
    localizer.reset(briefing_with(), rng)
    claims = [localizer.step(Observation(now_s, part)).sigma_m for now_s, part in windows_of_sources(phone(rng))]
    assert claims[0] < claims[-1]
    assert all(math.isfinite(one) and one > 0 for one in claims)
