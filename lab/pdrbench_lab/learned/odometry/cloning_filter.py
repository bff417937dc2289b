"""Error-state Kalman filter with stochastic cloning: TLIO (Liu et al., RA-L 2020), section VI.

State: attitude R (body to world), velocity v, position p, biases of gyroscope and accelerometer, and copies (clones) of
attitude and position at the last times at which the network was asked. Errors are in the world frame: the true attitude
is exp(theta) R. The network is given a window that was turned by the attitudes of the filter; an error of their yaw
turns window and displacement alike. So the displacement d of the window between clones i and j measures

    p_j - p_i = d + (z x d) theta_z,i + noise,

which is the paper's measurement in the local gravity-aligned frame without Euler angles, whose yaw is singular for a
phone that is held upright. It says nothing about the yaw, which drifts with the gyroscope.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from pdrbench.geometry import FloatArray, wrap_rad
from pdrbench_baselines.learned.signals import GRAVITY_MPS2

CLONE: Final = 6  # attitude, position
CURRENT: Final = 15  # attitude, velocity, position, bias of gyroscope, bias of accelerometer
THETA, SPEED, PLACE, GYRO, ACCEL = (slice(first, first + 3) for first in range(0, CURRENT, 3))
COAST_RAD: Final = 0.5  # ours: per root second without samples
COAST_MPS: Final = 1.0  # likewise
_UP: Final = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, slots=True)
class CloningParams:
    """Settings of the filter; of the published implementation unless a line says otherwise.

    Attributes:
        accel_noise_mps2, gyro_noise_radps: Of a sample at 200 Hz.
        accel_bias_walk, gyro_bias_walk: Of the biases, m/s2 and rad/s per root second.
        tilt_sigma_rad: Of the first attitude; 10 degrees there, the rotation vector of a phone is better.
        yaw_sigma_rad: Likewise.
        speed_sigma_mps: The walk begins at rest, or not.
        accel_bias_mps2, gyro_bias_radps: Prior of the biases; that of the gyroscope 1e-4 there, after a calibration.
        overlap: Windows overlap: the variance of a displacement is multiplied by as many as share a sample.
        gate: Chi-square of three degrees of freedom (99 %) above which a displacement gets a larger variance.
        compass_sigma_rad: Of the yaw of the rotation vector once a second, independent; the paper has no compass and
            starts with the yaw of visual-inertial odometry. inf to leave it out.
    """

    accel_noise_mps2: float = math.sqrt(1e-3)
    gyro_noise_radps: float = math.sqrt(1e-4)
    accel_bias_walk: float = 1e-4
    gyro_bias_walk: float = 1e-6
    tilt_sigma_rad: float = math.radians(2.0)  # ours
    yaw_sigma_rad: float = math.radians(11.0)  # ours, sources.md 1.5
    speed_sigma_mps: float = 1.0
    accel_bias_mps2: float = 0.2
    gyro_bias_radps: float = 1e-3  # ours: 0.06 degrees/s
    overlap: float = 5.0  # 10 for 20 windows a second in the paper
    gate: float = 11.345
    compass_sigma_rad: float = 0.3  # ours


class CloningFilter:
    """The filter of one walk.

    Args:
        rotation: (3, 3) the first attitude, body to world.
        params: See `CloningParams`.

    Attributes:
        rotation: (3, 3) body to world.
        speed_mps, place_m: (3,) in the world frame; the place since the start.
        cov: Covariance, clones first, then the current state.
        clones_m: Places of the clones.
    """

    def __init__(self, rotation: FloatArray, params: CloningParams) -> None:
        p = self._params = params
        self.rotation = np.array(rotation)
        self.speed_mps, self.place_m = np.zeros(3), np.zeros(3)
        self._gyro_bias, self._accel_bias = np.zeros(3), np.zeros(3)
        sigma = np.empty(CURRENT)
        sigma[THETA] = p.tilt_sigma_rad, p.tilt_sigma_rad, p.yaw_sigma_rad
        sigma[SPEED], sigma[PLACE] = p.speed_sigma_mps, 1e-3
        sigma[GYRO], sigma[ACCEL] = p.gyro_bias_radps, p.accel_bias_mps2
        self.cov: FloatArray = np.diag(sigma**2)
        self.clones_m: list[FloatArray] = []

    @property
    def yaw_rad(self) -> float:
        """Of the phone's attitude about the vertical: the twist, which has no singularity but upside down."""
        r = self.rotation
        return math.atan2(r[1, 0] - r[0, 1], r[0, 0] + r[1, 1])

    @property
    def current_cov(self) -> FloatArray:
        """(15, 15) of the current state."""
        return self.cov[-CURRENT:, -CURRENT:]

    def propagate(self, gyro: FloatArray, accel: FloatArray, step_s: float) -> FloatArray:
        """Integrates n samples of rates and specific force (n, 3) in the frame of the body, `step_s` apart.

        Returns:
            (n, 6) rates and force in the world frame, for the network.
        """
        rates, forces = gyro - self._gyro_bias, accel - self._accel_bias
        turns = _rotations(rates * step_s)
        world = np.empty((len(rates), 6))
        transition, noise = np.eye(CURRENT), np.zeros((CURRENT, CURRENT))
        driven = self._driven(step_s)
        for k in range(len(rates)):
            middle = self.rotation
            force = middle @ forces[k]
            world[k, :3], world[k, 3:] = middle @ rates[k], force
            change = np.eye(CURRENT)
            change[THETA, GYRO] = -middle * step_s
            change[SPEED, THETA] = -_cross(force) * step_s
            change[SPEED, ACCEL] = -middle * step_s
            change[PLACE, SPEED] = np.eye(3) * step_s
            transition = change @ transition
            noise = change @ noise @ change.T + driven
            moved_mps = (force - GRAVITY_MPS2 * _UP) * step_s
            self.place_m = self.place_m + self.speed_mps * step_s + 0.5 * moved_mps * step_s
            self.speed_mps = self.speed_mps + moved_mps
            self.rotation = middle @ turns[k]
        self.cov[-CURRENT:] = transition @ self.cov[-CURRENT:]
        self.cov[:, -CURRENT:] = self.cov[:, -CURRENT:] @ transition.T
        self.cov[-CURRENT:, -CURRENT:] += noise
        return world

    def coast(self, duration_s: float) -> None:
        """Goes on at the last velocity where samples are missing; what the phone did meanwhile is not known."""
        transition = np.eye(CURRENT)
        transition[PLACE, SPEED] = np.eye(3) * duration_s
        self.place_m = self.place_m + self.speed_mps * duration_s
        self.cov[-CURRENT:] = transition @ self.cov[-CURRENT:]
        self.cov[:, -CURRENT:] = self.cov[:, -CURRENT:] @ transition.T
        variance = np.zeros(CURRENT)
        variance[THETA], variance[SPEED] = COAST_RAD**2 * duration_s, COAST_MPS**2 * duration_s
        self.cov[-CURRENT:, -CURRENT:] += np.diag(variance)

    def clone(self) -> None:
        """Copies attitude and place of now behind the other clones."""
        last = len(self.cov) - CURRENT
        own = np.r_[last + np.arange(3), last + np.arange(6, 9)]  # attitude, position
        order = np.r_[np.arange(last), own, last + np.arange(CURRENT)]
        self.cov = self.cov[np.ix_(order, order)]
        self.clones_m.append(self.place_m.copy())

    def forget(self, count: int) -> None:
        """Drops the oldest clones."""
        self.cov = self.cov[CLONE * count :, CLONE * count :].copy()
        self.clones_m = self.clones_m[count:]

    def measure_move(self, move_m: FloatArray, covariance_m2: FloatArray) -> float:
        """The displacement (3,) from the oldest to the newest clone, in the world frame.

        Returns:
            The normalised innovation squared, chi-square with three degrees of freedom where the filter is consistent.
        """
        jacobian = np.zeros((3, len(self.cov)))
        newest = CLONE * (len(self.clones_m) - 1)
        jacobian[:, 3:6] = -np.eye(3)
        jacobian[:, newest + 3 : newest + 6] += np.eye(3)
        jacobian[:, 2] = -np.cross(_UP, move_m)
        residual = move_m - (self.clones_m[-1] - self.clones_m[0])
        return self._update(jacobian, residual, covariance_m2 * self._params.overlap)

    def measure_yaw(self, yaw_rad: float) -> None:
        """The yaw (twist) that the rotation vector reports."""
        sigma = self._params.compass_sigma_rad
        if not math.isfinite(sigma):
            return
        jacobian = np.zeros((1, len(self.cov)))
        jacobian[0, len(self.cov) - CURRENT + 2] = 1.0
        residual = np.array([float(wrap_rad(yaw_rad - self.yaw_rad))])
        self._update(jacobian, residual, np.array([[sigma**2]]), gated=False)

    def _update(self, jacobian: FloatArray, residual: FloatArray, noise: FloatArray, gated: bool = True) -> float:
        expected = jacobian @ self.cov @ jacobian.T
        distance2 = float(residual @ np.linalg.solve(expected + noise, residual))
        if gated and distance2 > self._params.gate:
            noise = noise * (distance2 / self._params.gate)
        gain = np.linalg.solve(expected + noise, jacobian @ self.cov).T
        self._correct(gain @ residual)
        rest = np.eye(len(self.cov)) - gain @ jacobian
        cov = rest @ self.cov @ rest.T + gain @ noise @ gain.T
        self.cov = 0.5 * (cov + cov.T)
        return distance2

    def _correct(self, error: FloatArray) -> None:
        for number in range(len(self.clones_m)):
            first = CLONE * number + 3
            self.clones_m[number] = self.clones_m[number] + error[first : first + 3]
        own = error[-CURRENT:]
        self.rotation = _rotations(own[None, THETA])[0] @ self.rotation
        self.speed_mps, self.place_m = self.speed_mps + own[SPEED], self.place_m + own[PLACE]
        self._gyro_bias, self._accel_bias = self._gyro_bias + own[GYRO], self._accel_bias + own[ACCEL]

    def _driven(self, step_s: float) -> FloatArray:
        """(15, 15) noise that one sample adds."""
        p = self._params
        variance = np.zeros(CURRENT)
        variance[THETA] = (p.gyro_noise_radps * step_s) ** 2
        variance[SPEED] = (p.accel_noise_mps2 * step_s) ** 2
        variance[GYRO], variance[ACCEL] = p.gyro_bias_walk**2 * step_s, p.accel_bias_walk**2 * step_s
        return np.diag(variance)


def _cross(vector: FloatArray) -> FloatArray:
    """(3, 3) the matrix of a cross product."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def _rotations(vectors: FloatArray) -> FloatArray:
    """(n, 3, 3) of rotation vectors (n, 3); Rodrigues."""
    angle = np.linalg.norm(vectors, axis=1)
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    skew = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
    first = np.sinc(angle / np.pi)[:, None, None]
    second = (0.5 * np.sinc(angle / (2 * np.pi)) ** 2)[:, None, None]
    rotations: FloatArray = np.eye(3) + first * skew + second * (skew @ skew)
    return rotations


def rotation_matrix(quaternion: FloatArray) -> FloatArray:
    """(3, 3) of a unit quaternion wxyz, body to world."""
    w, x, y, z = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
