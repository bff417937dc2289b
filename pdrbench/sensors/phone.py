"""The inertial and magnetic sensors of a phone, and its barometer.

Device frame of Android and of W3C: x to the right of the screen, y to its top edge, z out of it. Bounds are wide enough
for every part sold in phones and foot-mounted units, and narrow enough that degrees or milligauss run into them.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np

from pdrbench.recording import MAX_WALK_S, SensorSpec


def _three_axes(name: str, unit: str, most: float, what: str) -> SensorSpec:
    """A sensor that delivers x, y and z of at most `most` either way."""
    high = np.array([MAX_WALK_S, most, most, most])
    columns = ("t_s", *(f"{axis}_{unit}" for axis in "xyz"))
    return SensorSpec(name, columns, low=np.array([0.0, -most, -most, -most]), high=high, rate_hz=50.0, what=what)


ACCEL: Final = _three_axes(
    "accel",
    "mps2",
    50 * 9.80665,  # 50 g: foot-mounted units end at 18 g, shock-proof ones at 50 g
    "Specific force in the device frame: gravity is in it, a phone lying on its back reads +9.81 on z.",
)
GYRO: Final = _three_axes(
    "gyro",
    "radps",
    math.radians(4000),  # twice the 2000 degree/s at which phone gyroscopes end
    "Angular rate in the device frame, counter-clockwise positive, bias as the phone left it.",
)
# A second unit on the same person: the briefing has one mounting, so the name tells them apart.
ACCEL_2: Final = replace(ACCEL, name="accel_2", what="As accel, of a second unit: the one on the other foot.")
GYRO_2: Final = replace(GYRO, name="gyro_2", what="As gyro, of a second unit: the one on the other foot.")
MAG: Final = _three_axes(
    "mag",
    "ut",
    5000.0,  # AK09911 and its kin end at 4912 uT
    "Magnetic field in the device frame, hard iron as calibrated by the phone.",
)
ROTATION: Final = SensorSpec(
    name="rotation",
    columns=("t_s", "qw", "qx", "qy", "qz"),
    low=np.array([0.0, -1.0, -1.0, -1.0, -1.0]),
    high=np.array([MAX_WALK_S, 1.0, 1.0, 1.0, 1.0]),
    rate_hz=50.0,
    what="Attitude as the phone estimates it: unit Hamilton quaternion, device to building frame (x east, z up).",
)
BARO: Final = SensorSpec(
    name="baro",
    columns=("t_s", "pressure_hpa"),
    low=np.array([0.0, 0.0]),
    high=np.array([MAX_WALK_S, 1260.0]),  # LPS22 ends there, BMP280 at 1100 hPa; pascals run into it
    rate_hz=10.0,
    what="Air pressure as the phone has it: a metre up is 0.12 hPa less.",
)
