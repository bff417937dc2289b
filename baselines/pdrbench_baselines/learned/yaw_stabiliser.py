"""An attitude whose yaw follows the gyroscope, and the compass only in the mean.

The rotation vector of a phone gives way to its compass within some three seconds (sources.md 1.5), and the field of a
building turns every few metres: over one leg of a walk through a shopping centre the reported yaw wanders by 5 to 10
degrees. What turns less is the mean, over the walk so far, of how far the reported yaw has run away from the integrated
rate. This yaw is the integrated rate plus that mean. Turning a walk turns it by exactly the same angle.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from pdrbench.geometry import FloatArray
from pdrbench.inertial.quaternions import about_vertical, multiply
from pdrbench_baselines.learned.kernels import yaw_means

MEAN_S: Final = 30.0  # ours, by the val legs of MallPhone-v2: 10 s 1.74 m, 30 and 100 s 1.68 m, untouched 1.93 m; a
# gyroscope that drifts by 0.1 degrees/s is off by 3 degrees with it
SETTLES_S: Final = 2.0  # ours: on one walk the reported yaw lagged by a second after a gap
MAX_GAP_S: Final = 0.25  # over longer ones the rate is unknown, and the reported yaw is followed


class YawStabiliser:
    """Takes rotation vectors and rates as they come; gives the rotation vectors with another yaw.

    The mean forgets with the time constant `MEAN_S`, once the walk is longer than that. For `SETTLES_S` after a gap the
    reported yaw is followed as well: one that lags, or jumps and comes back, then shows how far the phone has turned
    since before the gap.

    Attributes:
        means_rad: (r,) that mean at each of the rotation vectors given last: by so much their yaw is turned from one
            that follows the gyroscope alone.
    """

    def __init__(self) -> None:
        self._settled_s = -np.inf
        self._rotation = np.zeros((0, 5))  # the last one reported, and those that wait for rates
        self._gyro = np.zeros((0, 4))
        self._is_begun = False
        self._since_s = self._run_away_rad = self._mean_rad = 0.0
        self.means_rad: FloatArray = np.zeros(0)

    def update(self, rotation: FloatArray, gyro: FloatArray) -> FloatArray:
        """(r, 5) rotation vectors up to the newest rate.

        Args:
            rotation: (k, 5) t_s and unit Hamilton wxyz, phone to world, later than those before.
            gyro: (m, 4) t_s and rates in rad/s, likewise.
        """
        self._rotation = np.concatenate([self._rotation, rotation])
        self._gyro = np.concatenate([self._gyro, gyro])
        self.means_rad = np.zeros(0)
        if not len(self._rotation) or not len(self._gyro):
            return np.zeros((0, 5))
        count = int(np.searchsorted(self._rotation[:, 0], self._gyro[-1, 0], side="right"))
        if not self._is_begun and not count:
            return np.zeros((0, 5))
        ready = self._rotation[: max(count, 1)]
        self.means_rad, corrections_rad = self._means_and_corrections_rad(ready)
        reported = ready[1:]
        if not self._is_begun:  # the first one is as reported
            self._is_begun, reported = True, ready
            self.means_rad, corrections_rad = np.append(0.0, self.means_rad), np.append(0.0, corrections_rad)
        self._rotation = self._rotation[len(ready) - 1 :]
        first = int(np.searchsorted(self._gyro[:, 0], self._rotation[0, 0], side="right")) - 1
        self._gyro = self._gyro[max(first, 0) :]
        return np.column_stack([reported[:, :1], multiply(about_vertical(corrections_rad), reported[:, 1:5])])

    def _means_and_corrections_rad(self, rotation: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(r - 1,) the mean, and by how much to turn, at all of them (r, 5) but the first."""
        state = self._settled_s, self._since_s, self._run_away_rad, self._mean_rad
        means_rad, runs_rad, state = yaw_means(rotation, self._gyro, MAX_GAP_S, SETTLES_S, MEAN_S, state)
        self._settled_s, self._since_s, self._run_away_rad, self._mean_rad = state
        return means_rad, means_rad - runs_rad
