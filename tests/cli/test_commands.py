"""The commands on the real rooms below them."""

from __future__ import annotations

import dataclasses
import json
import textwrap
from pathlib import Path
from typing import Any

import pytest

from pdrbench.process import Budget
from pdrbench.registry import make_task
from pdrbench_leaderboard.confine.landlock import Ruleset

MINE = """
    from pdrbench import Estimate


    class Mine:
        def reset(self, briefing, rng):
            print("hello")
            self.start = briefing.start

        def step(self, observation):
            return Estimate(xy_m=self.start.xy_m, level=self.start.level)


    class Crashing(Mine):
        def step(self, observation):
            raise ValueError("no step")


    class Hanging(Mine):
        def step(self, observation):
            while observation.now_s > 0:
                pass
            return super().step(observation)


    class Leaving(Mine):
        def step(self, observation):
            import os

            os._exit(0)


    class Interrupting(Mine):
        def step(self, observation):
            raise KeyboardInterrupt
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One for all: processes that were started in another folder are not used again; new ones take seconds."""
    made = tmp_path_factory.mktemp("commands")
    (made / "mine.py").write_text(textwrap.dedent(MINE))
    return made


@pytest.fixture(autouse=True)
def place(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(folder)
    return folder


@pytest.mark.usefixtures("one_figure")
def test_compare_writes_tables_and_plots_and_reuses_its_walks(command: Any, place: Path) -> None:
    arguments = ["--env", "CampusStride-v1", "--walks", 2, "--localizer", "stay", "--localizer", "mine.py:Mine"]
    outcome = command("compare", *arguments, "--json")
    assert outcome.code == 0
    rows = {row["localizer"]: row for row in outcome.json["rows"]}
    assert set(rows) == {"stay", "mine.py:Mine"}
    metrics = rows["stay"]["metrics"]
    assert metrics["mean_m"]["unit"] == "m" and metrics["mean_m"]["value"] > 1 and rows["stay"]["walks"] == 2
    assert metrics["mean_m"] == rows["mine.py:Mine"]["metrics"]["mean_m"]  # both stay
    assert metrics["mean_m"]["low"] is None  # no interval from two walks
    for name in ("table.md", "table.tex", "table.csv", "CampusStride-v1-cdf.png"):
        assert (place / "pdrbench-results" / name).stat().st_size > 0
    stored = {path: path.stat().st_mtime_ns for path in (place / "pdrbench-results/results").glob("*.result")}
    assert len(stored) == 4
    again = command("compare", *arguments)
    assert again.code == 0 and "CampusStride-v1, test split, 2 walks" in again.out and "mine.py:Mine" in again.out
    assert {path: path.stat().st_mtime_ns for path in stored} == stored

    plotted = command("plot", "pdrbench-results", "--out", "again", "--json")
    assert plotted.code == 0 and "again/CampusStride-v1-cdf.png" in plotted.json["files"]
    assert all((place / file).stat().st_size > 0 for file in plotted.json["files"])


def test_run_reports_a_crash_with_its_traceback(command: Any) -> None:
    outcome = command("run", "mine.py:Crashing", "CampusStride-v1", "--walks", 1, "--json")
    (row,) = outcome.json["rows"]
    assert (outcome.code, row["walks"], row["of"]) == (1, 0, 1)
    assert "ValueError: no step" in outcome.err


def test_the_oracle_does_not_run_on_a_test_split(command: Any) -> None:
    outcome = command("run", "oracle", "CampusStride-v1", "--walks", 1)
    assert (outcome.code, outcome.out) == (1, "")
    assert "pdrbench: oracle does not suit CampusStride-v1: " in outcome.err


def test_check_fails_localizers_that_break_the_rules_or_exit_on_import(command: Any, place: Path) -> None:
    outcome = command("check", "localizer", "mine.py:Crashing")
    assert outcome.code == 1 and "FAIL" in outcome.out and "checks passed" in outcome.out
    (place / "leaves.py").write_text("import sys\nsys.exit(0)\n")
    outcome = command("check", "localizer", "leaves.py:Mine")
    assert outcome.code == 1 and "leaves.py cannot be loaded: SystemExit" in outcome.err + outcome.out


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("Hanging", "timeout: step 2 took longer than"),
        ("Leaving", "ended with exit code (0)"),
        ("Interrupting", "KeyboardInterrupt"),
    ],
)
def test_check_survives_localizers_that_end_or_block_its_process(
    name: str, why: str, command: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pdrbench.cli.process_check.BUDGET", Budget(pace=0.5, slack_s=0.0, start_s=10.0))
    outcome = command("check", "localizer", f"mine.py:{name}", "--json")
    found = {check["name"]: check for check in outcome.json["checks"]}
    assert outcome.code == 1 and why in found["answers every observation"]["why"]


STRANGER = """
    from pathlib import Path

    class Snoops:
        def reset(self, briefing, rng):
            pass

        def step(self, observation):
            raise ValueError(Path({secret!r}).read_text())
"""


@pytest.mark.confinement
def test_check_confines_a_stranger_as_run_does(command: Any, place: Path) -> None:
    (place / "secret.txt").write_text("the combination is 4711")
    (place / "stranger.py").write_text(textwrap.dedent(STRANGER).format(secret=str(place / "secret.txt")))
    outcome = command("check", "localizer", "stranger.py:Snoops", "--confined", "--json")
    assert outcome.code == 1
    try:
        Ruleset()
    except OSError as error:
        pytest.skip(f"no Landlock here: {error}")
    assert "4711" not in json.dumps(outcome.json) and "PermissionError" in json.dumps(outcome.json)


def test_run_prints_the_warning_of_an_environment(command: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    task = dataclasses.replace(make_task("CampusStride-v1"), note="not the registered data")
    for module in ("registry", "cli.list", "evaluation.rows"):
        monkeypatch.setattr(f"pdrbench.{module}.make_task", lambda name, secret=None: task)
    outcome = command("run", "stay", "CampusStride-v1", "--walks", 1)
    assert outcome.code == 0 and "CampusStride-v1: not the registered data" in outcome.err.splitlines()
    assert "CampusFoot-v1: not the registered data" in command("list", "envs").err.splitlines()
