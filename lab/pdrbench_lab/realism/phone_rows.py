"""What the inertial unit, the magnetometer and the attitude filter of a phone deliver, given its motion."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from pdrbench.geometry import FloatArray
from pdrbench.inertial.quaternions import to_world
from pdrbench_sim.phone.heading import AttitudeErrorParams, rotation_vector
from pdrbench_sim.phone.magnetometer import PhoneMagnetometerParams, calibrated_field
from pdrbench_sim.units.device import draw_unit
from pdrbench_sim.units.motion import RigidMotion
from pdrbench_sim.units.profiles import ImuProfile


def phone_rows(
    motion: RigidMotion,
    profile: ImuProfile,
    rngs: Sequence[np.random.Generator],
    sampled: tuple[FloatArray, FloatArray, FloatArray],
    magnetometer: PhoneMagnetometerParams | None = None,
    attitude: AttitudeErrorParams | None = None,
    rotate: Callable[..., FloatArray] = rotation_vector,
) -> dict[str, FloatArray]:
    """Rows of accel, gyro, mag and rotation.

    Args:
        motion: Of the phone.
        profile: Of its inertial unit.
        rngs: Four: for the unit, its noise, the magnetometer and the attitude.
        sampled: Times (m,), attitudes (m, 4) and the true magnetic field (m, 3) in uT where the magnetometer is read.
        magnetometer: None for the defaults.
        attitude: None for the defaults.
        rotate: Called like `rotation_vector`, in its stead.
    """
    unit, noise, compass, drift = rngs
    stamps_s, accel, gyro = draw_unit(profile, unit).measure(motion.t_s, *motion.ideal_signals(), noise)
    t_s, quaternion, field_ut = sampled
    mag_ut = calibrated_field(t_s, field_ut, quaternion, compass, magnetometer)
    rotation = rotate(t_s, quaternion, to_world(quaternion, mag_ut), drift, attitude)
    return {
        "accel": np.column_stack([stamps_s, accel]),
        "gyro": np.column_stack([stamps_s, gyro]),
        "mag": np.column_stack([t_s, mag_ut]),
        "rotation": np.column_stack([t_s, rotation]),
    }
