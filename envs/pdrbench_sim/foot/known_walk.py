"""A foot whose truth is known: smooth strides in closed form, and what a perfect unit on it would measure.

Tests hold the filter against it, and `pdrbench bench inertial` times it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.polynomial import Polynomial

from pdrbench.geometry import FloatArray
from pdrbench.inertial.quaternions import from_yaw_pitch_roll, inverse, to_world
from pdrbench.inertial.zero_velocity import GRAVITY_MPS2

# Shapes of a swing over a fraction s in [0, 1]. Both rest, to the third derivative, at either end.
_ALONG: Final = Polynomial([0, 0, 0, 0, 35, -84, 70, -20])  # from 0 to 1
_BUMP: Final = 256 * Polynomial([0, 0, 0, 0, 1]) * Polynomial([1, -1]) ** 4  # from 0 to 1 and back
_TILT: Final = 2.0 * _BUMP * Polynomial([1, -2])  # toe down, then heel down


@dataclass(frozen=True, slots=True)
class FootMotion:
    """A foot at each of n samples, and what is measured there.

    The foot starts at the origin with x ahead and z up, which is how the filter's world frame lies, too.

    Attributes:
        t_s: (n,) seconds.
        accel: (n, 3) specific force in the body frame, m/s2.
        gyro: (n, 3) rate in the body frame, rad/s.
        position_m: (n, 3).
        velocity_mps: (n, 3).
        attitude: (n, 3, 3) body to world.
        is_rest: (n,) whether the foot stands on the floor and does not move at all.
    """

    t_s: FloatArray
    accel: FloatArray
    gyro: FloatArray
    position_m: FloatArray
    velocity_mps: FloatArray
    attitude: FloatArray
    is_rest: Any

    def __len__(self) -> int:
        return len(self.t_s)


def walk(
    num_strides: int,
    *,
    length_m: float = 1.3,
    rise_m: float = 0.0,
    turn_rad: float = 0.0,
    lift_m: float = 0.12,
    tilt_rad: float = 0.6,
    swing_s: float = 0.65,
    rest_s: float = 0.5,
    still_s: float = 1.0,
    rate_hz: float = 200.0,
) -> FootMotion:
    """Strides of one foot, with rests in between.

    Stride i leads `length_m` along the heading i `turn_rad`, and the foot turns by `turn_rad` during each.

    Args:
        num_strides: At least 0.
        length_m: Horizontal length of a stride.
        rise_m: Of each stride.
        turn_rad: Of each stride, counter-clockwise.
        lift_m: How far the foot is lifted meanwhile.
        tilt_rad: How far the toe points down, and up, meanwhile, roughly.
        swing_s: From lifting the foot to putting it down.
        rest_s: Between two swings.
        still_s: Before the first and after the last.
        rate_hz: Of the samples.
    """
    first_s = still_s + np.arange(num_strides) * (swing_s + rest_s)
    last_s = (first_s[-1] + swing_s if num_strides else 0.0) + still_s
    t_s = np.arange(round(last_s * rate_hz) + 1) / rate_hz
    stride = np.searchsorted(first_s, t_s, side="right") - 1
    begun = np.concatenate([[0.0], first_s])[np.maximum(stride, 0) + (num_strides > 0)]
    fraction = np.where(stride >= 0, np.clip((t_s - begun) / swing_s, 0.0, 1.0), 0.0)
    stride = np.maximum(stride, 0)

    heading = np.arange(max(num_strides, 1)) * turn_rad
    ahead = np.column_stack([length_m * np.cos(heading), length_m * np.sin(heading), np.full(len(heading), rise_m)])
    before_m = np.concatenate([np.zeros((1, 3)), np.cumsum(ahead, axis=0)])[:-1]

    def along(order: int) -> FloatArray:
        values: FloatArray = ahead[stride] * _rate(_ALONG, fraction, order, swing_s)[:, None]
        values[:, 2] += lift_m * _rate(_BUMP, fraction, order, swing_s)
        return values

    tilt, yaw = tilt_rad * _TILT(fraction), heading[stride] + turn_rad * _ALONG(fraction)
    attitude = from_yaw_pitch_roll(yaw, tilt, np.zeros(len(tilt)))
    matrices = np.stack([to_world(attitude, axis) for axis in np.eye(3)], axis=-1)
    force = along(2) + np.array([0.0, 0.0, GRAVITY_MPS2])
    spin = np.zeros((len(t_s), 3))
    spin[:, 2] = turn_rad * _rate(_ALONG, fraction, 1, swing_s)
    gyro = to_world(inverse(attitude), spin)
    gyro[:, 1] += tilt_rad * _rate(_TILT, fraction, 1, swing_s)
    accel = to_world(inverse(attitude), force)
    is_rest = (fraction <= 0.0) | (fraction >= 1.0)
    return FootMotion(t_s, accel, gyro, before_m[stride] + along(0), along(1), matrices, is_rest)


def _rate(shape: Polynomial, fraction: FloatArray, order: int, swing_s: float) -> FloatArray:
    """(n,) derivative by time, of the given order."""
    return np.asarray(shape.deriv(order)(fraction) / swing_s**order)
