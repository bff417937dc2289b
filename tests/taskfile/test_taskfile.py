"""Folders and files as environments: what is refused, frames, starts, surveys, changes of files."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from pdrbench.building import WALL, Building, FloorPolygon
from pdrbench.errors import PdrbenchError, RecordingError
from pdrbench.evaluation import evaluate, load_results
from pdrbench.gym import check_task
from pdrbench.inertial import phone_heading_rad
from pdrbench.io.geo import GeoFrame
from pdrbench.recording import Recording, SensorStream
from pdrbench.registry import PluginError, make_task, task_place
from pdrbench.sensors import sensor_spec
from pdrbench.task import Task
from pdrbench.trajectory import Trajectory
from pdrbench_formats.detect import read as io_read
from pdrbench_formats.maps import geojson
from pdrbench_formats.recordings import native
from pdrbench_formats.recordings.opaque import opaque_id
from pdrbench_formats.taskfile import as_toml, files, load, read_task_file, walks_of_file
from pdrbench_formats.taskfile.pack import pack

HALL = Building(
    "hall", (FloorPolygon("hall", np.array([[0.0, 0], [20, 0], [20, 8], [0, 8]]), np.full(4, WALL), 0.0, 0),)
)
COLUMNS = '[columns]\ntime = "t"\naccel = ["ax", "ay", "az"]\ngyro = ["gx", "gy", "gz"]\n'
TRUTH = "t_s,x_m,y_m,level\n0,2,4,0\n6,9,4,0\n12,16,5,0\n"
LAT, LON = 49.46, 11.11
QUESTIONS = ("who", "where", "how", "device", "licence", "consent")


def write_walk(path: Path, seconds: float = 12.0) -> Path:
    """A table of a phone that lies on its back and bounces twice a second, at 50 Hz."""
    t_s = np.arange(0.0, seconds, 0.02)
    rng = np.random.default_rng(1)
    rows = np.column_stack([t_s, rng.normal(0, 0.3, (len(t_s), 2)), 9.8 + 2.5 * np.sin(4 * np.pi * t_s)])
    rows = np.column_stack([rows, rng.normal(0, 0.05, (len(t_s), 3))])
    np.savetxt(path, rows, fmt="%.5f", delimiter=",", header="t,ax,ay,az,gx,gy,gz", comments="")
    return path


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two walks, one with places beside it, a plan, and a task file."""
    place = tmp_path / "my_walks"
    place.mkdir()
    write_walk(place / "one.csv")
    write_walk(place / "two.csv")
    (place / "one_truth.csv").write_text(TRUTH)
    geojson.write(HALL, place / "plan.geojson")
    (place / "task.toml").write_text(
        f'[task]\nlicence = "CC0-1.0"\n[plan]\nfile = "plan.geojson"\n{COLUMNS}'
        '[[walk]]\nfile = "one.csv"\nmounting = "hand"\n'
        '[[walk]]\nfile = "two.csv"\nsplit = "train"\nstart = { xy_m = [3, 4], heading_deg = 90 }\n'
    )
    return place


def test_a_folder_is_an_environment(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder.parent)
    results = evaluate("stay", "my_walks", out="results", seeds=1)  # in processes of their own, from a relative path
    assert [result.status for result in results.results] == ["complete"]
    truth = np.array([[9.0, 4.0], [16.0, 5.0]])
    expected_m = np.hypot(*(truth - [2.0, 4.0]).T).mean()
    assert results.rows()[0]["metrics"]["mean_m"]["value"] == pytest.approx(expected_m, abs=1e-4)  # as it is stored
    monkeypatch.chdir(folder)
    assert load_results(folder.parent / "results").rows() == results.rows()
    task = make_task(".")
    assert (task.id, task.split("test"), task.split("train")) == ("MyWalks-v0", ("one",), ("two",))
    start = task.tell_start(task.load("two"))
    assert start.xy_m.tolist() == [3.0, 4.0] and start.heading_rad == pytest.approx(math.pi / 2)


def test_a_folder_has_held_out_walks(folder: Path) -> None:
    """The same walk elsewhere: who stays at the start is as far off as before."""
    results = evaluate("stay", str(folder), split="heldout", secret="c0ffee" * 8, isolation="none", seeds=1)
    expected_m = np.hypot(*(np.array([[9.0, 4.0], [16.0, 5.0]]) - [2.0, 4.0]).T).mean()
    assert results.rows()[0]["metrics"]["mean_m"]["value"] == pytest.approx(expected_m, abs=1e-4)  # as it is stored
    assert {result.walk[:8] for result in results.results} == {"heldout-"}
    assert np.hypot(*results.results[0].estimates.xy_m[0]) > 50.0  # the start was (2, 4)


def test_units_and_groups_are_stated(folder: Path) -> None:
    path = folder / "task.toml"
    content = path.read_text().replace("[task]\n", '[task]\nunit_kind = "person"\n')
    content = content.replace('mounting = "hand"\n', 'mounting = "hand"\nunit = "A"\ngroup = "stairs"\n')
    path.write_text(content + 'unit = "B"\n')
    task = make_task(str(folder))
    assert (dict(task.units), task.unit_kind, dict(task.groups)) == (
        {"one": "A", "two": "B"},
        "person",
        {"one": ("stairs",)},
    )
    path.write_text(content)
    with pytest.raises(RecordingError, match="'two' has no unit"):
        make_task(str(folder))


def test_what_it_names_may_change(folder: Path) -> None:
    before = make_task(str(folder))
    assert make_task(str(folder / "task.toml")) is before
    sha256 = {walk: before.files_sha256(walk) for walk in ("one", "two")}
    write_walk(folder / "one.csv", seconds=10.0)
    after = make_task(str(folder))
    assert after.files_sha256("one") != sha256["one"]
    assert after.files_sha256("two") == sha256["two"]


def test_what_a_recording_lacks_is_derived(folder: Path) -> None:
    derived = {spec.name for spec in make_task(str(folder)).sensors if spec.derived}
    assert {"rotation", "position"} <= derived
    text = (folder / "task.toml").read_text()
    (folder / "task.toml").write_text(text.replace("[task]\n", "[task]\nderive = false\n"))
    assert [spec.name for spec in make_task(str(folder)).sensors] == ["accel", "gyro"]


def test_a_folder_without_walk_tables_takes_every_recording(folder: Path) -> None:
    (folder / "task.toml").write_text(f'[task]\nid = "All-v0"\n[plan]\nfile = "plan.geojson"\n{COLUMNS}')
    (folder / "notes.txt").write_text("rain in the morning\n")
    (folder / "two_truth.csv").write_text(TRUTH)
    task = make_task(str(folder))
    assert task.split("test") == ("one", "two")
    assert task.note == "notes.txt is no recording"
    failed = [check for check in check_task(task) if not check.passed]
    assert failed == []


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("[task]\nperiod = 1", r"no key 'period' in \[task\]; did you mean 'period_s'"),
        (
            '[[walk]]\nfile = "one.csv"\n[[walk]]\nfle = "two.csv"',
            r"no key 'fle' in \[walk \(number 2\)\]; did you mean",
        ),
        ('[[walk]]\nfile = "one.csv"\nstart = { xy_m = [1, 2], lvl = 3 }', "no key 'lvl' .*did you mean 'level'"),
        ('[[walk]]\nfile = "one.csv"\nsplit = "tst"', "Invalid enum value 'tst'.*number 1"),
        ("[plan.align]\nlat_deg = 3", "missing required field `file`"),
        ("[task", "not TOML"),
        ('[task]\nid = "CampusFoot-v1"\n[[walk]]\nfile = "one.csv"', "registered environment"),
        ('[task]\nid = "lower-v0"\n[[walk]]\nfile = "one.csv"', "not of the form Name-vN"),
        ('[task]\nsensors = ["acel"]\n[[walk]]\nfile = "one.csv"', "did you mean 'accel'"),
        ('[task]\nsensors = ["stride"]\n[[walk]]\nfile = "one.csv"', "strides are computed for a unit on a foot"),
        ('[[walk]]\nfile = "gone.csv"', "gone.csv.*cannot be read"),
        ('[[walk]]\nfile = "plan.geojson"', "holds Building, no walk"),
        ('[[walk]]\nfile = "one.csv"\n[[walk]]\nfile = "one.csv"', "two walks are called 'one'"),
        ('[[walk]]\nfile = "two.csv"', "neither a start nor a place"),
        ('[[walk]]\nfile = "one.csv"\n[survey]\nwalks = ["on"]', "did you mean 'one'"),
        ('[[walk]]\nfile = "one.csv"\n[survey]\nfile = "gone.csv"', "gone.csv.*cannot be read"),
        ('[[walk]]\nfile = "one.csv"\ncolumns = "gone.toml"', "gone.toml: cannot be read"),
    ],
)
def test_what_is_refused(text: str, why: str, folder: Path) -> None:
    (folder / "task.toml").write_text(text)
    with pytest.raises(PdrbenchError, match=why):
        make_task(str(folder))


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("my_wlks/", "no file or folder"),
        ("empty", "folder without task.toml"),
        ("made.py", "write made.py:task"),
        ("made.py:tsk", "defines no 'tsk'"),
        ("made.py:number", "returned int, not a Task"),
    ],
)
def test_paths_that_are_no_environment(name: str, why: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty").mkdir()
    (tmp_path / "made.py").write_text("def number():\n    return 1\n")
    with pytest.raises(PluginError, match=why):
        make_task(name)


def test_a_function_in_a_file_is_an_environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "made.py").write_text(
        "import dataclasses\nimport pdrbench\n\n\ndef task():\n"
        '    task = pdrbench.make_task("CampusStride-v1")\n'
        '    return dataclasses.replace(task, id="Made-v0", walks={"test": task.split("test")[:1]})\n'
    )
    assert make_task("made.py:task").id == "Made-v0"
    assert task_place("made.py:task") == f"{tmp_path / 'made.py'}:task"
    assert all(task_place(name) is None for name in ("CampusStride-v1", "pdrbench/CampusStride-v1", 300 * "x"))


def test_plan_places_and_starts_share_a_frame(folder: Path) -> None:
    """A plan in feet, turned by 90 degrees; truth as latitude and longitude in a table of its own."""
    frame, feet = GeoFrame(LAT, LON), 0.3048
    east_north_m = np.array([[-1.0, 2.0], [-1.0, 3.0], [-1.5, 4.0]])
    lat_deg, lon_deg = frame.to_geo(east_north_m)
    rows = [f"{6 * k},{lat:.10f},{lon:.10f}" for k, (lat, lon) in enumerate(zip(lat_deg, lon_deg, strict=True))]
    (folder / "truth.csv").write_text("t_s,lat_deg,lon_deg\n" + "\n".join(rows) + "\n")
    task_file = folder / "task.toml"
    task_file.write_text(
        '[plan]\nfile = "plan.geojson"\n'
        f"[plan.align]\nlat_deg = {LAT}\nlon_deg = {LON}\nturn_deg = 90\nscale = {feet}\n{COLUMNS}"
        '[[walk]]\nfile = "one.csv"\ntruth = "truth.csv"\n'
        '[[walk]]\nfile = "two.csv"\nstart = { xy_m = [10, 2], heading_deg = 0 }\n'
    )
    walks = walks_of_file(task_file)
    assert walks.reader.building is not None and walks.reader.geo == frame
    np.testing.assert_allclose(walks.reader.building.bounds_m(), [-8 * feet, 0, 0, 20 * feet], atol=1e-12)
    np.testing.assert_allclose(walks.task.load("one").reference.xy_m, east_north_m, atol=1e-5)
    start = walks.task.tell_start(walks.task.load("two"))
    np.testing.assert_allclose(start.xy_m, [-2 * feet, 10 * feet], atol=1e-12)
    assert start.heading_rad == pytest.approx(math.pi / 2)


def test_degrees_need_a_plan_that_says_where_it_lies(folder: Path) -> None:
    (folder / "one_truth.csv").write_text(f"t_s,lat_deg,lon_deg\n0,{LAT},{LON}\n9,{LAT},{LON + 1e-4}\n")
    with pytest.raises(RecordingError, match=r"add \[plan.align\]"):
        make_task(str(folder)).load("one")


def test_a_recording_begins_at_the_place_that_is_its_start(folder: Path) -> None:
    (folder / "one_truth.csv").write_text(TRUTH.replace("\n0,2", "\n5,2"))
    walks = walks_of_file(folder / "task.toml")
    recording = walks.task.load("one")
    assert walks.begin_s["one"] == 5.0
    assert recording.reference.t_s.tolist() == [0.0, 1.0, 7.0]
    assert recording.reference.surveyed.tolist() == [False, True, True]
    assert 0.0 <= recording.streams["accel"].t_s[0] < 0.02
    assert recording.end_s == pytest.approx(7.0)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "no places"),
        ("t_s,x_m,y_m\n", "no places"),
        ("time,u,v\n0,1,2\n", "a table of places has t_s,x_m,y_m,level"),
        ("unix_s,x_m,y_m\n1700000000,1,2\n", "does not say when it began"),
        ("t_s,x_m,y_m\n0,1,north\n", "line 2: y_m is 'north': no number"),
        ("t_s,x_m,y_m\n0,1\n", "no places"),
        ("t_s,x_m,y_m,level\n0,1,2,0.5\n", "a level is a whole number"),
        ("t_s,x_m,y_m\n0,1,2\n0,3,4\n", "t_s does not increase"),
        ("t_s,x_m,y_m\n0,1,2\n1,2\n2,3,4\n3,4,5\n", "line 3: 2 fields, expected 3"),
        ("t_s,x_m,y_m\n0,1,nan\n", "line 2: y_m is ''"),
        ("t_s,x,y,floor\n0,1,2,1\n2,3,2,1\n", "one level lower 100% do"),
        ("time,x,y\n09:00:00,1,2\n09:00:02,3,4\n", "another clock.*--truth-offset .* -32400.0 puts them right"),
    ],
)
def test_tables_of_places_that_are_wrong(text: str, why: str, folder: Path) -> None:
    (folder / "one_truth.csv").write_text(text)
    with pytest.raises(RecordingError, match=why):
        make_task(str(folder)).load("one")


def write_scans(place: Path, first: int) -> None:
    """A walk of ten metres in ten seconds with five scans of twelve access points, numbered from `first`."""
    scan_s = np.repeat(np.arange(1.0, 10.0, 2.0), 12)
    wifi = np.column_stack([scan_s, first + np.arange(len(scan_s)), 0 * scan_s - 60.0, 0 * scan_s, 0 * scan_s])
    way = Trajectory(np.array([0.0, 10.0]), np.array([[0.0, 0], [10, 0]]), np.zeros(2, np.int64), np.ones(2, np.bool_))
    native.write(Recording(place.name, None, {"wifi": SensorStream(sensor_spec("wifi"), wifi)}, way), place)


ADDRESSES = ("02:00:00:00:00:01", "02:00:00:00:00:02")
SCANS = (
    "x_m,y_m,level,access_point,rssi_dbm\n"
    f"1,2,0,{ADDRESSES[0]},-50\n1,2,0,{ADDRESSES[1]},-60\n1,2,0,{ADDRESSES[0]},-52\n5,6,1,77,-70\n"
)


def test_a_table_and_a_recording_are_a_survey(tmp_path: Path) -> None:
    """Without tables of walks, neither is a walk; the plan is turned by 90 degrees and in feet, places with it."""
    write_scans(tmp_path / "walk", 100)
    write_scans(tmp_path / "round", 200)
    (tmp_path / "scans.csv").write_text(SCANS)
    task_file = tmp_path / "task.toml"
    task_file.write_text('[task]\nid = "Survey-v0"\n[survey]\nfile = "scans.csv"\n')
    table = make_task(str(tmp_path))
    radio_map = table.radio_map(table.load("walk"))
    assert radio_map is not None and radio_map.surveyed
    assert radio_map.xy_m.tolist() == [[1, 2], [1, 2], [5, 6]] and radio_map.level.tolist() == [0, 0, 1]
    assert radio_map.walk.tolist() == [0, 0, 1] and radio_map.first.tolist() == [0, 2, 3, 4]
    assert radio_map.access_point.tolist() == [*(opaque_id("wifi", ADDRESSES[k]) for k in (0, 1, 0)), 77]
    geojson.write(HALL, tmp_path / "plan.geojson")
    task_file.write_text(
        '[task]\nid = "Survey-v0"\n[survey]\nfile = ["scans.csv", "round"]\n'
        '[plan]\nfile = "plan.geojson"\n[plan.align]\nturn_deg = 90\nscale = 0.3048\n'
    )
    both = make_task(str(tmp_path))
    assert both.split("test") == ("walk",)
    radio_map = both.radio_map(both.load("walk"))
    assert radio_map is not None and len(radio_map) == 3 + 5 and not radio_map.surveyed
    np.testing.assert_allclose(radio_map.xy_m[[0, -1]], 0.3048 * np.array([[-2.0, 1], [0, 9]]), atol=1e-12)
    assert radio_map.walk.tolist() == [0, 0, 1, 2, 2, 2, 2, 2]
    with task_file.open("a") as file:
        file.write("".join(["[card]\n", *(f'{question} = "one adult"\n' for question in QUESTIONS)]))
    pack(task_file, tmp_path / "packed" / "Survey-v0")
    unpacked = make_task(str(tmp_path / "packed" / "Survey-v0"))
    np.testing.assert_array_equal(unpacked.radio_map(unpacked.load("walk")).xy_m, radio_map.xy_m)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (SCANS.replace("rssi_dbm", "dbm"), "line 1.*a table of a survey has x_m,y_m,level,access_point,rssi_dbm"),
        (SCANS.replace("-60", "100"), "line 3: rssi_dbm 100.*leave out what was not received"),
        (SCANS.replace("-60", ""), "line 3: rssi_dbm is ''"),
        (SCANS.replace("x_m,y_m", "lat_deg,lon_deg"), r"scans.csv are latitudes and longitudes.*add \[plan.align\]"),
        ("t,ax,ay,az,gx,gy,gz\n0.1,0,0,9.8,0,0,0\n0.2,0,0,9.9,0,0,0\n", "scans.csv: no WiFi scan at a place"),
    ],
)
def test_surveys_that_are_wrong(text: str, why: str, folder: Path) -> None:
    (folder / "scans.csv").write_text(text)
    with (folder / "task.toml").open("a") as file:
        file.write('[survey]\nfile = "scans.csv"\n')
    with pytest.raises(RecordingError, match=why):
        make_task(str(folder))


def test_each_table_may_have_a_column_map_of_its_own(folder: Path) -> None:
    """A table in m/s2 and one in g with other names: by a file, in place, and by a file beside it."""
    rows = np.loadtxt(write_walk(folder / "shoe.csv"), delimiter=",", skiprows=1)
    np.savetxt(folder / "shoe.csv", rows[:, :4] / [1e-3, 9.80665, 9.80665, 9.80665], delimiter=";", header="ms;u;v;w")
    shoe = 'time = "# ms"\ntime_unit = "ms"\naccel = ["u", "v", "w"]\naccel_unit = "g"\n'
    (folder / "map.toml").write_text(shoe)
    start = 'start = { xy_m = [3, 4] }\n[[walk]]\nfile = "one.csv"\n'
    inline = f"columns = {{ {', '.join(shoe.splitlines())} }}\n"
    for stated in ('columns = "map.toml"\n', inline, ""):
        if not stated:
            (folder / "map.toml").rename(folder / "shoe_columns.toml")
        (folder / "task.toml").write_text(f'{COLUMNS}[[walk]]\nfile = "shoe.csv"\n{stated}{start}')
        task = make_task(str(folder))
        assert "gyro" in task.load("one").streams
        np.testing.assert_allclose(task.load("shoe").streams["accel"].rows, rows[:, :4], atol=1e-4)
    before = task.files_sha256("shoe")
    (folder / "shoe_columns.toml").write_text(shoe.replace('"u", "v"', '"v", "u"'))
    assert make_task(str(folder)).files_sha256("shoe") != before
    geojson.write(HALL, folder / "walk.geojson")
    (folder / "task.toml").write_text('[[walk]]\nfile = "walk.geojson"\nformat = "geojson"\ncolumns = "map.toml"\n')
    with pytest.raises(RecordingError, match="the format geojson has no option 'columns'"):
        make_task(str(folder))


def test_a_folder_is_opened_again_without_reading_it(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What another process would do: nothing is in memory, and only what has changed since is read."""
    (folder / "two_truth.csv").write_text(TRUTH)
    (folder / "task.toml").write_text(f'[task]\nid = "All-v0"\n[plan]\nfile = "plan.geojson"\n{COLUMNS}')
    monkeypatch.setenv("PDRBENCH_CACHE", str(tmp_path / "cache"))
    read: list[str] = []
    monkeypatch.setattr(
        files, "read", lambda place, kind, **options: read.append(place.name) or io_read(place, kind, **options)
    )

    def opened() -> Task:
        read.clear()
        for cache in (load._open, files._read_once):
            cache.cache_clear()
        return make_task(str(folder))

    first = opened()
    assert sorted(read) == ["one.csv", "two.csv"]
    again = opened()
    assert read == []
    assert (again.walks, again.capacity, again.start, again.note) == (
        first.walks,
        first.capacity,
        first.start,
        first.note,
    )
    assert [spec.rate_hz for spec in again.sensors] == [spec.rate_hz for spec in first.sensors]
    assert again.files_sha256("one") == first.files_sha256("one")
    write_walk(folder / "one.csv", seconds=10.0)
    opened()
    assert read == ["one.csv"]
    (folder / "two.csv").write_text("t,ax,ay,az,gx,gy,gz\n0,1,2,3,4,5,six\n0,1,2,3,4,5,6\n")
    for _ in range(2):
        with pytest.raises(RecordingError, match=r"two\.csv"):
            opened().load("two")
    for file in (tmp_path / "cache" / "tasks").iterdir():
        file.write_bytes(b"{}x")
    write_walk(folder / "two.csv")
    assert opened().start == "pose" and sorted(read) == ["one.csv", "two.csv"]


def test_task_files_are_written_as_they_are_read(folder: Path) -> None:
    content = read_task_file(folder / "task.toml")
    (folder / "again.toml").write_text(as_toml(content))
    assert read_task_file(folder / "again.toml") == content


@pytest.mark.parametrize("is_given", [True, False])
def test_computed_sensors_give_no_start_away(folder: Path, is_given: bool) -> None:
    """Without the places of one walk no walk of the task is given its start, and no position is counted from it."""
    if not is_given:
        (folder / "one_truth.csv").unlink()
    task = make_task(str(folder))
    offered = {spec.name: spec.derived for spec in task.sensors}
    assert task.start == ("pose" if is_given else "unknown")
    assert offered.get("position") is (True if is_given else None)
    assert offered["rotation"] and not offered["accel"]
    heading_rad = float(phone_heading_rad(task.load("two").streams["rotation"].rows[0, 1:]))
    assert heading_rad == pytest.approx(math.pi / 2 if is_given else 0.0)
