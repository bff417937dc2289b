"""Steps by peaks of the vertical acceleration, and their lengths by Weinberg's formula."""

from __future__ import annotations

import math
from collections import deque

G_MPS2 = 9.81
LENGTH_K = 0.39  # a step over swing ** (1/4): Weinberg 2002, AN-602; its value: 24 train walks of MallPhone-v2
SMOOTHED_S = 0.15  # the next three: ours, of any textbook; a person takes one to three steps a second
PEAK_MPS2 = 0.8
APART_S = 0.35


class WeinbergSteps:
    """Finds steps one sample at a time.

    Args:
        rate_hz: Of the accelerometer.
    """

    def __init__(self, rate_hz: float) -> None:
        self._raw = deque[float](maxlen=max(1, round(SMOOTHED_S * rate_hz)))
        self._before = self._last = self._low = self._high = 0.0
        self._step_s = -math.inf

    def update(self, t_s: float, up_mps2: float) -> float:
        """Length of the step that has just become visible, in metres; 0 where there is none.

        Args:
            t_s: Time of a sample.
            up_mps2: Its acceleration upwards, with gravity.
        """
        self._raw.append(up_mps2 - G_MPS2)
        now = sum(self._raw) / len(self._raw)
        self._low, self._high = min(self._low, now), max(self._high, now)
        is_peak = self._before < self._last >= now and self._last > PEAK_MPS2 and t_s - self._step_s >= APART_S
        self._before, self._last = self._last, now
        if not is_peak:
            return 0.0
        swing_mps2 = self._high - self._low
        self._step_s, self._low, self._high = t_s, now, now
        return float(LENGTH_K * swing_mps2**0.25)
