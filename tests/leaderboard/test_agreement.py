"""Two runs are compared by score and by place: in closed form, on walks whose errors are known."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from pdrbench.evaluation import Results
from pdrbench.result import FAILED, Result
from pdrbench.trajectory import Estimates
from pdrbench_leaderboard.agreement import disagreement

METRIC = "p75_m"
NUM_WALKS = 40


def run(walk: int, errors_m: Sequence[float], seed: int = 0, **changes: Any) -> Result:
    """Answers that are so far beside the x axis, where the pedestrian is."""
    count = len(errors_m)
    nothing = np.full(count, np.nan)
    xy_m = np.column_stack([np.arange(count), errors_m])
    estimates = Estimates(np.arange(count) * 1.0, xy_m, np.zeros(count), nothing, nothing, nothing)
    return Result("Toy-v1", "test", f"walk-{walk}", "mine", seed, estimates, nothing, **changes)


def played(results: Sequence[Result]) -> Results:
    """Runs with their scores: the third quartile and the mean of the errors."""
    scored = []
    for result in results:
        errors_m = np.abs(result.estimates.xy_m[:, 1])
        scores = {METRIC: float(np.quantile(errors_m, 0.75)), "mean_m": float(errors_m.mean())}
        scored.append(SimpleNamespace(scores=scores, unit=result.walk))
    return cast(Results, SimpleNamespace(results=tuple(results), scored=tuple(scored)))


def walks(scale_m: float = 2.0) -> list[Result]:
    """Walks whose errors differ widely, from a tenth of the scale to ten times as much."""
    rng = np.random.default_rng(3)
    return [
        run(walk, size_m * rng.uniform(0.5, 1.5, 60))
        for walk, size_m in enumerate(scale_m * np.geomspace(0.1, 10.0, NUM_WALKS))
    ]


def moved(result: Result, factor: float = 1.0, shift_m: float = 0.0) -> Result:
    """The same run with errors that are larger by a factor, answers that are shifted along the walk."""
    xy_m = result.estimates.xy_m * [1.0, factor] + [shift_m, 0.0]
    return dataclasses.replace(result, estimates=dataclasses.replace(result.estimates, xy_m=xy_m))


def differences(sent: Sequence[Result], again: Sequence[Result]) -> list[str]:
    return list(disagreement(played(sent), played(again), METRIC))


def test_the_same_run_agrees_and_so_do_scores_within_one_percent() -> None:
    assert differences(walks(), walks()) == []
    assert differences(walks(), [moved(result, 1.009) for result in walks()]) == []


def test_scores_that_are_two_percent_worse_everywhere_do_not_agree() -> None:
    (what,) = differences(walks(), [moved(result, 1.02) for result in walks()])
    assert what.startswith(f"{NUM_WALKS} of {NUM_WALKS} walks differ, the first is walk walk-0, seed 0: its score was")


def test_differences_of_a_millimetre_decide_nothing() -> None:
    """A localizer that is perfect but for rounding: 1 mm is a third of its error."""
    sent = [run(walk, [0.003] * 60) for walk in range(NUM_WALKS)]
    assert differences(sent, [moved(result, 4 / 3, shift_m=5e-4) for result in sent]) == []


def test_other_answers_with_the_same_score_do_not_agree() -> None:
    mirrored = [moved(result, -1.0) for result in walks()]
    assert "answers lie elsewhere, the first at 0 s" in differences(walks(), mirrored)[0]


def test_one_walk_in_twenty_may_differ_a_little() -> None:
    """As a filter does that takes another way from a last bit on."""
    again = walks()
    again[7], again[20] = moved(again[7], 1.05), moved(again[20], 0.93)
    assert differences(walks(), again) == []
    again[9] = moved(again[9], 1.05)
    assert differences(walks(), again)[0].startswith(f"3 of {NUM_WALKS} walks differ")


@pytest.mark.parametrize("factor", [0.0, 0.5, 1.5])
def test_a_changed_walk_of_small_error_is_found_however_large_the_noise_of_others_is(factor: float) -> None:
    """The mean over walks, 5 m with an interval of 2 m, says nothing of a walk with an error of 0.2 m."""
    again = walks()
    again[0] = moved(again[0], factor)
    (what,) = differences(walks(), again)
    assert what.startswith("walk walk-0, seed 0: its score was 0.2")


def test_a_walk_may_differ_as_its_seeds_do() -> None:
    rng = np.random.default_rng(5)
    sent = [run(walk, rng.uniform(1, 3, 60) * (1 + seed), seed) for walk in range(NUM_WALKS) for seed in (0, 1)]
    again = list(sent)
    again[6] = moved(sent[6], 1.5)
    assert differences(sent, again) == [], "its other seed is twice as far off"
    again[6] = moved(sent[6], 4.0)
    assert differences(sent, again)[0].startswith("walk walk-3, seed 0: its score was")


def test_another_status_and_missing_answers_are_named() -> None:
    again = walks()
    again[1] = dataclasses.replace(again[1], status=FAILED, failure="Traceback\nValueError: no idea")
    again[2] = run(2, again[2].estimates.xy_m[:50, 1])
    assert differences(walks(), again)[0] == "walk walk-1, seed 0: was complete, is failed (ValueError: no idea)"
    assert differences(walks(), [*walks()[:2], *again[2:3]])[0].endswith("60 estimates were given, 50 came")
