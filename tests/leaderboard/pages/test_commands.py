"""`pdrbench leaderboard build` and `check` as they are typed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from pdrbench.cli import main
from pdrbench.errors import DatasetError


def run(*arguments: str | Path) -> int:
    """The exit status of a command."""
    with pytest.raises(SystemExit) as stop:
        main(["leaderboard", *map(str, arguments)])
    assert isinstance(stop.value.code, int)
    return stop.value.code


def test_build_writes_tables_and_the_site_and_check_agrees(
    folder: Any, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    site = tmp_path / "site"
    assert run("build", "--root", folder.root, "--out", site) == 0
    assert f"2 entries, 1 leaderboards; open {site / 'index.html'}" in capfd.readouterr().out
    assert (site / "Corridor-v0" / "entries" / "far.html").is_file()
    assert run("check", "--root", folder.root) == 0
    assert capfd.readouterr().out == "3 of 3 checks passed\n"


def test_check_exits_1_and_names_the_entry(folder: Any, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    run("build", "--root", folder.root, "--out", tmp_path / "site")
    table = folder.root / "Corridor-v0" / "TABLE.md"
    table.write_text(table.read_text().replace("| 2 | `far`", "| 1 | `far`"))
    capfd.readouterr()
    assert run("check", "--root", folder.root) == 1
    assert "FAIL  Corridor-v0/TABLE.md: `far` is not what the estimates give" in capfd.readouterr().out
    assert run("check", "--root", folder.root, "--json") == 1
    checks = json.loads(capfd.readouterr().out)["checks"]
    assert [check["pass"] for check in checks] == [True, True, False]


def test_build_prints_as_json_what_it_wrote_and_what_it_left_out(
    folder: Any, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert run("build", "--root", folder.root, "--out", tmp_path / "site", "--json") == 0
    printed = json.loads(capfd.readouterr().out)
    assert printed["boards"] == [{"env": "Corridor-v0", "entries": 2, "first": "near"}] and printed["absent"] == {}
    for name in folder.entries:
        folder.entries[name] = DatasetError("ilc20 is missing")
    assert run("build", "--root", folder.root, "--out", tmp_path / "site") == 0
    assert "left out Corridor-v0: ilc20 is missing" in capfd.readouterr().err


def test_without_entries_there_is_a_page_that_says_so(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    site = tmp_path / "site"
    assert run("build", "--root", tmp_path, "--out", site) == 0
    assert "There are no entries yet" in (site / "index.html").read_text()
    assert run("check", "--root", tmp_path) == 0
    assert capfd.readouterr().out.endswith("0 of 0 checks passed\n")
