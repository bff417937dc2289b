"""Sizes and constants of the networks, the same whether PyTorch or compiled code computes them."""

from __future__ import annotations

from typing import Final

from pdrbench_baselines.learned.attitude_sources import FOOT, PHONE
from pdrbench_baselines.learned.signals import CHANNELS

DERIVED: Final = 3  # velocity x, y and turn since the beginning of the window, by integration
INPUTS: Final = CHANNELS + DERIVED + 2  # and height of the person, and whether it is known
FEATURES: Final = 96  # of a window
# Change of velocity, x and y in m/s, and yaw of the phone 2 s ago, 1 s ago and now in the frame of the window.
CHANGE: Final = 5
MEMORY: Final = 64
OUTPUTS: Final = 7  # direction x, y; log l11, l21, log l22 of the Cholesky factor; logit of standing; length
SCALES: Final = {  # m/s2, rad/s, none: about the spread while walking
    PHONE: (3.0, 3.0, 3.0, 1.5, 1.5, 1.5, 1.0, 1.0, 1.0),
    FOOT: (6.0, 6.0, 6.0, 2.0, 2.0, 1.0, 1.0, 1.0, 1.0),
}
USUAL_HEIGHT_M: Final = (1.70, 0.10)  # mean and spread of people [V], to scale with
DERIVED_SCALES: Final = {PHONE: (0.5, 0.5, 0.7), FOOT: (1.5, 1.5, 0.7)}  # m/s, m/s, rad
LOG_SIGMA: Final = (-4.6, 1.0)  # 1 cm to 2.7 m in a second

# Of networks whose length is a step rate times a step length
GAIT: Final = "gait"
GAIT_INPUTS: Final = 17  # shaking 6, slow rates 3, vertical 3, integrals 3, size of the shaking 2
FLOOR: Final = (0.3, 0.1)  # m/s2 and rad/s: shaking below it is not enlarged, so that standing stays standing
LAGS: Final = tuple(range(8, 82, 2))  # samples, 0.16 to 1.62 s: a quick step to a slow stride
STEP_LAGS: Final = (16, 60)  # samples, 0.32 to 1.2 s: steps of the quick, strides of the slow
SHAKES: Final = 0.4  # of the size of the shaking of force, 0.25 m/s2: who stands shakes less
MAX_STEPS_HZ: Final = 3.5  # sprinting
MAX_LOG_FACTOR: Final = 0.5  # exp(0.5) = 1.65 times the step law, and one over it
LAW_M: Final = (0.7, 0.371, 1.75, 0.227, 1.79)  # Chen, Pei & Chen 2011, as `pdrbench_sim.people.person`
DOUBT_M: Final = 0.4  # ours: added to the sigma of a second by full doubt, half of what walkers move by

# Of the velocity of a foot
REST_MPS2: Final = 1.06  # ours, by the 3 cm above, as the next: a third of both gives 3.5 cm
REST_RADPS: Final = 0.71
NEAR_S: Final = 0.4  # ours: a third of a stride; a rest within so much counts more than the one before it
MIN_WEIGHT: Final = 1e-6  # of any sample, where a window knows no rest
