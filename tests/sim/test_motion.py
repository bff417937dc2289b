from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pdrbench.inertial.quaternions import from_yaw_pitch_roll
from pdrbench_sim.units.motion import GRAVITY_MPS2, MotionError, RigidMotion

T_S = np.arange(0, 4, 1 / 500)
INSIDE = slice(5, -5)


def level(yaw_rad: np.ndarray) -> np.ndarray:
    return from_yaw_pitch_roll(yaw_rad, np.zeros_like(yaw_rad), np.zeros_like(yaw_rad))


def test_a_body_at_rest_reads_gravity_upwards_whichever_way_it_lies():
    quaternion = Rotation.random(len(T_S), random_state=1).as_quat()[0][[3, 0, 1, 2]]
    motion = RigidMotion(T_S, np.zeros((len(T_S), 3)), np.tile(quaternion, (len(T_S), 1)))
    accel, gyro = motion.ideal_signals()
    up = Rotation.from_quat(quaternion[[1, 2, 3, 0]]).inv().apply([0, 0, GRAVITY_MPS2])
    np.testing.assert_allclose(accel, np.tile(up, (len(T_S), 1)), atol=1e-9)
    np.testing.assert_allclose(gyro, 0, atol=1e-12)


def test_a_carousel_reads_centripetal_and_tangential_acceleration():
    rate, radius_m = 2.0, 0.7
    centre = RigidMotion(T_S, np.zeros((len(T_S), 3)), level(rate * T_S))
    accel, gyro = centre.at([radius_m, 0.0, 0.0]).ideal_signals()
    np.testing.assert_allclose(
        accel[INSIDE], [[-(rate**2) * radius_m, 0, GRAVITY_MPS2]] * len(accel[INSIDE]), atol=1e-6
    )
    np.testing.assert_allclose(gyro[INSIDE], [[0, 0, rate]] * len(gyro[INSIDE]), atol=1e-8)
    bend, radius_m = 1.5, 0.4
    accel, _ = RigidMotion(T_S, np.zeros((len(T_S), 3)), level(bend * T_S**2 / 2)).at([radius_m, 0, 0]).ideal_signals()
    np.testing.assert_allclose(accel[INSIDE, 1], bend * radius_m, atol=1e-5)


@pytest.mark.parametrize("frequency_hz", [1.0, 10.0, 40.0])
def test_differences_keep_oscillations(frequency_hz):
    turn = 2 * math.pi * frequency_hz
    path_m = np.column_stack([np.sin(turn * T_S) / turn**2, 0 * T_S, 0 * T_S])
    accel, _ = RigidMotion(T_S, path_m, level(0 * T_S)).ideal_signals()
    np.testing.assert_allclose(accel[INSIDE, 0], -np.sin(turn * T_S)[INSIDE], atol=1e-3)  # 40 Hz loses 0.07 %


def test_rates_are_those_of_the_angles():
    pitch, roll = 0.4 * np.sin(3 * T_S), 0.3 * np.cos(5 * T_S)
    attitude = from_yaw_pitch_roll(0.6 * T_S, pitch, roll)
    _, gyro = RigidMotion(T_S, np.zeros((len(T_S), 3)), attitude).ideal_signals()
    pitch_rate, roll_rate = 1.2 * np.cos(3 * T_S), -1.5 * np.sin(5 * T_S)
    expected = np.column_stack(
        [
            roll_rate - 0.6 * np.sin(pitch),
            pitch_rate * np.cos(roll) + 0.6 * np.cos(pitch) * np.sin(roll),
            -pitch_rate * np.sin(roll) + 0.6 * np.cos(pitch) * np.cos(roll),
        ]
    )
    np.testing.assert_allclose(gyro[INSIDE], expected[INSIDE], atol=1e-6)


def test_a_turned_unit_measures_the_same_motion_along_its_own_axes():
    path_m = np.column_stack([np.sin(T_S), np.cos(2 * T_S), 0.1 * T_S])
    motion = RigidMotion(T_S, path_m, level(0.5 * T_S))
    turn = from_yaw_pitch_roll(*np.array([[0.3], [-0.2], [1.0]]))[0]
    back = Rotation.from_quat(turn[[1, 2, 3, 0]]).inv()
    for turned, plain in zip(motion.mounted(turn).ideal_signals(), motion.ideal_signals(), strict=True):
        np.testing.assert_allclose(turned, back.apply(plain), atol=1e-9)


@pytest.mark.parametrize(
    ("t_s", "rows", "message"),
    [
        (T_S[:4], 4, "5 samples or more"),
        (T_S, 7, "needs t_s"),
        (T_S[::-1], len(T_S), "evenly in increasing time"),
        (T_S**1.01, len(T_S), "evenly in increasing time"),
    ],
)
def test_samples_that_are_no_motion_are_refused(t_s, rows, message):
    with pytest.raises(MotionError, match=message):
        RigidMotion(t_s, np.zeros((rows, 3)), np.tile([1.0, 0, 0, 0], (rows, 1)))
