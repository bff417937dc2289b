"""What a unit on a foot reports of true strides."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pdrbench.recording import SensorStream
from pdrbench.sensors.stride import STRIDE
from pdrbench_sim.units.strides import StrideErrors, fitted, measure


def straight(count: int, length_m: float = 1.3) -> np.ndarray:
    """Strides without error along a straight line."""
    rows = np.zeros((count, 4))
    rows[:, 0] = np.arange(1, count + 1)
    rows[:, 1] = length_m
    return rows


SIZES = StrideErrors(-0.019, 0.027, 0.026, math.radians(0.10), math.radians(0.29), math.radians(0.65))


def test_errors_of_one_walk_have_the_sizes_asked_for():
    count = 20_000
    rows = measure(straight(count), np.random.default_rng(0), SIZES)
    # A mean of n is known to sigma/sqrt(n), a standard deviation to sigma/sqrt(2n); four of each.
    mean, spread = 4 / math.sqrt(count), 4 / math.sqrt(2 * count)
    assert rows[:, 1].mean() == pytest.approx(1.3 * (1 - 0.019), abs=0.027 * mean)
    assert rows[:, 1].std() == pytest.approx(0.027, rel=spread)
    assert rows[:, 2].mean() == pytest.approx(0, abs=0.026 * mean)
    assert rows[:, 2].std() == pytest.approx(0.026, rel=spread)
    assert np.degrees(rows[:, 3].std()) == pytest.approx(0.65, rel=spread)


def test_the_drift_is_constant_within_a_walk_and_differs_between_walks():
    walks, strides = 600, 400
    rng = np.random.default_rng(1)
    turn_rad = np.array([measure(straight(strides), rng, SIZES)[:, 3] for _ in range(walks)])
    drift_deg = np.degrees(turn_rad.mean(axis=1))
    # White turns of 0.65 degrees leave 0.65/sqrt(400) = 0.033 in a mean: the spread over walks is hypot(0.29, 0.033).
    assert np.median(drift_deg) == pytest.approx(0.10, abs=4 * 1.25 * 0.29 / math.sqrt(walks))
    assert drift_deg.std() == pytest.approx(math.hypot(0.29, 0.033), rel=4 / math.sqrt(2 * walks))
    halves = np.degrees(turn_rad[:, : strides // 2].mean(axis=1) - turn_rad[:, strides // 2 :].mean(axis=1))
    assert halves.std() == pytest.approx(0.65 * math.sqrt(2 / 200), rel=4 / math.sqrt(2 * walks))


def test_without_errors_measured_strides_are_the_true_ones():
    none = StrideErrors()
    rows = straight(5)
    rows[:, 2:] = [[0.3, 1.0], [-0.3, -2.0], [0.0, 3.0], [0.0, -3.0], [0.1, 0.0]]
    np.testing.assert_allclose(measure(rows, np.random.default_rng(0), none), rows, atol=1e-15)


def test_lengths_stay_lengths_and_turns_stay_wrapped():
    rows = straight(2000, length_m=0.0)
    rows[:, 3] = math.pi - 1e-3
    found = measure(rows, np.random.default_rng(2), fitted())
    SensorStream(STRIDE, found)  # within the bounds of the spec
    assert (found[:, 1] == 0).any()
    assert (found[:, 3] < 0).any()


def test_a_heading_error_is_taken_back_by_the_next_turn():
    """White in the heading: turns of sqrt(2) sigma with a correlation of -1/2, and a heading that does not wander."""
    count, sigma_rad = 20_000, math.radians(0.8)
    only = StrideErrors(heading_sigma_rad=sigma_rad)
    turn_rad = measure(straight(count), np.random.default_rng(3), only)[:, 3]
    heading_rad = np.cumsum(turn_rad)
    spread = 4 / math.sqrt(2 * count)
    assert heading_rad.std() == pytest.approx(sigma_rad, rel=spread)
    assert turn_rad.std() == pytest.approx(sigma_rad * math.sqrt(2), rel=2 * spread)
    assert np.corrcoef(turn_rad[1:], turn_rad[:-1])[0, 1] == pytest.approx(-0.5, abs=4 / math.sqrt(count))
    assert abs(heading_rad[-1]) < 5 * sigma_rad


def test_every_walk_has_an_offset_of_its_own_and_some_strides_are_coarse():
    """Of 300 walks of 200 strides a mean is known to sigma / sqrt(300), a fraction p to sqrt(p / 60 000): four each."""
    errors = StrideErrors(
        length_sigma_m=0.01,
        heading_sigma_rad=0.01,
        length_offset_m=-0.02,
        length_offset_sigma_m=0.005,
        coarse_fraction=0.2,
        coarse_factor=10.0,
    )
    rng = np.random.default_rng(6)
    walks = [measure(straight(200), rng, errors) for _ in range(300)]
    offsets_m = np.array([np.median(rows[:, 1]) - straight(1)[0, 1] for rows in walks])
    assert offsets_m.mean() == pytest.approx(-0.02, abs=4 * 0.005 / math.sqrt(300))
    assert offsets_m.std() == pytest.approx(0.005, rel=4 / math.sqrt(600))
    white_m = np.concatenate([rows[:, 1] - np.median(rows[:, 1]) for rows in walks])
    heading_rad = np.concatenate([np.cumsum(rows[:, 3]) for rows in walks])
    far = 0.8 * math.erfc(4 / math.sqrt(2)) + 0.2 * math.erfc(0.4 / math.sqrt(2))  # beyond four of the smaller sigmas
    for values in (white_m / 0.01, heading_rad / 0.01):
        assert (np.abs(values) > 4).mean() == pytest.approx(far, abs=4 * math.sqrt(far / 60_000) + 0.002)
    both = (np.abs(white_m) > 0.04) & (np.abs(heading_rad) > 0.04)
    assert both.mean() > 3 * far**2  # the same strides


def test_drifts_of_students_law_have_its_quantiles():
    """The median size of t with 3 degrees of freedom is 0.765, its 95 % 3.18; of 4000 known to 3 and 7 %."""
    errors = StrideErrors(drift_mean_rad=0.01, drift_sigma_rad=0.001, drift_tail=1 / 3)
    rng = np.random.default_rng(7)
    drift = np.abs(np.array([measure(straight(1), rng, errors)[0, 3] for _ in range(4000)]) - 0.01) / 0.001
    assert np.median(drift) == pytest.approx(0.765, rel=0.1)
    assert np.quantile(drift, 0.95) == pytest.approx(3.18, rel=0.2)
