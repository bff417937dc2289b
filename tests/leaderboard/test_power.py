"""`pdrbench power`: what stored results say, for an environment and for a board of two."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from pdrbench import registry
from pdrbench.evaluation import evaluate
from pdrbench.registry import BOARDS_GROUP, PluginEntry
from pdrbench_leaderboard import power

ENV = "CampusStride-v1"


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four walks in four buildings, two localizers."""
    folder = tmp_path_factory.mktemp("stored")
    evaluate(["stay", "dead_reckoning"], ENV, split="val", walks=4, out=folder, isolation="none")
    return folder


@pytest.fixture
def board(monkeypatch: pytest.MonkeyPatch) -> None:
    def boards(root: object) -> dict[str, dict[str, int]]:
        return {"strides": {ENV: 200, "CampusFoot-v1": 200}}

    entries = registry.entries
    entry = PluginEntry("test", boards, "tests")
    monkeypatch.setattr(power, "entries", lambda group: {"test": entry} if group == BOARDS_GROUP else entries(group))
    monkeypatch.setattr(PluginEntry, "load", lambda self: self.target)


def test_an_environment_ranks_on_its_test_split(stored: Path, command: Any) -> None:
    (row,) = command("power", ENV, "--results", stored, "--json").json["rows"]
    assert (row["board"], row["env"], row["walks"], row["units"]) == (None, ENV, 100, 100)
    assert row["smallest_ratio"] > 1.05 and row["walks_for"]["1.1"] > row["walks_for"]["1.25"] > 1
    assert row["spread"]["unit"] > 0 and row["spread"]["seed"] == 0
    outcome = command("power", ENV, "--results", stored)
    assert f"{row['smallest_ratio']:.2f}" in outcome.out and "80 % power" in outcome.err


@pytest.mark.usefixtures("board")
def test_a_board_is_the_first_row_and_more_walks_tell_more(stored: Path, command: Any) -> None:
    outcome = command("power", "strides", "--results", stored, "--json")
    board, row = outcome.json["rows"]
    assert (board["board"], board["walks"], row["env"], row["walks"]) == ("strides", 200, ENV, 200)
    assert "left out: CampusFoot-v1: nothing was played of it" in outcome.err
    (alone,) = command("power", ENV, "--results", stored, "--json").json["rows"]
    assert row["smallest_ratio"] < alone["smallest_ratio"]


def test_what_cannot_be_measured_is_an_error(stored: Path, command: Any) -> None:
    assert "did you mean 'CampusStride-v1'" in command("power", "CampusStride-v2", "--results", stored).err
    assert "no results of CampusFoot-v1" in command("power", "CampusFoot-v1", "--results", stored).err
