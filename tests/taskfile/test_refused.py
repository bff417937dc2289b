"""A recording that a reader refuses is one failed walk with the reason; everything beside it is played and scored."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pdrbench
from pdrbench.errors import PdrbenchError, RecordingError

GOOD = ("first", "second")
REASONS = {
    "in_g": "it looks like g: state the unit, or multiply by 9.80665",
    "no_numbers": "no row of any sensor",
    "no_place": "has neither a start nor a place",
    "empty": "the file is empty",
    "noise": "the file is damaged",
    "bad_truth": "level",
}
COLUMNS = 'time = "t_s"\ntime_unit = "s"\naccel = ["ax", "ay", "az"]\ngyro = ["gx", "gy", "gz"]\n'


def write_walk(folder: Path, name: str, factor: float = 1.0, truth: str = "0,0,0,0\n20,15,0,0\n50,40,0,0\n") -> None:
    t_s = np.arange(0.0, 60.0, 0.02)
    bounce = 2.5 * np.sin(2 * np.pi * 1.9 * t_s)
    force = factor * np.column_stack([0.3 * bounce, 0 * t_s, 9.81 + bounce])
    turns = factor * np.column_stack([0.1 * bounce, 0 * t_s, 0.05 * bounce])
    rows = np.column_stack([t_s, force, turns])
    np.savetxt(folder / f"{name}.csv", rows, "%.6f", ",", header="t_s,ax,ay,az,gx,gy,gz", comments="")
    if truth:
        (folder / f"{name}_truth.csv").write_text(f"t_s,x_m,y_m,level\n{truth}")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two good walks and six that are refused."""
    folder = tmp_path / "house"
    folder.mkdir()
    for name in GOOD:
        write_walk(folder, name)
    write_walk(folder, "in_g", 1 / 9.80665)
    write_walk(folder, "no_numbers", np.nan)
    write_walk(folder, "no_place", truth="")
    write_walk(folder, "bad_truth", truth="0,0,0,cellar\n")
    (folder / "empty.csv").write_bytes(b"")
    (folder / "noise.csv").write_bytes(np.random.default_rng(0).bytes(4000))
    (folder / "columns.toml").write_text(COLUMNS)
    names = [GOOD[0], *REASONS, GOOD[1]]
    tables = "".join(f'[[walk]]\nfile = "{name}.csv"\nmounting = "hand"\n' for name in names)
    (folder / "task.toml").write_text('columns = "columns.toml"\n' + tables)
    return folder


def test_a_refused_recording_is_one_failed_walk(folder: Path) -> None:
    results = pdrbench.evaluate("dead_reckoning", str(folder), isolation="none", seeds=1)
    status = {result.walk: (result.status, result.failure) for result in results.results}
    assert {name: status[name][0] for name in GOOD} == dict.fromkeys(GOOD, "complete")
    for name, reason in REASONS.items():
        assert status[name][0] == "failed"
        assert reason in status[name][1]
    (row,) = results.rows()
    assert (row["walks"], row["failed"], row["metrics"]["mean_m"]["n"]) == (2, 6, 2)
    assert row["metrics"]["mean_m"]["value"] > 1.0
    assert "in_g is refused" in row["note"]


def test_a_mended_recording_is_played_by_the_next_run(folder: Path) -> None:
    def played() -> dict[str, str]:
        found = pdrbench.evaluate("stay", str(folder), isolation="none", out=folder.parent / "results", seeds=1)
        return {result.walk: result.status for result in found.results}

    assert played()["empty"] == "failed"
    write_walk(folder, "empty")
    again = played()
    assert (again["empty"], again["in_g"]) == ("complete", "failed")


@pytest.mark.usefixtures("one_figure")
def test_compare_and_try_go_on(folder: Path, command: Any) -> None:
    options = ("--localizer", "stay", "--isolation", "none", "--out", folder.parent / "compared", "--json")
    found = command("compare", "--env", folder, *options)
    assert found.code == 0, found.err
    assert found.json["rows"][0]["failed"] == len(REASONS)
    files = [folder / f"{name}.csv" for name in ("first", "in_g", "empty", "noise")]
    options = ("--columns", folder / "columns.toml", "--localizer", "dead_reckoning", "--isolation", "none")
    tried = command("try", *files, *options, "--out", folder.parent / "tried", "--json")
    assert tried.code == 0
    assert [path["walk"] for path in tried.json["paths"]] == ["first"]
    assert "the walk is refused" in tried.json["failed"]["dead_reckoning"]


def test_a_folder_of_which_nothing_can_be_read_and_a_file_that_is_missing_are_errors(folder: Path) -> None:
    tables = "".join(f'[[walk]]\nfile = "{name}.csv"\n' for name in REASONS)
    (folder / "task.toml").write_text('columns = "columns.toml"\n' + tables)
    with pytest.raises(RecordingError, match="neither a start nor a place"):
        pdrbench.evaluate("stay", str(folder), isolation="none", seeds=1)
    (folder / "task.toml").write_text('[[walk]]\nfile = "first.csv"\n[[walk]]\nfile = "third.csv"\n')
    with pytest.raises(RecordingError, match=r"third\.csv"):
        pdrbench.evaluate("stay", str(folder), isolation="none", seeds=1)


def test_a_recording_that_breaks_while_a_sweep_goes_on_fails_alone(folder: Path) -> None:
    task = pdrbench.make_task(str(folder))
    write_walk(folder, "second", 1 / 9.80665)
    with pytest.raises(RecordingError, match="looks like g"):
        task.load("second")
    assert len(task.load("first").streams) >= 2


@pytest.mark.parametrize(
    ("table", "where"),
    [
        ('[[walk]]\nfile = "a\\u0000.csv"\n', "walk (number 1).file"),
        ('[[walk]]\nfile = "a.csv"\nstart = {xy_m = [inf, 0.0]}\n', "start.xy_m"),
        ('[plan]\nfile = "a.geojson"\nalign = {turn_deg = nan}\n', "plan.align.turn_deg"),
    ],
)
def test_numbers_without_end_and_names_that_no_system_has_are_refused(tmp_path: Path, table: str, where: str) -> None:
    (tmp_path / "task.toml").write_text(table)
    with pytest.raises(PdrbenchError, match=re.escape(where)):
        pdrbench.make_task(str(tmp_path))
