"""`pdrbench reproduce`, with an installed reproduction from outside."""

from __future__ import annotations

import importlib
import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from pdrbench import registry
from pdrbench_lab.reproduce.number_text import three_digits

SOURCE = Path(__file__).parents[1] / "reproduce" / "plugin" / "toy_claims.py"


@pytest.fixture(autouse=True)
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A package that registers one reproduction that works and one whose experiment is missing; an empty folder."""
    site = tmp_path / "site"
    info = site / "toy-1.0.dist-info"
    info.mkdir(parents=True)
    shutil.copy(SOURCE, site)
    (site / "toy_tables.py").write_text(
        'REPRODUCTIONS = {"toy": "toy_claims:TOY", "gone": "toy_claims:GONE", "mistaken": "toy_claims:MISTAKEN"}\n'
    )
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: toy\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[pdrbench.reproductions]\nmine = toy_tables:REPRODUCTIONS\n")
    monkeypatch.syspath_prepend(str(site))
    monkeypatch.chdir(tmp_path)
    registry._scan.cache_clear()
    yield
    registry._scan.cache_clear()
    importlib.invalidate_caches()


def test_for_machines(command: Any, tmp_path: Path) -> None:
    outcome = command("reproduce", "toy", "--quick", "--json")
    assert outcome.code == 0
    assert list(outcome.json) == ["claims"]
    first = outcome.json["claims"][0]
    asked = ["id", "what", "paper", "ours", "low", "high", "gate", "pass"]
    assert list(first) == [*asked, "unit", "seeds", "failed", "note"]
    # 3 seeds: the median of 6.25, 7.25 and 8.25, and too few for an interval
    assert [first[key] for key in asked] == ["T1", "error, 75 %", "10 m", 7.25, None, None, "≤ 10 m", True]
    assert [claim["pass"] for claim in outcome.json["claims"]] == [True, False, True, None]
    folder = tmp_path / "pdrbench-results" / "reproduce" / "toy"
    assert json.loads((folder / "claims.json").read_text())["claims"] == outcome.json["claims"]
    assert (folder / "figures" / "errors.txt").exists() and "errors.txt" in outcome.err
    assert "4/4 measurements" in outcome.err


def test_for_people_and_with_a_gate_that_is_missed(command: Any, tmp_path: Path) -> None:
    outcome = command("reproduce", "toy", "--seeds", "7", "--no-figures", "--out", tmp_path / "out")
    assert outcome.code == 0 and "Journal of Closed Forms 1999" in outcome.out
    (line,) = [line for line in outcome.out.splitlines() if "error, 75 %" in line]
    assert all(cell in line for cell in ("T1", "10 m", "9.25 m", "6.25 m to 12.2 m", "≤ 10 m", "yes", "7"))
    (line,) = [line for line in outcome.out.splitlines() if "found" in line]
    assert three_digits(5 / 7, "share") in line and "shown" in line
    assert "3 of 3 gates hold" in outcome.err
    assert not (tmp_path / "out" / "toy" / "figures").exists()
    strict = command("reproduce", "toy", "--quick", "--no-figures", "--out", tmp_path / "out", "--strict")
    assert strict.code == 1 and strict.err.splitlines()[-1] == "pdrbench: gates missed: T1"


def test_unmeasured_or_undrawn_parts_are_no_success(
    command: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TOY_RAISES", "1")
    monkeypatch.setenv("TOY_NO_FIGURES", "1")
    outcome = command("reproduce", "toy", "--quick", "--json")
    assert outcome.code == 1 and outcome.json["claims"][0]["failed"] == 1, "the table is printed all the same"
    assert "steps, seed 1 failed: ZeroDivisionError: seed 1 fell over" in outcome.err and "no ink" in outcome.err
    outcome = command("reproduce", "toy", "--quick", "--no-figures")
    assert outcome.code == 1 and "2, 1 failed" in outcome.out
    assert "run it again to try what failed once more" in outcome.err.splitlines()[-1]
    outcome = command("reproduce", "mistaken", "--json")
    assert outcome.code == 1 and outcome.json["claims"][0]["ours"] is None
    assert "M1 (a mistake): LookupError" in outcome.err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("toi",), "did you mean 'toy'?"),
        (("gone",), "nowhere"),
        (("toy", "--out", "file/below"), "cannot make the folder"),
    ],
)
def test_one_line_says_what_is_wrong(arguments: tuple[str, ...], message: str, command: Any, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    outcome = command("reproduce", *arguments)
    assert outcome.code == 1 and outcome.out == "" and message in outcome.err and "Traceback" not in outcome.err


def test_wrong_usage(command: Any) -> None:
    assert command("reproduce", "toy", "--seeds", "0").code == 2


def test_reproductions_are_listed(command: Any) -> None:
    items = {item["id"]: item for item in command("reproduce", "--json").json["items"]}
    toy = items["toy"]
    assert (toy["package"], toy["claims"], toy["gates"]) == ("toy", 4, 3)
    assert toy["experiments"] == {"clock": 2, "steps": 8} and toy["figures"] and toy["broken"] is None
    assert "nowhere" in items["gone"]["broken"]
    outcome = command("reproduce")
    assert "Journal of Closed Forms" in outcome.out and "broken: gone: " in outcome.err
