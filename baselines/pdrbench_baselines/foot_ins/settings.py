"""Settings of the foot filter that are newer than those of `pdrbench.inertial`."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from pdrbench.inertial import ROBUST

# A foot is slowest at 0.2 to 0.5 m/s where it runs; data sheets of accelerometers of the consumer class give biases of
# 20 to 80 mg; `knee_fraction` and `clipped_sigma_fraction` are fitted, see `left_out`.
REWEIGHTED: Final = replace(
    ROBUST,
    detector=replace(ROBUST.detector, knee_fraction=0.024),
    accel_bias_mps2=0.3,
    ties_level=True,
    slip_mps=0.3,
)
