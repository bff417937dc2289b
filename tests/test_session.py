"""`Session`: rows that come late, unordered, twice or not at all, against `Episode` on the same rows."""

from __future__ import annotations

import numpy as np
import pytest

import pdrbench
from pdrbench.episode import Episode, play
from pdrbench.errors import PdrbenchError, RecordingError
from pdrbench.geometry import FloatArray
from pdrbench.localizer import Briefing, Estimate, Observation
from pdrbench.session import AHEAD, LATE, TWICE, WRONG, Session

LOCALIZER = "dead_reckoning"
SECONDS = 20.0
PACKET_S = 0.25


class Listener:
    """Keeps its observations, and answers how many there were."""

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        self.observations: list[Observation] = []

    def step(self, observation: Observation) -> Estimate:
        self.observations.append(observation)
        return Estimate(np.array([len(self.observations), 0.0]), 0)

    def rows(self, name: str) -> FloatArray:
        return np.concatenate([observation[name] for observation in self.observations])


@pytest.fixture(scope="module")
def episode() -> Episode:
    task = pdrbench.make_task("CampusPhone-v1")
    whole = Episode(task.load(task.split("train")[0]), task)
    return whole.prefix(int(SECONDS / task.period_s) + 1)


def packets(episode: Episode) -> list[tuple[str, FloatArray]]:
    """What each sensor delivered in each quarter of a second."""
    return [
        (name, rows[(rows[:, 0] > end_s - PACKET_S) & (rows[:, 0] <= end_s)])
        for end_s in np.arange(0.0, episode.now_s[-1] + PACKET_S, PACKET_S)
        for name, rows in episode.rows.items()
    ]


def test_answers_are_those_of_the_episode(episode: Episode) -> None:
    result = play(pdrbench.make_localizer(LOCALIZER), episode.fresh(), np.random.default_rng(0), name="", seed=0)
    session = Session(LOCALIZER, episode.briefing, wait_s=PACKET_S + 0.01)
    for name, rows in packets(episode):
        session.push(name, rows)
        answer = session.estimate()
        if answer is not None:
            k = round(session.now_s / episode.task.period_s)
            np.testing.assert_array_equal(answer.xy_m, result.estimates.xy_m[k])
    answer = session.finish()
    assert answer is not None and session.now_s == episode.now_s[-1]
    np.testing.assert_array_equal(answer.xy_m, result.estimates.xy_m[-1])
    assert not +session.dropped


def test_unordered_and_doubled_packets_give_the_same_observations(episode: Episode, rng: np.random.Generator) -> None:
    listener = Listener()
    session = Session(listener, episode.briefing, wait_s=2.0)
    sent = packets(episode)
    sent += [sent[k] for k in rng.choice(len(sent), len(sent) // 10)]
    end_s = [rows[-1, 0] if len(rows) else 0.0 for _, rows in sent]
    for k in np.argsort(end_s + rng.uniform(0.0, 1.5, len(sent))):
        session.push(*sent[k])
        session.estimate()
    session.finish()
    other = episode.fresh()
    assert len(listener.observations) == len(other)
    for mine in listener.observations:
        theirs = other.observe()
        other.submit(None)
        assert mine.now_s == theirs.now_s
        for name, rows in theirs.rows.items():
            np.testing.assert_array_equal(mine[name], rows)
    assert session.dropped[TWICE] and not session.dropped[LATE]


def test_what_comes_after_its_observation_is_left_out_and_counted(episode: Episode) -> None:
    listener, briefing = Listener(), episode.briefing
    session = Session(listener, briefing)
    rows = episode.rows["accel"]
    for part in (rows[:100], rows[200:300], rows[100:200], rows[300:400]):
        session.push("accel", part)
        session.estimate()
    kept = listener.rows("accel")
    assert (np.diff(kept[:, 0]) > 0).all()
    assert 80 <= session.dropped[LATE] <= 100
    now_s = [observation.now_s for observation in listener.observations]
    np.testing.assert_allclose(np.diff(now_s), briefing.period_s)  # a gap is given as observations without rows


def test_one_wrong_time_does_not_move_the_clock_and_a_real_gap_does(episode: Episode) -> None:
    session = Session(Listener(), episode.briefing)
    rows = episode.rows["accel"]
    session.push("accel", rows[:100])
    session.push("accel", rows[100:101] + np.eye(1, 4) * 500.0)
    session.estimate()
    assert session.now_s < rows[100, 0] and session.dropped[AHEAD] == 1
    later = rows[100:300] + np.eye(1, 4) * 60.0
    assert [session.push("accel", part) for part in (later[:100], later[100:])] == [0, 100]
    session.estimate()
    assert session.now_s > 60.0


def test_rows_that_cannot_be_meant_are_left_out(episode: Episode) -> None:
    session = Session(Listener(), episode.briefing)
    good = [0.1, 0.0, 0.0, 9.8]
    assert session.push("accel", [good, [np.nan, 0, 0, 9.8], [0.2, np.inf, 0, 9.8], [0.3, 1e300, 0, 9.8]]) == 1
    assert session.dropped[WRONG] == 3
    assert session.push("accel", []) == 0
    for wrong in ([[0.1, 2.0]], "rows", [[{}] * 4], [good, good[:2]], 3.0, [[[good]]]):
        with pytest.raises(RecordingError, match="push"):
            session.push("accel", wrong)
    with pytest.raises(PdrbenchError, match="accel"):
        session.push("acel", [good])


def test_an_answer_that_cannot_be_used_is_counted_and_the_one_before_stands(episode: Episode) -> None:
    class Odd(Listener):
        def step(self, observation: Observation) -> Estimate:
            answer = super().step(observation)
            return answer if len(self.observations) != 3 else None  # type: ignore[return-value]

    session = Session(Odd(), episode.briefing)
    session.push("accel", episode.rows["accel"][episode.rows["accel"][:, 0] < 0.39])
    answer = session.finish()
    assert answer is not None and answer.xy_m[0] == 2.0 and session.missing["nothing"] == 1
