"""Strides of one foot, as a foot-mounted inertial unit with zero-velocity updates reports them, and their errors."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from pdrbench.geometry import FloatArray, wrap_rad
from pdrbench.recording import SensorSpec

_LONGEST_WALK_S: Final = 86_400.0

STRIDE: Final = SensorSpec(
    name="stride",
    columns=("t_s", "length_m", "height_m", "turn_rad"),
    low=np.array([0.0, 0.0, -3.0, -math.pi]),
    high=np.array([_LONGEST_WALK_S, 5.0, 3.0, math.pi]),
    rate_hz=None,
    what=(
        "One stride of one foot, told while the foot rests: horizontal length, change of height, and change of the "
        "course since the previous stride (counter-clockwise positive), to be applied before the length. The first "
        "turn counts from the start heading. A stride shorter than 0.1 m turns by the yaw of the foot."
    ),
)


@dataclass(frozen=True, slots=True)
class StrideErrors:
    """Errors of stride events, measured on foot-mounted units against motion capture (sources.md, note 1).

    These are not the sigmas of a filter: those of W4 and W8 are inflated on purpose.

    Attributes:
        length_bias: Relative error of every length; the foot creeps forward while the filter holds it still.
        length_sigma_m: White error of a length.
        height_sigma_m: White error of a change of height.
        drift_mean_rad: Mean over walks of the turn that a walk adds to every stride; note 1 gives the median.
        drift_sigma_rad: Its standard deviation over walks; a normal law is our reading.
        turn_sigma_rad: White error of a turn.
    """

    length_bias: float = -0.019  # note 1
    length_sigma_m: float = 0.027  # note 1; read as the spread about the bias
    height_sigma_m: float = 0.026  # note 1
    drift_mean_rad: float = math.radians(0.10)  # note 1
    drift_sigma_rad: float = math.radians(0.29)  # note 1
    turn_sigma_rad: float = math.radians(0.65)  # note 1; read as white in the turn, so a random walk in the heading


def measure(true_rows: FloatArray, rng: np.random.Generator, errors: StrideErrors | None = None) -> FloatArray:
    """What the foot-mounted unit reports of true strides.

    length = (1 + bias) l + N(0, sigma_l), not below 0; height = dz + N(0, sigma_z);
    turn = wrap(dtheta + d + N(0, sigma_theta)) with one drift d ~ N(mean, sigma) for the whole walk.

    Args:
        true_rows: (S, 4) columns of `STRIDE`, without error.
        rng: Draws the drift of this walk first, then the white errors.
        errors: Sizes of the errors; None for the measured ones.

    Returns:
        (S, 4) with the times of `true_rows`.
    """
    errors = errors or StrideErrors()
    true_rows = np.asarray(true_rows, dtype=np.float64)
    drift_rad = rng.normal(errors.drift_mean_rad, errors.drift_sigma_rad)
    sigma = np.array([errors.length_sigma_m, errors.height_sigma_m, errors.turn_sigma_rad])
    white = rng.standard_normal((len(true_rows), 3)) * sigma
    length_m = np.maximum((1 + errors.length_bias) * true_rows[:, 1] + white[:, 0], 0.0)
    height_m = true_rows[:, 2] + white[:, 1]
    turn_rad = wrap_rad(true_rows[:, 3] + drift_rad + white[:, 2])
    return np.column_stack([true_rows[:, 0], length_m, height_m, turn_rad])
