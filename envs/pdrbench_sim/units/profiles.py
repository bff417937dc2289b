"""How inertial units of one kind err, and the kinds that are known."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from types import MappingProxyType
from typing import Final

from pdrbench.errors import PdrbenchError, unknown_name


class DeviceError(PdrbenchError):
    """An inertial unit that cannot be, or signals it cannot measure."""


@dataclass(frozen=True, slots=True)
class SensorErrors:
    """How three axes of one kind err. Values are in the unit of the sensor, rad/s or m/s2, sigmas those of one axis.

    The defaults are those of a perfect sensor.
    """

    density: float = 0.0  # white noise per root hertz: its Allan deviation at 1 s
    density_sigma: float = 0.0  # of units, of the logarithm of that
    turn_on_sigma: float = 0.0  # bias, another each time the unit is switched on
    instability: float = 0.0  # largest Allan deviation of a first-order Gauss-Markov process: the floor of data sheets
    instability_s: float = 100.0  # time constant of that process
    random_walk: float = 0.0  # of the bias, per root second
    scale_sigma: float = 0.0  # relative error of the gain
    misalignment_rad: float = 0.0  # of each axis towards each other one
    limit: float = math.inf  # largest value that is measured
    step: float = 0.0  # of the numbers that are delivered; 0 for real numbers
    bandwidth_hz: float = math.inf  # at which signals are passed with -3 dB

    def __post_init__(self) -> None:
        positive = ("instability_s", "limit", "bandwidth_hz")
        _check_signs(self, positive=positive, endless=("limit", "bandwidth_hz"))


@dataclass(frozen=True, slots=True)
class ImuProfile:
    """How units of one kind err."""

    gyro: SensorErrors  # in rad/s
    accel: SensorErrors  # in m/s2
    rate_hz: float  # of the samples delivered
    # Rate that the gyroscope shows per specific force along each axis, rad/s per m/s2, sigma.
    g_sensitivity: float = 0.0
    clock_jitter_s: float = 0.0  # how late stamps are: the half-normal sigma
    clock_drift: float = 0.0  # relative error of the clock of a unit, sigma

    def __post_init__(self) -> None:
        _check_signs(self, positive=("rate_hz",))
        if self.clock_drift > 0.01:
            raise DeviceError(
                f"clock_drift: a clock drifts by millionths; got {self.clock_drift:g}; give a fraction of 1"
            )
        for name in ("gyro", "accel"):
            band_hz = getattr(self, name).bandwidth_hz
            if self.rate_hz <= band_hz < math.inf:
                raise DeviceError(
                    f"{name}: a bandwidth of {band_hz:g} Hz is not below the rate of {self.rate_hz:g} Hz; lower it, or "
                    "leave it infinite"
                )


def imu_profile(name: str) -> ImuProfile:
    """The profile of that name in `PROFILES`.

    Raises:
        UnknownNameError: There is none.
    """
    if name not in PROFILES:
        raise unknown_name("inertial unit", name, PROFILES)
    return PROFILES[name]


def _check_signs(record: object, *, positive: Sequence[str], endless: Sequence[str] = ()) -> None:
    """Every number at least 0, those named positive above, and all but the endless ones finite."""
    for name in (field.name for field in fields(record)):  # type: ignore[arg-type]
        value = getattr(record, name)
        if isinstance(value, SensorErrors):
            continue
        wanted = "above 0" if name in positive else "of at least 0"
        is_right = (value > 0 if name in positive else value >= 0) and (value < math.inf or name in endless)
        if not is_right:
            raise DeviceError(f"{name}: expected a number {wanted}{'' if name in endless else ', finite'}; got {value}")


_G: Final = 9.80665  # data sheets count in it
_MG: Final = _G / 1000
_DPS: Final = math.radians(1.0)
_BITS_16: Final = 2**15  # steps from 0 to the end of the range

# Numbers are those of sources.md 1.6: [V] published, [M] measured on recordings, [R] general knowledge, unverified.
_FACTORY: Final = {"scale_sigma": 0.002, "misalignment_rad": math.radians(0.1)}  # [R] calibrated one by one
_CHIP: Final = {"scale_sigma": 0.01, "misalignment_rad": math.radians(0.5)}  # [R]

_PHONE_GYRO: Final = {
    "turn_on_sigma": 0.14 / math.sqrt(8 / math.pi) * _DPS,  # [M]; the mean length of three normal numbers is 1.596
    "instability": 10 / 3600 * _DPS,  # [V] 10 degrees/h
    "limit": 2000 * _DPS,  # [V]
    "step": 2000 * _DPS / _BITS_16,  # [V]
    "bandwidth_hz": 40.0,  # [R]
    **_CHIP,
}

_PHONE_ACCEL: Final = {
    "instability": 0.03 * _MG,  # [V]
    "limit": 8 * _G,  # [R]
    "step": 8 * _G / _BITS_16,  # [V]
    "bandwidth_hz": 40.0,  # [R]
    **_CHIP,
}

_PHONE: Final = {
    "rate_hz": 100.0,  # [R]
    "g_sensitivity": 0.05 * _DPS / _G,  # [R]
    "clock_jitter_s": 5e-4,  # ours
    "clock_drift": 2e-5,  # ours: a quartz
}

_MTX: Final = ImuProfile(
    gyro=SensorErrors(
        density=0.1 * _DPS,  # [V]
        turn_on_sigma=0.5 * _DPS,  # [V] repeatability
        instability=0.010 * _DPS,  # [R]
        instability_s=300.0,  # ours: the white noise is below the floor by then
        limit=1200 * _DPS,  # [V]
        step=1200 * _DPS / _BITS_16,  # [V]
        bandwidth_hz=40.0,  # [R]
        **_FACTORY,
    ),
    accel=SensorErrors(
        density=0.002,  # [V]
        turn_on_sigma=0.02,  # [R]
        instability=5e-4,  # [R]
        limit=5 * _G,  # [V]
        step=5 * _G / _BITS_16,  # [V]
        bandwidth_hz=30.0,  # [R]
        **_FACTORY,
    ),
    rate_hz=120.0,  # [V]
    g_sensitivity=0.01 * _DPS / _G,  # [R]
    clock_jitter_s=1e-4,  # ours: stamps count samples
    clock_drift=2e-5,  # ours: a quartz
)

_GX3_FACTORY: Final = {"scale_sigma": 0.0005, "misalignment_rad": math.radians(0.05)}  # [R] data sheet
_GX3: Final = ImuProfile(
    gyro=SensorErrors(
        density=0.325 / math.sqrt(250) * _DPS,  # [M] 0.29 to 0.36 degrees/s a sample at 250 Hz, taken as white
        turn_on_sigma=0.015 * _DPS,  # ours: loops close to 0.2 to 0.45 % of the way (sources.md 1.3)
        instability=0.005 * _DPS,  # [R] 18 degrees/h
        limit=1200 * _DPS,  # [M]
        step=1200 * _DPS / _BITS_16,  # [R]
        bandwidth_hz=100.0,  # [R]
        **_GX3_FACTORY,
    ),
    accel=SensorErrors(
        density=0.014 / math.sqrt(250),  # [M] 0.011 to 0.017 m/s2 a sample at 250 Hz, taken as white
        turn_on_sigma=2 * _MG,  # [R]
        instability=0.04 * _MG,  # [R]
        limit=18 * _G,  # [M]
        step=18 * _G / _BITS_16,  # [R]
        bandwidth_hz=100.0,  # [R]
        **_GX3_FACTORY,
    ),
    rate_hz=250.0,  # [M]
    g_sensitivity=0.01 * _DPS / _G,  # [R]
    clock_jitter_s=1e-4,  # ours
    clock_drift=2e-5,  # ours
)

PROFILES: Final[Mapping[str, ImuProfile]] = MappingProxyType(
    {
        "mtx": _MTX,  # Xsens MTx with 1200 degrees/s and 5 g
        "mtx18": replace(  # with 18 g
            _MTX,
            accel=replace(_MTX.accel, density=0.004, limit=18 * _G, step=18 * _G / _BITS_16),  # [V]
        ),
        "adis16405": ImuProfile(
            gyro=SensorErrors(
                density=2.0 / 60 * _DPS,  # [R] 2 degrees per root hour
                turn_on_sigma=3.0 * _DPS,  # [R]
                instability=0.007 * _DPS,  # [R]
                limit=300 * _DPS,  # [R]
                step=0.05 * _DPS,  # [R]
                bandwidth_hz=40.0,  # [R]
                **_FACTORY,
            ),
            accel=SensorErrors(
                density=0.2 / 60,  # [R] 0.2 m/s per root hour
                turn_on_sigma=50 * _MG,  # [R]
                instability=0.2 * _MG,  # [R]
                limit=18 * _G,  # [R]
                step=3.33 * _MG,  # [R]
                bandwidth_hz=40.0,  # [R]
                **_FACTORY,
            ),
            rate_hz=102.4,  # [R] 819.2 Hz, eight averaged
            g_sensitivity=0.05 * _DPS / _G,  # [R]
            clock_jitter_s=1e-4,  # ours
            clock_drift=2e-5,  # ours
        ),
        "3dm-gx3": _GX3,
        "3dm-gx3-25": replace(  # as on the feet of foot_vicon; the one of foot_stride_gcp stops at 8.8 rad/s
            _GX3,
            gyro=replace(
                _GX3.gyro,
                turn_on_sigma=0.12 * _DPS,  # ours: courses drift by 0.1 degrees a stride in the median (sources.md 1.3)
                limit=9.2,  # [M] where the recorded rates stop
                step=9.2 / _BITS_16,
            ),
            rate_hz=200.0,  # [M]
        ),
        "3dm-gx3-25b": replace(  # the same with the white noise of its data sheet, by which units differ
            _GX3,
            gyro=replace(
                _GX3.gyro,
                density=0.03 * _DPS,  # [R] data sheet
                density_sigma=0.1,  # ours
                turn_on_sigma=0.12 * _DPS,  # as above
                limit=9.2,
                step=9.2 / _BITS_16,
            ),
            accel=replace(_GX3.accel, density=0.08 * _MG, density_sigma=0.1),  # [R] data sheet; ours
            rate_hz=200.0,  # [M]
        ),
        # A chip may be off by 3 degrees/s (BMI160) [V]; uncalibrated rates of phones are off by 0.14 in the mean
        # [M], taken as the length of the vector. Instabilities are those of the MTi-1 [V] for want of better ones.
        "phone_mid": ImuProfile(  # BMI160
            gyro=SensorErrors(density=0.0075 * _DPS, **_PHONE_GYRO),  # [V] 0.007 to 0.008
            accel=SensorErrors(density=0.165 * _MG, turn_on_sigma=40 * _MG, **_PHONE_ACCEL),  # [V] 150 to 180 ug, 40 mg
            **_PHONE,
        ),
        "phone_good": ImuProfile(  # ICM-42688
            gyro=SensorErrors(density=0.0028 * _DPS, **_PHONE_GYRO),  # [V]
            accel=SensorErrors(density=0.070 * _MG, turn_on_sigma=20 * _MG, **_PHONE_ACCEL),  # [V] 70 ug, [R] 20 mg
            **_PHONE,
        ),
    }
)
