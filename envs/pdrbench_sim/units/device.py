"""Inertial units that err: `draw_unit` makes one of its kind, which measures ideal accelerations and rates."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from pdrbench.geometry import FloatArray, read_only
from pdrbench_sim.resolution import in_steps
from pdrbench_sim.units.profiles import DeviceError, ImuProfile, SensorErrors

MARKOV_PEAK: Final = 0.6174  # largest Allan deviation of a Gauss-Markov process of variance 1, at 1.89 time constants
_EVEN: Final = 0.01  # steps of the ideal signals may differ by this fraction
_MAX_DELAY: Final = 0.9  # of a period: a stamp is never later, so that stamps stay in order


@dataclass(frozen=True, slots=True)
class SensorTriad:
    """The three axes of one unit."""

    errors: SensorErrors  # of its kind
    gain: FloatArray  # (3, 3) what is measured of a value along each axis, with scale and misalignment
    bias: FloatArray  # (3,) since it was switched on
    noise: float = 1.0  # white noise of this unit over that of its kind

    def deliver(
        self, ideal: FloatArray, disturbance: FloatArray, rate_hz: float, streams: Sequence[np.random.Generator]
    ) -> FloatArray:
        """(n, 3) numbers delivered for (n, 3) ideal values, sampled, plus a disturbance of the same shape.

        Args:
            ideal: After the bandwidth.
            disturbance: From elsewhere, added before the sensor's own biases.
            rate_hz: Of the samples.
            streams: Three: for the Gauss-Markov process, the random walk and the white noise.
        """
        errors = self.errors
        markov, walk, white = streams
        measured = ideal @ self.gain.T + disturbance + self.bias
        measured += _in_run_bias(errors, len(ideal), rate_hz, markov, walk)
        measured += self.noise * errors.density * math.sqrt(rate_hz) * white.standard_normal(ideal.shape)
        limit = errors.limit
        if errors.step and limit < math.inf:
            limit = errors.step * math.floor(limit / errors.step + 1e-6)  # no number beyond the range
        np.clip(measured, -limit, limit, out=measured)
        return in_steps(measured, errors.step) if errors.step else measured


@dataclass(frozen=True, slots=True)
class ImuUnit:
    """One unit, switched on."""

    profile: ImuProfile  # its kind
    gyro: SensorTriad  # three axes
    accel: SensorTriad  # three axes
    g_sensitivity: FloatArray  # (3, 3) rad/s about each axis per m/s2 along each
    clock_drift: float  # its clock is fast by this fraction

    def measure(
        self, t_s: FloatArray, accel: FloatArray, gyro: FloatArray, rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """What the unit delivers.

        Signals pass the bandwidth, causally, and are sampled by the unit's clock; then come gain, g-sensitivity,
        biases, white noise, the end of the range and rounding. Each source of error has a stream of chance of its own,
        so that switching one off leaves the others as they were.

        Args:
            t_s: (n,) seconds, evenly spaced at twice the unit's rate or more.
            accel: (n, 3) ideal specific force in the body frame, m/s2.
            gyro: (n, 3) ideal rate in the body frame, rad/s.
            rng: Noise, in-run biases and jitter.

        Returns:
            t_s: (m,) stamps: seconds of the unit's clock, which starts at `t_s[0]`, and late by the jitter.
            accel: (m, 3) m/s2.
            gyro: (m, 3) rad/s.

        Raises:
            DeviceError: Times that do not increase evenly, too low a rate, other shapes, or values that are not finite.
        """
        rate_hz = self.profile.rate_hz
        t_s, accel, gyro = (np.asarray(values, dtype=np.float64) for values in (t_s, accel, gyro))
        internal_hz = _check_ideal(t_s, accel, gyro, rate_hz)
        *drawn, late = rng.spawn(7)

        true_hz = rate_hz * (1 + self.clock_drift)
        ticks = np.arange(math.floor((t_s[-1] - t_s[0]) * true_hz + 1e-6) + 1)
        sampled_s = np.minimum(t_s[0] + ticks / true_hz, t_s[-1])
        force = _sampled(t_s, accel, self.accel.errors.bandwidth_hz, internal_hz, sampled_s)
        rate = _sampled(t_s, gyro, self.gyro.errors.bandwidth_hz, internal_hz, sampled_s)

        late_s = np.abs(late.standard_normal(len(ticks))) * self.profile.clock_jitter_s
        stamp_s = t_s[0] + ticks / rate_hz + np.minimum(late_s, _MAX_DELAY / rate_hz)
        return (
            stamp_s,
            self.accel.deliver(force, np.zeros(3), rate_hz, drawn[:3]),
            self.gyro.deliver(rate, force @ self.g_sensitivity.T, rate_hz, drawn[3:]),
        )


def draw_unit(profile: ImuProfile, rng: np.random.Generator) -> ImuUnit:
    """One unit of its kind, switched on once; each of its constants has a stream of chance of its own."""
    *drawn, sensitivity, clock = rng.spawn(8)
    return ImuUnit(
        profile,
        _draw_sensor(profile.gyro, drawn[:3]),
        _draw_sensor(profile.accel, drawn[3:]),
        read_only(profile.g_sensitivity * sensitivity.standard_normal((3, 3))),
        profile.clock_drift * float(clock.standard_normal()),
    )


def _draw_sensor(errors: SensorErrors, streams: Sequence[np.random.Generator]) -> SensorTriad:
    scale, misalignment, turn_on = streams
    gain = 1 + errors.scale_sigma * scale.standard_normal((3, 1))
    directions = np.eye(3) + errors.misalignment_rad * misalignment.standard_normal((3, 3)) * (1 - np.eye(3))
    bias = errors.turn_on_sigma * turn_on.standard_normal(3)
    # Spawned only where units differ: what callers draw next from these streams stays as it is.
    noise = math.exp(errors.density_sigma * turn_on.spawn(1)[0].standard_normal()) if errors.density_sigma else 1.0
    return SensorTriad(errors, read_only(gain * directions), read_only(bias), noise)


def _in_run_bias(
    errors: SensorErrors, count: int, rate_hz: float, markov: np.random.Generator, walk: np.random.Generator
) -> FloatArray:
    """(count, 3) Gauss-Markov process, stationary from the start, plus a random walk from 0."""
    from scipy.signal import lfilter

    keeps = math.exp(-1 / (rate_hz * errors.instability_s))
    sigma = errors.instability / MARKOV_PEAK
    renews = math.sqrt(-math.expm1(-2 / (rate_hz * errors.instability_s)))
    driving = markov.standard_normal((count, 3)) * sigma
    driving[1:] *= renews
    bias: FloatArray = lfilter([1.0], [1.0, -keeps], driving, axis=0)
    steps = walk.standard_normal((count, 3)) * (errors.random_walk / math.sqrt(rate_hz))
    steps[0] = 0.0
    return bias + np.cumsum(steps, axis=0)


def _sampled(
    t_s: FloatArray, ideal: FloatArray, bandwidth_hz: float, internal_hz: float, sampled_s: FloatArray
) -> FloatArray:
    """(m, 3) ideal signals behind a second-order Butterworth low-pass, at other times."""
    from scipy.signal import butter, sosfilt, sosfilt_zi

    if bandwidth_hz < math.inf:
        sections = butter(2, bandwidth_hz, fs=internal_hz, output="sos")
        before = sosfilt_zi(sections)[:, :, None] * ideal[0]  # as if the first value had lasted
        ideal, _ = sosfilt(sections, ideal, axis=0, zi=before)
    return _between((sampled_s - t_s[0]) * internal_hz, ideal)


def _between(at: FloatArray, values: FloatArray) -> FloatArray:
    """(m, 3) even samples (n, 3) at places `at` (m,) between them, counted in samples.

    A cubic through the four nearest ones keeps 40 Hz at 400 Hz within half a percent; straight lines lose 5 % of it.
    """
    if len(values) < 4:
        return np.column_stack([np.interp(at, np.arange(len(values)), column) for column in values.T])
    first = np.clip(np.floor(at).astype(np.int64) - 1, 0, len(values) - 4)
    x = at - first
    weights = (
        (x - 1) * (x - 2) * (x - 3) / -6,
        x * (x - 2) * (x - 3) / 2,
        x * (x - 1) * (x - 3) / -2,
        x * (x - 1) * (x - 2) / 6,
    )
    found: FloatArray = sum(weight[:, None] * values[first + i] for i, weight in enumerate(weights))  # type: ignore[assignment]
    return found


def _check_ideal(t_s: FloatArray, accel: FloatArray, gyro: FloatArray, rate_hz: float) -> float:
    """The rate of ideal signals that can be measured."""
    if t_s.ndim != 1 or len(t_s) < 2 or accel.shape != (len(t_s), 3) or gyro.shape != (len(t_s), 3):
        raise DeviceError(
            "a unit measures t_s (n,), accel (n, 3) and gyro (n, 3) of two samples or more; "
            f"got {t_s.shape}, {accel.shape}, {gyro.shape}"
        )
    for name, values in (("t_s", t_s[:, None]), ("accel", accel), ("gyro", gyro)):
        wrong = np.flatnonzero(~np.isfinite(values).all(axis=1))
        if len(wrong):
            raise DeviceError(f"{name} is not finite at row {wrong[0]}; ideal signals have no gaps: mend the motion")
    steps_s = np.diff(t_s)
    back = np.flatnonzero(steps_s <= 0)
    if len(back):
        at = back[0] + 1
        raise DeviceError(
            f"t_s does not increase at row {at} ({t_s[at]:.6f} after {t_s[at - 1]:.6f}); sort the samples"
        )
    internal_hz = float((len(t_s) - 1) / (t_s[-1] - t_s[0]))
    uneven = np.flatnonzero(np.abs(steps_s * internal_hz - 1) > _EVEN)
    if len(uneven):
        raise DeviceError(
            f"t_s is not even: a step of {steps_s[uneven[0]]:.6f} s at row {uneven[0] + 1}, {1 / internal_hz:.6f} s in "
            "the mean; give samples at one rate"
        )
    if internal_hz < 2 * rate_hz * (1 - 1e-6):
        raise DeviceError(
            f"ideal signals at {internal_hz:g} Hz for a unit of {rate_hz:g} Hz; give at least {2 * rate_hz:g} Hz"
        )
    return internal_hz
