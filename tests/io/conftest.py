"""A walk of a phone whose true motion is known, for formats to hold and for checks to find fault with."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

GRAVITY_MPS2 = 9.80665
RATE_HZ, NUM_ROWS = 100.0, 3000
START_NS = 1_700_000_000_000_000_000


@pytest.fixture(scope="session")
def phone_walk() -> dict[str, np.ndarray]:
    """Rows by sensor of 30 s."""
    return make_walk()


def make_walk() -> dict[str, np.ndarray]:
    """A phone in a hand that tilts by half a radian and turns, with the shaking of steps."""
    t_s = np.arange(NUM_ROWS) / RATE_HZ
    angles = np.column_stack([0.3 * t_s, 0.7 + 0.5 * np.sin(0.9 * t_s), 0.4 * np.sin(1.3 * t_s)])
    turn = Rotation.from_euler("ZXY", angles)  # device to building
    step = turn[:-1].inv() * turn[1:]
    gyro = np.vstack([step.as_rotvec() * RATE_HZ, np.zeros(3)])
    gyro[-1] = gyro[-2]
    shake = 2.0 * np.sin(2 * np.pi * 1.9 * t_s)[:, None] * [0.3, 0.2, 1.0]
    accel = turn.apply(shake + np.array([0.0, 0.0, GRAVITY_MPS2]), inverse=True)
    mag = turn.apply(np.tile([0.0, 22.0, -42.0], (NUM_ROWS, 1)), inverse=True)
    q = turn.as_quat()[:, [3, 0, 1, 2]]
    gravity = turn.apply(np.tile([0.0, 0.0, GRAVITY_MPS2], (NUM_ROWS, 1)), inverse=True)
    return {
        "accel": np.column_stack([t_s, accel]),
        "gyro": np.column_stack([t_s, gyro]),
        "mag": np.column_stack([t_s, mag]),
        "rotation": np.column_stack([t_s, q]),
        "baro": np.column_stack([t_s, 1000.0 + 0.1 * np.sin(t_s)]),
        "gravity": np.column_stack([t_s, gravity]),
    }
