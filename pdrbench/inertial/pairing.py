"""Accelerations and rates of one unit, sample by sample."""

from __future__ import annotations

import numpy as np

from pdrbench.geometry import FloatArray


class SamplePairs:
    """Lays the rows of an accelerometer and of a gyroscope side by side, as they come in.

    Rates are interpolated where a unit samples the two at different times; an acceleration waits until a rate that is
    not earlier has come.
    """

    def __init__(self) -> None:
        self._waiting: FloatArray = np.zeros((0, 4))
        self._rate: FloatArray = np.zeros((0, 4))

    def update(self, accel: FloatArray, gyro: FloatArray) -> FloatArray:
        """Takes the next rows, (n, 4) and (m, 4) time and three axes.

        Returns:
            (k, 7) time, specific force, rate of the accelerations that now have a rate.
        """
        if not len(self._waiting) and np.array_equal(accel[:, 0], gyro[:, 0]):
            return np.column_stack([accel, gyro[:, 1:4]])
        self._waiting = np.concatenate([self._waiting, accel])
        self._rate = np.concatenate([self._rate, gyro])
        if not len(self._rate):
            return np.zeros((0, 7))
        is_ready = self._waiting[:, 0] <= self._rate[-1, 0]
        ready, self._waiting = self._waiting[is_ready], self._waiting[~is_ready]
        rates = [np.interp(ready[:, 0], self._rate[:, 0], self._rate[:, axis]) for axis in (1, 2, 3)]
        self._rate = self._rate[-1:]
        return np.column_stack([ready, *rates])
