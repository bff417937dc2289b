from __future__ import annotations

import math

import numpy as np
import pytest

from pdrbench.errors import RecordingError
from pdrbench.recording import SensorStream
from pdrbench.sensors.stride import STRIDE, StrideErrors, measure


def straight(count: int, length_m: float = 1.3) -> np.ndarray:
    """Strides without error along a straight line."""
    rows = np.zeros((count, 4))
    rows[:, 0] = np.arange(1, count + 1)
    rows[:, 1] = length_m
    return rows


def test_errors_of_one_walk_are_those_measured():
    count = 20_000
    rows = measure(straight(count), np.random.default_rng(0))
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
    turn_rad = np.array([measure(straight(strides), rng)[:, 3] for _ in range(walks)])
    drift_deg = np.degrees(turn_rad.mean(axis=1))
    # White turns of 0.65 degrees leave 0.65/sqrt(400) = 0.033 in a mean: the spread over walks is hypot(0.29, 0.033).
    assert np.median(drift_deg) == pytest.approx(0.10, abs=4 * 1.25 * 0.29 / math.sqrt(walks))
    assert drift_deg.std() == pytest.approx(math.hypot(0.29, 0.033), rel=4 / math.sqrt(2 * walks))
    halves = np.degrees(turn_rad[:, : strides // 2].mean(axis=1) - turn_rad[:, strides // 2 :].mean(axis=1))
    assert halves.std() == pytest.approx(0.65 * math.sqrt(2 / 200), rel=4 / math.sqrt(2 * walks))


def test_without_errors_strides_are_told_as_they_are():
    none = StrideErrors(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    rows = straight(5)
    rows[:, 2:] = [[0.3, 1.0], [-0.3, -2.0], [0.0, 3.0], [0.0, -3.0], [0.1, 0.0]]
    np.testing.assert_allclose(measure(rows, np.random.default_rng(0), none), rows, atol=1e-15)


def test_lengths_stay_lengths_and_turns_stay_wrapped():
    rows = straight(2000, length_m=0.0)
    rows[:, 3] = math.pi - 1e-3
    told = measure(rows, np.random.default_rng(2))
    SensorStream(STRIDE, told)  # within the bounds of the spec
    assert (told[:, 1] == 0).any()
    assert (told[:, 3] < 0).any()


def test_a_stride_in_degrees_is_refused():
    with pytest.raises(RecordingError, match="turn_rad is 90"):
        SensorStream(STRIDE, np.array([[1.0, 1.3, 0.0, 90.0]]))
