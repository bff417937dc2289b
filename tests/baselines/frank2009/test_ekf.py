from __future__ import annotations

import math

import numpy as np
import pytest

from pdrbench_baselines.frank2009.ekf import Belief, moved, moved_jacobian, predict, turned, update

SIGMA = np.array([0.1, 0.1, math.radians(2.0)])


def belief(heading_rad: float = 0.0, sigma_m: float = 1.0) -> Belief:
    return Belief(np.array([1.0, 2.0, heading_rad]), np.diag([sigma_m**2, sigma_m**2, 0.04]))


def test_a_step_goes_where_the_heading_before_it_points_and_headings_stay_within_a_turn() -> None:
    """F9: C(heading of k-1); the turn comes afterwards."""
    np.testing.assert_allclose(
        moved(np.array([1.0, 2.0, math.pi / 2]), np.array([1.5, 0.5, 0.3])), [0.5, 3.5, math.pi / 2 + 0.3]
    )
    assert moved(np.array([0.0, 0.0, 3.0]), np.array([0.0, 0.0, 1.0]))[2] == pytest.approx(4.0 - 2 * math.pi)
    assert turned(belief(3.0), 1.0).mean[2] == pytest.approx(4.0 - 2 * math.pi)


def test_jacobian_equals_central_differences(rng: np.random.Generator) -> None:
    """F11."""
    for _ in range(50):
        mean, step = rng.normal(0, [9.0, 9.0, 1.0]), rng.normal(0, [1.0, 1.0, 0.3])
        columns = [(moved(mean + h, step) - moved(mean - h, step)) / 2e-6 for h in 1e-6 * np.eye(3)]
        np.testing.assert_allclose(moved_jacobian(mean, step), np.column_stack(columns), atol=1e-7)


def test_an_uncertain_heading_spreads_the_place_to_the_side() -> None:
    """After a step of 2 m along x: variance along x is unchanged, to the side 4 times that of the heading more."""
    after = predict(belief(), np.array([2.0, 0.0, 0.0]), SIGMA)
    np.testing.assert_allclose(np.diag(after.cov)[:2], [1.01, 1.01 + 4 * 0.04])
    assert after.cov[1, 2] == pytest.approx(2 * 0.04)


def test_noise_is_added_along_the_axes_of_the_building() -> None:
    """F9: turned by any heading, the same Q."""
    sigma = np.array([0.5, 0.1, 0.0])
    for heading_rad in (0.0, 0.7, 2.0):
        grown = predict(belief(heading_rad), np.zeros(3), sigma).cov - belief().cov
        np.testing.assert_allclose(np.diag(grown), np.square(sigma), atol=1e-12)


def test_without_motion_it_is_the_scalar_kalman_filter(rng: np.random.Generator) -> None:
    """Each axis: variance 1 / (1 / P + n / R), mean weighted by that."""
    start, places = belief(sigma_m=3.0), rng.normal(0, 3, (12, 2))
    now = start
    for place in places:
        now, _ = update(now, place, 3.0)
    variance = 1 / (1 / 9 + 12 / 9)
    np.testing.assert_allclose(now.mean[:2], variance * (start.mean[:2] / 9 + places.sum(axis=0) / 9))
    np.testing.assert_allclose(now.cov[:2, :2], variance * np.eye(2), atol=1e-12)
    assert now.sigma_m == pytest.approx(math.sqrt(variance))


def test_innovations_of_a_consistent_filter_are_chi_square(rng: np.random.Generator) -> None:
    """Mean 2 with a standard deviation of 2 / sqrt(4000) = 0.03."""
    found = [update(belief(), np.array([1.0, 2.0]) + rng.normal(0, math.sqrt(10.0), 2), 3.0)[1] for _ in range(4000)]
    assert np.mean(found) == pytest.approx(2.0, abs=0.12)


def test_a_student_law_gives_less_weight_to_a_far_place() -> None:
    near, far = np.array([2.0, 2.0]), np.array([41.0, 2.0])
    normal, student = (update(belief(), far, 3.0, degrees)[0].mean[0] for degrees in (math.inf, 3.0))
    assert abs(student - 1.0) < 0.1 * abs(normal - 1.0)
    one, other = (update(belief(), near, 3.0, degrees)[0].mean for degrees in (math.inf, 3.0))
    np.testing.assert_array_equal(one, other)


def test_turned_frames_give_turned_answers() -> None:
    c, s = math.cos(0.9), math.sin(0.9)
    turn = np.array([[c, -s], [s, c]])
    one, other = belief(0.2), belief(0.2 + 0.9)
    other = Belief(np.array([*(turn @ one.mean[:2]), 1.1]), other.cov)
    for step, place in ((np.array([1.3, 0.1, 0.2]), np.array([3.0, 3.0])), (np.array([1.2, 0.0, -0.4]), np.zeros(2))):
        one, _ = update(predict(one, step, SIGMA), place, 3.0)
        other, _ = update(predict(other, step, SIGMA), turn @ place, 3.0)
    np.testing.assert_allclose(turn @ one.mean[:2], other.mean[:2], atol=1e-12)
