"""Attitudes of a recording: order and direction of the quaternion, which must turn gravity up."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from pdrbench.geometry import FloatArray
from pdrbench.inertial.quaternions import to_world
from pdrbench.sensors.checks import MIN_ROWS, Finding, Rows, found, lengths

_MAX_POSES: Final = 4000
_INVERTED: Final = "from building to device"


def attitude(rows: Rows) -> Iterator[Finding]:
    """Order and direction of the quaternion: it turns gravity to +z of the building."""
    rotation, accel = rows.get("rotation"), rows.get("accel")
    if rotation is None or len(rotation) < MIN_ROWS:
        return
    off = np.abs(lengths(rotation[:, 1:]) - 1.0)
    if off.max() > 0.05:
        row = int(off.argmax())
        seen = f"length {1.0 + off.max():.3f} or {1.0 - off.max():.3f}, expected 1"
        yield found("quaternion-length", f"rotation, row {row + 1}", seen)
        return
    if accel is None or len(accel) < MIN_ROWS:
        return
    sums = _ups(rotation, accel)
    if not sums:
        return
    given = sums["as given"]
    if given[2] > 0.7:
        return
    way = max(sums, key=lambda way: sums[way][2])
    if sums[way][2] > 0.8:
        seen = f"it turns gravity up only where it is read {way} ({sums[way][2]:.2f} against {given[2]:.2f} of 1)"
        yield found("quaternion", "rotation", seen)
        return
    axis = int(np.abs(given).argmax())
    steady = abs(given[axis]) > 0.8
    if steady:
        seen = f"it turns gravity to {'-' if given[axis] < 0 else '+'}{'xyz'[axis]}"
        yield found("quaternion, steady", "rotation", seen)
    else:
        seen = f"it turns gravity to no lasting direction (mean {np.round(given, 2).tolist()})"
        yield found("quaternion, unsteady", "rotation", seen)


def device_to_building(
    t_s: FloatArray, q: FloatArray, accel_s: FloatArray, accel_mps2: FloatArray
) -> FloatArray | None:
    """Quaternions of a format that does not say what they turn, as turns from the device to the building.

    Args:
        t_s, q: (T,), (T, 4) w first.
        accel_s, accel_mps2: (N,), (N, 3) with gravity, in the sign of Android.

    Returns:
        (T, 4) as they are or inverted, whichever turns gravity up; None where neither does.
    """
    order, other = np.argsort(t_s, kind="stable"), np.argsort(accel_s, kind="stable")
    sums = _ups(np.column_stack([t_s[order], q[order]]), np.column_stack([accel_s[other], accel_mps2[other]]))
    if not sums or max(sums["as given"][2], sums[_INVERTED][2]) < 0.7:
        return None
    return q if sums["as given"][2] >= sums[_INVERTED][2] else q * [1.0, -1.0, -1.0, -1.0]


def _ups(rotation: FloatArray, accel: FloatArray) -> dict[str, FloatArray]:
    """Mean direction into which gravity is turned, by the way in which the quaternions are read; {} of few rows."""
    force = accel[:: len(accel) // _MAX_POSES + 1]
    force = force[np.isfinite(force).all(axis=1)]
    at = np.searchsorted(rotation[:, 0], force[:, 0], side="right") - 1
    force, q = force[at >= 0], rotation[at[at >= 0], 1:]
    if len(force) < MIN_ROWS:
        return {}
    up = force[:, 1:] / np.maximum(lengths(force[:, 1:]), 1e-9)[:, None]
    ways: dict[str, FloatArray] = {
        "as given": q,
        _INVERTED: q * [1.0, -1.0, -1.0, -1.0],
        "in the order x, y, z, w": q[:, [3, 0, 1, 2]],
        "from building to device in the order x, y, z, w": q[:, [3, 0, 1, 2]] * [1.0, -1.0, -1.0, -1.0],
    }
    return {way: np.nanmean(to_world(quaternion, up), axis=0) for way, quaternion in ways.items()}
