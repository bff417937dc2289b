"""The filter, the smoother and the detectors once more, in plain matrices, one sample after the other.

To be read, and to be held against: tests demand that the compiled kernels agree with it, `pdrbench bench inertial` says
how much faster they are. Same names and the same order of things as in `foot_kernels.advance`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from pdrbench.geometry import FloatArray
from pdrbench.inertial.foot_kernels import Memory, Noise
from pdrbench.inertial.zero_velocity import Detector

_POSITION, _VELOCITY, _TURN = slice(0, 3), slice(3, 6), slice(6, 9)  # of the error; of the state, the first two
_ACCEL_BIAS, _GYRO_BIAS = slice(9, 12), slice(12, 15)  # of the error
_HEADING: Final = 8
_SHOWN: Final = np.array([0, 1, 2, _HEADING])  # position and heading, of which the covariance is told


@dataclass(frozen=True, slots=True)
class Stage:
    """One linear step of the error: it moves, noise is added, something is measured.

    Attributes:
        sample: Which sample it belongs to.
        transition: (N, N) F.
        predicted: (N, N) covariance before anything is measured, F P F^T + Q.
        correction: (N,) what the measurements say the error is.
        cov: (N, N) covariance after them.
    """

    sample: int
    transition: FloatArray
    predicted: FloatArray
    correction: FloatArray
    cov: FloatArray


@dataclass(frozen=True, slots=True)
class Filtered:
    """What the filter knows after each of n samples.

    Attributes:
        x: (n, 16) position, velocity, quaternion wxyz body to world, accelerometer bias, gyroscope bias.
        cov: (n, 4, 4) covariance of position and heading.
        nis: (n,) normalised innovation squared of the zero velocities, NaN where there was none.
        stages: What the smoother needs; empty unless asked for.
    """

    x: FloatArray
    cov: FloatArray
    nis: FloatArray
    stages: list[Stage] = field(default_factory=list)


def transition(dt: float, force: FloatArray, attitude: FloatArray, num_states: int) -> FloatArray:
    """F (N, N) of the error (position, velocity, turn of the world frame, biases) over a short time.

    With f the specific force in the world frame, C body to world, phi the turn, b the biases,

        dp' = dp + dt dv,   dv' = dv + dt (phi x f - C b_a),   phi' = phi - dt C b_w.

    Args:
        dt: Seconds.
        force: (3,) m/s2.
        attitude: (3, 3).
        num_states: 9 or 15.
    """
    f = np.eye(num_states)
    f[_POSITION, _VELOCITY] = dt * np.eye(3)
    f[_VELOCITY, _TURN] = -dt * _cross_matrix(force)
    if num_states == 15:
        f[_VELOCITY, _ACCEL_BIAS] = -dt * attitude
        f[_TURN, _GYRO_BIAS] = -dt * attitude
    return f


def advance(
    memory: Memory,
    t_s: FloatArray,
    accel: FloatArray,
    gyro: FloatArray,
    sigma_mps: FloatArray,
    rate_sigma_radps: FloatArray,
    magnetic: FloatArray,
    noise: Noise,
    *,
    keeps: bool = False,
) -> Filtered:
    """Filters n samples; arguments as those of `foot_kernels.advance`, but `memory` stays as it is."""
    foot = _Foot(memory, noise)
    known = Filtered(np.empty((len(t_s), 16)), np.empty((len(t_s), 4, 4)), np.full(len(t_s), np.nan))
    for k in range(len(t_s)):
        dt = float(t_s[k]) - foot.now_s
        if dt > 0:
            foot.now_s = float(t_s[k])
            foot.predict(dt, accel[k], gyro[k])
            if np.isfinite(sigma_mps[k]):
                known.nis[k] = foot.stand(gyro[k], float(sigma_mps[k]))
            if foot.num_states == 15:
                is_still = bool(np.isfinite(rate_sigma_radps[k]))
                if foot.is_switched_on(dt, gyro[k], is_still and dt <= noise.gap_s):
                    known.stages.append(foot.stage(k))
                    foot.set_bias()
                elif is_still:
                    foot.do_not_turn(gyro[k], float(rate_sigma_radps[k]))
            if not np.isnan(magnetic[k, 0]):
                foot.point(magnetic[k])
            known.stages.append(foot.stage(k))
            foot.close_loop()
        known.x[k], known.cov[k] = foot.x, foot.cov[np.ix_(_SHOWN, _SHOWN)]
        if not keeps:
            known.stages.clear()
    return known


def smooth(filtered: Filtered) -> tuple[FloatArray, FloatArray]:
    """Rauch-Tung-Striebel smoother of the error.

    From the last stage to the first, G = P F^T P_predicted^-1, e = G (correction + e_next) and
    S = P + G (S_next - P_predicted) G^T.

    Returns:
        x: (n, 16) smoothed states.
        cov: (n, 4, 4) covariance of position and heading.
    """
    x, cov = filtered.x.copy(), filtered.cov.copy()
    stages = filtered.stages
    error, spread = np.zeros(len(stages[-1].cov)), stages[-1].cov
    done = len(filtered.x)
    for stage, after in zip(reversed(stages), [None, *reversed(stages)], strict=False):
        if after is not None:
            gain = stage.cov @ after.transition.T @ _inverse(after.predicted)
            error = gain @ (after.correction + error)
            spread = stage.cov + gain @ (spread - after.predicted) @ gain.T
        if stage.sample < done:  # the last stage of a sample tells; samples that repeat a time share it
            told = slice(stage.sample, done)
            x[told] = corrected(filtered.x[stage.sample], error)
            cov[told] = spread[np.ix_(_SHOWN, _SHOWN)]
            done = stage.sample
    return x, cov


def corrected(x: FloatArray, error: FloatArray) -> FloatArray:
    """(16,) the state plus an error (9,) or (15,)."""
    plus = x.copy()
    plus[_POSITION] += error[_POSITION]
    plus[_VELOCITY] += error[_VELOCITY]
    plus[6:10] = _unit(_product(_of_rotation(error[_TURN]), x[6:10]))
    plus[10:] += error[9:] if len(error) == 15 else 0.0
    return plus


class _Foot:
    """State, covariance and the error found since the last `close_loop`."""

    def __init__(self, memory: Memory, noise: Noise) -> None:
        self.x, self.cov, self.now_s = memory.x.copy(), memory.cov.copy(), float(memory.previous[0])
        self.num_states = len(self.cov)
        self._noise = noise
        self._sample = memory.previous[1:].copy()
        self._largest_rate = memory.largest_rate.copy()
        self._still_s, self._turned, self._bias_is_set = memory.still[0], memory.still[1:4].copy(), memory.still[4] > 0
        self._field_heading = float(memory.field_heading[0])
        self._error, self._attitude = np.zeros(self.num_states), _matrix(self.x[6:10])
        self._begin_stage(np.eye(self.num_states))

    def predict(self, dt: float, accel: FloatArray, gyro: FloatArray) -> None:
        """Strapdown, and what becomes of the covariance."""
        noise, x = self._noise, self.x
        added = np.zeros((self.num_states, self.num_states))
        is_gap = dt > noise.gap_s
        now = np.concatenate([accel, gyro])
        mean = (now + self._sample) / 2 if is_gap else now
        self._sample = now
        if dt > noise.bridge_s:
            force, attitude = np.zeros(3), _matrix(x[6:10])
            x[_POSITION] += dt * x[_VELOCITY]
        else:
            half = _of_rotation(0.5 * dt * (mean[3:] - x[13:16]))
            middle = _unit(_product(x[6:10], half))
            x[6:10] = _unit(_product(middle, half))
            attitude = _matrix(middle)
            force = attitude @ (mean[:3] - x[10:13])
            motion = force - [0.0, 0.0, noise.gravity_mps2]
            x[_POSITION] += dt * x[_VELOCITY] + 0.5 * dt**2 * motion
            x[_VELOCITY] += dt * motion
        if is_gap:
            added[_POSITION, _POSITION] = (0.5 * noise.gap_accel_mps2 * dt**2) ** 2 * np.eye(3)
            added[_VELOCITY, _VELOCITY] = (noise.gap_accel_mps2 * dt) ** 2 * np.eye(3)
            added[_TURN, _TURN] = (noise.gap_rate_radps * dt) ** 2 * np.eye(3)
        else:
            added[_VELOCITY, _VELOCITY] = noise.accel_density**2 * dt * np.eye(3)
            doubt_radps = np.where(self._is_clipped(gyro), noise.clipped_sigma_radps, 0.0)
            clipped = attitude @ np.diag((doubt_radps * dt) ** 2) @ attitude.T
            added[_TURN, _TURN] = noise.gyro_density**2 * dt * np.eye(3) + clipped
        if self.num_states == 15:
            added[_ACCEL_BIAS, _ACCEL_BIAS] = noise.accel_bias_walk**2 * dt * np.eye(3)
            added[_GYRO_BIAS, _GYRO_BIAS] = noise.gyro_bias_walk**2 * dt * np.eye(3)
        self._attitude = attitude
        f = transition(dt, force, attitude, self.num_states)
        self.cov = f @ self.cov @ f.T + added
        self._begin_stage(f)

    def _is_clipped(self, gyro: FloatArray) -> Any:
        rate, noise = np.abs(gyro), self._noise
        self._largest_rate = np.maximum(self._largest_rate, rate)
        return (rate > noise.clipped_rate_radps) & (rate > noise.clipped_fraction * self._largest_rate)

    def stand(self, gyro: FloatArray, sigma_mps: float) -> float:
        """Zero velocity, of the sole over which the unit rolls; returns the normalised innovation squared."""
        rate = self._attitude @ (gyro - self.x[13:16])
        rolling_mps = np.cross(rate, [0.0, 0.0, self._noise.unit_height_m])
        return self._measure(_VELOCITY, rolling_mps - self.x[_VELOCITY], sigma_mps)

    def do_not_turn(self, gyro: FloatArray, sigma_radps: float) -> None:
        """Zero rate: what the gyroscope reads is its bias."""
        self._measure(_GYRO_BIAS, gyro - self.x[13:16], sigma_radps)

    def is_switched_on(self, dt: float, gyro: FloatArray, is_still: bool) -> bool:
        """Whether a foot that stands still has turned, by its gyroscope, too far."""
        if not is_still:
            self._still_s, self._turned = 0.0, np.zeros(3)
            return False
        self._still_s += dt
        self._turned += dt * (gyro - self.x[13:16])
        is_long = self._still_s >= self._noise.turn_on_still_s
        return bool(is_long and not self._bias_is_set and self._turned @ self._turned > self._noise.turn_on_rad**2)

    def set_bias(self) -> None:
        """Takes the mean rate while the foot stood still for the bias the unit was switched on with."""
        sigma, off = self._noise.turn_on_sigma_radps, self._turned / self._still_s
        self.cov = self.cov + np.diag([*np.zeros(12), *(off**2 + sigma**2)])
        self._begin_stage(np.eye(15))
        self._measure(_GYRO_BIAS, off, sigma)
        self._bias_is_set = True

    def point(self, magnetic: FloatArray) -> None:
        """The field points where it pointed when it was first used."""
        noise = self._noise
        towards = _matrix(self.x[6:10]) @ magnetic
        heading = math.atan2(towards[1], towards[0])
        if math.isnan(self._field_heading):
            self._field_heading = heading
        off = math.remainder(self._field_heading - heading, math.tau)
        variance = self.cov[_HEADING, _HEADING] + noise.heading_sigma_rad**2
        if (off - self._error[_HEADING]) ** 2 < noise.heading_gate**2 * variance:
            self._measure(slice(_HEADING, _HEADING + 1), np.array([off]), noise.heading_sigma_rad)

    def _measure(self, which: slice, measured: FloatArray, sigma: float) -> float:
        """Kalman update with a measurement of some of the errors; returns the normalised innovation squared."""
        h = np.eye(self.num_states)[which]
        innovation = measured - h @ self._error
        variance = h @ self.cov @ h.T + sigma**2 * np.eye(len(h))
        gain = np.linalg.solve(variance, h @ self.cov).T
        self._error = self._error + gain @ innovation
        self.cov = self.cov - gain @ variance @ gain.T
        return float(innovation @ np.linalg.solve(variance, innovation))

    def close_loop(self) -> None:
        """Moves the error into the state."""
        self.x, self._error = corrected(self.x, self._error), np.zeros(self.num_states)

    def _begin_stage(self, f: FloatArray) -> None:
        self._stage = (f, self.cov, self._error)

    def stage(self, sample: int) -> Stage:
        """What has happened since the stage began."""
        f, predicted, before = self._stage
        return Stage(sample, f, predicted, self._error - before, self.cov)


def _cross_matrix(v: FloatArray) -> FloatArray:
    """(3, 3) matrix that multiplies as v x."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def _of_rotation(vector: FloatArray) -> FloatArray:
    """Unit quaternion (4,) of a rotation vector (3,)."""
    half = 0.5 * vector
    return np.array([math.cos(float(np.linalg.norm(half))), *(half * np.sinc(np.linalg.norm(half) / np.pi))])


def _product(p: FloatArray, q: FloatArray) -> FloatArray:
    """Hamilton product (4,)."""
    return np.array([p[0] * q[0] - p[1:] @ q[1:], *(p[0] * q[1:] + q[0] * p[1:] + _cross_matrix(p[1:]) @ q[1:])])


def _unit(q: FloatArray) -> FloatArray:
    scaled: FloatArray = q / np.linalg.norm(q)
    return scaled


def _matrix(q: FloatArray) -> FloatArray:
    """(3, 3) of a unit quaternion, 1 + 2 w [v x] + 2 [v x]^2."""
    cross = _cross_matrix(q[1:])
    turned: FloatArray = np.eye(3) + 2 * q[0] * cross + 2 * cross @ cross
    return turned


def _inverse(cov: FloatArray) -> FloatArray:
    """Pseudo-inverse of a covariance, whose units differ and of which parts may be known for certain."""
    sigma = np.sqrt(np.diag(cov))
    scale = np.divide(1.0, sigma, out=np.zeros_like(sigma), where=sigma > 0)
    inverse: FloatArray = scale[:, None] * np.linalg.pinv(scale[:, None] * cov * scale, hermitian=True) * scale
    return inverse


# Detectors: one window after the other.


def statistic(
    kind: str, accel: FloatArray, gyro: FloatArray, rows: int, sigma_accel: float, sigma_gyro: float, gravity: float
) -> FloatArray:
    """(n,) statistic over the last `rows` samples, over fewer at the beginning; as `zero_velocity.statistic`."""
    value = np.empty(len(accel))
    for k in range(len(accel)):
        window = slice(max(k - rows + 1, 0), k + 1)
        value[k] = WINDOWS[kind](accel[window] / sigma_accel, gyro[window] / sigma_gyro, gravity / sigma_accel)
    return value


def _shoe(accel: FloatArray, gyro: FloatArray, gravity: float) -> Any:
    mean = accel.mean(axis=0)
    off = accel - gravity * mean / max(np.linalg.norm(mean), 1e-300)
    return (np.square(off).sum(axis=1) + np.square(gyro).sum(axis=1)).mean()


def _rate_energy(accel: FloatArray, gyro: FloatArray, gravity: float) -> Any:
    return np.square(gyro).sum(axis=1).mean()


def _moving_variance(accel: FloatArray, gyro: FloatArray, gravity: float) -> Any:
    return np.square(accel - accel.mean(axis=0)).sum(axis=1).mean()


def _magnitude(accel: FloatArray, gyro: FloatArray, gravity: float) -> Any:
    return np.square(np.linalg.norm(accel, axis=1) - gravity).mean()


Window = Callable[[FloatArray, FloatArray, float], Any]
WINDOWS: Final = MappingProxyType[str, Window](
    {"shoe": _shoe, "are": _rate_energy, "mv": _moving_variance, "mag": _magnitude}
)


def soft_sigma(shoe: FloatArray, rate_radps: FloatArray, detector: Detector) -> FloatArray:
    """(n,) m/s, as `zero_velocity.soft_sigma`."""
    sigma = np.full(len(shoe), np.inf)
    for k in range(len(shoe)):
        if shoe[k] < detector.threshold:
            rolls = math.hypot(detector.sigma_mps, detector.lever_m * rate_radps[k])
            sigma[k] = rolls * (1.0 + shoe[k] / detector.knee)
    return sigma


def held_s(t_s: FloatArray, holds: Any) -> FloatArray:
    """(n,) for how long something has held without a break at each sample, 0 where it does not."""
    value = np.zeros(len(t_s))
    for k in range(len(t_s)):
        if holds[k]:
            breaks = np.flatnonzero(~holds[: k + 1])
            value[k] = t_s[k] - t_s[breaks[-1] + 1 if len(breaks) else 0]
    return value
