"""Barometers: closed forms of each component, and that levels change noticeably but are not known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pdrbench.errors import RecordingError
from pdrbench.recording import SensorStream
from pdrbench.sensors import sensor_spec
from pdrbench_sim.fields.barometer import HPA_PER_M, SEA_LEVEL_HPA, BarometerErrors, draw_barometer, measure

PERFECT = BarometerErrors(weather_hpa_per_sqrt_h=0.0, local_hpa=0.0, noise_hpa=0.0, steps_per_h=0.0)
MINUTE_S = np.arange(600) / 10  # ten samples a second


def read(errors: BarometerErrors, t_s=MINUTE_S, z_m=0.0, seed: int = 0) -> np.ndarray:
    return measure(t_s, z_m, np.random.default_rng(seed), errors)


def test_a_barometer_falls_by_012_hpa_a_metre_with_white_noise_within_the_sensor():
    pressure_hpa = read(replace(PERFECT, offset_hpa=-3.0), np.array([0.0, 1.0, 2.0]), np.array([0.0, 1.0, -3.0]))
    np.testing.assert_allclose(pressure_hpa, SEA_LEVEL_HPA - 3.0 + np.array([0.0, -0.12, 0.36]))
    noise = read(replace(PERFECT, noise_hpa=0.02), np.arange(20_000) / 10) - SEA_LEVEL_HPA
    assert noise.std() == pytest.approx(0.02, rel=0.02)  # 0.5 % of standard error
    assert abs(np.mean(noise[1:] * noise[:-1])) < 0.02**2 * 0.03
    rows = np.column_stack([MINUTE_S, read(draw_barometer(np.random.default_rng(6)), z_m=300.0)])
    assert len(SensorStream(sensor_spec("baro"), rows).t_s) == 600


def test_weather_walks_with_the_square_root_of_time_however_it_is_sampled():
    errors = replace(PERFECT, weather_hpa_per_sqrt_h=0.5)
    coarse, fine = np.array([0.0, 3600.0]), np.linspace(0.0, 3600.0, 61)
    for times_s in (coarse, fine, fine**2 / 3600):
        ends = [read(errors, times_s, seed=seed)[-1] - SEA_LEVEL_HPA for seed in range(1000)]
        assert np.std(ends) == pytest.approx(0.5, rel=0.08)  # 2.2 % of standard error
        assert abs(np.mean(ends)) < 0.05


def test_local_component_is_gauss_markov():
    errors = replace(PERFECT, local_hpa=0.05, local_s=20.0)
    lags_s = np.array([0.0, 5.0, 20.0, 60.0])
    values = np.array([read(errors, lags_s, seed=seed) for seed in range(3000)]) - SEA_LEVEL_HPA
    np.testing.assert_allclose(values.std(axis=0), 0.05, rtol=0.06)
    np.testing.assert_allclose((values[:, :1] * values).mean(axis=0) / 0.05**2, np.exp(-lags_s / 20), atol=0.1)


def test_doors_change_the_pressure_and_change_it_back():
    errors = replace(PERFECT, steps_per_h=60.0)
    offsets = [read(errors, np.arange(0.0, 36_000.0, 0.5), seed=seed) - SEA_LEVEL_HPA for seed in range(5)]
    changes = np.concatenate([np.diff(offset)[np.diff(offset) != 0] for offset in offsets])
    # a change seldom falls together with the next one between two samples
    inside = (np.abs(changes) > 0.0499) & (np.abs(changes) < 0.3001)
    assert inside.mean() > 0.97
    assert len(changes) == pytest.approx(5 * 600, rel=0.08)  # 60 an hour for 10 hours
    assert np.abs(changes[inside]).mean() == pytest.approx(0.175, rel=0.05)
    assert np.mean(np.concatenate(offsets) == 0) == pytest.approx(0.5, abs=0.05)
    assert all(offset[0] == 0 for offset in offsets)
    assert abs(np.mean(changes > 0) - 0.5) < 0.05


def climbs(height_m: float, count: int) -> np.ndarray:
    """(count,) change of the pressure over stairs of 15 s: means of 5 s before and after, with drawn devices."""
    t_s = np.arange(0, 60, 0.1)
    z_m = height_m * np.clip((t_s - 22.5) / 15, 0, 1)
    change = []
    for seed in range(count):
        pressure_hpa = read(draw_barometer(np.random.default_rng([seed, 1])), t_s, z_m, seed)
        before, after = pressure_hpa[(t_s >= 17.5) & (t_s < 22.5)], pressure_hpa[(t_s >= 37.5) & (t_s < 42.5)]
        change.append(after.mean() - before.mean())
    return np.array(change)


def test_a_change_of_level_is_detected_and_staying_is_not():
    threshold_hpa = HPA_PER_M * 3.0 / 2
    assert np.mean(climbs(3.0, 300) < -threshold_hpa) > 0.95
    assert np.mean(climbs(-3.0, 300) > threshold_hpa) > 0.95
    assert np.mean(np.abs(climbs(0.0, 300)) > threshold_hpa) < 0.05


def test_same_generator_state_same_bytes_and_more_samples_change_nothing():
    errors = BarometerErrors(steps_per_h=120.0)
    whole = read(errors, seed=3)
    np.testing.assert_array_equal(whole, read(errors, seed=3))
    np.testing.assert_array_equal(whole[:200], read(errors, MINUTE_S[:200], seed=3))
    assert not np.array_equal(whole, read(errors, seed=4))


@pytest.mark.parametrize("part", ["weather_hpa_per_sqrt_h", "local_hpa", "steps_per_h"])
def test_a_component_that_is_switched_off_does_not_change_the_others(part: str):
    errors = BarometerErrors(steps_per_h=120.0)
    alone = replace(PERFECT, **{part: getattr(errors, part)})
    without = replace(errors, **{part: 0.0})
    together = read(without, seed=5) + read(alone, seed=5) - SEA_LEVEL_HPA
    np.testing.assert_allclose(together, read(errors, seed=5), atol=1e-9)


@pytest.mark.parametrize(
    ("t_s", "z_m", "says"),
    [
        ([], [], "needs .n,. times"),
        ([[0.0]], 0.0, "needs .n,. times"),
        ([0.0, 1.0], [0.0], "as many heights"),
        ([0.0, np.nan], 0.0, "finite times and heights"),
        ([0.0, 1.0], [0.0, np.inf], "finite times and heights"),
        ([0.0, 1.0, 1.0], 0.0, "row 2 has 1 s after 1 s"),
    ],
)
def test_samples_that_are_none_are_refused(t_s, z_m, says: str):
    with pytest.raises(RecordingError, match=says):
        measure(t_s, z_m, np.random.default_rng(0))


@pytest.mark.parametrize(
    "change",
    [{"noise_hpa": -0.1}, {"local_s": 0.0}, {"steps_per_h": -1.0}, {"offset_hpa": np.nan}, {"step_hpa": (-1, 1)}],
)
def test_barometers_that_are_none_are_refused(change):
    with pytest.raises(RecordingError, match="finite and not negative"):
        replace(PERFECT, **change)
