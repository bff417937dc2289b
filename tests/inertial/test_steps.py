from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pdrbench.inertial import PeakStepDetector


def walking(rate_hz: float, step_hz: float, duration_s: float) -> np.ndarray:
    """(T, 4) gravity plus a vertical bounce of 3 m/s^2 at the step frequency."""
    t_s = np.arange(0, duration_s, 1 / rate_hz)
    accel = np.zeros((len(t_s), 4))
    accel[:, 0], accel[:, 3] = t_s, 9.81 + 3 * np.sin(2 * np.pi * step_hz * t_s)
    return accel


@pytest.mark.parametrize("rate_hz", [25.0, 50.0, 100.0, 400.0])
@pytest.mark.parametrize("step_hz", [1.4, 1.9, 2.4])
def test_counts_the_steps_of_a_regular_walk(rate_hz: float, step_hz: float) -> None:
    steps = PeakStepDetector(rate_hz).update(walking(rate_hz, step_hz, 30.0))
    assert abs(len(steps) - 30 * step_hz) <= 1  # a step may be cut off at either end
    assert np.diff(steps[2:]).mean() == pytest.approx(1 / step_hz, rel=0.01)


def test_standing_still_is_no_step(rng: np.random.Generator) -> None:
    accel = walking(50.0, 0.0, 60.0)
    accel[:, 1:] += rng.normal(0, 0.02, (len(accel), 3))  # noise of a phone at rest
    assert len(PeakStepDetector(50.0).update(accel)) == 0


def test_steps_do_not_depend_on_how_the_rows_are_cut(rng: np.random.Generator) -> None:
    accel = walking(50.0, 1.9, 20.0)
    whole = PeakStepDetector(50.0).update(accel)
    detector = PeakStepDetector(50.0)
    cuts = np.sort(rng.integers(0, len(accel), 60))
    assert np.array_equal(np.concatenate([detector.update(part) for part in np.split(accel, cuts)]), whole)


def test_turning_the_phone_over_changes_nothing() -> None:
    accel = walking(50.0, 1.9, 20.0)
    turned = accel.copy()
    turned[:, 1:] = Rotation.from_euler("xyz", [0.3, 2.0, -1.0]).apply(accel[:, 1:])
    assert PeakStepDetector(50.0).update(turned) == pytest.approx(PeakStepDetector(50.0).update(accel))
