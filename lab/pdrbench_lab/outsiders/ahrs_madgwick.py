"""ahrs: attitude by Madgwick's gradient descent, steps and Weinberg lengths, on a phone."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from pdrbench.geometry import FloatArray
from pdrbench.inertial import multiply
from pdrbench.localizer import Briefing, Estimate, Observation
from pdrbench_lab.outsiders.packages import outside
from pdrbench_lab.outsiders.step_reckoner import StepReckoner, rate_of

WEST_TO_NORTH = np.sqrt([0.5, 0.0, 0.0, 0.5])  # a quarter turn: ahrs has x north and y west, we have x east


class AhrsMadgwick:
    """Adds steps of Weinberg's length along the attitude of ahrs' Madgwick filter with its own gain."""

    def __init__(self) -> None:
        self._filters = outside("ahrs.filters")

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        self._filter = self._filters.Madgwick(frequency=rate_of(briefing))
        self._filter.gain = self._filter.gain_marg
        self._quaternion: FloatArray | None = None
        self._reckoner = StepReckoner(briefing, self._attitude)

    def step(self, observation: Observation) -> Estimate:
        return self._reckoner.step(observation)

    def _attitude(self, gyro: FloatArray, accel: FloatArray, mag: FloatArray) -> FloatArray:
        before = _first(accel, mag) if self._quaternion is None else self._quaternion
        self._quaternion = np.asarray(self._filter.updateMARG(before, gyro, accel, mag))
        return multiply(WEST_TO_NORTH, self._quaternion)


def _first(accel: FloatArray, mag: FloatArray) -> FloatArray:
    """Attitude wxyz, phone to north, west, up, of one sample."""
    up = accel / np.linalg.norm(accel)
    west = np.cross(up, mag)
    west /= np.linalg.norm(west)
    first: FloatArray = Rotation.from_matrix([np.cross(west, up), west, up]).as_quat()[[3, 0, 1, 2]]
    return first
