"""Phones differ: a law from which the inertial unit of one kind of phone is drawn."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from pdrbench_sim.units.motion import GRAVITY_MPS2
from pdrbench_sim.units.profiles import ImuProfile, SensorErrors

_DPS: Final = math.radians(1.0)
_MG: Final = GRAVITY_MPS2 / 1000


@dataclass(frozen=True, slots=True)
class PhoneLaw:
    """How kinds of phones differ; pairs are the ends of a uniform draw of the logarithm.

    [M] are phones of `phone_steps`, which deliver at 100 to 406 Hz, stamp by 0.0003 to 1.4 ms beside an even clock, and
    count in steps of 0.00015 to 0.0024 m/s2; a part that is read through a low-pass of 10 Hz is known from elsewhere.
    """

    rate_hz: tuple[float, ...] = (50.0, 100.0)  # one of them; [M] less those that the motion is too coarse for
    bandwidth_hz: tuple[float, float] = (10.0, 45.0)  # of both sensors, at most 0.45 of the rate; [R]
    accel_density: tuple[float, float] = (75e-3 * _MG, 600e-3 * _MG)  # m/s2 per root hertz; 75 [V] to 600 ug [M]
    accel_bias: tuple[float, float] = (10 * _MG, 80 * _MG)  # sigma of each axis; [V] 20 to 60 mg
    accel_step: tuple[float, float] = (0.6e-3, 40e-3)  # m/s2; [M] 0.0012 and 0.0024, older parts 0.02 to 0.04 [R]
    accel_limit: tuple[float, ...] = (2 * GRAVITY_MPS2, 4 * GRAVITY_MPS2, 8 * GRAVITY_MPS2)  # one of them; [M], [R]
    gyro_density: tuple[float, float] = (0.003 * _DPS, 0.03 * _DPS)  # rad/s per root hertz; [V] 0.003 to 0.014
    gyro_bias: tuple[float, float] = (0.05 * _DPS, 1.0 * _DPS)  # sigma of each axis after calibration; [R]
    scale_sigma: tuple[float, float] = (0.003, 0.02)  # [R]
    jitter_s: tuple[float, float] = (2e-4, 2e-3)  # how late stamps are; [M]


def draw_phone_profile(rng: np.random.Generator, law: PhoneLaw | None = None) -> ImuProfile:
    """The inertial unit of one kind of phone; `law` is None for the defaults."""
    law = law or PhoneLaw()

    def between(ends: tuple[float, float]) -> float:
        return math.exp(rng.uniform(math.log(ends[0]), math.log(ends[1])))

    rate_hz = float(rng.choice(law.rate_hz))
    band_hz = min(between(law.bandwidth_hz), 0.45 * rate_hz)
    scale_sigma = between(law.scale_sigma)
    common = {"bandwidth_hz": band_hz, "scale_sigma": scale_sigma, "misalignment_rad": scale_sigma / 2}
    return ImuProfile(
        gyro=SensorErrors(
            density=between(law.gyro_density),
            turn_on_sigma=between(law.gyro_bias),
            instability=10 / 3600 * _DPS,  # [V] 10 degrees/h
            limit=2000 * _DPS,
            step=2000 * _DPS / 2**15,
            **common,
        ),
        accel=SensorErrors(
            density=between(law.accel_density),
            turn_on_sigma=between(law.accel_bias),
            instability=0.03 * _MG,  # [V]
            limit=float(rng.choice(law.accel_limit)),
            step=between(law.accel_step),
            **common,
        ),
        rate_hz=rate_hz,
        g_sensitivity=0.05 * _DPS / GRAVITY_MPS2,  # [R]
        clock_jitter_s=between(law.jitter_s),
        clock_drift=2e-5,  # ours: a quartz
    )
