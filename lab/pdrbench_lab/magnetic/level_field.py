"""The magnetic field of a phone, made level."""

from __future__ import annotations

import numpy as np

from pdrbench.geometry import FloatArray
from pdrbench.inertial import phone_heading_rad, to_world


def level_field_ut(rotation: FloatArray, mag: FloatArray) -> FloatArray:
    """(n, 3) a magnetic field to the right of a phone, ahead as its top edge points, and up.

    Its yaw is in no component: where the attitude is wrong about that only, the field is right.

    Args:
        rotation: (n, 4) attitude of the phone.
        mag: (n, 3) in its frame, microtesla.

    >>> level_field_ut(np.array([[1.0, 0.0, 0.0, 0.0]]), np.array([[1.0, 2.0, 3.0]])).round(9).tolist()
    [[1.0, 2.0, 3.0]]
    """
    field_ut, heading_rad = to_world(rotation, mag), phone_heading_rad(rotation)
    cos, sin = np.cos(heading_rad), np.sin(heading_rad)
    ahead_ut = cos * field_ut[:, 0] + sin * field_ut[:, 1]
    return np.column_stack([sin * field_ut[:, 0] - cos * field_ut[:, 1], ahead_ut, field_ut[:, 2]])
