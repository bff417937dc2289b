"""`pdrbench try` and `pdrbench data pack`: from a file to a picture, a table and paths; from a folder to a folder."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pdrbench.building import WALL, Building, FloorPolygon
from pdrbench.registry import make_task
from pdrbench_formats.maps import geojson
from pdrbench_formats.taskfile import advice
from pdrbench_sim.foot.known_walk import walk as foot_walk

LAT, LON = 49.46, 11.11
QUESTIONS = ("who", "where", "how", "device", "licence", "consent")


@pytest.fixture
def walk(tmp_path: Path) -> Path:
    """A table of a phone at 50 Hz, its column map and places, and a plan."""
    t_s = np.arange(0.0, 9.0, 0.02)
    rows = np.column_stack([1.7e12 + 1e3 * t_s, 0 * t_s, 0 * t_s, 1 + 0.25 * np.sin(4 * np.pi * t_s)])
    np.savetxt(tmp_path / "walk.csv", rows, fmt="%.4f", delimiter=";", header="t;ax;ay;az", comments="")
    (tmp_path / "columns.toml").write_text(
        '[columns]\ntime = "t"\ntime_unit = "ms"\naccel = ["ax", "ay", "az"]\naccel_unit = "g"\n'
    )
    places = f"unix_ms,lat_deg,lon_deg\n1.7e12,{LAT},{LON}\n{1.7e12 + 9000},{LAT},{LON + 1e-4}\n"
    (tmp_path / "places.csv").write_text(places)
    outline = np.array([[0.0, 0], [20, 0], [20, 8], [0, 8]])
    geojson.write(
        Building("hall", (FloorPolygon("hall", outline, np.full(4, WALL), 0.0, 0),)), tmp_path / "plan.geojson"
    )
    return tmp_path / "walk.csv"


def tried(command: Any, walk: Path, *options: str) -> tuple[dict[str, Any], str]:
    out = walk.parent / "out"
    localizers = [f"--localizer={name}" for name in ("stay", "woodman2008")]
    columns = f"--columns={walk.parent / 'columns.toml'}"
    done = command("try", walk, columns, *localizers, *options, "--isolation=none", f"--out={out}", "--json")
    assert done.code == 0, done.err
    return json.loads(done.out), done.err


def test_a_walk_with_places_is_scored_drawn_and_exported(command: Any, walk: Path) -> None:
    answer, _ = tried(command, walk, f"--truth={walk.parent / 'places.csv'}", "--heading=0")
    errors = {row["localizer"]: row["metrics"].get("mean_m", {}).get("value") for row in answer["rows"]}
    assert errors["stay"] == pytest.approx(7.25, abs=0.01)  # 1e-4 degrees at this latitude
    assert answer["declined"].keys() == {"woodman2008"}
    assert not any("woodman" in file.name for file in (walk.parent / "out" / "results").iterdir())  # nor was it run
    names = {Path(file).name for file in answer["files"]}
    assert {"walk.png", "table.csv", "stay.tum", "reference.geojson", "stay.geojson"} <= names
    paths = walk.parent / "out" / "paths" / "walk"
    assert f"{LAT:.9f}".rstrip("0") in (paths / "stay.geojson").read_text()
    assert np.loadtxt(paths / "stay.tum")[0, 0] == pytest.approx(1.7e9)
    assert {row["localizer"] for row in (*answer["paths"], *answer["rows"])} == {"stay"}
    assert make_task(str(walk.parent / "out")).split("test") == ("walk",)


def test_a_walk_without_places_is_relative(command: Any, walk: Path) -> None:
    answer, notes = tried(command, walk, f"--map={walk.parent / 'plan.geojson'}")
    assert "relative to (0, 0)" in notes and "plan.geojson is not used" in notes
    assert answer["rows"] == []
    assert not any(str(file).endswith(".geojson") for file in answer["files"])


def test_a_start_on_a_plan(command: Any, walk: Path) -> None:
    answer, notes = tried(command, walk, f"--map={walk.parent / 'plan.geojson'}", "--start=3,4", "--heading=0")
    assert "relative" not in notes
    stay = next(row for row in answer["paths"] if row["localizer"] == "stay")
    assert (stay["end_x_m"], stay["end_y_m"]) == (3.0, 4.0)
    assert (walk.parent / "out" / "walk.png").stat().st_size > 5000


def test_a_shoe_is_recognised_and_may_be_called_something_else(command: Any, tmp_path: Path) -> None:
    motion = foot_walk(12, swing_s=0.5, tilt_rad=0.9)
    rows = np.column_stack([motion.t_s, motion.accel, motion.gyro])
    shoe = tmp_path / "shoe.csv"
    np.savetxt(shoe, rows, fmt="%.6f", delimiter=",", header="t (s),ax,ay,az,gx,gy,gz", comments="")

    def answer(*options: str) -> tuple[dict[str, Any], str]:
        options = ("--localizer=foot_ins", "--isolation=none", f"--out={tmp_path / 'out'}", *options)
        done = command("try", shoe, *options, "--json")
        assert done.code == 0, done.err
        return json.loads(done.out), done.err

    found, notes = answer()
    assert "taken for a shoe; --mounting hand" in notes
    assert found["paths"][0]["end_x_m"] == pytest.approx(float(motion.position_m[-1, 0]), rel=0.05)
    found, notes = answer("--mounting=hand")
    assert "taken for a shoe" not in notes
    assert "carried in the hand" in found["declined"]["foot_ins"] and not found["failed"]


@pytest.mark.parametrize(
    ("options", "why"),
    [
        (["--start=3"], "--start is x,y,level"),
        (["--start=3,4,0.5"], "--start is x,y,level"),
        (["--columns=gone.toml"], "gone.toml: cannot be read"),
        (["--columns=gone.toml", "--rate=50"], "write rate_hz = 50 into the file"),
        (["--map=gone.geojson"], "gone.geojson"),
        (["--truth=gone.csv"], "gone.csv: cannot be read"),
    ],
)
def test_what_cannot_be_tried_is_one_line(options: list[str], why: str, command: Any, walk: Path) -> None:
    done = command("try", walk, "--localizer=stay", f"--out={walk.parent / 'out'}", *options)
    assert done.code == 1
    assert why in done.err and "Traceback" not in done.err


def test_a_packed_folder_is_the_same_environment_for_whoever_fetches_it(
    command: Any, walk: Path, serve: Callable[[Path], str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried(command, walk, f"--truth={walk.parent / 'places.csv'}")
    packed = tmp_path / "packed"
    refused = command("data", "pack", tmp_path / "out", "--out", packed)
    assert refused.code == 1 and "consent" in refused.err
    with (tmp_path / "out" / "task.toml").open("a") as file:
        file.write("[card]\n" + "".join(f'{question} = "one adult"\n' for question in QUESTIONS))
    done = command("data", "pack", tmp_path / "out", "--out", packed, "--json")
    sha256 = json.loads(done.out)["sha256"]
    assert sha256 == hashlib.sha256((packed / "dataset.json").read_bytes()).hexdigest()
    assert "one adult" in (packed / "README.md").read_text()
    monkeypatch.setenv("PDRBENCH_CACHE", str(tmp_path / "cache"))
    url = serve(packed)
    wrong = command("data", "fetch", url, "--sha256", "0" * 64)
    fetched = command("data", "fetch", url, "--sha256", sha256)
    assert wrong.code == 1 and "hash differs" in wrong.err
    assert fetched.code == 0, fetched.err
    theirs, ours = make_task(str(tmp_path / "cache" / "Try-v0")), make_task(str(tmp_path / "out"))
    for name, stream in ours.load("walk").streams.items():
        np.testing.assert_array_equal(theirs.load("walk").streams[name].rows, stream.rows)


def phone_in_an_office(folder: Path) -> tuple[Path, Path]:
    """A recording of a simulated walk, and a place a second."""
    from pdrbench_sim.buildings.office import make_office
    from pdrbench_sim.record import IN_HAND, make_scene, simulate_walk

    building = make_office(np.random.default_rng(1), num_levels=1, area_m2=800)
    recording = simulate_walk(make_scene(np.random.default_rng(2), building), 3, IN_HAND, duration_s=60)
    rows = np.column_stack([recording.streams["accel"].rows, recording.streams["gyro"].rows[:, 1:4]])
    header = "t (s),ax (m/s^2),ay (m/s^2),az (m/s^2),gx (rad/s),gy (rad/s),gz (rad/s)"
    np.savetxt(folder / "phone.csv", rows, fmt="%.5f", delimiter=",", header=header, comments="")
    at = np.searchsorted(recording.reference.t_s, np.arange(0.0, 59.0))
    places = np.column_stack([np.arange(0.0, 59.0), recording.reference.xy_m[at]])
    np.savetxt(folder / "places.csv", places, fmt="%.3f", delimiter=",", header="t_s,x_m,y_m", comments="")
    return folder / "phone.csv", folder / "places.csv"


def test_the_first_line_says_whom_to_believe_and_the_places_may_be_late(command: Any, tmp_path: Path) -> None:
    phone, places = phone_in_an_office(tmp_path)
    late = np.loadtxt(places, delimiter=",", skiprows=1)
    late[:, 0] += 4.0
    np.savetxt(places, late, fmt="%.3f", delimiter=",", header="t_s,x_m,y_m", comments="")
    options = ("--isolation=none", "--mounting=hand", f"--out={tmp_path / 'out'}")
    done = command("try", phone, f"--truth={places}", "--localizer=dead_reckoning", "--localizer=stay", *options)
    first, *others = done.out.splitlines()
    assert first.startswith("believe dead_reckoning: it errs least once turned onto your places"), done.err
    assert any("--truth-offset -4 moves them" in line for line in others)
    assert any("no heading at the start is known" in line for line in others)
    done = command("try", phone, f"--truth={places}", "--localizer=stay", "--truth-offset=-4", *options)
    assert done.out.startswith("no localizer to believe") and "--truth-offset" not in done.out


def test_places_overrule_the_table_where_they_can(monkeypatch: Any) -> None:
    for name in ("lay_still", "is_aligned", "lacks_heading"):
        monkeypatch.setattr(advice, name, lambda _: False)
    walk = SimpleNamespace(mounting="pocket", streams={"accel": 0}, building=True)
    task = SimpleNamespace(start="given", load=lambda _: walk)
    walks: Any = SimpleNamespace(facts={"walk": 0}, refused={}, task=task)
    results: Any = [SimpleNamespace(localizer=one, division="offline", status="ok") for one in ("li2012", "fusion")]
    for fusion_m, first in ((None, "fusion"), (1.09, "fusion"), (1.2, "li2012")):
        rows = [("li2012", 1.0), ("fusion", fusion_m)] if fusion_m else []
        of_rows = [{"localizer": a, "division": "offline", "metrics": {"mean_m": {"value": v}}} for a, v in rows]
        assert advice.believed(of_rows, results, walks)[0] == f"{first} (offline)"
    walk.streams["rotation"] = SimpleNamespace(spec=SimpleNamespace(derived=True))  # whose yaw is that of the walker
    assert advice.believed([], results, walks)[0] == "li2012 (offline)"


def test_a_device_that_lay_still_is_said_and_who_fails_is_not_believed(command: Any, tmp_path: Path) -> None:
    t_s = np.arange(0.0, 20.0, 0.02)
    rows = np.column_stack([t_s, np.random.default_rng(1).normal(0.0, 0.01, (len(t_s), 6))])
    rows[:, 3] += 9.81
    np.savetxt(tmp_path / "still.csv", rows, fmt="%.4f", delimiter=",", header="t,ax,ay,az,gx,gy,gz", comments="")
    (tmp_path / "mine.py").write_text(
        "class Fails:\n    def reset(self, briefing, rng): pass\n    def step(self, observation): raise OSError\n"
    )
    fails = f"--localizer={tmp_path / 'mine.py'}:Fails"
    done = command("try", tmp_path / "still.csv", fails, "--isolation=none", f"--out={tmp_path / 'out'}")
    assert done.out.startswith("no localizer to believe: none played")
    done = command(
        "try", tmp_path / "still.csv", "--localizer=dead_reckoning", "--isolation=none", f"--out={tmp_path / 'out'}"
    )
    assert done.out.startswith("no localizer to believe: the device lay still all the time")
