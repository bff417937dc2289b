"""Drift and trajectory errors in closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tracks import make_answers, make_reference

from pdrbench.metrics import hold_at, score
from pdrbench.metrics.hold import Held
from pdrbench.metrics.odometry import (
    align_se2,
    ate_m,
    ate_se2_aligned_m,
    ate_se2_translation_only,
    ate_start_aligned_m,
    ate_start_translation_only,
    distance_error_pct,
    drift_pct,
    loop_closure_pct,
    path_length_m,
    resampling_times_s,
    rte_m,
    rte_whole_walk,
    windows,
)
from pdrbench.trajectory import Estimates, Start, Trajectory

ORIGIN = Start(xy_m=np.zeros(2), level=0)


def answer(reference: Trajectory, xy_m: np.ndarray) -> Estimates:
    return make_answers(reference.t_s, xy_m)


def held_on(reference: Trajectory, xy_m: np.ndarray) -> Held:
    return hold_at(answer(reference, xy_m), reference.t_s, ORIGIN)


def straight(count: int) -> np.ndarray:
    """One metre per row along x."""
    return np.column_stack([np.arange(count, dtype=float), np.zeros(count)])


def turned(xy_m: np.ndarray, yaw_deg: float) -> np.ndarray:
    yaw = math.radians(yaw_deg)
    return xy_m @ np.array([[math.cos(yaw), math.sin(yaw)], [-math.sin(yaw), math.cos(yaw)]])


def wander(seed: int, count: int = 150) -> np.ndarray:
    return np.cumsum(np.random.default_rng(seed).normal(size=(count, 2)), axis=0)


def test_alignment_hides_a_heading_bias_and_the_plain_error_does_not() -> None:
    reference = make_reference(straight(181))
    held = held_on(reference, turned(reference.xy_m, 30.0))
    # |R(30 deg) x - x| = 2 sin(15 deg) |x|, and the RMS of 0..N is N sqrt((2N + 1) / (6N))
    expected = 2 * math.sin(math.radians(15)) * math.sqrt(180 * 361 / 6)
    assert ate_m(held, reference) == pytest.approx(expected)
    assert expected > 50
    assert ate_se2_aligned_m(held, reference) == pytest.approx(0.0, abs=1e-9)
    assert ate_start_aligned_m(held, reference) == pytest.approx(0.0, abs=1e-9)
    assert ate_se2_translation_only(held, reference) == ate_start_translation_only(held, reference) == 0.0
    assert align_se2(held.xy_m, reference.xy_m).yaw_rad == pytest.approx(math.radians(-30))


def test_alignment_is_the_best_of_all_rigid_motions_and_keeps_scale_and_handedness() -> None:
    track, onto = wander(3, 30), wander(4, 30)
    best = np.sqrt(np.mean(np.sum((align_se2(track, onto).xy_m - onto) ** 2, axis=1)))
    for yaw_deg in np.arange(0.0, 360.0, 0.5):
        other = turned(track - track.mean(axis=0), yaw_deg) + onto.mean(axis=0)
        assert best <= np.sqrt(np.mean(np.sum((other - onto) ** 2, axis=1))) + 1e-12
    track = wander(5)
    mirrored = track * [1.0, -1.0]
    assert align_se2(2 * track, track).xy_m == pytest.approx(2 * (track - track.mean(axis=0)) + track.mean(axis=0))
    assert np.abs(align_se2(track, mirrored).xy_m - mirrored).max() > 1.0


@pytest.mark.parametrize("stands", ["estimate", "reference"])
def test_a_standing_track_is_shifted_and_not_turned(stands: str) -> None:
    walking, standing = straight(20), np.full((20, 2), 4.0) + 0.001 * wander(6, 20)
    reference = make_reference(walking if stands == "estimate" else standing)
    held = held_on(reference, standing if stands == "estimate" else walking)
    assert ate_se2_translation_only(held, reference) == 1.0
    assert ate_start_translation_only(held, reference) == 1.0
    assert align_se2(held.xy_m, reference.xy_m).yaw_rad == 0.0
    assert ate_se2_aligned_m(held, reference) <= ate_m(held, reference)


def test_start_alignment_uses_the_first_metres_alone() -> None:
    # right for 10 m, then a turn to the left that the reference does not make
    reference = make_reference(straight(21))
    bent = np.vstack([straight(11), turned(straight(11)[1:], 90.0) + np.array([10.0, 0.0])])
    held = held_on(reference, turned(bent, 45.0) + np.array([7.0, 7.0]))
    expected = math.sqrt(np.mean(np.concatenate([np.zeros(11), 2 * np.arange(1, 11) ** 2])))
    assert ate_start_aligned_m(held, reference) == pytest.approx(expected)


def test_a_scale_error_shows_in_every_window() -> None:
    reference = make_reference(straight(200))  # 1 m/s
    held = held_on(reference, 1.05 * straight(200))
    assert rte_m(held, reference) == pytest.approx(0.05 * 60)
    assert rte_m(held, reference, window_s=20.0) == pytest.approx(0.05 * 20)
    assert rte_whole_walk(held, reference) == 0.0
    assert drift_pct(held, reference) == pytest.approx(5.0)


def test_a_constant_heading_drift_has_its_chord_error() -> None:
    rate = math.radians(0.5)  # per second and per metre: the estimate walks a circle of radius 1 / rate
    t_s = np.arange(200.0)
    reference = make_reference(straight(200))
    arc = np.column_stack([np.sin(rate * t_s), 1 - np.cos(rate * t_s)]) / rate
    # start-aligned at 5 m, where the least-squares yaw of rows 1..5 (weights k^2, chord angle k rate / 2) is taken out
    k = np.arange(1, 6)
    chord = 2 * np.sin(rate * k / 2) / rate
    yaw = math.atan2(-np.sum(chord * k * np.sin(rate * k / 2)), np.sum(chord * k * np.cos(rate * k / 2)))
    end = 2 * math.sin(rate * 30) / rate * np.array([math.cos(rate * 30 + yaw), math.sin(rate * 30 + yaw)])
    expected = math.hypot(end[0] - 60, end[1])
    assert rte_m(held_on(reference, arc), reference) == pytest.approx(expected)


def test_windows_end_with_the_first_row_late_enough_and_a_short_walk_is_one() -> None:
    reference = make_reference(straight(31))
    held = held_on(reference, 1.1 * straight(31))
    assert rte_m(held, reference) == pytest.approx(3.0)
    assert rte_whole_walk(held, reference) == 1.0
    first, last = windows(np.array([0.0, 30.0, 50.0, 70.0, 111.0]))
    assert first.tolist() == [0, 1, 2]
    assert last.tolist() == [3, 4, 4]


def test_drift_counts_the_path_from_the_given_start() -> None:
    # the first row is given, the last is not surveyed: the path ends at the last surveyed row, 20 m from the start
    reference = make_reference(straight(31), surveyed=[False] + 20 * [True] + 10 * [False])
    held = held_on(reference, reference.xy_m + np.array([0.0, 3.0]))
    assert drift_pct(held, reference) == pytest.approx(15.0)


def test_a_dense_and_a_sparse_reference_have_the_same_length() -> None:
    corners = np.array([[0.0, 0.0], [30.0, 0.0], [30.0, 20.0]])
    sparse = make_reference(corners, t_s=20.0 * np.arange(3))
    dense = make_reference(
        np.vstack([np.linspace(*corners[:2], 600)[:-1], np.linspace(*corners[1:], 401)]), t_s=0.04 * np.arange(1000)
    )
    assert path_length_m(sparse, resampling_times_s(sparse)) == pytest.approx(50.0)
    assert path_length_m(dense, resampling_times_s(dense)) == pytest.approx(50.0, abs=0.5)


def test_jitter_adds_no_distance_and_the_distance_error_has_a_sign() -> None:
    reference = make_reference(np.column_stack([0.1 * np.arange(601), np.zeros(601)]), t_s=0.1 * np.arange(601))
    jitter = np.where(np.arange(601) % 10 == 5, 3.0, 0.0)[:, None] * [0.0, 1.0]
    estimates = answer(reference, reference.xy_m + jitter)
    resampled = hold_at(estimates, resampling_times_s(reference), ORIGIN)
    assert distance_error_pct(resampled, reference) == pytest.approx(0.0, abs=1e-9)
    reference = make_reference(straight(101))
    for factor, expected in ((1.1, 10.0), (0.8, -20.0), (0.0, -100.0)):
        scores = score(answer(reference, factor * reference.xy_m), reference, None, ORIGIN)
        assert scores["distance_error_pct"] == pytest.approx(expected)


def test_loop_closure_is_the_gap_over_the_length() -> None:
    angle = np.linspace(0, 2 * np.pi, 101)
    circle = 20 * np.column_stack([np.cos(angle) - 1, np.sin(angle)])
    reference = make_reference(circle)
    gap_m = np.linspace(0, 1, 101)[:, None] * [3.0, -4.0]
    length_m = 100 * 2 * 20 * math.sin(math.pi / 100)
    assert loop_closure_pct(held_on(reference, circle + gap_m), reference) == pytest.approx(100 * 5.0 / length_m)
    assert loop_closure_pct(held_on(reference, circle + np.array([9.0, 9.0])), reference) == pytest.approx(
        0.0, abs=1e-9
    )


def test_standing_still_has_no_percentages_and_an_open_walk_no_loop_closure() -> None:
    reference = make_reference(straight(50))
    assert math.isnan(loop_closure_pct(held_on(reference, straight(50)), reference))
    still = make_reference(np.zeros((50, 2)))
    assert math.isnan(loop_closure_pct(held_on(still, np.zeros((50, 2))), still))
    reference = make_reference(np.zeros((50, 2)))
    scores = score(answer(reference, np.ones((50, 2))), reference, None, ORIGIN)
    assert math.isnan(scores["drift_pct"])
    assert math.isnan(scores["distance_error_pct"])
    assert scores["ate_m"] == pytest.approx(math.sqrt(2))


def loop_of_two_rows(xy_m: np.ndarray) -> dict[str, float]:
    """Scores of a track, one row a second, on a loop of which only both ends are known."""
    both_ends = Trajectory(
        t_s=np.array([0.0, len(xy_m) - 1.0]),
        xy_m=np.zeros((2, 2)),
        level=np.zeros(2, int),
        surveyed=np.array([0, 1]) > 0,
    )
    return score(answer(make_reference(xy_m), xy_m), both_ends, None, ORIGIN)


def test_a_loop_of_two_rows_is_as_long_as_the_estimate() -> None:
    corners = np.array([[0, 0], [30, 0], [30, 10], [0, 10], [0.3, 0.4]], dtype=float)
    length_m = 30 + 10 + 30 + math.hypot(0.3, 9.6)
    assert loop_of_two_rows(corners)["loop_closure_pct"] == pytest.approx(100 * 0.5 / length_m)
    wavering = np.array([[0, 0], [0.9, 0], [0, 0.9], [0, 0]], dtype=float)
    assert math.isnan(loop_of_two_rows(wavering)["loop_closure_pct"])
    assert loop_of_two_rows(1.2 * wavering)["loop_closure_pct"] == 0.0
    reference = make_reference(np.array([[0.0, 0.0], [0.5, 0.0]]), t_s=9.0 * np.arange(2))
    track = answer(make_reference(straight(10)), straight(10))
    assert math.isnan(score(track, reference, None, ORIGIN)["loop_closure_pct"])


@pytest.mark.parametrize("surveyed", [0, 1])
def test_few_surveyed_rows(surveyed: int) -> None:
    reference = make_reference(straight(3), surveyed=np.arange(3) < surveyed)
    held = held_on(reference, straight(3))
    assert math.isnan(rte_m(held, reference))
    assert math.isnan(rte_whole_walk(held, reference))
    for metric in (ate_m, ate_start_aligned_m, ate_se2_aligned_m, ate_se2_translation_only):
        assert math.isnan(metric(held, reference)) == (surveyed == 0), metric
    assert math.isnan(drift_pct(held, reference))
