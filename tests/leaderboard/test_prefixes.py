"""Beginnings of walks as canaries."""

from __future__ import annotations

import dataclasses
import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pdrbench.episode import Episode
from pdrbench.errors import RecordingError, ResultError
from pdrbench.evaluation.process_run import play_in_child
from pdrbench.evaluation.walk_job import plan_walks
from pdrbench.process import Budget
from pdrbench.registry import make_task
from pdrbench.result import Result
from pdrbench_leaderboard.prefixes import check_prefixes

ENV = "Toy-v1"
SOURCE = """
import numpy as np

from pdrbench import Estimate


class Honest:
    def reset(self, briefing, rng):
        self.rng = rng
        self.end_s = briefing.subject.get("end_s", 0.0)

    def step(self, observation):
        self.now_s = observation.now_s
        return self.answer()

    def answer(self):
        return Estimate(self.rng.normal(size=2), 0)


class Peeks(Honest):
    def answer(self):  # looks back from the end of the walk, which it was told one way or another
        return Estimate(np.array([float(self.end_s - self.now_s < 5.0), 0.0]), 0)


class Revises(Honest):
    def revise(self):
        return np.array([[0.0, 7.0, 7.0, 0.0]])


class Breaks(Honest):
    def answer(self):
        if self.now_s > 20.0:
            raise RuntimeError("lost")
        return super().answer()


class Limited(Honest):
    def answer(self):
        import resource

        names = sorted(name for name in dir(resource) if name.startswith("RLIMIT_"))
        limits = [float(limit) for name in names for limit in resource.getrlimit(getattr(resource, name))]
        return Estimate(np.array([hash(tuple(limits)) % 10**9, limits[0]]), 0)


class Declines(Honest):
    def reset(self, briefing, rng):
        from pdrbench.errors import UnsuitableError

        raise UnsuitableError("not today")
"""


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("canaries") / "mine.py"
    path.write_text(SOURCE)
    return path


def whole(spec: str, nonce: str = "", walk: int = 0) -> Result:
    """The result of a walk that this process plays, so that a test can leak something into it."""
    budget = Budget(start_s=60.0)
    jobs = plan_walks(
        {ENV: [spec]}, split="test", seeds=[2], walks=4, parameters={}, budget=budget, isolation="confined", nonce=nonce
    )
    return play_in_child(jobs[walk], {}, io.BytesIO())


@pytest.mark.parametrize("name", ["Revises", "Breaks"])
def test_a_localizer_that_knows_no_future_answers_beginnings_as_the_whole(file: Path, name: str) -> None:
    result = whole(f"{file}:{name}", nonce="5" * 32)
    assert (result.revised is not None) == (name == "Revises")
    found = check_prefixes(result, np.random.default_rng(0), num_prefixes=2)
    assert found.difference is None
    assert len(set(found.lengths)) == 2
    assert all(1 <= length < len(result.estimates) for length in found.lengths)


def test_one_that_knows_when_the_walk_ends_is_found(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def leaking(self: Episode) -> Any:
        briefing = self.task.brief(self.recording)
        return dataclasses.replace(briefing, subject={"end_s": float(self.now_s[-1])})

    monkeypatch.setattr(Episode, "briefing", property(leaking))
    result = whole(f"{file}:Peeks")
    found = check_prefixes(result, np.random.default_rng(1), num_prefixes=1)
    (length,) = found.lengths
    difference = found.difference
    assert difference is not None
    assert difference.length == length
    assert (difference.whole[0], difference.prefix[0]) == (0.0, 1.0)
    assert result.estimates.t_s[length - 1] - difference.now_s < 5.0
    assert f"of {length} observations" in str(difference)


def test_no_limit_of_a_process_tells_how_long_the_walk_is(file: Path) -> None:
    first, second = (whole(f"{file}:Limited", walk=walk) for walk in (0, 1))
    assert len(first.estimates) != len(second.estimates)
    assert (first.estimates.xy_m[0] == second.estimates.xy_m[0]).all()


def test_what_cannot_be_compared_is_an_error(file: Path) -> None:
    rng = np.random.default_rng(0)
    with pytest.raises(ResultError, match="declined"):
        check_prefixes(whole(f"{file}:Declines"), rng)
    changed = file.with_name("changed.py")
    changed.write_text(SOURCE + "# and more")
    with pytest.raises(ResultError, match="sources"):
        check_prefixes(dataclasses.replace(whole(f"{file}:Honest"), localizer=f"{changed}:Honest"), rng)


def test_a_beginning_is_handed_out_as_the_whole_is_and_ends_earlier() -> None:
    task = make_task("CampusStride-v1")
    episode = Episode(task.load(task.split("train")[0]), task)
    beginning = episode.prefix(7)
    assert (len(beginning), len(episode.fresh())) == (7, len(episode))
    for _ in range(7):
        first, second = beginning.observe(), episode.observe()
        assert first.now_s == second.now_s
        assert all((first[name] == second[name]).all() for name in second.rows)
        beginning.submit(None)
        episode.submit(None)
    assert beginning.done
    assert max(len(rows) and rows[-1, 0] for rows in beginning.rows.values()) <= first.now_s + 1e-6
    for length in (0, len(episode) + 1):
        with pytest.raises(RecordingError, match="no beginning"):
            episode.prefix(length)
