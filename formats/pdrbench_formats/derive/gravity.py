"""Specific force as gravity and linear acceleration, and the way back."""

from __future__ import annotations

from typing import Final

import numpy as np

from pdrbench.geometry import FloatArray
from pdrbench.inertial.quaternions import inverse, to_world

GRAVITY_MPS2: Final = 9.80665


def split_gravity(accel: FloatArray, rotation: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Linear acceleration and gravity in the device frame; their sum is what came in.

    Args:
        accel: (n, 4) t_s and specific force, m/s2.
        rotation: (m, 5) t_s and attitude, as the sensor `rotation` has it.

    Returns:
        linear: (k, 4) t_s and acceleration without gravity, m/s2; rows before the first attitude are left out.
        gravity: (k, 4) t_s and gravity as a device at rest measures it, upwards.
    """
    known, gravity = _gravity(accel, rotation)
    linear = np.column_stack([known[:, 0], known[:, 1:4] - gravity[:, 1:4]])
    return linear, gravity


def add_gravity(linear: FloatArray, rotation: FloatArray) -> FloatArray:
    """(k, 4) t_s and specific force, of acceleration without gravity (n, 4) and attitudes (m, 5); see `split_gravity`.

    >>> lying = np.array([[0.0, 1.0, 0.0, 0.0, 0.0]])
    >>> add_gravity(np.array([[0.5, 1.0, 0.0, 0.0]]), lying).tolist()
    [[0.5, 1.0, 0.0, 9.80665]]
    """
    known, gravity = _gravity(linear, rotation)
    return np.column_stack([known[:, 0], known[:, 1:4] + gravity[:, 1:4]])


def _gravity(rows: FloatArray, rotation: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The rows from the first attitude on, and gravity there, by the last attitude that is not later."""
    latest = np.searchsorted(rotation[:, 0], rows[:, 0], side="right") - 1
    known, latest = rows[latest >= 0], latest[latest >= 0]
    up = np.broadcast_to([0.0, 0.0, GRAVITY_MPS2], (len(known), 3))
    return known, np.column_stack([known[:, 0], to_world(inverse(rotation[latest, 1:5]), up)])
