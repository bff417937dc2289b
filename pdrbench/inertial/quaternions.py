"""Attitudes as unit quaternions: Hamilton, wxyz, body to world (x east, y north, z up), any leading axes.

Written out in components: these are called with a row or two per step, where `scipy.spatial.transform.Rotation` takes
ten times as long, and stored walks and estimates depend on the order of the operations. Tests hold them against it.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from pdrbench.geometry import FloatArray

_CONJUGATE: Final = np.array([1.0, -1.0, -1.0, -1.0])


def multiply(first: FloatArray, second: FloatArray) -> FloatArray:
    """(..., 4) Hamilton product: rotates by `second`, then by `first`.

    Args:
        first: (..., 4).
        second: (..., 4).
    """
    w, x, y, z = (first[..., i] for i in range(4))
    a, b, c, d = (second[..., i] for i in range(4))
    product: FloatArray = np.stack(
        [
            w * a - x * b - y * c - z * d,
            w * b + x * a + y * d - z * c,
            w * c - x * d + y * a + z * b,
            w * d + x * c - y * b + z * a,
        ],
        axis=-1,
    )
    return product


def inverse(quaternion: FloatArray) -> FloatArray:
    """(..., 4) inverse of unit quaternions."""
    conjugate: FloatArray = quaternion * _CONJUGATE
    return conjugate


def to_world(quaternion: FloatArray, vector: FloatArray) -> FloatArray:
    """Rotates vectors from the body into the world frame.

    Args:
        quaternion: (..., 4).
        vector: (..., 3).

    >>> half = np.sqrt(0.5)
    >>> (to_world(np.array([half, 0, 0, half]), np.array([1.0, 0, 0])).round(6) + 0.0).tolist()
    [0.0, 1.0, 0.0]
    """
    (w, x, y, z), (a, b, c) = ([of[..., i] for i in range(of.shape[-1])] for of in (quaternion, vector))
    d, e, f = 2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)
    turned = [a + w * d + (y * f - z * e), b + w * e + (z * d - x * f), c + w * f + (x * e - y * d)]
    return np.stack(turned, axis=-1)


def about_vertical(angle_rad: FloatArray | float) -> FloatArray:
    """(..., 4) rotation about the z axis, counter-clockwise."""
    half_rad = np.asarray(angle_rad) / 2
    nothing = np.zeros(half_rad.shape)
    return np.stack([np.cos(half_rad), nothing, nothing, np.sin(half_rad)], axis=-1)


def from_yaw_pitch_roll(yaw_rad: FloatArray, pitch_rad: FloatArray, roll_rad: FloatArray) -> FloatArray:
    """(n, 4) body to world: about z by yaw, then about the new y by pitch (nose down positive), then x by roll."""
    cy, sy = np.cos(yaw_rad / 2), np.sin(yaw_rad / 2)
    cp, sp = np.cos(pitch_rad / 2), np.sin(pitch_rad / 2)
    cr, sr = np.cos(roll_rad / 2), np.sin(roll_rad / 2)
    quaternion: FloatArray = np.stack(
        [
            cy * cp * cr + sy * sp * sr,
            cy * cp * sr - sy * sp * cr,
            cy * sp * cr + sy * cp * sr,
            sy * cp * cr - cy * sp * sr,
        ],
        axis=-1,
    )
    return quaternion


def twist_rad(quaternion: FloatArray) -> FloatArray:
    """(...) rotation about the vertical, radians: the twist of the attitude about the world's z axis.

    The yaw of Euler angles jumps where an axis points up, as those of a unit on an instep may; the twist does not.

    >>> round(float(twist_rad(about_vertical(np.pi / 4))), 6) == round(np.pi / 4, 6)
    True
    """
    return 2.0 * np.arctan2(quaternion[..., 3], quaternion[..., 0])


def phone_heading_rad(quaternion: FloatArray) -> FloatArray:
    """(...) direction in which the top edge (y axis) of a phone points, projected onto the floor; in [-pi, pi].

    The azimuth from north is atan2(2 (qx qy - qz qw), 1 - 2 (qx^2 + qz^2)); the heading counts counter-clockwise from
    east, so the two arguments change places.

    >>> float(phone_heading_rad(np.array([1.0, 0.0, 0.0, 0.0]))) == np.pi / 2
    True
    """
    w, x, y, z = np.moveaxis(np.asarray(quaternion, dtype=np.float64), -1, 0)
    east = 2 * (x * y - z * w)
    north = 1 - 2 * (x * x + z * z)
    heading: FloatArray = np.arctan2(north, east)
    return heading
