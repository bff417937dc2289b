"""Phones that are handled by people who stand."""

from __future__ import annotations

import numpy as np
import pytest

from pdrbench.inertial.steps import PeakStepDetector
from pdrbench_lab.papers.li2012.handling_motion import HandlingParams, handling_motion
from pdrbench_sim.units.motion import GRAVITY_MPS2, MotionError, RigidMotion


def lengths(motion: RigidMotion) -> np.ndarray:
    """(n,) of the specific force."""
    return np.linalg.norm(motion.ideal_signals()[0], axis=1)


def test_handling_is_mistaken_for_steps():
    motion = handling_motion(np.random.default_rng(1), 600.0, [1.0, 2.0, 1.2])
    assert len(motion) == 120_001
    accel, gyro = motion.ideal_signals()
    false = PeakStepDetector(motion.rate_hz).update(np.column_stack([motion.t_s, accel]))
    assert 2 < len(false) / 10 < 40  # a minute
    assert np.linalg.norm(motion.xyz_m - [1.0, 2.0, 1.2], axis=1).max() < 1.5
    assert np.linalg.norm(accel, axis=1).mean() == pytest.approx(GRAVITY_MPS2, abs=0.3)
    assert np.degrees(np.abs(gyro)).max() > 90
    assert np.abs(np.diff(accel, axis=0)).max() < 14.0


def test_a_still_hand_hardly_moves():
    quiet = HandlingParams(every_s=1e9)
    motion = handling_motion(np.random.default_rng(1), 30.0, [0.0, 0.0, 1.0], params=quiet)
    assert lengths(motion).std() < 0.15


@pytest.mark.parametrize("kind", range(5))
def test_every_act_ends_at_rest(kind):
    fractions = tuple(1.0 if i == kind else 0.0 for i in range(5))
    params = HandlingParams(every_s=20.0, fractions=fractions)
    motion = handling_motion(np.random.default_rng(2), 400.0, [0.0, 0.0, 1.0], params=params)
    gyro = motion.ideal_signals()[1]
    quiet = (np.abs(lengths(motion) - GRAVITY_MPS2) < 0.5) & (np.abs(gyro).max(axis=1) < 0.3)
    assert 0.4 < quiet.mean() < 0.9999


@pytest.mark.parametrize(("duration_s", "xyz_m"), [(0.0, [0, 0, 1]), (float("nan"), [0, 0, 1]), (10.0, [0, 1])])
def test_impossible_handling_is_refused(duration_s, xyz_m):
    with pytest.raises(MotionError, match="for a second or more"):
        handling_motion(np.random.default_rng(1), duration_s, xyz_m)


def test_fractions_add_up():
    with pytest.raises(MotionError, match="add up to 1"):
        HandlingParams(fractions=(0.5, 0.5, 0.5, 0.0, 0.0))
