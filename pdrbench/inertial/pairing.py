"""Accelerations and rates of one unit, sample by sample."""

from __future__ import annotations

from typing import Final

import numpy as np

from pdrbench.geometry import BoolArray, FloatArray

MOVES_RADPS: Final = 0.5  # a foot or a hand that turns faster never shows six equal numbers twice


def is_repeat(rows: FloatArray, before: FloatArray) -> BoolArray:
    """(n,) whether a row (n, 7) of time and sample stands twice, or a new time has the sample before once more.

    Some units send the last sample in place of one that was lost; at rest two may be equal.
    """
    both, is_again = np.concatenate([before, rows]), np.zeros(len(rows), dtype=np.bool_)
    at = np.flatnonzero(both[1:, 4] == both[:-1, 4]) + 1
    if len(at):
        at = at[(both[at, 1:] == both[at - 1, 1:]).all(axis=1)]
        at = at[(both[at, 0] == both[at - 1, 0]) | (np.linalg.norm(both[at, 4:], axis=1) > MOVES_RADPS)]
        is_again[at - len(before)] = True
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
        is_again = is_repeat(pairs, self._last)
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
