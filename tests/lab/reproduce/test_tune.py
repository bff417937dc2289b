from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from pdrbench.errors import PdrbenchError
from pdrbench_lab.reproduce.tune import folds_of, grid, tune
from pdrbench_lab.speed.environment import made_up_task

ENV = "Folds-v1"
WALKS = [f"train-{i}" for i in range(7)]
SESSIONS = {walk: f"session {i // 2}" for i, walk in enumerate(WALKS)}
TASK = replace(made_up_task(), id=ENV, walks={"train": tuple(WALKS)}, units=SESSIONS, unit_kind="session")
# Error of each candidate on the walks of train: each of the first two is best on one half only.
ERRORS_M = {"a": [0, 0, 0, 0, 9, 9, 9], "b": [9, 9, 9, 9, 0, 0, 0], "c": [4, 4, 4, 4, 5, 5, 5]}


@pytest.fixture(autouse=True)
def made_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pdrbench_lab.reproduce.tune.make_task", lambda _: TASK)


def test_folds_are_whole_units_and_balanced() -> None:
    fold = folds_of(TASK, 2)
    assert list(fold) == WALKS
    assert [fold[walk] for walk in WALKS] == [0, 0, 1, 1, 0, 0, 1]
    assert len(set(folds_of(TASK, 4).values())) == 4
    with pytest.raises(PdrbenchError, match="has 4 units in train"):
        folds_of(TASK, 5)


def test_the_figure_is_that_of_walks_that_had_no_part_in_the_choice(monkeypatch: pytest.MonkeyPatch) -> None:
    """With the halves as folds, the candidate that is best on one half is the worst on the other."""
    monkeypatch.setattr("pdrbench_lab.reproduce.tune.evaluate", answered)
    monkeypatch.setattr(
        "pdrbench_lab.reproduce.tune.folds_of", lambda *_: dict(zip(WALKS, [0] * 4 + [1] * 3, strict=True))
    )
    found = tune("x", ENV, grid({"which": list(ERRORS_M)}), folds=2)
    assert found.chosen == (1, 0)  # without fold 0 it is b, without fold 1 it is a
    assert found.value == 9.0 and (found.left_out == 9.0).all()
    assert found.final == 0  # on all walks a has 27 / 7, b 36 / 7, c 31 / 7
    assert np.nanmean(found.values[found.final]) == pytest.approx(27 / 7)


def test_a_candidate_that_fails_everywhere_is_never_chosen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pdrbench_lab.reproduce.tune.evaluate", answered)
    assert tune("x", ENV, grid({"which": ["never", "c"]}), folds=2).chosen == (1, 1)
    with pytest.raises(PdrbenchError, match="no mean_m on the train split"):
        tune("x", ENV, grid({"which": ["never"]}), folds=2)
    with pytest.raises(PdrbenchError, match="not better when low or high"):
        tune("x", ENV, grid({"which": ["c"]}), folds=2, metric="n")


def answered(localizer: str, env: str, *, split: str) -> Any:
    assert (env, split) == (ENV, "train")
    errors_m = ERRORS_M.get(localizer.removeprefix("x?which="), [np.nan] * 7)
    units = [TASK.units[walk] for walk in WALKS]
    frame = pd.DataFrame({"walk": WALKS, "unit": units, "mean_m": np.array(errors_m, dtype=float), "n": 1.0})
    return SimpleNamespace(walks=lambda: frame.sample(frac=1, random_state=1), results=())


def test_a_grid_is_every_combination_or_some_of_them() -> None:
    every = grid({"a": [1, 2, 3], "b": [True, False]})
    assert len(every) == 6
    some = grid({"a": [1, 2, 3], "b": [True, False]}, most=4)
    assert len(some) == 4 and all(of in every for of in some) and some == grid({"a": [1, 2, 3], "b": [True, False]}, 4)
