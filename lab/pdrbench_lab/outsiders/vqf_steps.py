"""vqf: attitude by the versatile quaternion-based filter, steps and Weinberg lengths, on a phone."""

from __future__ import annotations

import numpy as np

from pdrbench.geometry import FloatArray
from pdrbench.localizer import Briefing, Estimate, Observation
from pdrbench_lab.outsiders.packages import outside
from pdrbench_lab.outsiders.step_reckoner import StepReckoner, rate_of


class VqfSteps:
    """Adds steps of Weinberg's length along the attitude of VQF (Laidig & Seel 2023) with its own settings.

    VQF estimates the biases of the gyroscope and refuses a disturbed magnetic field.
    """

    def __init__(self) -> None:
        self._package = outside("vqf")

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        self._filter = self._package.VQF(1.0 / rate_of(briefing))
        self._reckoner = StepReckoner(briefing, self._attitude)

    def step(self, observation: Observation) -> Estimate:
        return self._reckoner.step(observation)

    def _attitude(self, gyro: FloatArray, accel: FloatArray, mag: FloatArray) -> FloatArray:
        self._filter.update(gyro, accel, mag)
        quaternion: FloatArray = self._filter.getQuat9D()
        return quaternion
