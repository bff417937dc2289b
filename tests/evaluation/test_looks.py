from __future__ import annotations

import functools
import json
from collections.abc import Callable
from pathlib import Path

import pytest

from pdrbench.errors import PdrbenchError, ResultError
from pdrbench.evaluation import evaluate, load_results
from pdrbench.evaluation.looks import LEDGER, checked_looks, read_looks
from pdrbench.task import HELD_OUT

Spec = Callable[[str], str]
SEALED = "CorridorSealed-v0"


def look(localizer: str, out: Path, why: str = "final score", **parameters: float) -> list[object]:
    results = evaluate(
        localizer, SEALED, split="test", why=why, walks=2, out=out, isolation="none", parameters=parameters, seeds=1
    )
    return [result.provenance["look"] for result in results.results]


def test_a_sealed_environment_plays_val_unless_a_reason_is_given(localizer: Spec, tmp_path: Path) -> None:
    results = evaluate(localizer("Good"), [SEALED, "Corridor-v0"], walks=1, out=tmp_path, isolation="none", seeds=1)
    assert [result.split for result in results.results] == ["val", "test"]
    assert all("look" not in result.provenance for result in results.results)
    with pytest.raises(PdrbenchError, match=r"CorridorSealed-v0 is sealed: .*--folds 5.*--why"):
        evaluate(localizer("Good"), SEALED, split="test", walks=1, out=tmp_path, isolation="none", seeds=1)
    assert read_looks(tmp_path) == ()


def test_replays_of_a_sealed_test_split_are_looks(localizer: Spec, tmp_path: Path) -> None:
    replays = functools.partial(
        evaluate, localizer("Good"), SEALED, split=HELD_OUT, secret="c0ffee" * 8, walks=1, out=tmp_path
    )
    with pytest.raises(PdrbenchError, match=r"CorridorSealed-v0 is sealed"):
        replays(isolation="none")
    (result,) = replays(isolation="none", why="verified").results
    assert result.status == "complete" and result.provenance["look"]["count"] == 1  # type: ignore[index]
    assert [of.why for of in read_looks(tmp_path)] == ["verified"]


def test_looks_are_counted_by_code_and_parameters(localizer: Spec, tmp_path: Path) -> None:
    """The same again, or a run that goes on, shows nothing new; other parameters do."""
    first = look(localizer("Good"), tmp_path)
    assert [of["count"] for of in first] == [1, 1] and first[0]["why"] == "final score"  # type: ignore[index]
    look(localizer("Good"), tmp_path)
    assert [of.why for of in read_looks(tmp_path)] == ["final score"]
    assert look(localizer("Good"), tmp_path, "once more", noise_m=0.5)[0]["count"] == 2  # type: ignore[index]
    assert look(localizer("Worse"), tmp_path)[0]["count"] == 3  # type: ignore[index]
    looks = read_looks(tmp_path)
    assert [of.why for of in looks] == ["final score", "once more", "final score"]
    assert {of.package for of in looks} == {"strange_localizers.py"}
    shown = load_results(tmp_path).table()
    assert "look 3 of strange_localizers.py at the sealed test split of CorridorSealed-v0: final score" in shown


@pytest.mark.parametrize("change", ["reason", "order", "removed", "not json"])
def test_a_ledger_that_was_changed_is_refused(localizer: Spec, tmp_path: Path, change: str) -> None:
    for noise_m in (0.0, 0.5, 1.0):
        look(localizer("Good"), tmp_path, noise_m=noise_m)
    path = tmp_path / LEDGER
    lines = path.read_text().splitlines()
    assert len(lines) == 3
    changed = {
        "reason": [json.dumps({**json.loads(lines[0]), "why": "none"}, separators=(",", ":")), *lines[1:]],
        "order": [lines[0], lines[2], lines[1]],
        "removed": [lines[0], lines[2]],
        "not json": [lines[0], "{", *lines[1:]],
    }[change]
    path.write_text("\n".join(changed) + "\n")
    with pytest.raises(ResultError, match=f"{LEDGER}, line 2"):
        read_looks(tmp_path)
    with pytest.raises(ResultError, match=f"{LEDGER}, line 2"):
        look(localizer("Good"), tmp_path, noise_m=2.0)
    assert path.read_text().splitlines() == changed


@pytest.mark.parametrize("change", ["reason", "removed"])
def test_the_last_line_is_held_by_its_results(localizer: Spec, tmp_path: Path, change: str) -> None:
    for noise_m in (0.0, 0.5):
        look(localizer("Good"), tmp_path, noise_m=noise_m)
    assert len(checked_looks(tmp_path)) == 2
    path = tmp_path / LEDGER
    first, last = path.read_text().splitlines()
    path.write_text(first + "\n" + (last.replace("final score", "a slip") + "\n" if change == "reason" else ""))
    with pytest.raises(ResultError, match="the ledger was changed"):
        checked_looks(tmp_path)
