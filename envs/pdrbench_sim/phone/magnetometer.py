"""The magnetometer of a phone: what is delivered as the calibrated field (sources.md 1.7).

Magnets and steel of the phone itself add an offset of as much as the field of the Earth. The phone learns that offset
while it is turned about, subtracts what it learned, and now and then learns it anew: the reading jumps then.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray
from pdrbench_sim.fields.magnetic import draw_magnetometer


@dataclass(frozen=True, slots=True)
class PhoneMagnetometerParams:
    """How magnetometers of phones err."""

    hard_iron_ut: tuple[float, float] = (20.0, 60.0)  # least and largest offset before calibration; sources.md 1.7 [R]
    # Largest change of each element of the matrix, which no phone calibrates.
    soft_iron: float = 0.05  # sources.md 1.7 [R]
    # Standard deviation, on each axis, of the offset that a calibration leaves; median over phones.
    left_ut: float = 3.0  # [M] mean strength (35 to 63 uT) and heading error on 15 walks, and those of sources.md 1.5
    left_spread: float = 0.9  # standard deviation of its logarithm over phones; [M] the same: both have long tails
    recalibrated_s: float = 120.0  # mean time between two calibrations; ours
    # Standard deviation of white noise on each axis and sample.
    noise_ut: float = 0.7  # [M] 15 walks of one phone: differences of neighbours
    step_ut: float = 0.69  # of the numbers that the part delivers; 0 for real numbers; [M] the same walks

    def __post_init__(self) -> None:
        sizes = (*self.hard_iron_ut, self.soft_iron, self.left_ut, self.left_spread, self.noise_ut, self.step_ut)
        if not (all(0 <= size < math.inf for size in sizes) and self.recalibrated_s > 0):
            raise RecordingError(f"errors of a magnetometer are finite and not negative; got {self}")


def calibrated_field(
    t_s: ArrayLike,
    field_ut: ArrayLike,
    quaternion: ArrayLike,
    rng: np.random.Generator,
    params: PhoneMagnetometerParams | None = None,
) -> FloatArray:
    """(n, 3) uT in the body frame: noise and rounding of the part, less the offset that the phone takes it to have.

    Args:
        t_s: (n,) increasing from 0 or later.
        field_ut: (n, 3) building frame, as `MagneticField.at` has it.
        quaternion: (n, 4) true attitude, Hamilton wxyz, body to building.
        rng: Device, calibrations and noise draw from children of their own; more samples change none before them.
        params: None for the defaults.
    """
    params = params or PhoneMagnetometerParams()
    device, times, offsets, noise, quality = rng.spawn(5)
    part = draw_magnetometer(
        device, hard_iron_ut=params.hard_iron_ut, soft_iron=params.soft_iron, noise_ut=params.noise_ut
    )
    raw_ut = part.measure(field_ut, quaternion, noise)
    if params.step_ut:
        raw_ut = params.step_ut * np.rint(raw_ut / params.step_ut)
    left_ut = params.left_ut * math.exp(params.left_spread * float(quality.standard_normal()))
    learned_ut = part.hard_iron_ut - left_ut * _since_calibration(np.asarray(t_s), times, offsets, params)
    calibrated: FloatArray = raw_ut - learned_ut
    return calibrated


def _since_calibration(
    t_s: FloatArray, times: np.random.Generator, offsets: np.random.Generator, params: PhoneMagnetometerParams
) -> FloatArray:
    """(n, 3) standard normal, constant from one calibration to the next; the first was before the walk."""
    end_s, changes_s = float(t_s[-1]), [0.0]
    while changes_s[-1] < end_s:
        changes_s.append(changes_s[-1] + params.recalibrated_s * float(times.exponential()))
    drawn: FloatArray = offsets.standard_normal((len(changes_s), 3))
    return drawn[np.searchsorted(changes_s[1:], t_s, side="right")]
