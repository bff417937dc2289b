"""Sizes and constants of the networks, the same whether PyTorch or compiled code computes them."""

from __future__ import annotations

from typing import Final

from pdrbench_baselines.learned.attitude_sources import FOOT, PHONE
from pdrbench_baselines.learned.signals import CHANNELS

CNN: Final = "cnn"  # architecture of the network of phones
CNN_INPUTS: Final = CHANNELS + 2  # and height of the person, and whether it is known
CNN_LAYERS: Final = 5

# Of the network of a foot
DERIVED: Final = 3  # velocity x, y and turn since the beginning of the window, by integration
INPUTS: Final = CHANNELS + DERIVED + 2  # and height of the person, and whether it is known
FEATURES: Final = 96  # of a window
# Velocity, x and y in m/s, and yaw of the foot 2 s ago, 1 s ago and now in the frame of the window.
CHANGE: Final = 5
MEMORY: Final = 64
OUTPUTS: Final = 7  # direction x, y; log l11, l21, log l22 of the Cholesky factor; logit of standing; length
SCALES: Final = {  # of both, m/s2, rad/s, none: about the spread while walking
    PHONE: (3.0, 3.0, 3.0, 1.5, 1.5, 1.5, 1.0, 1.0, 1.0),
    FOOT: (6.0, 6.0, 6.0, 2.0, 2.0, 1.0, 1.0, 1.0, 1.0),
}
USUAL_HEIGHT_M: Final = (1.70, 0.10)  # mean and spread of people [V], to scale with
DERIVED_SCALES: Final = (1.5, 1.5, 0.7)  # m/s, m/s, rad
LOG_SIGMA: Final = (-4.6, 1.0)  # 1 cm to 2.7 m in a second

# Of the velocity of a foot
REST_MPS2: Final = 1.06  # ours, by the 3 cm above, as the next: a third of both gives 3.5 cm
REST_RADPS: Final = 0.71
NEAR_S: Final = 0.4  # ours: a third of a stride; a rest within so much counts more than the one before it
MIN_WEIGHT: Final = 1e-6  # of any sample, where a window knows no rest
