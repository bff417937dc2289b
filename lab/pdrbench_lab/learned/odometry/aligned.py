"""What the networks see: rates and specific force at 200 Hz in the frame of an attitude, z up, whose yaw is any.

RoNIN calls it the heading-agnostic coordinate frame, TLIO the local gravity-aligned frame. Here it is that of the
phone's rotation vector with a steady yaw. Logs of 50 or 100 Hz are interpolated linearly: what a sensor of 200 Hz
measures above 25 or 50 Hz is not in them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from pdrbench.geometry import BoolArray, FloatArray
from pdrbench.inertial import to_world
from pdrbench_baselines.learned.kernels import attitudes_at
from pdrbench_baselines.learned.signals import has_samples

RATE_HZ: Final = 200.0  # of both papers
LENGTH: Final = 200  # samples of a window


@dataclass(frozen=True, slots=True, eq=False)
class Aligned:
    """Samples on an even grid of `RATE_HZ`.

    Attributes:
        first_s: Time of the first one.
        rows: (n, 6) rates in rad/s and specific force, gravity included, in m/s2.
        is_whole: (n,) False where samples were missing.
    """

    first_s: float
    rows: FloatArray
    is_whole: BoolArray

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def t_s(self) -> FloatArray:
        """(n,) times."""
        return self.first_s + np.arange(len(self.rows)) / RATE_HZ


def aligned(accel: FloatArray, gyro: FloatArray, rotation: FloatArray, from_s: float, count: int) -> Aligned:
    """Samples in the frame of an attitude.

    Args:
        accel: (k, 4) t_s and specific force in m/s2.
        gyro: (m, 4) t_s and rates in rad/s.
        rotation: (r, 5) t_s and unit Hamilton wxyz, phone to world.
        from_s: Time of the first sample.
        count: Number of samples.
    """
    t_s = from_s + np.arange(count) / RATE_HZ
    columns = []
    for rows in (gyro, accel):
        world = to_world(attitudes_at(rotation, rows[:, 0]), rows[:, 1:4])
        columns += [np.interp(t_s, rows[:, 0], one) for one in world.T]
    is_whole = np.logical_and.reduce([has_samples(rows[:, 0], t_s) for rows in (accel, gyro, rotation)])
    return Aligned(from_s, np.column_stack(columns), is_whole)
