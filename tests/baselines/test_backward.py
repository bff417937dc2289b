"""Lines through the clouds of a filter, against closed forms."""

from __future__ import annotations

import numpy as np

from pdrbench.episode import Episode, play, read_track
from pdrbench.geometry import BoolArray, FloatArray, IntArray
from pdrbench.localizer import Estimate
from pdrbench.registry import make_localizer, make_task
from pdrbench_baselines.backward import BETWEEN_M, MIN_KEPT, BackwardSampler, StoredCloud, gaussian

STEP_M: FloatArray = np.array([1.0, 0.0])
STEP_SIGMA_M, SEEN_SIGMA_M = 0.5, 1.0


def cloud(t_s: float, xy_m: FloatArray, level: int = 0, **more: object) -> StoredCloud:
    count = len(xy_m)
    weight = np.ones(count)
    return StoredCloud(t_s, xy_m, np.full(count, level), np.zeros(count, dtype=int), weight, **more)  # type: ignore[arg-type]


def forward(state: FloatArray) -> FloatArray:
    return state + STEP_M


STEP = gaussian(forward, STEP_SIGMA_M**2 * np.eye(2))


def kalman(seen_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Filtered means and variances per axis of a walk by steps, seen with noise; the prior is one observation."""
    mean_m, variance_m2 = [seen_m[0]], [SEEN_SIGMA_M**2]
    for seen in seen_m[1:]:
        expected, spread = mean_m[-1] + STEP_M, variance_m2[-1] + STEP_SIGMA_M**2
        gain = spread / (spread + SEEN_SIGMA_M**2)
        mean_m.append(expected + gain * (seen - expected))
        variance_m2.append((1 - gain) * spread)
    return np.array(mean_m), np.array(variance_m2)


def test_lines_follow_the_smoother_of_a_linear_model(rng: np.random.Generator) -> None:
    steps = 12
    true_m = np.cumsum(STEP_M + STEP_SIGMA_M * rng.standard_normal((steps, 2)), axis=0)
    mean_m, variance_m2 = kalman(true_m + SEEN_SIGMA_M * rng.standard_normal((steps, 2)))
    smooth_m, smooth_m2 = mean_m.copy(), variance_m2.copy()
    for k in range(steps - 2, -1, -1):  # Rauch, Tung & Striebel 1965
        spread = variance_m2[k] + STEP_SIGMA_M**2
        gain = variance_m2[k] / spread
        smooth_m[k] += gain * (smooth_m[k + 1] - mean_m[k] - STEP_M)
        smooth_m2[k] += gain**2 * (smooth_m2[k + 1] - spread)
    past = BackwardSampler(num_kept=2000)
    for k in range(steps):
        drawn_m = mean_m[k] + np.sqrt(variance_m2[k]) * rng.standard_normal((2000, 2))
        past.follow(cloud(float(k), drawn_m), k - 1.0, STEP if k else None)
    lines_m, _ = past.lines(rng, 400)
    # 400 lines of a spread below 0.8 m: standard error 0.04 m, and as much from clouds of 2000
    np.testing.assert_allclose(lines_m.mean(axis=1), smooth_m, atol=0.2)
    np.testing.assert_allclose(lines_m.var(axis=1).mean(axis=1), smooth_m2, rtol=0.3)
    assert (lines_m.var(axis=1).mean(axis=1)[:-2] < 0.9 * variance_m2[:-2]).all()


def answer(past: BackwardSampler, rows: FloatArray) -> None:
    for t_s, x_m, y_m, level, sigma_m in rows.tolist():
        claimed = None if np.isnan(sigma_m) else sigma_m
        past.answered(t_s, Estimate(xy_m=(x_m, y_m), level=int(level), sigma_m=claimed))


def test_a_place_that_a_wall_parts_from_what_followed_is_left(rng: np.random.Generator) -> None:
    def is_free(from_xy_m: FloatArray, cell: IntArray, to_xy_m: FloatArray) -> BoolArray:
        return np.sign(from_xy_m[:, 1]) == np.sign(to_xy_m[:, 1])  # a wall along y = 0

    both = np.concatenate([np.tile([0.0, 0.2], (50, 1)), np.tile([0.0, -0.2], (50, 1))])
    past = BackwardSampler()
    past.follow(cloud(0.0, both, is_free=is_free), 0.0)
    past.follow(cloud(1.0, np.tile([1.0, 0.2], (50, 1)), is_free=is_free), 0.0, STEP)
    lines_m, _ = past.lines(rng, 200)
    assert (lines_m[0, :, 1] > 0).mean() > 0.97  # eight tries: one of 256 finds none that is free


def test_what_is_known_late_decides_between_two_places(rng: np.random.Generator) -> None:
    """The walker was in one of two places, and the next cloud says in which: answers of before are revised."""
    past = BackwardSampler()
    past.follow(cloud(0.0, np.concatenate([np.zeros((70, 2)), np.full((30, 2), 20.0)])), 0.0)
    past.follow(cloud(1.0, np.full((100, 2), 20.0) + STEP_M), 0.0, STEP)
    answers = np.array(
        [[-1.0, 5, 5, 2, np.nan], [0.0, 6, 6, 0, 9.0], [0.5, 6, 6, 0, 9.0], [1.0, 6, 6, 0, 9.0], [2.0, 7, 7, 1, 3.0]]
    )
    answer(past, answers)
    made = past.revised(rng)
    np.testing.assert_allclose(made[1:4, 1:3], [[20.0, 20.0], [20.5, 20.0], [21.0, 20.0]])
    np.testing.assert_array_equal(made[[0, -1]], answers[[0, -1]])  # before the first cloud and after the last
    assert (made[1:4, 4] == BETWEEN_M).all() and (made[1:4, 3] == 0).all()


def test_evidence_takes_the_place_of_the_last_cloud_and_a_walk_begins_anew(rng: np.random.Generator) -> None:
    past = BackwardSampler()
    past.follow(cloud(0.0, np.zeros((10, 2))), 0.0)
    past.follow(cloud(1.0, np.zeros((10, 2))), 0.0, STEP)
    past.amend(cloud(1.4, np.full((10, 2), 5.0), level=3))
    lines_m, level = past.lines(rng, 4)
    assert len(past) == 2 and (lines_m[1] == 5.0).all() and (level[1] == 3).all()
    past.follow(cloud(2.0, np.ones((10, 2))), 2.0)
    assert len(past) == 1 and (past.lines(rng, 4)[0] == 1.0).all()


def test_memory_is_bounded(rng: np.random.Generator) -> None:
    past = BackwardSampler(num_kept=128, max_stored=1000)
    for k in range(200):
        past.follow(cloud(float(k), rng.standard_normal((500, 2)) + k * STEP_M), k - 1.0, STEP if k else None)
        assert past._num_stored <= 1000
    assert len(past) >= 1000 // MIN_KEPT  # the last ones
    answers = np.column_stack([np.arange(200.0), np.zeros((200, 3)), np.full(200, np.nan)])
    answer(past, answers)
    made = past.revised(rng)
    assert (made[:100] == answers[:100])[:, :4].all() and abs(made[-1, 1] - 199) < 1.0


def test_answers_on_the_way_are_those_of_the_filter() -> None:
    """Bit for bit: what is kept for the end draws no random number before it."""
    task = make_task("CampusStride-v1")
    recording = task.load(task.split("train")[0])
    made, *others = make_localizer("woodman2008"), make_localizer("woodman2008?revises=false")
    online, before = (
        play(
            localizer, Episode(recording, task).prefix(60), np.random.default_rng(5), name="woodman2008", seed=0
        ).estimates
        for localizer in (made, *others)
    )
    np.testing.assert_array_equal(online.xy_m, before.xy_m)
    np.testing.assert_array_equal(online.level, before.level)
    track = read_track(made.revise())  # type: ignore[attr-defined]
    np.testing.assert_array_equal(track[:, 0], online.t_s)
    assert 0 < np.hypot(*(track[:, 1:3] - online.xy_m).T).mean() < 5.0
