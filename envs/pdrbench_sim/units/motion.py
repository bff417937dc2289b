"""Something that moves and turns, and what a perfect inertial unit on it measures.

A motion is sampled from smooth functions of time, never from noise, finely enough that central differences of the
samples are its derivatives: of fourth order, they lose 0.1 % of an acceleration at 40 Hz when sampled at 500 Hz.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from pdrbench.errors import PdrbenchError
from pdrbench.geometry import FloatArray, IntArray, read_only
from pdrbench.inertial.quaternions import inverse, multiply, to_world

GRAVITY_MPS2: Final = 9.81
_MIN_SAMPLES: Final = 5  # samples that a central difference of fourth order looks at
_EVEN: Final = 1e-6  # steps of time may differ by this fraction


class MotionError(PdrbenchError):
    """Samples that are no motion."""


@dataclass(frozen=True, slots=True, eq=False)
class RigidMotion:
    """A rigid body, evenly sampled."""

    t_s: FloatArray  # (n,) even
    xyz_m: FloatArray  # (n, 3) in the building: z counts from level 0
    quaternion: FloatArray  # (n, 4) unit Hamilton wxyz, body to building; neighbours have the same sign

    def __post_init__(self) -> None:
        for name in ("t_s", "xyz_m", "quaternion"):
            object.__setattr__(self, name, read_only(getattr(self, name)))
        count = len(self.t_s)
        if self.xyz_m.shape != (count, 3) or self.quaternion.shape != (count, 4) or count < _MIN_SAMPLES:
            raise MotionError(
                f"a motion needs t_s (n,), xyz_m (n, 3) and quaternion (n, 4) of {_MIN_SAMPLES} samples or more; got "
                f"{self.t_s.shape}, {self.xyz_m.shape}, {self.quaternion.shape}"
            )
        steps_s = np.diff(self.t_s)
        if not (np.abs(steps_s - steps_s.mean()) <= _EVEN * steps_s.mean()).all():
            raise MotionError("a motion is sampled evenly in increasing time; sample it again")

    def __len__(self) -> int:
        return len(self.t_s)

    @property
    def rate_hz(self) -> float:
        """Samples per second."""
        return float((len(self.t_s) - 1) / (self.t_s[-1] - self.t_s[0]))

    def at(self, lever_m: ArrayLike) -> RigidMotion:
        """The motion of a site of the same body, `lever_m` (3,) away in the body frame."""
        return RigidMotion(self.t_s, self.xyz_m + to_world(self.quaternion, np.asarray(lever_m)), self.quaternion)

    def mounted(self, quaternion: ArrayLike) -> RigidMotion:
        """The same motion of a unit whose axes are turned: `quaternion` (4,) leads from the unit to the body."""
        return RigidMotion(self.t_s, self.xyz_m, multiply(self.quaternion, np.asarray(quaternion, dtype=np.float64)))

    def ideal_signals(self) -> tuple[FloatArray, FloatArray]:
        """What a perfect unit measures.

        Centripetal and lever-arm terms need no formula here: they are in the path of the site (see `at`).

        Returns:
            accel: (n, 3) specific force in the body frame, m/s2; a body at rest reads 9.81 upwards.
            gyro: (n, 3) rate in the body frame, rad/s.
        """
        step_s = 1.0 / self.rate_hz
        back = inverse(self.quaternion)
        force = _second(self.xyz_m, step_s) + np.array([0.0, 0.0, GRAVITY_MPS2])
        gyro = 2.0 * multiply(back, _first(self.quaternion, step_s))[:, 1:]
        return to_world(back, force), gyro


def _first(values: FloatArray, step: float) -> FloatArray:
    """(n, k) derivative of fourth order inside, of second at the ends."""
    slope = np.gradient(values, step, axis=0, edge_order=2)
    slope[2:-2] = (8 * (values[3:-1] - values[1:-3]) - (values[4:] - values[:-4])) / (12 * step)
    return np.asarray(slope)


def _second(values: FloatArray, step: float) -> FloatArray:
    """(n, k) second derivative of fourth order inside; the two samples at either end repeat the third."""
    bend = np.empty_like(values)
    bend[2:-2] = (16 * (values[3:-1] + values[1:-3]) - (values[4:] + values[:-4]) - 30 * values[2:-2]) / (12 * step**2)
    bend[:2], bend[-2:] = bend[2], bend[-3]
    return bend


def sample_times(motion: RigidMotion, end_s: float, rate_hz: float) -> tuple[FloatArray, IntArray]:
    """(m,) even times from 0 to `end_s` and the sample of a motion nearest to each."""
    t_s = np.arange(math.floor(end_s * rate_hz) + 1) / rate_hz
    return t_s, np.minimum(np.rint(t_s * motion.rate_hz).astype(np.int64), len(motion) - 1)
