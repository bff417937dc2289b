from __future__ import annotations

import math
import re
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

from pdrbench.errors import UnknownNameError
from pdrbench_sim.units.device import draw_unit
from pdrbench_sim.units.profiles import PROFILES, DeviceError, ImuProfile, SensorErrors, imu_profile

PERFECT = SensorErrors()
DPS = math.radians(1.0)


class Measured(NamedTuple):
    t_s: np.ndarray
    accel: np.ndarray
    gyro: np.ndarray


def make_profile(*, gyro: SensorErrors = PERFECT, accel: SensorErrors = PERFECT, rate_hz=100.0, **facts) -> ImuProfile:
    return ImuProfile(gyro=gyro, accel=accel, rate_hz=rate_hz, **facts)


def at_rest(duration_s: float, internal_hz: float) -> Measured:
    """A unit that lies on a table, ideally measured."""
    t_s = np.arange(round(duration_s * internal_hz) + 1) / internal_hz
    accel = np.tile([0.0, 0.0, 9.81], (len(t_s), 1))
    return Measured(t_s, accel, np.zeros_like(accel))


def swinging(duration_s: float = 20.0, internal_hz: float = 400.0) -> Measured:
    """Smooth signals of several frequencies below 10 Hz on every axis."""
    t_s = np.arange(round(duration_s * internal_hz) + 1) / internal_hz
    phase = 2 * np.pi * t_s[:, None] * np.array([1.1, 3.7, 8.3])
    return Measured(t_s, 30 * np.sin(phase) + [0, 0, 9.81], 4 * np.cos(phase))


def measure(profile: ImuProfile, ideal: Measured, seed: int = 0) -> Measured:
    rng = np.random.default_rng(seed)
    return Measured(*draw_unit(profile, rng).measure(*ideal, rng))


def markov_allan(tau_s: np.ndarray, errors: SensorErrors) -> np.ndarray:
    """IEEE Std 952-1997, equation C.19, scaled so that its largest value is the tabulated instability."""
    x = np.asarray(tau_s) / errors.instability_s
    largest = 0.436543  # of the expression below, at 1.8926
    return errors.instability / largest * np.sqrt((1 - (3 - 4 * np.exp(-x) + np.exp(-2 * x)) / (2 * x)) / x)


def relative_sigma(count: int, clusters: np.ndarray, axes: int = 3) -> np.ndarray:
    """Of an overlapping Allan deviation, taking one degree of freedom per cluster.

    White noise in clusters of m = 4 samples or more has 1.4 to 1.5: (3 n / 2 m) 4 m^2 / (4 m^2 + 5), Riley 2008.
    """
    return 1 / np.sqrt(2 * axes * np.maximum(count / clusters, 1.0))


def allan_deviation(
    rate_hz: float, values: np.ndarray, taus_s: list[float] | np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Averaging times (m,) and overlapping Allan deviation (m, k) of values (n, k); IEEE Std 952-1997, annex C."""
    sizes = np.rint(np.asarray(taus_s) * rate_hz).astype(int)
    theta = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values - values.mean(axis=0), axis=0)]) / rate_hz
    second = (theta[2 * m :] - 2 * theta[m:-m] + theta[: -2 * m] for m in sizes)
    return sizes / rate_hz, np.array(
        [np.sqrt(np.mean(d**2, axis=0) / 2) / (m / rate_hz) for d, m in zip(second, sizes, strict=True)]
    )


# What a unit delivers


def test_without_errors_the_ideal_signals_are_delivered():
    ideal = swinging()
    measured = measure(make_profile(), ideal)
    assert measured.t_s == pytest.approx(ideal.t_s[::4], abs=1e-12)
    np.testing.assert_allclose(measured.accel, ideal.accel[::4], atol=1e-9)
    np.testing.assert_allclose(measured.gyro, ideal.gyro[::4], atol=1e-9)


def test_between_ideal_samples_signals_are_smooth():
    """37 Hz do not divide 400 Hz; a cubic through 8 Hz at 400 Hz errs by (2 pi 8 / 400)^4 3 / 128 of the amplitude."""
    ideal = swinging()
    measured = measure(make_profile(rate_hz=37.0), ideal)
    phase = 2 * np.pi * measured.t_s[:, None] * np.array([1.1, 3.7, 8.3])
    assert np.abs(measured.gyro - 4 * np.cos(phase))[5:-5].max() < 4 * 2e-5


@pytest.mark.parametrize("name", PROFILES)
def test_allan_deviation_of_every_profile_is_that_of_its_table(name):
    """White noise and instability add up, from some seconds to the floor, within 4 sigma of the estimate.

    At one sample a second, where a day is short. Rounding is left out, since it is white only where the noise of a
    sample is larger than a step; so are shorter times, at which samples of the bias are no means of it.
    """
    ideal = {"bandwidth_hz": math.inf, "limit": math.inf, "step": 0.0, "density_sigma": 0.0}
    sensors = {sensor: replace(getattr(PROFILES[name], sensor), **ideal) for sensor in ("gyro", "accel")}
    count = 60_000
    measured = measure(make_profile(rate_hz=1.0, **sensors), at_rest(count - 1, 2.0))
    for sensor, errors in sensors.items():
        at_s = np.array([4.0, 20.0, 1.89 * errors.instability_s])
        _, sigma = allan_deviation(1.0, getattr(measured, sensor), at_s)
        ratio = np.sqrt(np.mean(sigma**2, axis=1) / (errors.density**2 / at_s + markov_allan(at_s, errors) ** 2))
        assert np.all(np.abs(ratio - 1) < 4 * relative_sigma(count, at_s))
        # white noise is small by then: what is found there is the tabulated floor
        assert sigma[-1].mean() == pytest.approx(errors.instability, rel=0.25)


def test_units_differ_in_their_noise_where_the_profile_says_so():
    """Log-normal with a sigma of 0.3: of 400 units 0.3 +- 0.011 (one standard error)."""
    differing = make_profile(gyro=SensorErrors(density=0.01, density_sigma=0.3), accel=SensorErrors(density=0.01))
    units = [draw_unit(differing, np.random.default_rng(seed)) for seed in range(400)]
    assert np.std(np.log([unit.gyro.noise for unit in units])) == pytest.approx(0.3, abs=0.045)
    assert {unit.accel.noise for unit in units} == {1.0}
    loud = max(units, key=lambda unit: unit.gyro.noise)
    t_s, still, none = at_rest(20.0, 2 * differing.rate_hz)
    _, _, gyro = loud.measure(t_s, still, none, np.random.default_rng(0))
    assert gyro.std() == pytest.approx(loud.gyro.noise * 0.01 * math.sqrt(differing.rate_hz), rel=0.1)


@pytest.mark.parametrize("name", PROFILES)
def test_turn_on_biases_spread_over_units_and_stay_with_one(name):
    rng = np.random.default_rng(0)
    units = [draw_unit(PROFILES[name], rng) for _ in range(400)]
    for sensor in ("gyro", "accel"):
        biases = np.array([getattr(unit, sensor).bias for unit in units])
        sigma = getattr(PROFILES[name], sensor).turn_on_sigma
        # 1200 numbers: 4 sigma are 8 % of the spread and 12 % of a sigma for the mean
        assert np.std(biases) == pytest.approx(sigma, rel=0.085)
        assert abs(biases.mean()) < 0.12 * sigma


def test_values_are_rounded_to_the_step_and_end_exactly_at_the_range():
    profile = PROFILES["mtx"]
    ideal = swinging(internal_hz=480.0)
    ideal = Measured(ideal.t_s, 3 * ideal.accel, 10 * ideal.gyro)
    measured = measure(profile, ideal)
    assert np.abs(measured.accel).max() == 5 * 9.80665
    assert np.abs(measured.gyro).max() == 1200 * DPS
    assert np.mean(np.abs(measured.accel) == 5 * 9.80665) > 0.2  # clipped, not scaled
    ideal = swinging()
    steps = measure(make_profile(gyro=SensorErrors(step=0.05)), ideal).gyro / 0.05
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-9)
    off = steps * 0.05 - ideal.gyro[::4]
    assert np.abs(off).max() <= 0.025 + 1e-9
    assert np.std(off) == pytest.approx(0.05 / math.sqrt(12), rel=0.05)  # 6000 nearly even numbers


@pytest.mark.parametrize("frequency_hz", [2.0, 20.0, 60.0])
def test_the_bandwidth_is_that_of_a_butterworth_filter_of_second_order(frequency_hz):
    """A gain of 1 / sqrt(1 + r^4): -3 dB at the cut-off, where the ratio r of the (warped) frequencies is 1."""
    t_s = np.arange(8001) / 800.0
    wave = np.sin(2 * np.pi * frequency_hz * t_s)[:, None] * np.ones(3)
    ratio = math.tan(math.pi * frequency_hz / 800) / math.tan(math.pi * 20 / 800)
    profile = make_profile(accel=SensorErrors(bandwidth_hz=20.0), rate_hz=400.0)
    measured = measure(profile, Measured(t_s, wave, wave))
    settled = measured.accel[400:-1]
    assert math.sqrt(2) * np.std(settled, axis=0) == pytest.approx(1 / math.sqrt(1 + ratio**4), rel=2e-3)
    np.testing.assert_allclose(measured.gyro, wave[::2], atol=1e-9)  # the other sensor has none


def test_the_bandwidth_looks_back_only_and_starts_settled():
    ideal = at_rest(4.0, 400.0)
    late = Measured(ideal.t_s, ideal.accel.copy(), ideal.gyro)
    late.accel[801:] += 50.0
    profile = make_profile(accel=SensorErrors(bandwidth_hz=20.0))
    before, after = measure(profile, ideal), measure(profile, late)
    np.testing.assert_allclose(before.accel, np.tile([0, 0, 9.81], (401, 1)), rtol=1e-9)
    # a cubic through the samples is the only thing that looks ahead, and it forgets a jump within some samples
    np.testing.assert_allclose(after.accel[:195], before.accel[:195], atol=1e-6)
    assert after.accel[-1] == pytest.approx([50, 50, 59.81], rel=1e-6)


def test_scale_and_misalignment_act_on_the_true_vector():
    errors = SensorErrors(scale_sigma=0.02, misalignment_rad=0.01)
    ideal = swinging()
    rng = np.random.default_rng(4)
    unit = draw_unit(make_profile(gyro=errors), rng)
    _, _, gyro = unit.measure(*ideal, rng)
    solved, *_ = np.linalg.lstsq(ideal.gyro[::4], gyro, rcond=None)
    np.testing.assert_allclose(solved.T, unit.gyro.gain, atol=1e-9)

    gains = np.array([draw_unit(make_profile(gyro=errors), rng).gyro.gain for _ in range(500)])
    is_scale = np.eye(3, dtype=bool)
    assert np.std(gains[:, is_scale]) == pytest.approx(0.02, rel=0.08)  # 1500 numbers: 4 sigma are 7 %
    assert np.std(gains[:, ~is_scale]) == pytest.approx(0.01, rel=0.08)
    assert gains[:, is_scale].mean() == pytest.approx(1.0, abs=4 * 0.02 / math.sqrt(1500))


def test_the_gyroscope_turns_with_the_specific_force():
    ideal = at_rest(1.0, 200.0)
    rng = np.random.default_rng(5)
    unit = draw_unit(make_profile(g_sensitivity=0.05 * DPS / 9.80665), rng)
    _, accel, gyro = unit.measure(*ideal, rng)
    np.testing.assert_allclose(gyro, np.tile(9.81 * unit.g_sensitivity[:, 2], (len(gyro), 1)), rtol=1e-12)
    np.testing.assert_allclose(accel, ideal.accel[::2], rtol=1e-12)
    drawn = np.array([draw_unit(unit.profile, rng).g_sensitivity for _ in range(200)])
    assert np.std(drawn) == pytest.approx(0.05 * DPS / 9.80665, rel=0.07)  # 1800 numbers: 4 sigma


# Clock


def test_stamps_are_late_in_order_and_at_the_nominal_rate():
    measured = measure(make_profile(clock_jitter_s=0.001), at_rest(60.0, 200.0))
    late_s = measured.t_s - np.arange(6001) / 100.0
    assert late_s.min() >= 0.0
    assert np.mean(late_s) == pytest.approx(0.001 * math.sqrt(2 / math.pi), rel=0.05)  # 6001 numbers: 4 sigma are 4 %
    rough = measure(make_profile(clock_jitter_s=0.1), at_rest(60.0, 200.0))
    assert np.diff(rough.t_s).min() > 0


def test_a_fast_clock_counts_more_samples():
    ideal = swinging(200.0)
    rng = np.random.default_rng(6)
    unit = draw_unit(make_profile(clock_drift=0.001), rng)
    assert 1e-4 < abs(unit.clock_drift) < 5e-3
    t_s, _, gyro = unit.measure(*ideal, rng)
    assert len(t_s) == math.floor(200.0 * 100.0 * (1 + unit.clock_drift)) + 1
    true_s = t_s / (1 + unit.clock_drift)
    assert gyro[:, 0] == pytest.approx(4 * np.cos(2 * np.pi * 1.1 * true_s), abs=1e-3)


# Chance


def test_same_seed_same_bytes_and_the_global_state_is_untouched():
    before = np.random.get_state()[1].copy()  # noqa: NPY002
    one, same, other = (measure(PROFILES["phone_mid"], swinging(), seed) for seed in (1, 1, 2))
    for a, b in zip(one, same, strict=True):
        assert a.tobytes() == b.tobytes()
    assert one.gyro.tobytes() != other.gyro.tobytes()
    np.testing.assert_array_equal(np.random.get_state()[1], before)  # noqa: NPY002


ALL = SensorErrors(
    density=0.01, turn_on_sigma=0.02, instability=0.003, random_walk=0.001, scale_sigma=0.01, misalignment_rad=0.01
)


@pytest.mark.parametrize("off", ["density", "turn_on_sigma", "instability", "random_walk"])
def test_an_error_switched_off_leaves_the_others_as_they_were(off):
    """Switching one error off subtracts that error alone."""
    full = make_profile(gyro=ALL, accel=ALL, g_sensitivity=1e-3, clock_jitter_s=1e-3)
    less = replace(full, gyro=replace(ALL, **{off: 0.0}))
    alone = make_profile(gyro=SensorErrors(**{off: getattr(ALL, off)}))
    t_s, accel, gyro = at_rest(5.0, 200.0)
    ideal = Measured(t_s, 0 * accel, gyro)
    one, two, only = (measure(profile, ideal) for profile in (full, less, alone))
    assert one.t_s.tobytes() == two.t_s.tobytes()
    assert one.accel.tobytes() == two.accel.tobytes()
    assert np.std(only.gyro) > 0
    np.testing.assert_allclose(one.gyro - two.gyro, only.gyro, atol=1e-12)


def test_a_longer_walk_begins_like_a_shorter_one_and_unknown_units_suggest_the_nearest():
    long, short = (measure(PROFILES["mtx"], at_rest(duration_s, 240.0)) for duration_s in (20.0, 10.0))
    np.testing.assert_allclose(long.gyro[:1200], short.gyro[:1200], atol=1e-12)
    assert imu_profile("phone_mid") is PROFILES["phone_mid"]
    with pytest.raises(UnknownNameError, match="no inertial unit named 'mtx81'; did you mean 'mtx18'"):
        imu_profile("mtx81")


# Bad input


def spoilt(**changes) -> Measured:
    ideal = at_rest(1.0, 400.0)
    return Measured(*(changes.get(name, getattr(ideal, name)) for name in Measured._fields))


def with_row(values: np.ndarray, row: int, value: float) -> np.ndarray:
    changed = values.copy()
    changed[row] = value
    return changed


@pytest.mark.parametrize(
    ("ideal", "message"),
    [
        (
            spoilt(t_s=with_row(at_rest(1.0, 400.0).t_s, 7, 0.015)),
            "does not increase at row 7 (0.015000 after 0.015000)",
        ),
        (
            spoilt(t_s=with_row(at_rest(1.0, 400.0).t_s, 7, 0.016)),
            "not even: a step of 0.001000 s at row 7, 0.002500 s",
        ),
        (spoilt(t_s=with_row(at_rest(1.0, 400.0).t_s, 7, np.nan)), "t_s is not finite at row 7"),
        (spoilt(gyro=with_row(at_rest(1.0, 400.0).gyro, 9, np.inf)), "gyro is not finite at row 9"),
        (spoilt(accel=np.zeros((401, 2))), "got (401,), (401, 2), (401, 3)"),
        (spoilt(gyro=np.zeros((400, 3))), "got (401,), (401, 3), (400, 3)"),
        (Measured(np.zeros(1), np.zeros((1, 3)), np.zeros((1, 3))), "two samples or more"),
        (at_rest(1.0, 150.0), "ideal signals at 150 Hz for a unit of 100 Hz; give at least 200 Hz"),
    ],
)
def test_signals_that_cannot_be_measured_are_refused(ideal, message):
    with pytest.raises(DeviceError, match=re.escape(message)):
        measure(PROFILES["phone_mid"], ideal)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: SensorErrors(density=-1.0), "density: expected a number of at least 0, finite; got -1.0"),
        (lambda: SensorErrors(instability=math.nan), "instability: expected"),
        (lambda: SensorErrors(instability_s=0.0), "instability_s: expected a number above 0, finite; got 0.0"),
        (lambda: SensorErrors(limit=0.0), "limit: expected a number above 0; got 0.0"),
        (lambda: SensorErrors(step=math.inf), "step: expected"),
        (lambda: make_profile(rate_hz=0.0), "rate_hz: expected a number above 0"),
        (lambda: make_profile(clock_drift=50.0), "give a fraction of 1"),
        (lambda: make_profile(accel=SensorErrors(bandwidth_hz=100.0)), "accel: a bandwidth of 100 Hz is not below"),
    ],
)
def test_units_that_cannot_be_are_refused(make, message):
    with pytest.raises(DeviceError, match=re.escape(message)):
        make()
