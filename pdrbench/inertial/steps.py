"""Steps from the accelerometer of a phone."""

from __future__ import annotations

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
        from scipy import signal  # takes half a second to import

        self._sections = signal.butter(2, CUTOFF_HZ, fs=rate_hz, output="sos")
        self._filter = signal.sosfilt
        self._state: FloatArray = np.zeros((len(self._sections), 2))
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
        smooth, self._state = self._filter(self._sections, excess, zi=self._state)
        steps = []
        for t_s, value in zip(accel[:, 0].tolist(), smooth.tolist(), strict=True):
            is_peak = self._before < self._last >= value and self._last > THRESHOLD_MPS2
            if is_peak and self._last_t_s - self._step_t_s >= REFRACTORY_S:
                self._step_t_s = self._last_t_s
                steps.append(self._last_t_s)
            self._before, self._last, self._last_t_s = self._last, value, t_s
        return np.array(steps)
