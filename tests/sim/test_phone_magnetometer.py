"""The calibrated magnetometer of a phone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pdrbench.errors import RecordingError
from pdrbench_sim.phone.magnetometer import PhoneMagnetometerParams, calibrated_field

PLAIN = PhoneMagnetometerParams(soft_iron=0.0, left_ut=0.0, noise_ut=0.0, step_ut=0.0)
T_S = np.arange(30_000) / 50.0
STILL = np.tile([1.0, 0, 0, 0], (30_000, 1))
FIELD_UT = np.tile([0.0, 31.0, -30.0], (30_000, 1))


def reading(seed: int, **changes) -> np.ndarray:
    return calibrated_field(T_S, FIELD_UT, STILL, np.random.default_rng(seed), replace(PLAIN, **changes))


def test_a_perfect_calibration_gives_the_field_and_another_leaves_an_offset_that_jumps():
    np.testing.assert_allclose(reading(1), FIELD_UT, atol=1e-12)
    np.testing.assert_allclose(reading(1, hard_iron_ut=(500.0, 500.0)), FIELD_UT, atol=1e-9)
    offset_ut = reading(2, left_ut=5.0, left_spread=0.0, recalibrated_s=60.0) - FIELD_UT
    jumps = np.abs(np.diff(offset_ut, axis=0)).max(axis=1) > 1e-9
    assert 3 <= jumps.sum() <= 20  # 10 expected in 600 s
    sizes = [reading(seed, left_ut=5.0, left_spread=0.0)[0] - FIELD_UT[0] for seed in range(60)]
    assert np.std(sizes) == pytest.approx(5.0, rel=0.2)  # 180 numbers: 5 %


def test_numbers_lie_on_a_grid_that_the_offset_has_shifted():
    read_ut = reading(3, noise_ut=0.7, step_ut=0.69)[:, 0]
    steps = np.diff(np.unique(read_ut.round(9))) / 0.69
    np.testing.assert_allclose(steps, steps.round(), atol=1e-6)
    assert read_ut.std() == pytest.approx(np.hypot(0.7, 0.69 / np.sqrt(12)), rel=0.03)


def test_a_longer_walk_begins_like_a_shorter_one():
    whole = calibrated_field(T_S, FIELD_UT, STILL, np.random.default_rng(4))
    part = calibrated_field(T_S[:999], FIELD_UT[:999], STILL[:999], np.random.default_rng(4))
    np.testing.assert_array_equal(part, whole[:999])
    assert not np.array_equal(whole, calibrated_field(T_S, FIELD_UT, STILL, np.random.default_rng(5)))


@pytest.mark.parametrize("change", [{"left_ut": -1.0}, {"recalibrated_s": 0.0}, {"noise_ut": np.inf}])
def test_magnetometers_that_are_none_are_refused(change):
    with pytest.raises(RecordingError, match="errors of a magnetometer"):
        replace(PLAIN, **change)
