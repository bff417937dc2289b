"""The offline division: a past that a localizer revises when the walk is over, from its score to its table row."""

from __future__ import annotations

import dataclasses
import re
import textwrap
from pathlib import Path

import numpy as np
import pytest

from pdrbench.errors import ResultError
from pdrbench.evaluation import Results, evaluate, load_results, retrace
from pdrbench.process import Budget
from pdrbench.result import Result, by_division

NUM_ANSWERS = 13  # of a walk along the corridor, a second apart; a stride at each but the first
TOY = """
    import os
    import time

    import numpy as np
    from pdrbench import Estimate
    from pdrbench.errors import UnsuitableError


    class Plain:
        '''Says nothing but the origin, and notes every walk that it begins.'''

        def reset(self, briefing, rng):
            self.rows = [[0.0, 0.0, 0.0, 0.0]]
            if "CORRIDOR_COUNTER" in os.environ:
                with open(os.environ["CORRIDOR_COUNTER"], "a") as file:
                    file.write("walk\\n")

        def step(self, observation):
            for t_s, length_m in observation["stride"]:
                self.rows.append([t_s, self.rows[-1][1] + length_m, 0.0, 0.0])
            return Estimate(np.zeros(2), 0, heading_rad=0.25, sigma_m=7.0, converged=True)


    class Smooth(Plain):
        '''Knows it all when the walk is over, but for a shift; `from_s` is where its revised past begins.'''

        def __init__(self, shift_m=(0.0, 0.0), from_s=0.0):
            self.shift_m, self.from_s = shift_m, from_s

        def revise(self):
            track = np.array(self.rows) + [0.0, *self.shift_m, 0.0]
            return track[track[:, 0] >= self.from_s]


    class Silent(Smooth):
        def step(self, observation):
            super().step(observation)


    class Breaks(Plain):
        '''Goes wrong, or gives nothing, in a way to choose.'''

        def __init__(self, how):
            self.how = how

        def revise(self):
            track = np.array(self.rows)
            if self.how == "nothing at all":
                return None
            if self.how == "no rows":
                return track[:0]
            if self.how == "raises":
                raise ZeroDivisionError("no past")
            if self.how == "declines":
                raise UnsuitableError("that one went badly")
            if self.how == "exits":
                raise SystemExit(3)
            if self.how == "hangs":
                time.sleep(3600)
            if self.how == "shape":
                return track[:, :3]
            if self.how == "text":
                return "the same as before"
            if self.how == "nan":
                track[4, 1] = np.nan
            if self.how == "level":
                track[5, 3] = 0.5
            if self.how == "order":
                track[6, 0] = track[5, 0]
            return track
"""


@pytest.fixture
def toy(tmp_path: Path) -> Path:
    path = tmp_path / "toy.py"
    path.write_text(textwrap.dedent(TOY))
    return path


def play(toy: Path, name: str, walks: int = 1, **parameters: object) -> Results:
    return evaluate(f"{toy}:{name}", "Corridor-v0", walks=walks, parameters=parameters, isolation="none", seeds=1)


def stride_m(result: Result) -> float:
    from pdrbench.registry import make_task

    return float(make_task("Corridor-v0").load(result.walk).streams["stride"].rows[0, 1])


def test_a_run_is_scored_as_it_was_answered_and_as_it_was_revised(toy: Path) -> None:
    plain, smooth, beside = (play(toy, "Plain"), play(toy, "Smooth"), play(toy, "Smooth", shift_m=[3.0, 4.0]))
    online_m = pytest.approx(6.5 * stride_m(plain.results[0]))
    assert [scored.scores["mean_m"] for scored in plain.scored] == [online_m]
    assert [result.division for result in smooth.results] == ["online", "offline"]
    assert smooth.scored[0].scores["mean_m"] == beside.scored[0].scores["mean_m"] == online_m
    assert smooth.scored[1].errors_m == pytest.approx(np.zeros(12), abs=1e-9)
    assert beside.scored[1].errors_m == pytest.approx(np.full(12, 5.0))
    assert np.isnan(plain.results[0].revise_s) and smooth.results[0].revise_s > 0
    assert plain.results[0].revised is None and smooth.results[0].estimates.xy_m.max() == 0.0


def test_answers_before_the_first_revised_row_stay(toy: Path) -> None:
    found = play(toy, "Smooth", from_s=5.0)
    estimates, stride = found.results[0].revised, stride_m(found.results[0])
    assert estimates is not None
    assert estimates.xy_m[:, 0] == pytest.approx([0.0] * 5 + [k * stride for k in range(5, NUM_ANSWERS)])
    np.testing.assert_array_equal(estimates.sigma_m, [7.0] * 5 + [np.nan] * 8)
    np.testing.assert_array_equal(estimates.heading_rad, [0.25] * 5 + [np.nan] * 8)
    np.testing.assert_array_equal(estimates.converged, [1.0] * 5 + [np.nan] * 8)


def test_an_answer_that_was_missing_is_no_longer_offline(toy: Path) -> None:
    online, offline = play(toy, "Silent", from_s=5.0).results
    assert (online.missing, offline.missing) == ({"nothing": NUM_ANSWERS}, {"not given": 5})
    assert offline.estimates.given.tolist() == [False] * 5 + [True] * 8


def test_walks_that_are_not_revised_count_offline_as_they_were_answered(toy: Path) -> None:
    """Where a localizer revises any walk of an environment."""
    revised, plain = play(toy, "Smooth").results[0], play(toy, "Plain").results[0]
    other = dataclasses.replace(plain, localizer=revised.localizer, walk="test-001")
    alone = by_division([plain, revised, other])
    assert [(result.walk[-1], result.division) for result in alone] == [
        *((walk, "online") for walk in "001"),
        *((walk, "offline") for walk in "01"),
    ]
    assert alone[-1].estimates is other.estimates


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ("raises", "ZeroDivisionError: no past"),
        ("declines", "UnsuitableError: that one went badly"),
        ("exits", "raised SystemExit: 3"),
        ("hangs", r"revise took longer than the .* s it had"),
        ("shape", r"columns t_s, x_m, y_m, level, sigma_m, heading_rad, or None; got the shape \(13, 3\)"),
        ("text", "got str"),
        ("nan", r"row 4 is not finite: \[4.0, nan"),
        ("level", "row 5 has a level that is no whole number"),
        ("order", r"row 6 is not later than the one before: \[5.0"),
    ],
)
def test_a_past_that_cannot_be_taken_is_a_failed_walk_scored_online(toy: Path, how: str, words: str) -> None:
    found = evaluate(
        f"{toy}:Breaks",
        "Corridor-v0",
        walks=1,
        parameters={"how": how},
        isolation="none",
        budget=Budget(start_s=1.0) if how == "hangs" else Budget(),
        seeds=1,
    )
    result = found.results[0]
    assert (result.status, result.division, len(result.estimates)) == ("failed", "online", NUM_ANSWERS)
    assert not np.isnan(result.reset_s) and np.isnan(result.revise_s)
    assert np.flatnonzero(result.estimates.xy_m).size == 0
    assert found.scored[0].scores["mean_m"] == pytest.approx(6.5 * stride_m(result))
    assert re.search(words, result.failure), result.failure
    assert "failed on 1 of 1 walks" in found.table() and "offline" not in found.table()


@pytest.mark.parametrize("how", ["nothing at all", "no rows"])
def test_a_localizer_that_revises_nothing_is_online(toy: Path, how: str) -> None:
    (result,) = play(toy, "Breaks", how=how).results
    assert (result.status, result.division) == ("complete", "online")


def test_tables_have_a_row_for_each_division(toy: Path) -> None:
    found = evaluate([f"{toy}:Plain", f"{toy}:Smooth"], "Corridor-v0", walks=2, isolation="none", seeds=1)
    rows = found.rows()
    names = [(row["localizer"].partition(":")[2], row["division"]) for row in rows]
    assert names == [("Plain", "online"), ("Smooth", "online"), ("Smooth", "offline")]
    times_s = [result.revise_s for result in found.results if result.division == "offline"]
    assert rows[2]["revise_s"] == pytest.approx(np.mean(times_s)) and rows[1]["revise_s"] is None
    assert [row["rank"] for row in rows] == [[1, 2], [1, 2], [1, 1]], "ranks are of a division"
    for text in (found.table(), found.to_markdown(), found.to_latex().replace(r"\_", "_")):
        assert f"{toy}:Smooth (offline)" in text and f"{toy}:Plain (offline)" not in text
        assert "offline: answers were revised when the walk was over, in " in text
    assert found.walks()["division"].tolist() == ["online"] * 4 + ["offline"] * 2
    assert set(found.to_frame().groupby(["localizer", "division"]).size().index) == {
        (f"{toy}:Plain", "online"),
        (f"{toy}:Smooth", "online"),
        (f"{toy}:Smooth", "offline"),
    }
    assert {place[2] for place in found.rankings} == {"online", "offline"}, "each is ranked by itself"


def test_a_sweep_resumes_and_a_folder_is_read_back(toy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CORRIDOR_COUNTER", str(tmp_path / "walks"))

    def sweep(walks: int) -> Results:
        return evaluate(f"{toy}:Smooth", "Corridor-v0", walks=walks, out=tmp_path / "out", isolation="none", seeds=1)

    first, both = sweep(1), sweep(2)
    assert (tmp_path / "walks").read_text().splitlines() == ["walk"] * 2, "the first walk is not computed again"
    assert [result.division for result in both.results] == ["online"] * 2 + ["offline"] * 2
    assert both.results[0].revise_s == first.results[0].revise_s
    assert load_results(tmp_path / "out").walks().equals(both.walks())


def test_a_replay_shows_the_revised_past_and_compares_it_with_the_stored_one(toy: Path) -> None:
    result = play(toy, "Smooth", from_s=5.0).results[1]
    frames = list(retrace(result, only=range(3, 8)))
    shown = [frame.estimate.xy_m.tolist() for frame in frames if frame.estimate is not None]
    assert shown == result.estimates.xy_m[3:8].tolist()
    xy_m = result.estimates.xy_m.copy()
    xy_m[7] += 1e-3
    spoilt = dataclasses.replace(result, estimates=dataclasses.replace(result.estimates, xy_m=xy_m))
    with pytest.raises(ResultError, match="from 7 s on"):
        list(retrace(spoilt))
