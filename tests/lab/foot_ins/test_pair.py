"""Both feet: two filters and the limit on their distance, on feet whose motion is known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pdrbench.errors import UnsuitableError
from pdrbench.localizer import Briefing, Estimate, Observation
from pdrbench.sensors import sensor_spec
from pdrbench.trajectory import Start
from pdrbench_lab.foot_ins.pair import FootPair, FootPairParams
from pdrbench_sim.foot.known_walk import walk

NAMES = ("accel", "gyro", "accel_2", "gyro_2")
SPECS = {name: sensor_spec(name) for name in NAMES}


def briefed(sensors: tuple[str, ...] = NAMES) -> Briefing:
    start = Start(xy_m=np.array([2.0, 1.0]), level=0, heading_rad=math.pi / 2)
    return Briefing(None, {name: SPECS[name] for name in sensors}, 0.05, start=start, mounting="foot")


def played(yaw_bias_radps: float, params: FootPairParams, num_strides: int = 20) -> tuple[Estimate, FootPair]:
    """Two feet that walk straight ahead, half a stride apart; in its swings the gyroscope of the first has a bias."""
    first, second = walk(num_strides, still_s=1.0), walk(num_strides, still_s=1.6)
    localizer = FootPair(params)
    localizer.reset(briefed(), np.random.default_rng(0))
    rows = {}
    for motion, suffix, bias in ((first, "", yaw_bias_radps), (second, "_2", 0.0)):
        rows[f"accel{suffix}"] = np.column_stack([motion.t_s, motion.accel])
        swinging = np.outer(~motion.is_rest, [0.0, 0.0, bias])  # a rest would reveal a bias
        rows[f"gyro{suffix}"] = np.column_stack([motion.t_s, motion.gyro + swinging])
    for now_s in np.arange(0.0, first.t_s[-1] + 1.0, 0.25):
        now = {name: r[(r[:, 0] <= now_s) & (r[:, 0] > now_s - 0.25)] for name, r in rows.items()}
        estimate = localizer.step(Observation(now_s, now))
    return estimate, localizer


def test_two_perfect_feet_lead_along_the_given_heading() -> None:
    estimate, _ = played(0.0, FootPairParams())
    np.testing.assert_allclose(estimate.xy_m, [2.0, 1.0 + 20 * 1.3], atol=0.1)
    assert estimate.sigma_m is not None and estimate.sigma_m > 0


def test_the_limit_lets_the_good_foot_hold_the_bad_one() -> None:
    bias_radps = math.radians(3.0)
    alone, _ = played(bias_radps, FootPairParams(max_step_m=1e3))
    held, localizer = played(bias_radps, FootPairParams(max_step_m=0.9))
    assert abs(held.xy_m[0] - 2.0) < 0.9 * abs(alone.xy_m[0] - 2.0)
    state = localizer._state
    assert math.hypot(*(state[:2] - state[3:5])) < 1.5


def test_one_foot_is_refused() -> None:
    with pytest.raises(UnsuitableError, match="accel_2"):
        FootPair().reset(briefed(("accel", "gyro")), np.random.default_rng(0))
