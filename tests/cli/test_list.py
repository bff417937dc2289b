"""`pdrbench list`."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from pdrbench.datasets import datasets
from pdrbench.registry import environments, localizers

TWO_LISTS = """
from pdrbench.cli import main
try:
    main(["list", "localizers", "--json"])
except SystemExit:
    main(["list", "envs"])
"""
PROGRAM = [sys.executable, "-c", TWO_LISTS]


@pytest.fixture(autouse=True)
def no_data(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("PDRBENCH_DATA", raising=False)
    monkeypatch.setenv("PDRBENCH_CACHE", str(tmp_path / "cache"))


def test_environments_list_what_they_offer_and_what_is_missing_for_people_too(command: Any) -> None:
    items = {item["id"]: item for item in command("list", "envs", "--json").json["items"]}
    assert set(items) >= set(environments())
    office, mall = items["CampusStride-v1"], items["MallPhone-v2"]
    assert office["available"] and office["splits"]["test"] > 0 and office["start"] == "pose"
    assert "stride" in office["sensors"] and office["broken"] is None
    assert not mall["available"] and "pdrbench data fetch ilc20" in mall["missing"]
    assert mall["splits"] and mall["licence"] and mall["dataset"] == "ilc20_full"  # known without the data
    outcome = command("list", "envs")
    assert outcome.code == 0
    (line,) = [line for line in outcome.out.splitlines() if line.strip().startswith("CampusStride-v1")]
    assert "embedded" in line and "pose" in line
    assert "recorded data is missing: " in outcome.err and "ilc20_full" in outcome.err


@pytest.mark.parametrize(("what", "registered"), [("envs", environments), ("localizers", localizers)])
def test_what_is_registered_fits_on_a_screen(
    what: str, registered: Any, command: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    names = {name for name, entry in registered().items() if entry.package == "pdrbench"}
    outcome = command("list", what)
    lines = outcome.out.splitlines()
    assert all(len(line.rstrip()) <= 80 for line in lines)
    shown = [line.split()[0] for line in lines if line.strip()][2:]
    assert len(shown) == len(set(shown)) and names <= set(shown), "an item is a line, and no id is cut"
    of_others = len(shown) - len(names)
    assert len(lines) + len(outcome.err.splitlines()) - of_others <= 40


def test_localizers_describe_what_they_do_and_metrics_their_unit_and_direction(command: Any) -> None:
    items = {item["id"]: item for item in command("list", "localizers", "--json").json["items"]}
    assert set(items) >= set(localizers())
    assert items["oracle"]["is_told_the_truth"] and not items["stay"]["is_told_the_truth"]
    assert all(item["summary"] for item in items.values() if not item["broken"])
    assert items["stay"]["summary"][:30] in " ".join(command("list", "localizers").out.split())
    items = {item["id"]: item for item in command("list", "metrics", "--json").json["items"]}
    assert items["mean_m"]["unit"] == "m" and items["mean_m"]["better"] == "lower"
    assert items["level_hit_rate"]["better"] == "higher"
    assert "p75_level_penalised_m" in command("list", "metrics").out


@pytest.mark.parametrize("arguments", [("list", "datasets"), ("data", "list")])
def test_datasets_print_licence_and_folder(
    arguments: tuple[str, str], command: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps" / "x").write_text("")
    monkeypatch.setenv("PDRBENCH_DATA", str(tmp_path))
    items = {item["id"]: item for item in command(*arguments, "--json").json["items"]}
    assert set(items) == set(datasets())
    assert items["maps"]["folder"] == str(tmp_path / "maps")
    assert not items["ilc20"]["available"] and items["ilc20"]["fetchable"] and items["ilc20"]["licence"] == "MIT"
    assert items["foot_loops"]["how_to_get"]
    assert "CC-BY-4.0 AND ODbL-1.0" in command(*arguments).out


def test_broken_plugins_are_listed_as_broken_with_their_error(outside: Path) -> None:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(outside), os.environ.get("PYTHONPATH", "")])}
    outcome = subprocess.run(PROGRAM, capture_output=True, text=True, env=environment, timeout=120, check=True)
    items = {item["id"]: item for item in json.loads(outcome.stdout.partition("\n}\n")[0] + "}")["items"]}
    assert items["rusty-v0"]["package"] == "outside" and "rusted through" in items["rusty-v0"]["broken"]
    assert "outside_gone" in items["outside:gone"]["broken"]
    assert items["stay"]["broken"] is None
    assert "on import" in outcome.stderr  # what it printed
    (line,) = [line for line in outcome.stderr.splitlines() if line.startswith("broken: Rust-v0: ")]
    assert "rusted through" in line


@pytest.mark.parametrize("kind", ["metrics", "sensors", "formats", "datasets"])
def test_a_terminal_of_80_columns_breaks_no_word(kind: str, command: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    items = command("list", kind, "--json").json["items"]
    out = command("list", kind).out
    assert max(map(len, out.splitlines())) <= 80 and "…" not in out
    said = set(out.split())
    for item in items:
        assert item["id"] in said and {*item.get("summary", "").rstrip(".").split()} <= {*said, *map(_bare, said)}, item


def _bare(word: str) -> str:
    return word.rstrip(".;")
