from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from pdrbench.inertial import LITERAL, find_strides, navigate
from pdrbench.inertial.strides import Strides
from pdrbench_baselines.frank2009.step_sensor import FootSteps, StepSensor, StepSensorParams
from pdrbench_sim.foot.known_walk import walk

LENGTH_M = 1.3


def straight(yaw_rad: float, count: int = 6, heading_rad: float = 0.4) -> Strides:
    """Strides of 1 m in one direction by a foot whose yaw is another."""
    one = np.ones(count)
    ahead = np.array([math.cos(heading_rad), math.sin(heading_rad), 0.0])
    start = np.arange(count)[:, None] * ahead
    t_s = np.arange(count, dtype=float)
    return Strides(
        t_s,
        t_s + 0.7,
        t_s + 0.8,
        one,
        0 * one,
        0 * one,
        heading_rad * one,
        yaw_rad * one,
        0 * one,
        start + ahead,
        start,
    )


@pytest.mark.parametrize("alpha", [-2.5, -0.3, 0.0, 1.2, 3.1])
def test_a_sensor_turned_by_minus_alpha_has_the_misalignment_alpha(alpha: float) -> None:
    """F8: psi_pedestrian - psi_sensor; the step is then (stride, 0)."""
    sensor = StepSensor()
    steps = sensor.update(straight(0.4 - alpha))
    assert sensor.misalignment_rad == pytest.approx(alpha)
    np.testing.assert_allclose(steps.step, np.tile([1.0, 0.0, 0.0], (6, 1)), atol=1e-9)
    assert sensor.heading_rad == pytest.approx(0.4)


def test_it_is_the_mean_over_the_first_strides_and_then_stays() -> None:
    sensor = StepSensor(StepSensorParams(strides=2))
    first, second, third = (straight(yaw, count=1) for yaw in (0.3, 0.1, -2.0))
    assert sensor.update(first).misalignment_change_rad[0] == pytest.approx(0.1)
    assert sensor.update(second).misalignment_change_rad[0] == pytest.approx(0.1)  # mean of 0.1 and 0.3, less 0.1
    assert sensor.update(third).misalignment_change_rad[0] == 0.0
    assert sensor.misalignment_rad == pytest.approx(0.2)


def test_a_short_stride_is_not_used_for_the_misalignment() -> None:
    sensor = StepSensor()
    short = straight(0.0, count=1)._replace(length_m=np.array([0.3]))
    sensor.update(short)
    assert sensor.misalignment_rad == 0.0


def test_renaming_the_heading_turns_no_step() -> None:
    """With `misalignment_change_rad` added before each step, the way is the same whatever the misalignment is."""
    strides = straight(0.9, count=8)
    for params in (StepSensorParams(strides=1), StepSensorParams(strides=5)):
        steps = StepSensor(params).update(strides)
        heading, xy_m = 0.9, np.zeros(2)  # the yaw of the foot, misalignment 0
        for misalignment_change_rad, (ahead_m, left_m, turn_rad) in zip(
            steps.misalignment_change_rad, steps.step, strict=True
        ):
            heading += misalignment_change_rad
            c, s = math.cos(heading), math.sin(heading)
            xy_m += (c * ahead_m - s * left_m, s * ahead_m + c * left_m)
            heading += turn_rad
        np.testing.assert_allclose(xy_m, 8 * np.array([math.cos(0.4), math.sin(0.4)]), atol=1e-9)


def test_from_signals_as_from_strides(rng: np.random.Generator) -> None:
    """In pieces, and with the two sensors sampled at different times, the same steps to a centimetre."""
    motion = walk(12, length_m=LENGTH_M, turn_rad=0.1)
    accel, gyro = (np.column_stack([motion.t_s, values]) for values in (motion.accel, motion.gyro))
    whole = StepSensor().update(find_strides(navigate(motion.t_s, motion.accel, motion.gyro, LITERAL)))
    pieces = FootSteps(200.0, LITERAL)
    found = [
        pieces.update({"accel": a, "gyro": g}).step
        for a, g in zip(np.array_split(accel, 90), np.array_split(gyro, 90), strict=True)
    ]
    np.testing.assert_array_equal(np.concatenate(found), whole.step)
    apart = FootSteps(200.0, LITERAL)
    later_s = gyro[:-1, 0] + 0.002
    between = np.column_stack([later_s, *(np.interp(later_s, gyro[:, 0], gyro[:, k]) for k in (1, 2, 3))])
    np.testing.assert_allclose(apart.update({"accel": accel, "gyro": between}).step[:10], whole.step[:10], atol=0.02)


def test_a_field_of_which_the_direction_is_known(rng: np.random.Generator) -> None:
    """The foot stands with x to magnetic north, so that the field points along x of the lower filter's world."""
    from pdrbench.inertial.magnetometer import FieldParams

    count = 400
    t_s = np.arange(count) / 200.0
    accel = np.column_stack([t_s, np.tile([0.0, 0.0, 9.80665], (count, 1)) + rng.normal(0, 0.01, (count, 3))])
    gyro = np.column_stack([t_s, rng.normal(0, 1e-3, (count, 3))])
    mag = np.column_stack([t_s + 1e-4, np.tile([18.0, 18.0, -30.0], (count, 1))])
    steps = FootSteps(200.0, replace(LITERAL, field=FieldParams()))
    assert steps.field_rad is None
    steps.update({"accel": accel, "gyro": gyro, "mag": mag})
    assert steps.field_rad == pytest.approx(math.pi / 4, abs=0.05)
