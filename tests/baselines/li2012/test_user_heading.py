from __future__ import annotations

import numpy as np
import pytest

from pdrbench.geometry import wrap_rad
from pdrbench.inertial.quaternions import inverse, multiply
from pdrbench_baselines.li2012.user_heading import UserHeading, facing, to_user

HEADINGS = np.linspace(-3.0, 3.0, 13)


def turned(axis: list[float], angle_rad: float) -> np.ndarray:
    unit = np.array(axis) / np.linalg.norm(axis)
    return np.array([np.cos(angle_rad / 2), *(np.sin(angle_rad / 2) * unit)])


def test_transform_is_equation_one_and_a_phone_in_the_hand_points_ahead() -> None:
    carried = multiply(turned([0, 0, 1], 0.4), turned([1, 0.3, 0], 1.5))
    transform = to_user(carried, 0.9)
    assert multiply(facing(0.9), inverse(transform)) == pytest.approx(carried)  # V_h Q^-1 = V_p
    heading = UserHeading(None)
    assert heading.heading_rad(facing(0.7)) == pytest.approx(0.7)
    assert heading.heading_rad(facing(-2.0)) == pytest.approx(-2.0)


@pytest.mark.parametrize("start_rad", [-2.0, 0.3, 3.1])
def test_any_way_in_the_pocket_gives_the_heading_of_the_walker(start_rad: float, rng: np.random.Generator) -> None:
    """The walker turns about the vertical; the phone turns with them, whatever its attitude in the pocket."""
    in_pocket = rng.standard_normal(4)
    in_pocket /= np.linalg.norm(in_pocket)
    heading = UserHeading(start_rad)
    for turn_rad in (0.0, *HEADINGS):
        found_rad = heading.heading_rad(multiply(turned([0, 0, 1], turn_rad), in_pocket))
        assert float(wrap_rad(found_rad - start_rad - turn_rad)) == pytest.approx(0.0, abs=1e-9)


def test_two_transforms_remove_alternating_errors() -> None:
    """On alternate steps the thigh leans the other way: one transform errs on them, two do not."""
    pocket = turned([1, 0.2, 0.4], 1.3)
    legs = [multiply(turned([1, 0, 0], 0.35), pocket), multiply(turned([1, 0.3, 0], -0.35), pocket)]
    attitudes = [multiply(turned([0, 0, 1], 0.1 * (k // 2)), legs[k % 2]) for k in range(8)]
    one, two = UserHeading(1.0), UserHeading(1.0, alternate_q=True)
    truth = [1.0 + 0.1 * (k // 2) for k in range(8)]
    assert [two.heading_rad(a) for a in attitudes] == pytest.approx(truth)
    off = np.abs(np.array([one.heading_rad(a) for a in attitudes]) - truth)
    assert off[::2] == pytest.approx(0.0, abs=1e-9)
    assert off[1::2].min() > 0.05
