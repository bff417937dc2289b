"""The smoother, a modified Bryson-Frazier one, against the truth; tests of the laboratory have it against matrices."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pdrbench.inertial import LITERAL, FootParams, navigate, navigate_smoothed
from pdrbench.inertial.foot_smoother import smooth
from pdrbench_sim.foot.known_walk import walk


def smoothed(done: Any) -> tuple[np.ndarray, np.ndarray]:
    """The kernel's output for a run."""
    count = len(done.start.cov)
    x, cov = done.states.x.copy(), done.states.cov.copy()
    smooth(done.record, np.zeros(count), np.zeros((count, count)), done.start.size, x, cov)
    return x, cov


@pytest.mark.parametrize("params", [LITERAL, FootParams()], ids=["9", "15"])
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
    filtered, smooth_states = navigate(*measured), navigate_smoothed(*measured)
    np.testing.assert_array_equal(smooth_states.x[-1], filtered.x[-1])
    np.testing.assert_array_equal(smooth_states.cov[-1], filtered.cov[-1])
    np.testing.assert_array_equal(smooth_states.nis, filtered.nis)


def test_pieces_of_the_forward_pass_leave_no_seams(measure: Any, run_kernel: Any, rng: Any) -> None:
    """A walk longer than several pieces, against one record of all of it."""
    motion = walk(22, turn_rad=0.2)
    assert len(motion) > 5000
    measured = measure(motion, rng)
    states = navigate_smoothed(*measured)
    x, cov = smoothed(run_kernel(measured, FootParams()))
    np.testing.assert_allclose(states.x[20:], x, rtol=1e-8, atol=1e-12)
    np.testing.assert_allclose(states.cov[20:], cov, rtol=1e-8, atol=1e-12)


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
