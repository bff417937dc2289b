"""Accelerations and rates of one unit, sample by sample."""

from __future__ import annotations

from typing import Final

import numpy as np

from pdrbench.geometry import BoolArray, FloatArray

MOVES_RADPS: Final = 0.5  # a foot or a hand that turns faster never shows six equal numbers twice


def is_repeat(t_s: FloatArray, accel: FloatArray, gyro: FloatArray) -> BoolArray:
    """(n,) whether a row (n,), (n, 3), (n, 3) stands twice, or a new time has the sample before once more.

    Some units send the last sample in place of one that was lost; at rest two may be equal.
    """
    is_again = np.zeros(len(t_s), dtype=np.bool_)
    at = np.flatnonzero(gyro[1:, 0] == gyro[:-1, 0]) + 1
    if len(at):
        at = at[((gyro[at] == gyro[at - 1]) & (accel[at] == accel[at - 1])).all(axis=1)]
        is_again[at[(t_s[at] == t_s[at - 1]) | (np.linalg.norm(gyro[at], axis=1) > MOVES_RADPS)]] = True
    return is_again


class SamplePairs:
    """Lays the rows of an accelerometer and of a gyroscope side by side, as they come in.

    Rates are interpolated where a unit samples the two at different times; an acceleration waits until a rate that is
    not earlier has come. Repetitions of the sample before are left out.
    """

    def __init__(self) -> None:
        self._waiting: FloatArray = np.zeros((0, 4))
        self._rate: FloatArray = np.zeros((0, 4))
        self._last: FloatArray = np.zeros((0, 7))

    def update(self, accel: FloatArray, gyro: FloatArray) -> FloatArray:
        """Takes the next rows, (n, 4) and (m, 4) time and three axes.

        Returns:
            (k, 7) time, specific force, rate of the accelerations that now have a rate.
        """
        pairs = self._pairs(accel, gyro)
        if not len(pairs):
            return pairs
        both = np.concatenate([self._last, pairs])
        is_again = is_repeat(both[:, 0], both[:, 1:4], both[:, 4:])[len(self._last) :]
        self._last = pairs[-1:]
        return pairs[~is_again] if is_again.any() else pairs

    def _pairs(self, accel: FloatArray, gyro: FloatArray) -> FloatArray:
        if not len(self._waiting) and np.array_equal(accel[:, 0], gyro[:, 0]):
            return np.concatenate([accel, gyro[:, 1:4]], axis=1)
        self._waiting = np.concatenate([self._waiting, accel])
        self._rate = np.concatenate([self._rate, gyro])
        if not len(self._rate):
            return np.zeros((0, 7))
        is_ready = self._waiting[:, 0] <= self._rate[-1, 0]
        ready, self._waiting = self._waiting[is_ready], self._waiting[~is_ready]
        rates = [np.interp(ready[:, 0], self._rate[:, 0], self._rate[:, axis]) for axis in (1, 2, 3)]
        self._rate = self._rate[-1:]
        return np.column_stack([ready, *rates])
