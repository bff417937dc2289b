"""The inertial and magnetic sensors of a phone.

Device frame of Android and of W3C: x to the right of the screen, y to its top edge, z out of it. Bounds are wide enough
for every part sold in phones and foot-mounted units, and narrow enough that degrees or milligauss run into them.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from pdrbench.recording import SensorSpec

LONGEST_WALK_S: Final = 86_400.0  # a day; a time beyond it is a clock of another unit
_ACCEL_MPS2: Final = 50 * 9.80665  # 50 g: foot-mounted units end at 18 g, shock-proof ones at 50 g
_GYRO_RADPS: Final = math.radians(4000)  # twice the 2000 degree/s at which phone gyroscopes end
_MAG_UT: Final = 5000.0  # AK09911 and its kin end at 4912 uT

ACCEL: Final = SensorSpec(
    name="accel",
    columns=("t_s", "x_mps2", "y_mps2", "z_mps2"),
    low=np.array([0.0, -_ACCEL_MPS2, -_ACCEL_MPS2, -_ACCEL_MPS2]),
    high=np.array([LONGEST_WALK_S, _ACCEL_MPS2, _ACCEL_MPS2, _ACCEL_MPS2]),
    rate_hz=50.0,
    what="Specific force in the device frame: gravity is in it, a phone lying on its back reads +9.81 on z.",
)
GYRO: Final = SensorSpec(
    name="gyro",
    columns=("t_s", "x_radps", "y_radps", "z_radps"),
    low=np.array([0.0, -_GYRO_RADPS, -_GYRO_RADPS, -_GYRO_RADPS]),
    high=np.array([LONGEST_WALK_S, _GYRO_RADPS, _GYRO_RADPS, _GYRO_RADPS]),
    rate_hz=50.0,
    what="Angular rate in the device frame, counter-clockwise positive, bias as the phone left it.",
)
MAG: Final = SensorSpec(
    name="mag",
    columns=("t_s", "x_ut", "y_ut", "z_ut"),
    low=np.array([0.0, -_MAG_UT, -_MAG_UT, -_MAG_UT]),
    high=np.array([LONGEST_WALK_S, _MAG_UT, _MAG_UT, _MAG_UT]),
    rate_hz=50.0,
    what="Magnetic field in the device frame, hard iron as calibrated by the phone.",
)
ROTATION: Final = SensorSpec(
    name="rotation",
    columns=("t_s", "qw", "qx", "qy", "qz"),
    low=np.array([0.0, -1.0, -1.0, -1.0, -1.0]),
    high=np.array([LONGEST_WALK_S, 1.0, 1.0, 1.0, 1.0]),
    rate_hz=50.0,
    what="Attitude as the phone estimates it: unit Hamilton quaternion, device to building frame (x east, z up).",
)
