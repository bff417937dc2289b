"""Strides of one foot, as a foot-mounted inertial unit with zero-velocity updates reports them."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from pdrbench.recording import MAX_WALK_S, SensorSpec

STRIDE: Final = SensorSpec(
    name="stride",
    columns=("t_s", "length_m", "height_m", "turn_rad"),
    low=np.array([0.0, 0.0, -3.0, -math.pi]),
    high=np.array([MAX_WALK_S, 5.0, 3.0, math.pi]),
    rate_hz=None,
    what=(
        "One stride of one foot, reported while the foot rests: horizontal length, change of height, and change of the "
        "course since the previous stride (counter-clockwise positive), to be applied before the length. The first "
        "turn counts from the start heading. A stride shorter than 0.1 m turns by the yaw of the foot."
    ),
)
