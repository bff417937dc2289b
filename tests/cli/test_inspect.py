"""`pdrbench inspect` and `pdrbench convert`: what a file holds, recognised by content, and lossless conversion."""

from __future__ import annotations

import csv
import gzip
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pdrbench
from pdrbench.evaluation import evaluate, store
from pdrbench_formats.detect import detect
from pdrbench_formats.maps import geojson
from pdrbench_formats.recordings import native

ILC20 = "#\tstartTime:1574559781435\n#\tSiteID:a\tFloorName:F1\n#\tBrand:OPPO\tModel:X\n"


@pytest.fixture(scope="module")
def walk() -> pdrbench.Recording:
    task = pdrbench.make_task("CampusStride-v1")
    return task.load(task.split("train")[0])


def ilc20_log(rows: int = 300) -> str:
    def line(index: int, kind: str, *values: object) -> str:
        return "\t".join([str(1574559781435 + 20 * index), kind, *map(str, values)])

    lines = [line(i, "TYPE_ACCELEROMETER", 0.1, 0.2 + i % 3, 9.7, 3) for i in range(rows)]
    places = [line(0, "TYPE_WAYPOINT", 1.0, 2.0), line(rows - 1, "TYPE_WAYPOINT", 4.0, 6.0)]
    return ILC20 + "\n".join([*places, *lines, ""])


def test_a_log_is_known_by_its_content_under_any_name(command: Any, tmp_path: Path) -> None:
    for name, content in (("log", ilc20_log().encode()), ("log.dat", gzip.compress(ilc20_log().encode()))):
        (tmp_path / name).write_bytes(content)
        printed = command("inspect", tmp_path / name, "--json").json
        assert (printed["format"], printed["device"], printed["reference"]["length_m"]) == ("ilc20", "OPPO X", 5.0)
        (sensor,) = printed["sensors"]
        assert (sensor["sensor"], sensor["rows"]) == ("accel", 300)
        assert sensor["median rate_hz"] == pytest.approx(50.0)
    shown = command("inspect", tmp_path / "log")
    assert shown.code == 0
    assert "accel" in shown.out


def test_a_walk_survives_the_conversion_exactly(command: Any, walk: pdrbench.Recording, tmp_path: Path) -> None:
    native.write(walk, tmp_path / "first")
    assert command("convert", tmp_path / "first", tmp_path / "second", "--mounting", "hand").code == 0
    again = native.read(tmp_path / "second")
    assert again.mounting == "hand"
    assert np.array_equal(again.streams["stride"].rows, walk.streams["stride"].rows)
    assert np.array_equal(again.reference.xy_m, walk.reference.xy_m)
    printed = command("inspect", tmp_path / "second", "--json").json
    assert printed["building"] == walk.building.name if walk.building is not None else "none"
    assert printed["sensors"][0]["rows"] == len(walk.streams["stride"].rows)


def test_a_log_gets_the_map_it_is_given(command: Any, walk: pdrbench.Recording, tmp_path: Path) -> None:
    assert walk.building is not None
    geojson.write(walk.building, tmp_path / "map.geojson")
    (tmp_path / "log.txt").write_text(ilc20_log())
    out = tmp_path / "walk"
    assert command("convert", tmp_path / "log.txt", out, "--map", tmp_path / "map.geojson", "--name", "mine").code == 0
    made = native.read(out)
    assert made.id == "mine"
    assert made.building is not None
    assert made.building.levels == walk.building.levels


def test_a_map_lists_its_levels_and_stays_the_same(command: Any, walk: pdrbench.Recording, tmp_path: Path) -> None:
    assert walk.building is not None
    geojson.write(walk.building, tmp_path / "one.geojson")
    assert command("convert", tmp_path / "one.geojson", tmp_path / "two.geojson").code == 0
    assert (tmp_path / "one.geojson").read_bytes() == (tmp_path / "two.geojson").read_bytes()
    printed = command("inspect", tmp_path / "two.geojson", "--json").json
    assert [row["level"] for row in printed["levels"]] == list(walk.building.levels)
    assert sum(row["area_m2"] for row in printed["levels"]) == pytest.approx(walk.building.area_m2)


def test_the_answers_of_a_stored_walk_read_back_to_the_last_bit(command: Any, tmp_path: Path) -> None:
    evaluate("dead_reckoning", "CampusStride-v1", split="val", walks=1, out=tmp_path / "out", isolation="none")
    (stored,) = (tmp_path / "out").glob(f"*{store.SUFFIX}")
    printed = command("inspect", stored, "--json").json
    assert (printed["format"], printed["localizer"], printed["status"]) == ("result", "dead_reckoning", "complete")
    assert command("convert", stored, tmp_path / "answers.csv").code == 0
    with (tmp_path / "answers.csv").open() as file:
        rows = list(csv.DictReader(file))
    answers = store.load(stored).estimates
    assert [float(row["x_m"]) for row in rows] == answers.xy_m[:, 0].tolist()
    assert printed["answers"] == len(rows)
    assert rows[0]["sigma_m"] == ""  # claimed nothing


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda path: path.write_text("hello\n"), "in no format that pdrbench knows"),
        (lambda path: path.write_bytes(b"\n"), "is empty; copy or export it again"),
        (lambda path: path.write_bytes(b"\x1f\x8bnot gzip"), "damaged"),
        (lambda path: path.mkdir(), "in no format that pdrbench knows"),
        (lambda path: None, "cannot be read"),
        (lambda path: path.write_bytes(store.MAGIC + b"torn"), "torn"),
    ],
)
def test_impossible_reports_are_errors_of_one_line(
    command: Any, tmp_path: Path, make: Callable[[Path], object], message: str
) -> None:
    make(tmp_path / "thing")
    outcome = command("inspect", tmp_path / "thing")
    assert outcome.code == 1
    assert message in outcome.err
    assert outcome.err.count("\n") == 1


def test_a_wrong_format_is_refused_and_the_nearest_named(command: Any, tmp_path: Path) -> None:
    (tmp_path / "log").write_text(ilc20_log())
    assert "did you mean 'ilc20'" in command("inspect", tmp_path / "log", "--format", "ilc2").err
    assert command("inspect", tmp_path / "log", "--format", "foot_short").code == 1


def test_nothing_is_overwritten_and_the_kind_of_file_is_asked_for(command: Any, tmp_path: Path) -> None:
    (tmp_path / "log").write_text(ilc20_log())
    (tmp_path / "there").mkdir()
    assert "exists" in command("convert", tmp_path / "log", tmp_path / "there").err
    assert "becomes a folder" in command("convert", tmp_path / "log", tmp_path / "walk.geojson").err
    assert "no folder" in command("convert", tmp_path / "log", tmp_path / "no" / "walk").err
    assert "is no map" in command("convert", tmp_path / "log", tmp_path / "walk", "--map", tmp_path / "log").err
    assert not (tmp_path / "walk").exists()


@pytest.mark.parametrize(
    ("pattern", "kind"),
    [
        ("foot_vicon/data/*.mat", "foot_vicon"),
        ("foot_stride_gcp/gcp_labelled/*.mat", "foot_stride_gcp"),
        ("wifi_fingerprints/*.mat", "wifi_fingerprints"),
        ("ilc20/site1", "ilc20_map"),
        ("ilc20/*/*/path_data_files/*", "ilc20"),
    ],
)
def test_recorded_sets_are_distinguished(data_root: Path, pattern: str, kind: str) -> None:
    found = sorted(data_root.glob(pattern))
    assert found
    assert {detect(path) for path in found} == {kind}


def test_inspect_lists_what_is_wrong_and_convert_refuses_it(command: Any, tmp_path: Path) -> None:
    rows = "".join(f"{k * 10},0.01,0.02,{0.99 + k % 3 / 100},{k % 7 / 10},0.1,0.2\n" for k in range(300))
    (tmp_path / "walk.csv").write_text(f"time_ms,acc_x (m/s^2),acc_y,acc_z,gyro_x (rad/s),gyro_y,gyro_z\n{rows}")
    shown = command("inspect", tmp_path / "walk.csv")
    assert shown.code == 1 and "not to be played as it is: accel-unit" in shown.err
    assert "error (accel-unit): accel: " in shown.out
    assert 'accel_unit = "m/s^2"' in shown.out
    refused = command("convert", tmp_path / "walk.csv", tmp_path / "walk")
    assert refused.code == 1
    assert "it looks like g: state the unit" in refused.err
    column_map = shown.out.partition("[columns]")[2].replace('"m/s^2"', '"g"')
    (tmp_path / "columns.toml").write_text(f"[columns]{column_map}")
    facts = command("inspect", tmp_path / "walk.csv", "--columns", tmp_path / "columns.toml", "--json").json
    assert facts["findings"] == []
    options = ("--columns", tmp_path / "columns.toml")
    assert command("convert", tmp_path / "walk.csv", tmp_path / "walk", *options).code == 0
