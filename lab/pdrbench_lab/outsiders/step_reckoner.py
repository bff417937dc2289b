"""A phone's plain dead reckoning: steps of Weinberg's lengths along the attitude of any package."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from pdrbench.geometry import FloatArray
from pdrbench.inertial import SamplePairs, phone_heading_rad, to_world
from pdrbench.localizer import Briefing, Estimate, Observation
from pdrbench_lab.outsiders.weinberg import WeinbergSteps

Attitude = Callable[[FloatArray, FloatArray, FloatArray], FloatArray]
"""Attitude wxyz, phone to east, north, up, after a rate, a specific force and a magnetic field, (3,) each."""


class StepReckoner:
    """Adds steps along the top edge of a phone, from a known start.

    Args:
        briefing: With a start, and a phone with accelerometer, gyroscope and magnetometer.
        attitude: Asked of every sample; the magnetic field is the latest.
    """

    def __init__(self, briefing: Briefing, attitude: Attitude) -> None:
        assert briefing.start is not None
        self._attitude, self._pairs, self._steps = attitude, SamplePairs(), WeinbergSteps(rate_of(briefing))
        self._mag: FloatArray = np.zeros((0, 4))
        self._xy_m, self._level = np.array(briefing.start.xy_m), briefing.start.level
        self._has_level_changes = "level_change" in briefing.sensors

    def step(self, observation: Observation) -> Estimate:
        """As `Localizer.step`."""
        rows = self._pairs.update(observation["accel"], observation["gyro"])
        self._mag = np.concatenate([self._mag[-1:], observation["mag"]])
        if len(self._mag):
            latest = np.maximum(np.searchsorted(self._mag[:, 0], rows[:, 0], side="right") - 1, 0)
            for row, mag in zip(rows, self._mag[latest], strict=True):
                self._add(row, np.ascontiguousarray(mag[1:4]))
        if self._has_level_changes:
            self._level += int(observation["level_change"][:, 1].sum())
        return Estimate(self._xy_m, self._level)

    def _add(self, row: FloatArray, mag_ut: FloatArray) -> None:
        """One sample, (7,) time, specific force, rate."""
        quaternion = self._attitude(np.ascontiguousarray(row[4:7]), np.ascontiguousarray(row[1:4]), mag_ut)
        length_m = self._steps.update(float(row[0]), float(to_world(quaternion, row[1:4])[2]))
        if length_m:
            heading_rad = float(phone_heading_rad(quaternion))
            self._xy_m = self._xy_m + length_m * np.array([math.cos(heading_rad), math.sin(heading_rad)])


def rate_of(briefing: Briefing) -> float:
    """Of a phone with a start and a magnetometer; declines anything else."""
    briefing.require(sensors=("accel", "gyro", "mag"), start=True, carrier="phone", min_rate_hz=20.0)
    return briefing.sensors["accel"].rate_hz or 50.0
