"""The attitude of a phone from gyroscope, accelerometer and magnetometer, where it offers no rotation vector.

A complementary filter: the gyroscope turns the attitude, gravity levels it slowly, and the magnetic field turns it
towards north, more slowly still and only while strength and dip of the field are what they were (sources.md 1.7: steel
changes all three).
"""

from __future__ import annotations

import math
from dataclasses import asdict, astuple, dataclass

import numpy as np

from pdrbench.compiled import compiled
from pdrbench.errors import PdrbenchError
from pdrbench.geometry import FloatArray
from pdrbench.inertial.steps import GRAVITY_MPS2
from pdrbench.sensors.checks import Gate

MAX_GAP_S = 0.5  # a gyroscope that is silent for longer has missed a turn; the attitude goes on as it is


@dataclass(frozen=True, slots=True)
class PhoneAttitudeParams:
    """Settings of `PhoneAttitude`; all ours unless a line says otherwise.

    Attributes:
        level_s: Time constant with which gravity levels the attitude: a few steps, whose accelerations cancel.
        calm_mps2: Samples whose strength is further from gravity are not used to level.
        compass_s: Time constant with which the field turns the attitude.
        strength_fraction: Largest relative difference of the field's strength from the usual one.
        dip_rad: Largest difference of its dip from the usual one.
        usual_s: Time constant of what is usual.
    """

    level_s: float = 2.0
    calm_mps2: float = 3.0
    compass_s: float = 10.0  # phones take 3.1 s (sources.md 1.5); longer passes over more of the steel
    strength_fraction: float = 0.1  # sources.md 1.7: the field varies by 4 of 43 microtesla
    dip_rad: float = math.radians(10.0)
    usual_s: float = 20.0

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            if not value > 0:
                raise PdrbenchError(f"attitude: {name} must be positive; got {value!r}")


class PhoneAttitude:
    """Follows the attitude of a phone while its samples come in; any chunks of them give the same attitudes.

    Without a magnetometer the yaw counts from an arbitrary direction: 0 where the first sample found it.
    """

    def __init__(self, params: PhoneAttitudeParams | None = None) -> None:
        self._settings = np.array(astuple(params or PhoneAttitudeParams()), dtype=np.float64)
        self._gate = Gate("attitude")
        self._accel = np.zeros((0, 4))
        self._mag = np.zeros((0, 4))
        # quaternion, time of the last sample, times since levelling and the compass began, usual strength and dip
        self._state = np.array([1.0, 0, 0, 0, math.nan, 0, 0, math.nan, math.nan])

    def update(self, accel: FloatArray, gyro: FloatArray, mag: FloatArray | None = None) -> FloatArray:
        """Takes the next rows of all three and gives the attitude at every sample of the gyroscope.

        Args:
            accel: (n, 4) t_s, x, y, z in m/s^2.
            gyro: (m, 4) t_s, x, y, z in rad/s.
            mag: (k, 4) t_s, x, y, z in microtesla; None where there is none.

        Returns:
            (j, 5) t_s and unit Hamilton wxyz, body to world (x east, y north, z up), as the sensor `rotation` has
            them; from the first sample on at which gravity has been measured.

        Raises:
            RecordingError: What came so far cannot be meant; see `pdrbench.sensors.checks.Gate`.
        """
        self._gate.take({"accel": accel, "gyro": gyro} | ({} if mag is None else {"mag": mag}))
        self._accel = np.concatenate([self._accel[-1:], accel])
        self._mag = np.concatenate([self._mag[-1:], np.zeros((0, 4)) if mag is None else mag])
        if not len(self._accel):
            return np.zeros((0, 5))
        gyro = gyro[gyro[:, 0] >= self._accel[0, 0]]
        force = self._accel[_latest(self._accel[:, 0], gyro[:, 0]), 1:]
        field = np.full((len(gyro), 3), np.nan)
        if len(self._mag):
            known = gyro[:, 0] >= self._mag[0, 0]
            field[known] = self._mag[_latest(self._mag[:, 0], gyro[known, 0]), 1:]
        attitude = np.empty((len(gyro), 4))
        # Copies: one row is contiguous and several are not, for which the kernel would be compiled again.
        t_s, rate = gyro[:, 0].copy(), gyro[:, 1:].copy()
        _follow(t_s, rate, force, field, self._state, self._settings, GRAVITY_MPS2, attitude)
        return np.column_stack([gyro[:, 0], attitude])


def _latest(t_s: FloatArray, at_s: FloatArray) -> np.ndarray:
    """(m,) the last of the rows at `t_s` (n,) that is not later than each of `at_s` (m,)."""
    return np.maximum(np.searchsorted(t_s, at_s, side="right") - 1, 0)


@compiled
def _turn(q: FloatArray, x: float, y: float, z: float, in_world: bool) -> None:
    """Turns a quaternion by a rotation vector given in the body, or in the world."""
    angle = math.sqrt(x * x + y * y + z * z)
    half = 0.5 * math.sin(0.5 * angle) / (0.5 * angle) if angle > 1e-12 else 0.5
    a, b, c, d = math.cos(0.5 * angle), half * x, half * y, half * z
    w, i, j, k = q[0], q[1], q[2], q[3]
    if in_world:
        a, b, c, d, w, i, j, k = w, i, j, k, a, b, c, d
    q[0] = w * a - i * b - j * c - k * d
    q[1] = w * b + i * a + j * d - k * c
    q[2] = w * c - i * d + j * a + k * b
    q[3] = w * d + i * c - j * b + k * a
    norm = math.sqrt(q[0] ** 2 + q[1] ** 2 + q[2] ** 2 + q[3] ** 2)
    for n in range(4):  # an operation on arrays takes Numba a second to compile
        q[n] /= norm


@compiled
def _to_world(q: FloatArray, x: float, y: float, z: float) -> tuple[float, float, float]:
    w, i, j, k = q[0], q[1], q[2], q[3]
    tx, ty, tz = 2 * (j * z - k * y), 2 * (k * x - i * z), 2 * (i * y - j * x)
    return x + w * tx + j * tz - k * ty, y + w * ty + k * tx - i * tz, z + w * tz + i * ty - j * tx


@compiled
def _follow(
    t_s: FloatArray,
    gyro: FloatArray,
    force: FloatArray,
    field: FloatArray,
    state: FloatArray,
    settings: FloatArray,
    gravity: float,
    attitude: FloatArray,
) -> None:
    """Fills `attitude` (m, 4); `state` as in `PhoneAttitude`, `settings` in the order of `PhoneAttitudeParams`."""
    level_s, calm, compass_s, strength_fraction, dip_most, usual_s = settings
    q = state[:4]
    for n in range(len(t_s)):
        is_first = math.isnan(state[4])
        dt = 0.0 if is_first else t_s[n] - state[4]
        state[4] = t_s[n]
        if dt > MAX_GAP_S:
            dt = 0.0
        _turn(q, gyro[n, 0] * dt, gyro[n, 1] * dt, gyro[n, 2] * dt, False)
        strength = math.sqrt(force[n, 0] ** 2 + force[n, 1] ** 2 + force[n, 2] ** 2)
        if strength > 1e-6 and (is_first or abs(strength - gravity) < calm):
            ux, uy, uz = _to_world(q, force[n, 0] / strength, force[n, 1] / strength, force[n, 2] / strength)
            state[5] += dt
            # At first the mean of all samples, then of the last few; the first one counts whole.
            fraction = 1.0 if is_first else min(dt / min(level_s, state[5] + dt), 1.0)
            sine = math.sqrt(ux * ux + uy * uy)
            if sine > 1e-12:
                angle = math.atan2(sine, uz) * fraction
                _turn(q, uy / sine * angle, -ux / sine * angle, 0.0, True)
        if not math.isnan(field[n, 0]):
            bx, by, bz = _to_world(q, field[n, 0], field[n, 1], field[n, 2])
            level = math.sqrt(bx * bx + by * by)
            total, dip = math.sqrt(level * level + bz * bz), math.atan2(bz, level)
            if level > 1e-6:
                begins = math.isnan(state[7])
                if begins:
                    state[7], state[8] = total, dip
                usual = abs(total - state[7]) < strength_fraction * state[7] and abs(dip - state[8]) < dip_most
                keeps = dt / usual_s
                state[7] += keeps * (total - state[7])
                state[8] += keeps * (dip - state[8])
                if usual:
                    state[6] += dt
                    fraction = 1.0 if begins else min(dt / min(compass_s, state[6] + dt), 1.0)
                    _turn(q, 0.0, 0.0, math.atan2(bx, by) * fraction, True)
        for m in range(4):
            attitude[n, m] = q[m]
