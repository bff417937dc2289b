from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pdrbench.episode import REVISION_SLACK_S, Episode, EstimateRow, play, read_estimate
from pdrbench.errors import EstimateError, RecordingError, UnsuitableError, unknown_name
from pdrbench.localizer import Briefing, Estimate, Observation
from pdrbench.metrics.hold import HOLD_SLACK_S
from pdrbench.recording import Recording, SensorSpec, SensorStream
from pdrbench.result import Result
from pdrbench.task import Task
from pdrbench.trajectory import Estimates, Start, Trajectory

SPEC = SensorSpec("accel", ("t_s", "x_mps2"), [0, -1e6], [1e6, 1e6], 50.0, "a test sensor")


def make_episode(t_s: list[float], end_s: float, *, period_s: float = 0.5, capacity: int = 3) -> Episode:
    rows = np.column_stack([t_s, np.arange(len(t_s))]) if t_s else np.zeros((0, 2))
    reference = Trajectory([0.0, end_s], [[0, 0], [3, 4]], [0, 0], [False, True])
    recording = Recording("walk", None, {"accel": SensorStream(SPEC, rows)}, reference)
    task = Task(
        id="Test-v0",
        summary="",
        description="",
        sensors=(SPEC,),
        capacity={"accel": capacity},
        period_s=period_s,
        start="pose",
        walks={"train": ("walk",)},
        load=lambda walk: recording,
        tell_start=lambda recording: Start(np.zeros(2), 0),
        licence="MIT",
        source="generated",
    )
    return Episode(recording, task)


def observe_all(episode: Episode) -> list[Observation]:
    observations = []
    while not episode.done:
        observations.append(episode.observe())
        episode.submit(Estimate(np.zeros(2), 0))
    return observations


@given(gaps_s=st.lists(st.sampled_from([0.0, 0.01, 0.1, 0.5, 0.7, 3.0]), max_size=40), capacity=st.integers(1, 4))
def test_every_row_is_delivered_once_in_order_and_never_early(gaps_s: list[float], capacity: int) -> None:
    t_s = np.cumsum(gaps_s).tolist()
    end_s = (t_s[-1] if t_s else 0.0) + 0.5 * len(t_s) + 1.0  # room for what waits
    observations = observe_all(make_episode(t_s, end_s, capacity=capacity))
    rows = np.concatenate([o["accel"] for o in observations])
    assert rows[:, 1].tolist() == list(range(len(t_s)))
    assert all((o["accel"][:, 0] <= o.now_s + 1e-6).all() and len(o["accel"]) <= capacity for o in observations)


def test_the_last_observation_reaches_the_end_and_rows_that_fit_nowhere_are_an_error() -> None:
    for end_s, count in ((1.0, 3), (1.2, 4), (0.0001, 2)):
        observations = observe_all(make_episode([0.0], end_s))
        assert len(observations) == count
        assert observations[-1].now_s >= end_s
    with pytest.raises(RecordingError, match="2 rows of 'accel' do not fit"):
        make_episode([1.0] * 5, 1.0, capacity=3)


def test_observe_and_submit_alternate_and_expose_neither_future_nor_recording() -> None:
    episode = make_episode([0.0, 0.1, 0.6], 1.0)
    rows = episode.observe()["accel"]
    assert rows.base is None
    rows[:] = -1.0
    episode.submit(None)
    assert episode.observe()["accel"][0, 1] == 1.0
    episode = make_episode([0.0], 1.0)
    with pytest.raises(EstimateError, match="observe"):
        episode.submit(Estimate(np.zeros(2), 0))
    observe_all(episode)
    with pytest.raises(EstimateError, match="over"):
        episode.observe()


def test_observing_twice_gives_the_same_rows_and_repr_tells_no_truth() -> None:
    episode = make_episode([0.0, 0.1], 1.0)
    assert np.array_equal(episode.observe()["accel"], episode.observe()["accel"])
    episode = make_episode([0.0], 2.0)
    assert "3" not in repr(episode).replace("step 0 of 5", "")
    assert repr(episode) == "Episode(Test-v0, walk walk, step 0 of 5)"


@pytest.mark.parametrize(
    ("answer", "why"),
    [
        (None, "the localizer returned None"),
        ((1.0, 2.0, 0), "expected an Estimate, got tuple"),
        (Estimate(np.full(2, np.nan), 0), "is not finite"),
        (Estimate(np.zeros(3), 0), "xy_m has shape (3,)"),
        (Estimate(np.zeros(2), 0.5), "0.5 is not a whole number"),  # type: ignore[arg-type]
        (Estimate(np.array([48e4, 11e4]), 0), "m and more from the start"),
    ],
)
def test_first_answers_that_cannot_be_meant_end_the_walk(answer: Any, why: str) -> None:
    class Mine:
        def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
            pass

        def step(self, observation: Observation) -> Any:
            return answer

    class Revises(Mine):
        def revise(self) -> None:
            pass

    def played(localizer: Any) -> Result:
        return play(localizer, make_episode([0.0], 9.0), np.random.default_rng(1), name="mine", seed=0)

    result = played(Mine())
    assert result.status == "failed" and len(result.estimates) == 10
    assert "first 10 answers cannot be meant" in result.failure and why in result.failure
    assert "step returns pdrbench.Estimate" in result.failure and "test_episode.py, line" in result.failure
    may_wait = answer is None or why == "is not finite"
    assert (played(Revises()).status == "complete") == may_wait


@pytest.mark.parametrize(
    ("answer", "reason"),
    [
        (None, "nothing"),
        ((0.0, 0.0, 0), "type"),
        (Estimate(np.zeros(3), 0), "shape"),
        (Estimate(np.array([np.nan, 0.0]), 0), "nan"),
        (Estimate(np.array([np.inf, 0.0]), 0), "nan"),
        (Estimate(np.zeros(2), 0.5), "level"),  # type: ignore[arg-type]
        (Estimate(np.zeros(2), "first"), "type"),  # type: ignore[arg-type]
        (Estimate(np.zeros(2), 10**400), "type"),
        (Estimate(np.zeros(2), 0, sigma_m="wide"), "type"),  # type: ignore[arg-type]
        (Estimate(np.zeros(2), 0, converged=0.5), "type"),  # type: ignore[arg-type]
        (Estimate(np.zeros(2), 0, converged=1), "type"),
        (Estimate(np.zeros(2), 0, converged="yes"), "type"),  # type: ignore[arg-type]
        (EstimateRow(np.nan, 0.0, 0.0, 0.0, 0.0, 0.0), "nan"),
        (EstimateRow(0.0, 0.0, -np.inf, 0.0, 0.0, 0.0), "nan"),
        (EstimateRow(0.0, 0.0, 0.5, 0.0, 0.0, 0.0), "level"),
        (EstimateRow(0.0, 0.0, 0.0, 0.0, 0.0, 0.5), "type"),
    ],
)
def test_an_answer_that_cannot_be_scored_is_missing_and_counted(answer: object, reason: str) -> None:
    episode = make_episode([0.0], 0.5)
    episode.observe()
    episode.submit(answer)
    result = episode.result(localizer="test", seed=0)
    assert result.missing == {reason: 1}
    assert not result.estimates.given.any()


def test_claims_of_an_estimate_are_taken_in_its_place() -> None:
    claims = read_estimate(Estimate(np.array([1.5, -2.0]), 3, heading_rad=7.0, converged=True))
    assert claims[:4] == (1.5, -2.0, 3.0, 7.0)
    assert np.isnan(claims.sigma_m)
    assert claims.converged == 1.0
    assert read_estimate(claims) is claims


class Scripted:
    """Returns or raises by a function of the step number."""

    def __init__(self, answer: Callable[[int], object], reset: Callable[[], None] = lambda: None) -> None:
        self._answer, self._reset = answer, reset

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        self._reset()
        self._step = 0

    def step(self, observation: Observation) -> Estimate:
        self._step += 1
        return self._answer(self._step)  # type: ignore[return-value]


def fail(error: Exception) -> None:
    raise error


def run(localizer: Scripted) -> object:
    return play(localizer, make_episode([0.0], 2.0), np.random.default_rng(0), name="scripted", seed=0)


def test_a_crash_keeps_what_was_answered_and_declining_is_none() -> None:
    result = run(Scripted(lambda step: Estimate(np.zeros(2), 0) if step < 3 else fail(ZeroDivisionError("boom"))))
    assert (result.status, len(result.estimates), len(result.step_s)) == ("failed", 2, 2)
    assert "ZeroDivisionError: boom" in result.failure
    result = run(Scripted(lambda step: None, reset=lambda: fail(RuntimeError("no"))))
    assert (result.status, len(result.estimates)) == ("failed", 0)
    result = run(Scripted(lambda step: None, reset=lambda: fail(UnsuitableError("needs wifi"))))
    assert (result.status, result.failure) == ("unsuitable", "needs wifi")


@pytest.mark.parametrize(("declined_at", "status"), [(1, "unsuitable"), (2, "failed"), (5, "failed")])
def test_after_the_first_estimate_a_walk_cannot_be_declined(declined_at: int, status: str) -> None:
    def answer(step: int) -> Estimate | None:
        return Estimate(np.zeros(2), 0) if step < declined_at else fail(UnsuitableError("too hard"))

    result = run(Scripted(answer))
    assert (result.status, len(result.estimates)) == (status, declined_at - 1)
    assert "too hard" in result.failure


def test_a_whole_walk_is_timed_step_by_step() -> None:
    result = run(Scripted(lambda step: Estimate(np.full(2, step), 0, heading_rad=0.1)))
    assert result.status == "complete"
    assert (result.step_s >= 0).all() and len(result.step_s) == len(result.estimates) == 5
    assert result.estimates.xy_m[:, 0].tolist() == [1, 2, 3, 4, 5]
    assert np.isnan(result.estimates.sigma_m).all()


def test_a_past_is_revised_and_convergence_claimed_in_their_order() -> None:
    claims = [True, False, None, np.bool_(True), None]
    result = run(Scripted(lambda step: Estimate(np.zeros(2), 0, converged=claims[step - 1])))  # type: ignore[arg-type]
    assert np.array_equal(result.estimates.converged, [1.0, 0.0, np.nan, 1.0, np.nan], equal_nan=True)
    episode = make_episode([0.0], 1.0)
    with pytest.raises(EstimateError, match="is not over"):
        episode.revise(np.zeros((1, 4)))


def revised(episode: Episode) -> Estimates:
    found = episode.result(localizer="test", seed=0).revised
    assert found is not None
    return found


def test_a_revised_past_takes_the_last_row_not_later_than_the_slack() -> None:
    episode = make_episode([0.0], 2.0)  # answers at 0, 0.5, 1, 1.5, 2
    observe_all(episode)
    episode.revise([[0.2, 1, 2, 3], [0.5 + HOLD_SLACK_S - 1e-6, 4, 5, 6], [1.0 + HOLD_SLACK_S + 1e-6, 7, 8, -9]])
    assert not episode.estimates.xy_m.any(), "what was answered stays"
    estimates = revised(episode)
    assert estimates.xy_m.tolist() == [[0, 0], [4, 5], [4, 5], [7, 8], [7, 8]]
    assert estimates.level.tolist() == [0, 6, 6, -9, -9]
    assert REVISION_SLACK_S == HOLD_SLACK_S


def test_a_revised_past_may_claim_sigma_and_heading() -> None:
    rows = np.array([[0.0, 1, 2, 0, 0.5, -1.0], [1.0, 1, 2, 0, np.nan, np.nan]])
    for columns, sigma_m, heading_rad in ((6, 0.5, -1.0), (5, 0.5, np.nan), (4, np.nan, np.nan)):
        episode = make_episode([0.0], 1.0)
        observe_all(episode)
        episode.revise(rows[:, :columns])
        np.testing.assert_array_equal(revised(episode).sigma_m, [sigma_m, sigma_m, np.nan])
        np.testing.assert_array_equal(revised(episode).heading_rad, [heading_rad, heading_rad, np.nan])
        assert np.isnan(revised(episode).converged).all()


@pytest.mark.parametrize(
    "track", [np.zeros((3, 7)), np.zeros(4), 1.0, [[0, 0, 0, "one"]], [[np.inf, 0, 0, 0]], [[1, 2]]]
)
def test_a_malformed_track_changes_nothing(track: object) -> None:
    episode = make_episode([0.0], 1.0)
    observe_all(episode)
    with pytest.raises(EstimateError, match="revise returns an array"):
        episode.revise(track)
    result = episode.result(localizer="test", seed=0)
    assert result.revised is None and not result.estimates.xy_m.any()


class Revising(Scripted):
    """Counts its steps."""

    asked = 0

    def revise(self) -> object:
        self.asked += 1
        return [[0.0, 5.0, 6.0, 1.0]]


def test_revise_is_called_once_and_only_after_a_complete_walk() -> None:
    through = Revising(lambda step: Estimate(np.zeros(2), 0))
    result = run(through)
    assert (through.asked, result.division, result.status) == (1, "online", "complete")
    assert result.revised is not None and not result.estimates.xy_m.any()
    assert result.revised.xy_m.tolist() == [[5.0, 6.0]] * 5 and result.revise_s >= 0
    crashing = Revising(lambda step: Estimate(np.zeros(2), 0) if step < 3 else fail(ZeroDivisionError("boom")))
    result = run(crashing)
    assert (crashing.asked, result.revised, len(result.estimates)) == (0, None, 2)
    assert not result.estimates.xy_m.any()


def test_unknown_names_suggest_the_nearest_and_list_what_is_broken() -> None:
    error = unknown_name("localizer", "woodmann2008-v0", ["woodman2008-v0", "stay-v0"], {"learned-v0": "needs torch"})
    assert "did you mean 'woodman2008-v0'?" in str(error)
    assert "(not loaded: 'learned-v0': needs torch)" in str(error)
    assert "known: stay-v0" in str(unknown_name("localizer", "zzz", ["stay-v0"]))
