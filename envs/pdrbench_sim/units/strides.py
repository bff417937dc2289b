"""Errors of the strides that a foot-mounted inertial unit with zero-velocity updates reports."""

from __future__ import annotations

import functools
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from pdrbench.geometry import FloatArray, wrap_rad

STRIDE_LAW: Final = Path(__file__).with_name("stride_law.json")  # which the laboratory fits to recordings


@dataclass(frozen=True, slots=True)
class StrideErrors:
    """Errors of stride events; without arguments, of a unit that makes none.

    These are not the sigmas of a filter: those of W4 and W8 are inflated on purpose. What foot-mounted units do against
    motion capture `pdrbench error-model` of the laboratory measures.

    Attributes:
        length_bias: Relative error of every length; the foot creeps forward while the filter holds it still.
        length_sigma_m: White error of a length.
        height_sigma_m: White error of a change of height.
        drift_mean_rad: Mean over walks of the turn that a walk adds to every stride.
        drift_sigma_rad: Its standard deviation over walks, or the scale of Student's law where there is a `drift_tail`.
        turn_sigma_rad: White error of a turn: a random walk in the heading.
        heading_sigma_rad: White error of the heading of a stride: what one turn has too much, the next has too little.
        length_offset_m: Mean over walks of what a walk adds to every length; negative: measured short.
        length_offset_sigma_m: Its standard deviation over walks.
        drift_tail: One over the degrees of freedom of Student's law, which drifts then follow; 0: a normal law.
        coarse_fraction: Fraction of strides whose errors of length, height and heading are larger,
        coarse_factor: by this factor.
    """

    length_bias: float = 0.0
    length_sigma_m: float = 0.0
    height_sigma_m: float = 0.0
    drift_mean_rad: float = 0.0
    drift_sigma_rad: float = 0.0
    turn_sigma_rad: float = 0.0
    heading_sigma_rad: float = 0.0
    length_offset_m: float = 0.0
    length_offset_sigma_m: float = 0.0
    drift_tail: float = 0.0
    coarse_fraction: float = 0.0
    coarse_factor: float = 1.0


@functools.cache
def fitted() -> StrideErrors:
    """The law that environments draw with, as `pdrbench error-model --law` of the laboratory fitted it."""
    return StrideErrors(**json.loads(STRIDE_LAW.read_text(encoding="utf-8"))["errors"])


def measure(true_rows: FloatArray, rng: np.random.Generator, errors: StrideErrors) -> FloatArray:
    """What the foot-mounted unit reports of true strides.

    length = (1 + bias) l + c + s_k N(0, sigma_l), not below 0; height = dz + s_k N(0, sigma_z);
    turn = wrap(dtheta + d + N(0, sigma_theta) + h_k - h_(k-1)) with h_k ~ s_k N(0, sigma_h) and h_0 = 0, since the
    heading of the start is given. For the whole walk there is one drift d, mean + sigma times a normal number or one of
    Student's law, and one offset c ~ N(mean, sigma). s_k is 1, or `coarse_factor` with `coarse_fraction`.

    Args:
        true_rows: (S, 4) columns of `pdrbench.sensors.stride.STRIDE`, without error.
        rng: Draws the drift of this walk first, then the white errors of length, height and turn stride by stride, and
            at last the h_k, c and which strides are coarse, each of them unless its size is 0.
        errors: Sizes of the errors.

    Returns:
        (S, 4) with the times of `true_rows`.
    """
    true_rows = np.asarray(true_rows, dtype=np.float64)
    count = len(true_rows)
    unit = rng.standard_t(1 / errors.drift_tail) if errors.drift_tail else rng.normal()
    drift_rad = errors.drift_mean_rad + errors.drift_sigma_rad * unit
    white = rng.standard_normal((count, 3)) * [errors.length_sigma_m, errors.height_sigma_m, errors.turn_sigma_rad]
    heading_rad = errors.heading_sigma_rad * (
        rng.standard_normal(count) if errors.heading_sigma_rad else np.zeros(count)
    )
    offset_sigma_m = errors.length_offset_sigma_m
    offset_m = errors.length_offset_m + (offset_sigma_m * rng.normal() if offset_sigma_m else 0.0)
    if errors.coarse_fraction:
        scale = np.where(rng.random(count) < errors.coarse_fraction, errors.coarse_factor, 1.0)
        white[:, :2] *= scale[:, None]
        heading_rad *= scale
    length_m = np.maximum((1 + errors.length_bias) * true_rows[:, 1] + offset_m + white[:, 0], 0.0)
    height_m = true_rows[:, 2] + white[:, 1]
    turn_rad = true_rows[:, 3] + drift_rad + white[:, 2]
    if errors.heading_sigma_rad:
        turn_rad += np.diff(heading_rad, prepend=0.0)
    return np.column_stack([true_rows[:, 0], length_m, height_m, wrap_rad(turn_rad)])
