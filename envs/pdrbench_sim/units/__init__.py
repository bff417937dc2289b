"""Inertial units: error profiles, and what one of a kind measures.

`motion.RigidMotion` gives ideal signals, `device.draw_unit` a unit of a profile (`profiles.imu_profile`) that measures
them. `STRIDE_LAW` is the fitted law of the errors of strides; the laboratory fits it to recordings.
"""

from pathlib import Path
from typing import Final

STRIDE_LAW: Final = Path(__file__).with_name("stride_law.json")
