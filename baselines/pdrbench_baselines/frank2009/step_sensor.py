"""The virtual step sensor of Frank et al. 2009, eq. (2)-(5): from a foot filter to steps of the pedestrian (F8).

The lower filter knows the yaw of the unit; the pedestrian's heading is that plus a misalignment, which "has to be fixed
initially": here by the first strides, whose direction is the pedestrian's heading.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pdrbench.geometry import FloatArray, wrap_rad
from pdrbench.inertial.foot_filter import FootFilter, FootParams
from pdrbench.inertial.pairing import SamplePairs
from pdrbench.inertial.strides import Strides, StrideSegmenter


@dataclass(frozen=True, slots=True)
class StepSensorParams:
    """Settings of `StepSensor`.

    Attributes:
        strides: The misalignment is the mean over so many strides: those with which the walk begins.
        min_stride_m: The direction of a shorter stride is not used.
    """

    strides: int = 3  # ours: a foot is set down within some degrees of the heading of travel
    min_stride_m: float = 0.5  # ours


class VirtualSteps(NamedTuple):
    """Measures of the steps of a pedestrian.

    Attributes:
        known_s: (S,) when each became known.
        step: (S, 3) ahead_m, left_m in the heading before the step; change of heading, radians: eq. (4).
        misalignment_change_rad: (S,) change of the misalignment before the step. A heading that contains the last
            misalignment has to be changed by it first; steps before are not turned.
    """

    known_s: FloatArray
    step: FloatArray
    misalignment_change_rad: FloatArray


class StepSensor:
    """Turns strides of the lower filter into steps.

    The misalignment is that of the first stride, and the mean over the first strides when these have come; then it
    stays. Before the first stride that is long enough it is 0.

    Args:
        params: See `StepSensorParams`.
    """

    def __init__(self, params: StepSensorParams | None = None) -> None:
        self._params = params or StepSensorParams()
        self._seen: list[float] = []
        self._yaw_rad = 0.0
        self.misalignment_rad = 0.0

    @property
    def heading_rad(self) -> float:
        """The pedestrian's heading after the last step, in the world frame of the lower filter."""
        return float(wrap_rad(self._yaw_rad + self.misalignment_rad))

    def update(self, strides: Strides) -> VirtualSteps:
        """The steps of the next S strides."""
        count = len(strides.known_s)
        step, misalignment_change_rad = np.zeros((count, 3)), np.zeros(count)
        off_rad = strides.heading_rad - wrap_rad(strides.yaw_rad - strides.yaw_turn_rad)
        for k in range(count):
            misalignment_change_rad[k] = self._look(float(strides.length_m[k]), float(off_rad[k]))
            step[k] = strides.steps(self.misalignment_rad)[k]
            self._yaw_rad = float(strides.yaw_rad[k])
        return VirtualSteps(strides.known_s, step, misalignment_change_rad)

    def _look(self, length_m: float, off_rad: float) -> float:
        """Takes a stride into the mean while it is one of the first; returns the change of the misalignment."""
        if len(self._seen) >= self._params.strides or length_m < self._params.min_stride_m:
            return 0.0
        self._seen.append(off_rad)
        before_rad = self.misalignment_rad
        self.misalignment_rad = math.atan2(np.sin(self._seen).sum(), np.cos(self._seen).sum())
        return float(wrap_rad(self.misalignment_rad - before_rad))


class FootSteps:
    """From the rows of a unit on the foot to steps: lower filter, rest phases, step sensor.

    Args:
        rate_hz: Nominal rate of the unit.
        filter_params: Of the lower filter.
        params: Of the step sensor.
    """

    def __init__(self, rate_hz: float, filter_params: FootParams, params: StepSensorParams | None = None) -> None:
        self._filter = FootFilter(rate_hz, filter_params)
        self._segmenter = StrideSegmenter()
        self.sensor = StepSensor(params)
        self._pairs = SamplePairs()

    @property
    def field_rad(self) -> float | None:
        """Direction of the horizontal magnetic field in the world frame of the lower filter, once it is known."""
        memory = self._filter.memory
        if memory is None or math.isnan(memory.field_heading[0]):
            return None
        return float(memory.field_heading[0])

    def update(self, rows: Mapping[str, FloatArray]) -> VirtualSteps:
        """Takes the next rows.

        Args:
            rows: `accel` and `gyro`, and `mag` where there is one: (n, 4) t_s and three axes each.
        """
        both = self._pairs.update(rows["accel"], rows["gyro"])
        if not len(both):
            return VirtualSteps(np.zeros(0), np.zeros((0, 3)), np.zeros(0))
        t_s = both[:, 0].copy()
        states = self._filter.update(t_s, both[:, 1:4], both[:, 4:7], _at_samples(rows.get("mag"), t_s))
        return self.sensor.update(self._segmenter.update(states))


def _at_samples(mag: FloatArray | None, t_s: FloatArray) -> FloatArray | None:
    """(n, 3) the magnetic field at the nearest sample within half a period of one, NaN elsewhere."""
    if mag is None:
        return None
    if np.array_equal(mag[:, 0], t_s):
        return mag[:, 1:4].copy()
    field = np.full((len(t_s), 3), np.nan)
    if len(mag):
        steps_s = np.sort(t_s[1:] - t_s[:-1])  # `np.median` takes ten times as long for a few
        half_s = 0.25 * (steps_s[(len(steps_s) - 1) // 2] + steps_s[len(steps_s) // 2]) if len(steps_s) else 0.005
        after = np.minimum(np.searchsorted(t_s, mag[:, 0]), len(t_s) - 1)
        before = np.maximum(after - 1, 0)
        is_before = np.abs(t_s[before] - mag[:, 0]) < np.abs(t_s[after] - mag[:, 0])
        at = np.where(is_before, before, after)
        near = np.abs(t_s[at] - mag[:, 0]) <= half_s
        field[at[near]] = mag[near, 1:4]
    return field
