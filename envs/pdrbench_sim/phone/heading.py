"""Where a phone points while it is held, and where it takes itself to point (sources.md 1.4, 1.5).

The attitude that a phone reports leans on its gyroscope for seconds and on its compass in the long run. Its yaw is
therefore off by what the field was turned by over the last metres, by what calibration left of the phone's own
magnetism, and by a drift that the compass holds back. None of this knows of the heading of the walk: how the hand turns
the phone away from it comes on top.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray
from pdrbench.inertial.quaternions import from_yaw_pitch_roll, multiply
from pdrbench_sim.noise import autoregressive

_KNOTS: Final = 4  # of a smooth process within its correlation time
_KEEPS: Final = math.exp(-1 / _KNOTS)
_SHRINKS: Final = 0.93622  # standard deviation of a cubic B-spline of such coefficients, over all places between knots


@dataclass(frozen=True, slots=True)
class HoldParams:
    """How a hand turns a phone away from the heading of the body."""

    # Standard deviation over walks of the constant part.
    offset_rad: float = math.radians(4.0)  # with all else, what headings of 15 walks are off by [M]
    # Standard deviation of the slow part.
    wander_rad: float = math.radians(4.0)  # [M] 15 walks: 3.8 degrees within a leg in the median
    wander_s: float = 2.0  # its correlation falls to about 1/e; ours


@dataclass(frozen=True, slots=True)
class AttitudeErrorParams:
    """How the attitude that a phone reports errs."""

    # Time constant with which the yaw follows the compass.
    compass_s: float = 3.1  # [M] regression of the yaw less the gyroscope on the anomaly, 15 walks: 0.32 per second
    # Standard deviation of the rate at which the yaw would drift without a compass.
    drift_radps: float = math.radians(0.4)  # [M] the same
    drift_s: float = 60.0  # the correlation of that rate falls to about 1/e; ours
    # Standard deviation of pitch and roll, each.
    tilt_rad: float = math.radians(0.8)  # [M] mean specific force of 15 walks: 0.3 to 2 degrees off the vertical
    tilt_s: float = 10.0  # their correlation falls to about 1/e; ours

    def __post_init__(self) -> None:
        sizes = (self.drift_radps, self.tilt_rad)
        times = (self.compass_s, self.drift_s, self.tilt_s)
        if not (all(0 <= size < math.inf for size in sizes) and all(0 < time < math.inf for time in times)):
            raise RecordingError(f"errors of an attitude are not negative, its times positive; got {self}")


def held_yaw_rad(t_s: FloatArray, rng: np.random.Generator, params: HoldParams | None = None) -> FloatArray:
    """(n,) yaw of a held phone against the heading of the body: a constant of the walk and a slow wander.

    It can be differentiated twice. The two parts draw from children of their own, and more samples do not change those
    before them.

    Args:
        t_s: (n,) seconds from 0, increasing.
        rng: Draws both parts.
        params: None for the defaults.
    """
    params = params or HoldParams()
    offset, wander = rng.spawn(2)
    constant_rad = params.offset_rad * float(offset.standard_normal())
    return constant_rad + params.wander_rad * smooth_noise(t_s, wander, params.wander_s)


def smooth_noise(t_s: FloatArray, rng: np.random.Generator, correlation_s: float) -> FloatArray:
    """(n,) a stationary process of variance 1 with two continuous derivatives.

    A cubic B-spline whose coefficients are a first-order autoregression with a knot every quarter of its time. A value
    depends on four coefficients only, so that a longer series begins like a shorter one.

    Args:
        t_s: (n,) from 0.
        rng: Draws it.
        correlation_s: Of the autoregression.
    """
    from scipy.interpolate import BSpline

    step_s = correlation_s / _KNOTS
    count = math.ceil(float(t_s[-1]) / step_s) + 4
    coefficients = autoregressive(rng.standard_normal(count), _KEEPS) / _SHRINKS
    knots = step_s * np.arange(-3, count + 1)
    smooth: FloatArray = BSpline(knots, coefficients, 3)(t_s)
    return smooth


def rotation_vector(
    t_s: FloatArray,
    quaternion: FloatArray,
    field_ut: FloatArray,
    rng: np.random.Generator,
    params: AttitudeErrorParams | None = None,
) -> FloatArray:
    """(n, 4) the attitude that a phone reports: unit Hamilton wxyz, body to building.

    Its yaw follows the compass with a time constant: psi' = drift - (psi + alpha) / tau, where psi is the error of the
    yaw and alpha the angle from +y to the horizontal field. Directions are averaged as unit vectors, so that no jump
    comes of an angle that passes half a turn.

    Args:
        t_s: (n,) even, from 0 or later.
        quaternion: (n, 4) true attitude; the one reported has no sign jumps where this one has none.
        field_ut: (n, 3) the field as the phone has it, turned into the building frame by the true attitude. What
            calibration left of the hard iron belongs to it.
        rng: Drift and tilts draw from children of their own; more samples change none before them.
        params: None for the defaults.

    Raises:
        RecordingError: Shapes that do not agree.
    """
    from scipy.signal import lfilter  # takes half a second, and walks without a phone need none of it

    params = params or AttitudeErrorParams()
    count = len(t_s)
    if count < 2 or quaternion.shape != (count, 4) or field_ut.shape != (count, 3):
        raise RecordingError(
            f"a reported attitude needs t_s (n,), quaternion (n, 4) and field_ut (n, 3) of two rows or more; got "
            f"{t_s.shape}, {quaternion.shape}, {field_ut.shape}"
        )
    drift, pitch, roll = rng.spawn(3)
    step_s = float(t_s[-1] - t_s[0]) / (count - 1)
    keeps = math.exp(-step_s / params.compass_s)
    north = field_ut[:, 1] - 1j * field_ut[:, 0]
    north /= np.maximum(np.abs(north), 1e-9)
    met, _ = lfilter([1 - keeps], [1.0, -keeps], north, zi=keeps * north[:1])
    drift_rad = params.drift_radps * params.compass_s * smooth_noise(t_s, drift, params.drift_s)
    yaw_rad = drift_rad - np.angle(met)
    pitch_rad, roll_rad = (params.tilt_rad * smooth_noise(t_s, tilt, params.tilt_s) for tilt in (pitch, roll))
    return multiply(from_yaw_pitch_roll(np.unwrap(yaw_rad), pitch_rad, roll_rad), quaternion)
