"""Walks played once more: bit-equal estimates, the localizer's debug values, and errors."""

from __future__ import annotations

import dataclasses
import textwrap
from pathlib import Path

import numpy as np
import pytest

from pdrbench.errors import ResultError
from pdrbench.evaluation import evaluate, retrace
from pdrbench.result import Result

TOY = """
    import numpy as np
    from pdrbench import Estimate
    from pdrbench.errors import UnsuitableError


    class Plain:
        def __init__(self, spread_m=0.5):
            self.spread_m = spread_m

        def reset(self, briefing, rng):
            self.rng, self.x_m, self.count = rng, 0.0, 0

        def step(self, observation):
            self.count += 1
            self.x_m += observation["stride"][:, 1].sum()
            self.cloud_m = [self.x_m, 0.0] + self.spread_m * self.rng.standard_normal((30, 2))
            return Estimate(self.cloud_m.mean(axis=0), 0, sigma_m=self.spread_m, converged=self.count > 3)


    class Toy(Plain):
        def reset(self, briefing, rng):
            super().reset(briefing, rng)
            self.shown = 0

        def debug(self):
            self.shown += 1
            return {"particles_xy_m": self.cloud_m, "shown": np.array(self.shown)}


    class Silent(Toy):
        def step(self, observation):
            answer = super().step(observation)
            return None if self.count % 2 else answer


    class Crashing(Toy):
        def step(self, observation):
            if self.count == 5:
                raise ValueError("no sixth step")
            return super().step(observation)


    class Declining(Toy):
        def reset(self, briefing, rng):
            raise UnsuitableError("nothing suits it")


    class Broken(Toy):
        def reset(self, briefing, rng):
            raise ValueError("no walk")
"""


@pytest.fixture
def toy(tmp_path: Path) -> Path:
    path = tmp_path / "toy.py"
    path.write_text(textwrap.dedent(TOY))
    return path


def play(toy: Path, name: str, split: str = "val", **parameters: float) -> Result:
    """The second of two seeds, so that a seed that is not handed on shows."""
    found = evaluate(
        f"{toy}:{name}", "Corridor-v0", split=split, seeds=2, walks=1, parameters=parameters, isolation="none"
    )
    return found.results[-1]


@pytest.mark.parametrize("name", ["Toy", "Silent", "Plain"])
def test_every_answer_is_the_stored_one(toy: Path, name: str) -> None:
    result = play(toy, name, spread_m=0.25)
    frames = list(retrace(result))
    assert [frame.index for frame in frames] == list(range(13))
    assert [frame.now_s for frame in frames] == result.estimates.t_s.tolist()
    for frame, xy_m, given in zip(frames, result.estimates.xy_m, result.estimates.given, strict=True):
        assert (frame.estimate is not None) == given
        if frame.estimate is not None:
            np.testing.assert_allclose(frame.estimate.xy_m, xy_m, rtol=0, atol=0.5001e-4)
            assert frame.estimate.sigma_m == 0.25


def test_frames_show_what_the_localizer_shows(toy: Path) -> None:
    for frame in retrace(play(toy, "Toy")):
        assert frame.estimate is not None
        np.testing.assert_array_equal(frame.debug["particles_xy_m"].mean(axis=0), frame.estimate.xy_m)
        assert frame.debug["shown"] == frame.index + 1
    assert all(not frame.debug for frame in retrace(play(toy, "Plain")))


def test_only_the_requested_frames_are_shown_and_all_are_compared(toy: Path) -> None:
    result = play(toy, "Toy")
    frames = list(retrace(result, only=range(1, 13, 4)))
    assert [(frame.index, int(frame.debug["shown"])) for frame in frames] == [(1, 1), (5, 2), (9, 3)]
    xy_m = result.estimates.xy_m.copy()
    xy_m[2] += 1e-3
    spoilt = dataclasses.replace(result, estimates=dataclasses.replace(result.estimates, xy_m=xy_m))
    with pytest.raises(ResultError, match=r"from 2 s on"):
        list(retrace(spoilt, only=(9,)))


def test_a_walk_is_retraced_to_where_it_failed_and_given_the_truth_that_it_was_given(toy: Path) -> None:
    result = play(toy, "Crashing")
    assert result.status == "failed"
    assert len(list(retrace(result))) == len(result.estimates) == 5
    result = evaluate("oracle", "Corridor-v0", split="val", walks=1, isolation="none", seeds=1).results[0]
    assert len(list(retrace(result))) == len(result.estimates) == 13
    with pytest.raises(ResultError, match=r"from 0 s on; the sources are the same"):
        list(retrace(dataclasses.replace(play(toy, "Toy"), seed=7)))


def test_changed_code_is_reported_with_the_time_and_the_cause(toy: Path) -> None:
    result = play(toy, "Toy")
    toy.write_text(toy.read_text().replace("converged=self.count > 3", "converged=self.count > 4"))
    frames = retrace(result)
    assert [next(frames).index for _ in range(3)] == [0, 1, 2]
    with pytest.raises(ResultError, match=r"val-0.*not the stored ones from 3 s on; .*: localizer; run the walk again"):
        next(frames)
    with pytest.warns(UserWarning, match="from 3 s on") as caught:
        assert len(list(retrace(result, strict=False))) == 13
    assert len(caught) == 1


@pytest.mark.parametrize(
    ("name", "message"),
    [("Declining", "declined the walk.*nothing suits it"), ("Broken", "nothing was answered before it failed")],
)
def test_walks_that_cannot_be_replayed_are_errors(toy: Path, name: str, message: str) -> None:
    with pytest.raises(ResultError, match=message):
        next(retrace(play(toy, name)))
