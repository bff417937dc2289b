"""What one localizer does to its process does not reach the next, and wrong arguments are told in one line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pdrbench.errors import PdrbenchError
from pdrbench.evaluation import evaluate

RUDE = """
import os
import numpy as np
from pdrbench.localizer import Estimate

class Rude:
    def reset(self, briefing, rng):
        np.seterr(all="raise")
        os.chdir("/")
    def step(self, observation):
        return Estimate(np.zeros(2), 0)
"""


def test_numeric_errors_and_folder_are_as_before_after_every_walk(tmp_path: Path) -> None:
    (tmp_path / "rude.py").write_text(RUDE)
    before = np.geterr(), Path.cwd()
    results = evaluate(f"{tmp_path / 'rude.py'}:Rude", "OfficeStride-v0", split="val", walks=2, isolation="none")
    assert [result.status for result in results.results] == ["complete", "complete"]
    assert (np.geterr(), Path.cwd()) == before
    assert Path.cwd() != Path("/")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"walks": "2"}, "walks is a whole number, at least 1; got '2'"),
        ({"seeds": 1.5}, "seeds is a whole number"),
        ({"jobs": 0}, "jobs is a whole number, at least 1; got 0"),
        ({"localizers": int}, "are named"),
        ({"localizers": []}, "at least one"),
    ],
)
def test_wrong_arguments_are_told(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(PdrbenchError, match=message):
        evaluate(**({"localizers": "stay-v0", "envs": "OfficeStride-v0"} | arguments))  # type: ignore[arg-type]


def test_an_unknown_paired_test_is_told() -> None:
    results = evaluate(["stay-v0", "dead_reckoning-v0"], "OfficeStride-v0", split="val", walks=1, isolation="none")
    with pytest.raises(PdrbenchError, match="no paired test named 't'"):
        results.pairs(test="t")
