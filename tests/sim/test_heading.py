"""True and reported heading of a phone: closed forms, prefixes, speed of turning."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pdrbench.errors import RecordingError
from pdrbench.geometry import wrap_rad
from pdrbench.inertial.quaternions import from_yaw_pitch_roll, phone_heading_rad
from pdrbench_sim.phone.heading import AttitudeErrorParams, HoldParams, held_yaw_rad, rotation_vector, smooth_noise

EXACT = AttitudeErrorParams(drift_radps=0.0, tilt_rad=0.0)
T_S = np.arange(6000) / 100.0


def attitudes(seed: int) -> np.ndarray:
    """(6000, 4) of a phone that is turned about."""
    rng = np.random.default_rng(seed)
    yaw, pitch, roll = (smooth_noise(T_S, child, 3.0) for child in rng.spawn(3))
    return from_yaw_pitch_roll(2 * yaw, 0.3 * pitch, 0.3 * roll)


def field_turned_by(angle_rad: np.ndarray) -> np.ndarray:
    """(n, 3) a horizontal field turned from +y, with a vertical part."""
    return np.column_stack([-31 * np.sin(angle_rad), 31 * np.cos(angle_rad), np.full(len(angle_rad), -30.0)])


def yaw_error_rad(reported: np.ndarray, true: np.ndarray) -> np.ndarray:
    return wrap_rad(phone_heading_rad(reported) - phone_heading_rad(true))


def test_a_homogeneous_field_gives_the_true_attitude_and_one_that_turns_no_jump():
    true = attitudes(1)
    reported = rotation_vector(T_S, true, field_turned_by(np.zeros(6000)), np.random.default_rng(2), EXACT)
    np.testing.assert_allclose(reported, true, atol=1e-12)
    angle_rad = np.linspace(0.0, 4 * math.pi, 6000)
    true = np.tile([1.0, 0, 0, 0], (6000, 1))
    reported = rotation_vector(T_S, true, field_turned_by(angle_rad), np.random.default_rng(2), EXACT)
    np.testing.assert_allclose(np.linalg.norm(reported, axis=1), 1.0)
    assert np.abs(np.diff(reported, axis=0)).max() < 0.01


@pytest.mark.parametrize("turn_deg", [-8.0, 25.0])
def test_yaw_follows_a_turned_field_with_its_time_constant(turn_deg: float):
    """A first-order lag of unit vectors: the error is atan2(s sin a, 1 - s + s cos a), s = 1 - exp(-t / tau)."""
    since_s = T_S - 10.0
    turn_rad = math.radians(turn_deg) * (since_s >= 0)
    true = np.tile([math.sqrt(0.5), 0, 0, math.sqrt(0.5)], (6000, 1))
    reported = rotation_vector(T_S, true, field_turned_by(turn_rad), np.random.default_rng(2), EXACT)
    fraction = -np.expm1(-np.maximum(since_s + 0.01, 0.0) / EXACT.compass_s)
    wanted_rad = -np.arctan2(fraction * np.sin(turn_rad), 1 - fraction + fraction * np.cos(turn_rad))
    # What is set down in the reported attitude is a heading: field to the left of north, heading to the right.
    np.testing.assert_allclose(yaw_error_rad(reported, true), wanted_rad, atol=1e-9)
    assert yaw_error_rad(reported, true)[-1] == pytest.approx(-math.radians(turn_deg), abs=1e-6)


@pytest.mark.parametrize("count", [2, 1000])
def test_a_longer_walk_begins_like_a_shorter_one(count: int):
    true = attitudes(3)
    field_ut = field_turned_by(0.2 * np.sin(T_S))
    whole = rotation_vector(T_S, true, field_ut, np.random.default_rng(4))
    part = rotation_vector(T_S[:count], true[:count], field_ut[:count], np.random.default_rng(4))
    np.testing.assert_allclose(part, whole[:count], atol=1e-12)
    np.testing.assert_array_equal(
        held_yaw_rad(T_S[:count], np.random.default_rng(4)), held_yaw_rad(T_S, np.random.default_rng(4))[:count]
    )
    assert not np.array_equal(whole, rotation_vector(T_S, true, field_ut, np.random.default_rng(5)))


def test_a_held_phone_is_off_by_a_constant_and_a_wander():
    params = HoldParams(offset_rad=0.2, wander_rad=0.05, wander_s=1.0)
    yaws = np.array([held_yaw_rad(T_S, np.random.default_rng(seed), params) for seed in range(300)])
    assert yaws.mean(axis=1).std() == pytest.approx(0.2, rel=0.1)  # 300 walks: 4 %
    assert (yaws - yaws.mean(axis=1, keepdims=True)).std() == pytest.approx(0.05, rel=0.05)
    still = held_yaw_rad(T_S, np.random.default_rng(0), HoldParams(offset_rad=0.2, wander_rad=0.0))
    assert np.ptp(still) == 0.0


def test_smooth_noise_has_variance_one_and_the_given_correlation_time():
    values = np.array([smooth_noise(T_S, np.random.default_rng(seed), 2.0) for seed in range(400)])
    assert values.var() == pytest.approx(1.0, rel=0.03)
    after = np.mean(values[:, :-200] * values[:, 200:])
    assert after == pytest.approx(math.exp(-1), abs=0.07)  # the spline keeps a little more than its coefficients


def test_attitudes_that_are_none_are_refused():
    true = attitudes(1)
    with pytest.raises(RecordingError, match="a reported attitude needs"):
        rotation_vector(T_S, true[:-1], field_turned_by(np.zeros(6000)), np.random.default_rng(0))
    with pytest.raises(RecordingError, match="its times positive"):
        AttitudeErrorParams(compass_s=0.0)
    with pytest.raises(RecordingError, match="not negative"):
        AttitudeErrorParams(tilt_rad=-1.0)
