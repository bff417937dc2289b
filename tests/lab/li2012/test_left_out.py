"""Settings that are measured on walks left out are chosen on the others."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pdrbench.evaluation import evaluate
from pdrbench_lab.papers.li2012.left_out import choose_by_others, short_trials, short_walks


def test_walks_left_out_have_no_say() -> None:
    error_pct = np.array([[1.0, 9.0], [-1.0, 9.0], [8.0, -2.0], [8.0, 2.0]])
    group = np.array(["a", "a", "b", "b"])
    assert choose_by_others(error_pct, group).tolist() == [9.0, 9.0, 8.0, 8.0]


def test_short_trials_keep_their_steps() -> None:
    t_s = np.arange(0.0, 60.0, 0.02)
    accel = np.column_stack([t_s, 0 * t_s, 0 * t_s, 9.81 + np.sin(t_s)])
    made_s = np.arange(2.0, 58.0, 0.5)
    trials = list(short_trials(accel, made_s, np.random.default_rng(0)))
    for rows, steps_s in trials:
        assert (np.diff(rows[:, 0]) > 0).all() and np.diff(rows[:, 0]).max() < 0.03
        assert rows[0, 0] <= steps_s[0] and steps_s[-1] <= rows[-1, 0]
        np.testing.assert_allclose(np.diff(steps_s), 0.5, atol=0.03)
    assert sorted(len(steps_s) for _, steps_s in trials)[:4] == [6, 6, 6, 6]


def test_short_walks_keep_their_ends() -> None:
    found = short_walks(0, people=10)
    assert abs(found["short_bias_adaptive"]) < 5.0 < abs(found["short_bias_gentle"])


def test_the_revised_count_is_that_of_the_adaptive_detector(data_root: Path) -> None:
    results = evaluate(["step_count"], "PhoneSteps-v1", split="train", walks=3, isolation="none", seeds=1)
    assert not any(result.failure for result in results.results)
    walks = results.walks()
    assert (walks[walks["division"] == "offline"]["drift_pct"] < 2.0).sum() == 3
