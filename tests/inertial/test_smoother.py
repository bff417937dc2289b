"""The smoother, a modified Bryson-Frazier one, against Rauch-Tung-Striebel in matrices, and against the truth."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pdrbench.inertial import ADAPTIVE, LITERAL, ROBUST, FieldParams, FootParams, navigate, navigate_smoothed
from pdrbench.inertial.foot_motion import walk
from pdrbench.inertial.foot_smoother import smooth
from pdrbench_lab.foot_ins.bench import plain_filter, plain_smooth


def smoothed(done: Any) -> tuple[np.ndarray, np.ndarray]:
    """The kernel's output for a run."""
    count = len(done.start.cov)
    x, cov = done.states.x.copy(), done.states.cov.copy()
    smooth(done.record, np.zeros(count), np.zeros((count, count)), done.start.size, x, cov)
    return x, cov


CASES = {
    "9 states": (LITERAL, 0.003, False),
    "15 states": (ADAPTIVE, 0.003, False),
    "robust": (ROBUST, 0.003, False),
    "reweighted": (replace(ROBUST, accel_bias_mps2=0.3, ties_level=True, slip_mps=0.3), 0.003, False),
    "clipped": (replace(ADAPTIVE, clipped_rate_radps=2.0, clipped_fraction=0.8), 0.003, False),
    "magnetometer": (replace(ADAPTIVE, field=FieldParams()), 0.003, True),
    "switched on with a bias": (ADAPTIVE, 0.035, False),
}


@pytest.mark.parametrize("name", CASES)
def test_the_kernel_is_rauch_tung_striebel(
    name: str, measure: Any, run_kernel: Any, earth_field: Any, rng: Any
) -> None:
    params, bias, has_field = CASES[name]
    motion = walk(2, turn_rad=0.5, rise_m=0.17)
    measured = measure(motion, rng, accel_bias=(0.03, -0.02, 0.05), gyro_bias=(bias, 0.001, -bias))
    kept = np.r_[0:260, 300 : len(motion)]  # and a gap
    field = earth_field(motion)[kept] if has_field else None
    done = run_kernel(type(measured)(*(v[kept] for v in measured)), params, field)
    x, cov = smoothed(done)
    twin_x, twin_cov = plain_smooth(plain_filter(done.start, *done.arguments))
    assert np.abs(x - done.states.x).max() > 0.01  # it does something
    np.testing.assert_allclose(x, twin_x[:, :16], atol=1e-9)
    assert (
        np.abs(cov - twin_cov) / np.abs(twin_cov).max(axis=0)
    ).max() < 1e-6  # the twin inverts what is nearly singular


@pytest.mark.parametrize("params", [LITERAL, ADAPTIVE], ids=["9", "15"])
def test_smoothing_never_increases_the_covariance(params: FootParams, measure: Any, rng: Any) -> None:
    measured = measure(walk(12, turn_rad=0.2), rng)
    filtered, smooth_states = navigate(*measured, params), navigate_smoothed(*measured, params)
    before, after = (np.trace(s.cov, axis1=1, axis2=2) for s in (filtered, smooth_states))
    known = np.isfinite(before)
    assert np.array_equal(known, np.isfinite(after))
    assert (after[known] <= before[known] + 1e-12).all()
    assert np.mean(after[known]) < 0.97 * np.mean(before[known])  # most is yaw, which is never observed afterwards
    variances = np.diagonal(smooth_states.cov[known], axis1=1, axis2=2)
    assert variances.min() > -1e-12


def test_the_end_stays_as_it_was(measure: Any, rng: Any) -> None:
    """No later sample carries information about the last one."""
    measured = measure(walk(3), rng)
    filtered, smooth_states = navigate(*measured, ADAPTIVE), navigate_smoothed(*measured, ADAPTIVE)
    np.testing.assert_array_equal(smooth_states.x[-1], filtered.x[-1])
    np.testing.assert_array_equal(smooth_states.cov[-1], filtered.cov[-1])
    np.testing.assert_array_equal(smooth_states.nis, filtered.nis)


def test_pieces_of_the_forward_pass_leave_no_seams(measure: Any, run_kernel: Any, rng: Any) -> None:
    """A walk longer than several pieces, against one record of all of it."""
    motion = walk(22, turn_rad=0.2)
    assert len(motion) > 5000
    measured = measure(motion, rng)
    states = navigate_smoothed(*measured, ADAPTIVE)
    x, cov = smoothed(run_kernel(measured, ADAPTIVE))
    np.testing.assert_array_equal(states.x[20:], x)
    np.testing.assert_array_equal(states.cov[20:], cov)


def test_within_strides_it_is_nearer_to_the_truth(measure: Any) -> None:
    """The filter drifts while the foot swings, until the next rest corrects it; the smoother uses that rest already."""
    motion = walk(10, turn_rad=0.2, rise_m=0.17)
    off = {navigate: [], navigate_smoothed: []}
    swings = ~motion.is_rest
    for seed in range(6):
        rng = np.random.default_rng(seed)
        measured = measure(motion, rng, accel_bias=tuple(rng.normal(0, 0.1, 3)))
        for filters, found in off.items():
            states = filters(*measured, LITERAL)
            speed_off = np.linalg.norm(states.velocity_mps - motion.velocity_mps, axis=1)
            found.append(speed_off[swings].mean())
    assert np.mean(off[navigate_smoothed]) < 0.8 * np.mean(off[navigate])
