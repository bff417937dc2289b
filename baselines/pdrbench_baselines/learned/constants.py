"""Sizes and constants of the network, the same whether PyTorch or compiled code computes it."""

from __future__ import annotations

from typing import Final

from pdrbench_baselines.learned.signals import CHANNELS

CNN: Final = "cnn"  # its architecture
INPUTS: Final = CHANNELS + 2  # and height of the person, and whether it is known
LAYERS: Final = 5
OUTPUTS: Final = 6  # displacement x, y; log l11, l21, log l22 of the Cholesky factor; logit of standing
SCALES: Final = (3.0, 3.0, 3.0, 1.5, 1.5, 1.5, 1.0, 1.0, 1.0)  # m/s2, rad/s, none: about the spread while walking
USUAL_HEIGHT_M: Final = (1.70, 0.10)  # mean and spread of people [V], to scale with
LOG_SIGMA: Final = (-4.6, 1.0)  # 1 cm to 2.7 m in a second
