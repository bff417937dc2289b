"""Steps from the accelerometer of a phone."""

from __future__ import annotations

import math

import numpy as np

from pdrbench.geometry import FloatArray

GRAVITY_MPS2 = 9.81
CUTOFF_HZ = 3.0  # L4; a person takes one to three steps a second
THRESHOLD_MPS2 = 1.0  # smallest height of a peak above gravity; ours, as the next
REFRACTORY_S = 0.3  # shortest time between two steps


class PeakStepDetector:
    """A plain causal peak detector: low-pass the magnitude, take each maximum that is high and late enough.

    Args:
        rate_hz: Nominal rate of the accelerometer.
    """

    def __init__(self, rate_hz: float) -> None:
        if not rate_hz > 2 * CUTOFF_HZ:
            raise ValueError(f"steps need more than {2 * CUTOFF_HZ:.0f} samples a second; got {rate_hz}")
        # Butterworth of second order by the bilinear transform, as `scipy.signal.butter`, which takes long to import
        warped = math.tan(math.pi * CUTOFF_HZ / rate_hz)
        scale = 1.0 + math.sqrt(2.0) * warped + warped**2
        self._gain = warped**2 / scale
        self._poles = 2.0 * (warped**2 - 1.0) / scale, (1.0 - math.sqrt(2.0) * warped + warped**2) / scale
        self._state = 0.0, 0.0
        self._before, self._last = -np.inf, -np.inf
        self._last_t_s = 0.0
        self._step_t_s = -np.inf

    def update(self, accel: FloatArray) -> FloatArray:
        """Takes the next rows and gives the steps that became visible in them.

        Args:
            accel: (n, 4) t_s, x, y, z in m/s^2, following on those of the last call.

        Returns:
            (k,) times of the peaks of the filtered magnitude, at most one sample and the filter's delay late.
        """
        if not len(accel):
            return np.zeros(0)
        excess = np.linalg.norm(accel[:, 1:4], axis=1) - GRAVITY_MPS2
        (first, second), (pole, last_pole) = self._state, self._poles
        steps = []
        for t_s, value_in in zip(accel[:, 0].tolist(), (self._gain * excess).tolist(), strict=True):
            value = value_in + first
            first, second = 2.0 * value_in - pole * value + second, value_in - last_pole * value
            is_peak = self._before < self._last >= value and self._last > THRESHOLD_MPS2
            if is_peak and self._last_t_s - self._step_t_s >= REFRACTORY_S:
                self._step_t_s = self._last_t_s
                steps.append(self._last_t_s)
            self._before, self._last, self._last_t_s = self._last, value, t_s
        self._state = first, second
        return np.array(steps)
