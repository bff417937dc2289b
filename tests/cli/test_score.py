"""`pdrbench score`: tracks that another program made, against a table of places or a walk of an environment."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pdrbench.errors import RecordingError
from pdrbench.trajectory import Estimates
from pdrbench_formats.commands.score import read_track
from pdrbench_formats.export import write_path

T_S = np.arange(0.0, 120.0)
XY_M = np.column_stack([20 * np.sin(T_S / 9), 12 * np.cos(T_S / 5)])


def table(path: Path, header: str, rows: Any, delimiter: str = ",") -> Path:
    np.savetxt(path, rows, fmt="%.4f", delimiter=delimiter, header=header, comments="")
    return path


def written(folder: Path, kind: str, xy_m: Any) -> Path:
    if kind == "own csv":  # every second answer is missing, as `convert` writes them
        level = np.tile([0.0, np.nan], len(T_S))
        nothing, twice_m = 0 * level + np.nan, np.repeat(xy_m, 2, axis=0) + level[:, None]
        write_path(folder / "a.csv", Estimates(np.arange(0.0, 120.0, 0.5), twice_m, level, nothing, nothing, nothing))
        return folder / "a.csv"
    if kind == "csv":
        return table(folder / "mine.csv", "t_s,x_m,y_m", np.column_stack([T_S, xy_m]))
    if kind == "tum":
        rows = np.column_stack([T_S, xy_m, 0 * T_S, 0 * T_S, 0 * T_S, 0 * T_S, 1 + 0 * T_S])
        return table(folder / "mine.tum", "# timestamp tx ty tz qx qy qz qw", rows, " ")
    from scipy.io import savemat

    content = {"t": T_S, "x": xy_m[:, 0], "y": xy_m[:, 1]}
    savemat(folder / "mine.mat", {"track": np.column_stack([T_S, xy_m])} if kind == "matrix" else content)
    return folder / "mine.mat"


@pytest.mark.parametrize("kind", ["csv", "own csv", "tum", "matrix", "vectors"])
def test_a_constant_offset_is_what_it_is(command: Any, tmp_path: Path, kind: str) -> None:
    truth = table(tmp_path / "truth.csv", "t_s;x_m;y_m", np.column_stack([T_S, XY_M]), ";")
    found = command("score", written(tmp_path, kind, XY_M + 5.0), "--truth", truth, "--json").json
    assert found["scores"]["mean_m"] == pytest.approx(5 * np.sqrt(2), abs=1e-3)
    assert found["scores"]["ate_se2_aligned_m"] == pytest.approx(0.0, abs=1e-3) and found["lag_s"] == 0.0


def test_places_that_are_late_are_noticed_and_moved(command: Any, tmp_path: Path) -> None:
    truth = table(tmp_path / "truth.csv", "t_s,x_m,y_m", np.column_stack([T_S + 7.5, XY_M]))
    mine = written(tmp_path, "csv", XY_M)
    assert "--truth-offset -7.5 moves them" in command("score", mine, "--truth", truth).out
    moved = command("score", mine, "--truth", truth, "--truth-offset=-7.5", "--json").json
    assert moved["scores"]["mean_m"] < 0.01


def test_a_walk_of_an_environment(command: Any, tmp_path: Path) -> None:
    from pdrbench.registry import make_task

    task = make_task("CampusStride-v1")
    reference = task.load(task.split("val")[0]).reference
    mine = table(
        tmp_path / "mine.csv", "t_s,x_m,y_m,level", np.column_stack([reference.t_s, reference.xy_m, reference.level])
    )
    options = ("--env", "CampusStride-v1", "--split", "val", "--json")
    found = command("score", mine, "--walk", task.split("val")[0], *options)
    assert found.json["scores"]["mean_m"] < 0.01 and found.json["scores"]["level_hit_rate"] == 1.0
    assert "name one with --walk" in command("score", mine, *options).err


@pytest.mark.parametrize(
    ("content", "options", "why"),
    [
        ("t_s,x_m,y_m\n0,1,2\n", (), "name what to score against"),
        ("t_s,x_m,y_m\n900,1,2\n", ("--truth",), "no time is common"),
        ("t_s,lat_deg,lon_deg\n1,48.0,11.0\n", ("--truth",), "one has degrees, the other metres"),
        ("time,steps\n0,1\n", ("--truth",), "a table of places has"),
    ],
)
def test_what_cannot_be_scored_is_one_line(
    command: Any, tmp_path: Path, content: str, options: tuple[str, ...], why: str
) -> None:
    (tmp_path / "mine.csv").write_text(content)
    truth = table(tmp_path / "truth.csv", "t_s,x_m,y_m", np.column_stack([T_S, XY_M]))
    done = command("score", tmp_path / "mine.csv", *(part for name in options for part in (name, truth)))
    assert done.code == 1 and why in done.err and "Traceback" not in done.err


def test_a_damaged_matlab_file_is_refused_and_ends_no_process(tmp_path: Path) -> None:
    """`scipy.io.loadmat` ends the process, or raises `UnboundLocalError`, on some of these."""
    from scipy.io import savemat

    savemat(tmp_path / "track.mat", {"track": np.ones((30, 4))})
    whole = (tmp_path / "track.mat").read_bytes()
    for place in range(128, 184):
        (tmp_path / "track.mat").write_bytes(whole[:place] + b"\xff" + whole[place + 1 :])
        with contextlib.suppress(RecordingError):
            read_track(tmp_path / "track.mat")
