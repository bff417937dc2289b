"""Where a device points."""

from __future__ import annotations

import numpy as np

from pdrbench.geometry import FloatArray


def phone_heading_rad(quaternion: FloatArray) -> FloatArray:
    """Direction in which the top edge (y axis) of a phone points, projected onto the floor.

    The azimuth from north is atan2(2 (qx qy - qz qw), 1 - 2 (qx^2 + qz^2)); the heading counts counter-clockwise from
    east, so the two arguments change places.

    Args:
        quaternion: (..., 4) Hamilton wxyz, body to world (x east, y north, z up).

    Returns:
        (...) radians in [-pi, pi].

    >>> north = phone_heading_rad(np.array([1.0, 0.0, 0.0, 0.0]))
    >>> float(north) == np.pi / 2
    True
    """
    w, x, y, z = np.moveaxis(np.asarray(quaternion, dtype=np.float64), -1, 0)
    east = 2 * (x * y - z * w)
    north = 1 - 2 * (x * x + z * z)
    heading: FloatArray = np.arctan2(north, east)
    return heading


def to_world(quaternion: FloatArray, vector: FloatArray) -> FloatArray:
    """Turns vectors from the body into the world frame.

    Args:
        quaternion: (..., 4) unit Hamilton wxyz, body to world.
        vector: (..., 3).

    >>> half = np.sqrt(0.5)
    >>> (to_world(np.array([half, 0, 0, half]), np.array([1.0, 0, 0])).round(6) + 0.0).tolist()
    [0.0, 1.0, 0.0]
    """
    w, axis = quaternion[..., :1], quaternion[..., 1:]
    twice = 2 * np.cross(axis, vector)
    turned: FloatArray = vector + w * twice + np.cross(axis, twice)
    return turned
