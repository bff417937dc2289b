"""Position errors in closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tracks import make_answers, make_reference

from pdrbench.metrics import ecdf, errors_m, hold_at, pooled
from pdrbench.metrics.hold import Held
from pdrbench.metrics.position import (
    along_path_errors_m,
    bias_m,
    circular_error_m,
    covariance_m2,
    max_m,
    mean_m,
    num_scored,
    percentile_m,
    rmse_m,
    spherical_error_m,
    success,
    vertical_error_m,
)
from pdrbench.trajectory import Start, Trajectory


def held_on(reference: Trajectory, xy_m: object, level: object = 0.0) -> Held:
    """Answers at exactly the times of the reference."""
    estimates = make_answers(reference.t_s, xy_m, level)
    return hold_at(estimates, reference.t_s, Start(xy_m=np.zeros(2), level=0))


def with_errors(errors: list[float]) -> tuple[Held, Trajectory]:
    reference = make_reference(np.zeros((len(errors), 2)))
    return held_on(reference, np.column_stack([errors, np.zeros(len(errors))])), reference


def test_known_errors() -> None:
    held, reference = with_errors([1.0, 2.0, 3.0, 4.0])
    assert mean_m(held, reference) == 2.5
    assert rmse_m(held, reference) == pytest.approx(math.sqrt(7.5))
    assert max_m(held, reference) == 4.0
    assert num_scored(held, reference) == 4.0
    # Hazen: the k-th of four sorted values is the quantile (k - 1/2) / 4
    assert [percentile_m(held, reference, quantile=q) for q in (0.125, 0.5, 0.75, 0.875, 1.0)] == [
        1.0,
        2.5,
        3.5,
        4.0,
        4.0,
    ]


def test_the_limit_counts_as_success_and_only_surveyed_rows_are_scored() -> None:
    held, reference = with_errors([1.0, 2.0, 3.0, 4.0])
    assert [success(held, reference, within_m=limit) for limit in (0.999, 1.0, 3.0, 10.0)] == [0.0, 0.25, 0.75, 1.0]
    reference = make_reference(np.zeros((3, 2)), surveyed=[True, False, True])
    held = held_on(reference, [[1.0, 0.0], [50.0, 0.0], [3.0, 0.0]])
    assert errors_m(held, reference).tolist() == [1.0, 3.0]


def test_opposite_errors_cancel_in_the_bias_alone() -> None:
    reference = make_reference(np.zeros((2, 2)))
    held = held_on(reference, [[2.0, 0.0], [-2.0, 0.0]])
    assert bias_m(held, reference) == 0.0
    assert mean_m(held, reference) == 2.0
    assert covariance_m2(held, reference).tolist() == [[4.0, 0.0], [0.0, 0.0]]


def test_ecdf_is_a_right_continuous_step_function() -> None:
    errors = np.array([2.0, 1.0, 2.0, 5.0])
    at_m = np.array([0.0, np.nextafter(1.0, 0.0), 1.0, 2.0, 4.999, 5.0, 99.0])
    assert ecdf(errors, at_m).tolist() == [0.0, 0.0, 0.25, 0.75, 0.75, 1.0, 1.0]


def test_pooled_scores_weigh_samples_not_walks() -> None:
    walks = [np.array([1.0]), np.array([4.0, 4.0, 4.0])]
    assert pooled(walks)["pooled_mean_m"] == 3.25
    assert pooled(walks)["pooled_p50_m"] == 4.0
    assert pooled(walks)["pooled_rmse_m"] == pytest.approx(math.sqrt(49 / 4))
    assert pooled(walks)["pooled_n"] == 4.0
    assert pooled(walks[::-1]) == pooled(walks)
    assert math.isnan(pooled([])["pooled_p95_m"])


# Along the path ------------------------------------------------------------------------------------------------


def test_along_the_path_the_nearer_pass_counts_and_standing_still_has_no_path() -> None:
    reference = make_reference([[0.0, 0.0], [10.0, 0.0], [20.0, 0.0]])
    held = held_on(reference, reference.xy_m + np.array([2.0, 7.0]))
    assert along_path_errors_m(held, reference) == pytest.approx([2.0, 2.0, 0.0])
    there_and_back = make_reference([[0.0, 0.0], [20.0, 0.0], [0.0, 0.0]], surveyed=[False, False, True])
    assert along_path_errors_m(held_on(there_and_back, [3.0, 1.0]), there_and_back) == pytest.approx([3.0])
    reference = make_reference(np.ones((3, 2)))
    assert along_path_errors_m(held_on(reference, [9.0, 9.0]), reference).tolist() == [0.0, 0.0, 0.0]


def test_paths_turn_corners_and_pauses_on_the_way_change_nothing() -> None:
    # from (0, 5) back round the corner to (5, 0): 10 m along the path, 7.07 m as the crow flies
    reference = make_reference([[5.0, 0.0], [0.0, 0.0], [0.0, 5.0]], surveyed=[False, False, True])
    held = held_on(reference, [5.0, 0.0])
    assert along_path_errors_m(held, reference) == pytest.approx([10.0])
    assert errors_m(held, reference) == pytest.approx([math.hypot(5, 5)])
    path = np.repeat([[0.0, 0.0], [10.0, 0.0], [20.0, 0.0]], 3, axis=0)
    reference = make_reference(path, level=np.repeat([0, 0, 1], 3))
    held = held_on(reference, path + np.array([4.0, 1.0]))
    assert along_path_errors_m(held, reference) == pytest.approx([4.0] * 3 + [4.0] * 3 + [0.0] * 3)
    only_a_pause = held_on(reference, [4.0, 1.0], level=1.0)  # the way to level 1 and the pause there
    assert along_path_errors_m(only_a_pause, reference) == pytest.approx([10.0] * 3 + [0.0] * 3 + [10.0] * 3)


def test_on_a_loop_the_shorter_arc_counts() -> None:
    square = [[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0], [0.0, 0.0]]
    reference = make_reference(square, surveyed=[False, True, False, False, False])
    held = held_on(reference, [0.0, 5.0])  # 25 m ahead of (10, 0), 15 m behind it
    assert along_path_errors_m(held, reference) == pytest.approx([15.0])
    open_end = make_reference(square[:-1], surveyed=[False, True, False, False])
    held = held_on(open_end, [0.0, 10.0])
    assert along_path_errors_m(held, open_end) == pytest.approx([20.0])


@pytest.mark.parametrize("seed", range(3))
def test_along_path_equals_brute_force(seed: int) -> None:
    rng = np.random.default_rng(seed)
    reference = make_reference(np.cumsum(rng.normal(size=(40, 2)), axis=0), level=np.arange(40) // 14)
    held = held_on(reference, reference.xy_m + rng.normal(size=(40, 2)), level=rng.integers(0, 4, 40).astype(float))
    start_m, step_m = reference.xy_m[:-1], np.diff(reference.xy_m, axis=0)
    length_m = np.hypot(*step_m.T)
    expected = []
    for k in range(40):
        nearest = (math.inf, math.inf, math.nan)  # levels away, metres away, arc length
        for i in range(39):
            fraction = np.clip((held.xy_m[k] - start_m[i]) @ step_m[i] / length_m[i] ** 2, 0, 1)
            away_m = math.hypot(*(held.xy_m[k] - start_m[i] - fraction * step_m[i]))
            levels = np.abs(reference.level[i : i + 2] - held.level[k]).min()
            nearest = min(nearest, (levels, away_m, length_m[:i].sum() + fraction * length_m[i]))
        expected.append(abs(nearest[2] - length_m[:k].sum()))
    assert along_path_errors_m(held, reference) == pytest.approx(expected, abs=0.003)


# Height --------------------------------------------------------------------------------------------------------


def test_heights_are_scored_and_outside_every_polygon_are_those_of_the_level(two_levels: object) -> None:
    reference = make_reference([[1.0, 1.0]] * 4, z_m=np.zeros(4))
    held = held_on(reference, [[1.0, 5.0]] * 4, level=[0.0, 0.0, 0.0, 1.0])
    assert vertical_error_m(held, reference, two_levels, quantile=1.0) == pytest.approx(3.5)
    assert vertical_error_m(held, reference, two_levels, quantile=0.5) == 0.0
    assert circular_error_m(held, reference, quantile=0.5) == 4.0
    assert spherical_error_m(held, reference, two_levels, quantile=1.0) == pytest.approx(math.hypot(4.0, 3.5))
    reference = make_reference([[1.0, 1.0]], z_m=[0.0])
    assert vertical_error_m(held_on(reference, [99.0, 99.0], level=1.0), reference, two_levels) == pytest.approx(3.5)
    beyond = held_on(reference, [1.0, 1.0], level=3.0)
    assert vertical_error_m(beyond, reference, two_levels, level_height_m=4.0) == pytest.approx(3.5 + 2 * 4.0)


def test_without_heights_there_is_no_vertical_error(two_levels: object) -> None:
    reference = make_reference([[1.0, 1.0]])
    held = held_on(reference, [1.0, 1.0])
    assert math.isnan(circular_error_m(held, reference))
    for metric in (vertical_error_m, spherical_error_m):
        assert math.isnan(metric(held, reference, two_levels))
    with_z = make_reference([[1.0, 1.0]], z_m=[0.0])
    assert math.isnan(vertical_error_m(held, with_z, None))
