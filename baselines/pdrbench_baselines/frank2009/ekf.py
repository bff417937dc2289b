"""The upper Kalman filter of Frank et al. 2009, eq. (6)-(23): place and heading from steps and WLAN (F9-F12).

The state is x = (x_m, y_m, heading_rad); C(a) is the rotation by a, counter-clockwise. Pure functions: each returns a
new belief.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pdrbench.geometry import FloatArray, wrap_rad


class Belief(NamedTuple):
    """A normal law over place and heading.

    Attributes:
        mean: (3,) x_m, y_m, heading_rad within (-pi, pi].
        cov: (3, 3).
    """

    mean: FloatArray
    cov: FloatArray

    @property
    def sigma_m(self) -> float:
        """Standard deviation of the place per axis, as a root mean square."""
        return math.sqrt((self.cov[0, 0] + self.cov[1, 1]) / 2)


def moved(mean: FloatArray, step: FloatArray) -> FloatArray:
    """The state after a step: r + C(heading) d, heading + turn; eq. (9), (10) without noise.

    The step is taken along the heading *before* it (F9).

    Args:
        mean: (3,).
        step: (3,) ahead_m, left_m, turn_rad: eq. (4).
    """
    c, s = math.cos(mean[2]), math.sin(mean[2])
    x_m = mean[0] + c * step[0] - s * step[1]
    y_m = mean[1] + s * step[0] + c * step[1]
    return np.array([x_m, y_m, float(wrap_rad(mean[2] + step[2]))])


def moved_jacobian(mean: FloatArray, step: FloatArray) -> FloatArray:
    """(3, 3) derivative of `moved` by the state: 1 and, in the last column, g = C'(heading) d; eq. (15)-(17).

    Evaluated at the mean of the belief before the step (F11).
    """
    c, s = math.cos(mean[2]), math.sin(mean[2])
    jacobian = np.eye(3)
    jacobian[0, 2] = -s * step[0] - c * step[1]
    jacobian[1, 2] = c * step[0] - s * step[1]
    return jacobian


def predict(belief: Belief, step: FloatArray, sigma: FloatArray) -> Belief:
    """After a step, eq. (13), (14).

    Args:
        belief: Before it.
        step: (3,) as for `moved`.
        sigma: (3,) standard deviations of its noise: two along the axes of the building, one of the heading; eq. (23).
    """
    jacobian = moved_jacobian(belief.mean, step)
    cov = jacobian @ belief.cov @ jacobian.T + np.diag(np.square(sigma))
    return Belief(moved(belief.mean, step), (cov + cov.T) / 2)


def update(belief: Belief, xy_m: FloatArray, sigma_m: float, degrees: float = math.inf) -> tuple[Belief, float]:
    """After a measured place, eq. (18)-(22); also the normalised innovation squared (NIS).

    The NIS is chi-square with two degrees of freedom where the filter is consistent.

    Args:
        belief: Before it.
        xy_m: (2,) measured.
        sigma_m: Standard deviation per axis.
        degrees: Of freedom of the Student law of its error; infinite for a normal one, as in the paper. Otherwise R
            counts (degrees + NIS) / (degrees + 2) times where that is more than once: the weight that a Student law
            with so many degrees gives to an innovation of that size.
    """
    innovation = np.asarray(xy_m) - belief.mean[:2]
    variance = sigma_m**2 * np.eye(2)
    nis = float(innovation @ np.linalg.solve(belief.cov[:2, :2] + variance, innovation))
    factor = 1.0 if math.isinf(degrees) else max((degrees + nis) / (degrees + 2), 1.0)
    gain = np.linalg.solve(belief.cov[:2, :2] + factor * variance, belief.cov[:2, :]).T
    mean = belief.mean + gain @ innovation
    mean[2] = float(wrap_rad(mean[2]))
    cov = belief.cov - gain @ belief.cov[:2, :]
    return Belief(mean, (cov + cov.T) / 2), nis


def turned(belief: Belief, by_rad: float) -> Belief:
    """The same place with the heading turned; the uncertainty stays."""
    return Belief(np.append(belief.mean[:2], float(wrap_rad(belief.mean[2] + by_rad))), belief.cov)
