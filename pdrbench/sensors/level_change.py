"""Changes of level, as `pdrbench.inertial.LevelTracker` finds them in pressure and steps."""

from __future__ import annotations

from typing import Final

import numpy as np

from pdrbench.recording import MAX_WALK_S, SensorSpec

LEVEL_CHANGE: Final = SensorSpec(
    name="level_change",
    columns=("t_s", "levels", "rise_m", "way"),
    low=np.array([0.0, -200.0, -1000.0, 0.0]),
    high=np.array([MAX_WALK_S, 200.0, 1000.0, 3.0]),
    rate_hz=None,
    what=(
        "The middle between two levels was passed: by how many levels upwards, the height of the new level above the "
        "old one, and the way: 1 stairs, 2 lift, 3 escalator, 0 unknown."
    ),
)
