"""The magnetometer corrects the yaw, and a disturbed field does no harm."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pdrbench.inertial import LITERAL, FieldParams, navigate
from pdrbench.inertial.magnetometer import FieldGate
from pdrbench_sim.foot.known_walk import walk

EARTH_UT = np.array([20.0, 0.0, -45.0])
WITH_FIELD = replace(LITERAL, field=FieldParams())


def standing(count: int = 400) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """t_s, accel, field and sigma of a foot that stands still in the field of the Earth, at 200 Hz."""
    accel, sigma = np.tile([0.0, 0.0, 9.81], (count, 1)), np.full(count, 0.01)
    return np.arange(count) / 200, accel, np.tile(EARTH_UT, (count, 1)), sigma


def used_s(t_s: np.ndarray, used: np.ndarray) -> np.ndarray:
    return t_s[np.isfinite(used[:, 0])]


def test_at_most_one_sample_in_a_time_while_the_foot_rests() -> None:
    t_s, accel, field, sigma = standing()
    sigma[90:150] = np.inf
    used = FieldGate(FieldParams(every_s=0.5)).choose(t_s, accel, field, sigma)
    np.testing.assert_allclose(used_s(t_s, used), [0.0, 0.75, 1.25, 1.75])
    chosen = np.isfinite(used[:, 0])
    np.testing.assert_array_equal(used[chosen], field[chosen])


@pytest.mark.parametrize(
    ("disturbed", "is_used"),
    [
        (1.05 * EARTH_UT, True),
        (1.15 * EARTH_UT, False),  # too strong
        (0.85 * EARTH_UT, False),
        (np.array([23.0, 0.0, -43.5]), True),  # 3.9 degrees of dip away
        (np.array([25.0, 0.0, -42.4]), False),  # 6.5
        (np.array([0.0, 20.0, -45.0]), True),  # of another direction: for the filter to judge
        (np.full(3, np.nan), False),
        (np.zeros(3), False),
    ],
)
def test_strength_and_dip_are_those_of_the_first_rest(disturbed: np.ndarray, is_used: bool) -> None:
    t_s, accel, field, sigma = standing(150)
    field[1:] = disturbed
    used = FieldGate(FieldParams(every_s=0.5)).choose(t_s, accel, field, sigma)
    assert (0.5 in used_s(t_s, used).tolist()) == is_used


def test_pieces_choose_the_same() -> None:
    t_s, accel, field, sigma = standing()
    whole = FieldGate(FieldParams()).choose(t_s, accel, field, sigma)
    gate = FieldGate(FieldParams())
    parts = [gate.choose(t_s[p], accel[p], field[p], sigma[p]) for p in (slice(0, 37), slice(37, 38), slice(38, None))]
    np.testing.assert_array_equal(np.concatenate(parts), whole)


def test_it_keeps_the_yaw_that_a_gyroscope_loses(measure: Any, earth_field: Any, rng: Any) -> None:
    motion = walk(60, turn_rad=0.1)
    measured = measure(motion, rng, gyro_bias=(0.0, 0.0, math.radians(0.2)))
    field = earth_field(motion) + rng.normal(0, 0.5, (len(motion), 3))
    truth = 0.1 * 60
    doubting = replace(
        LITERAL, gyro_density=0.01
    )  # with the default a gyroscope is trusted too far for a field to matter
    without = navigate(*measured, doubting)
    with_field = navigate(*measured, replace(doubting, field=FieldParams()), field=field)

    def off(yaw: float) -> float:
        return abs(math.remainder(yaw - truth, math.tau))

    assert off(without.yaw_rad[-1]) > math.radians(12)  # 0.2 degrees/s for 71 s
    assert off(with_field.yaw_rad[-1]) < math.radians(6)
    assert with_field.cov[-1, 3, 3] < 0.8 * without.cov[-1, 3, 3]


def test_a_field_is_used_only_where_settings_say_so(measure: Any, earth_field: Any, rng: Any) -> None:
    motion = walk(3)
    measured = measure(motion, rng)
    plain, corrected = navigate(*measured, LITERAL), navigate(*measured, LITERAL, field=earth_field(motion))
    np.testing.assert_array_equal(plain.x, corrected.x)
    unseen = navigate(*measured, WITH_FIELD, field=np.full((len(motion), 3), np.nan))
    np.testing.assert_array_equal(plain.x, unseen.x)


def test_iron_in_the_floor_does_no_harm(measure: Any, earth_field: Any, rng: Any) -> None:
    """From the middle on the field points elsewhere, as strong and as steep: the gate has to reject it."""
    motion = walk(20)
    measured, field = measure(motion, rng), earth_field(motion)
    turned = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    later = motion.t_s > 12
    field[later] = np.einsum("nji,j->ni", motion.attitude[later], turned @ EARTH_UT)
    states = navigate(*measured, WITH_FIELD, field=field)
    assert abs(states.yaw_rad[-1]) < math.radians(2)
    np.testing.assert_allclose(states.position_m[-1, :2], motion.position_m[-1, :2], atol=0.5)
