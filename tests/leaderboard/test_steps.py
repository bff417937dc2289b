"""`leaderboard draw|play|score`: three steps with plain files between them, the middle one without anything secret."""

from __future__ import annotations

import dataclasses
import datetime
import hashlib
import re
import shutil
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from pdrbench.errors import BundleError
from pdrbench.evaluation import store
from pdrbench_leaderboard import leaderboard_command, record
from pdrbench_leaderboard.boards import Board
from pdrbench_leaderboard.play import read_played
from pdrbench_leaderboard.signing import new_key

from .conftest import ENV, SECRET

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="confinement is Linux's")


def call(*arguments: object) -> Result:
    return CliRunner().invoke(leaderboard_command.app, [str(argument) for argument in arguments])


@pytest.fixture(scope="module")
def drawn(toy_board: Board, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the first machine has drawn."""
    work = tmp_path_factory.mktemp("host") / "work"
    assert call("draw", "toy", "--work", work, "--walks", 4).exit_code == 0
    return work


@pytest.fixture(scope="module")
def answers(drawn: Path, submitted: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the second machine has played; it has nothing but observations."""
    there = tmp_path_factory.mktemp("player")
    shutil.copytree(drawn / "observations", there / "observations")
    assert not any(SECRET.encode() in path.read_bytes() for path in there.rglob("*") if path.is_file())
    played = call("play", there / "observations", "--localizer", f"{submitted}:Mine", "--out", there / "answers")
    assert played.exit_code == 0, played.output
    return there / "answers"


def test_an_entry_comes_out_of_three_steps(drawn: Path, answers: Path, mine: tuple[str, Path], tmp_path: Path) -> None:
    root, key = tmp_path / "leaderboards", tmp_path / "key"
    root.mkdir()
    (root / "keys.toml").write_text(new_key(key, "a maintainer", datetime.date(2026, 1, 1)))
    spec, card = mine
    scored = call("score", answers, "--localizer", spec, "--card", card, "--work", drawn, "--root", root, "--key", key)
    assert scored.exit_code == 0, scored.output
    folder = root / "toy" / "mine"
    entry, _ = record.read_entry(folder)
    assert [part.place for part in entry.parts] == [(ENV, "held-out"), (ENV, "public")]
    assert entry.parts[0].divisions[0].statuses == "cccc"
    assert entry.parts[0].canaries is not None and entry.parts[0].canaries.compared == 3
    assert (folder / record.SIGNATURE_FILE).is_file() and record.is_verified(folder, entry)


def test_what_was_not_confined_says_so_and_waits_for_a_person(
    drawn: Path, mine: tuple[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    spec, card = mine
    options = ("--localizer", spec, "--out", tmp_path / "answers", "--isolation", "process")
    played = call("play", drawn / "observations", *options)
    assert played.exit_code == 0 and "NOT CONFINED" in played.output
    root = tmp_path / "leaderboards"
    scored = call("score", tmp_path / "answers", "--localizer", spec, "--card", card, "--work", drawn, "--root", root)
    assert "HELD  mine: it was played as process" in scored.output
    assert not record.is_verified(root / "toy" / "mine", record.read_entry(root / "toy" / "mine")[0])
    monkeypatch.setenv("PDRBENCH_PRIVATE", str(tmp_path))
    assert "beside private walks" in str(call("play", drawn / "observations", *options).exception)


LIES = {
    "another walk": lambda result: dataclasses.replace(result, walk="0" * 16),
    "another environment": lambda result: dataclasses.replace(result, env="CampusFoot-v1"),
    "another seed": lambda result: dataclasses.replace(result, seed=7),
    "no provenance": lambda result: dataclasses.replace(result, provenance={}),
    "versions that are none": lambda result: dataclasses.replace(
        result, provenance={**result.provenance, "versions": {"../x": "a"}}
    ),
    "a localizer that is none": lambda result: dataclasses.replace(result, localizer=["x"]),
    "a failure that is none": lambda result: dataclasses.replace(result, failure=5),
    "a time that is none": lambda result: dataclasses.replace(
        result, provenance={**result.provenance, "child": {"cpu_s": "x"}}
    ),
    "answers of a later time": lambda result: dataclasses.replace(
        result, estimates=dataclasses.replace(result.estimates, t_s=result.estimates.t_s - 1.0)
    ),
}


def with_digest(body: bytes) -> bytes:
    return store.MAGIC + hashlib.sha256(body).hexdigest().encode() + b"\n" + body


@pytest.mark.parametrize("lie", [*LIES, "no header", "rows below none", "torn", "twice", "few"])
def test_answers_that_lie_are_refused(drawn: Path, answers: Path, tmp_path: Path, lie: str) -> None:
    observations, folder = drawn / "observations" / ENV / "public", tmp_path / "answers"
    shutil.copytree(answers / ENV / "public", folder)
    assert len(read_played(folder, observations)) == 4
    path = next(folder.glob(f"*{store.SUFFIX}"))
    content = path.read_bytes()
    if lie in LIES:
        content = store.encode(LIES[lie](store.load(path)))
    elif lie == "no header":
        content = with_digest(b"[1]\n")
    elif lie == "rows below none":
        content = with_digest(re.sub(rb'"rows":\d+', b'"rows":-1', content[len(store.MAGIC) + 65 :]))
    elif lie == "few":
        path = path.rename(tmp_path / "elsewhere")
    elif lie == "torn":
        content = content[:-5]
    else:
        path = folder / f"again{store.SUFFIX}"
    path.write_bytes(content)
    with pytest.raises(BundleError, match=r"holds no answers|a second time|answers 3 of 4 walks") as refused:
        read_played(folder, observations)
    assert str(refused.value).isprintable()
