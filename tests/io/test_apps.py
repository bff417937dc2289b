"""Apps that are described by a TOML file: a new one is a file of ten lines."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import recording_samples as samples

from pdrbench.errors import PdrbenchError, RecordingError
from pdrbench.io.reader import head_of
from pdrbench_formats import READERS
from pdrbench_formats.recordings.apps import FOLDER, reader_of

Rows = dict[str, np.ndarray]
NEW_APP = """
title = "A new app"
app = "1.0"
header = ["uptime", "ax|bx"]

[columns]
time = "Uptime"
time_unit = "ms"
accel = ["-A{}", "-B{}* + -G{}"]
accel_unit = "g"
gyro = "W{}"
"""


def written(folder: Path, walk: Rows, *, is_split: bool) -> Path:
    """A table of the new app, whose accelerometer is off where gravity stands beside the rest of it."""
    force, gravity = (walk[name][:, 1:] / samples.GRAVITY_MPS2 for name in ("accel", "gravity"))
    values = [np.zeros_like(force), gravity - force, -gravity] if is_split else [-force, gravity - force, -gravity]
    names = "Uptime," + ",".join(
        f"{n}{axis}{unit}" for n, unit in (("A", ""), ("B", " (g)"), ("G", ""), ("W", "")) for axis in "XYZ"
    )
    table = np.column_stack([walk["accel"][:, 0] * 1e3, *values, walk["gyro"][:, 1:]])
    (folder / "walk.csv").write_bytes(samples.text_of(names, table, form="%.12g"))
    return folder / "walk.csv"


@pytest.mark.parametrize("is_split", [False, True])
def test_a_new_app_is_a_file(phone_walk: Rows, tmp_path: Path, is_split: bool) -> None:
    (tmp_path / "new.toml").write_text(NEW_APP)
    reader, path = reader_of(tmp_path / "new.toml"), written(tmp_path, phone_walk, is_split=is_split)
    assert reader.sniff(head_of(path))
    log = reader.read(path)
    for sensor in ("accel", "gyro"):
        np.testing.assert_allclose(log.rows[sensor], phone_walk[sensor], atol=1e-6)


def test_every_file_is_found_and_right() -> None:
    named = {path.stem for path in FOLDER.glob("*.toml")}
    assert named == {"androsensor", "euroc", "oxiod", "ridi", "sensorlog", "xio"} <= READERS.keys()
    assert reader_of(FOLDER / "xio.toml").summary.startswith("x-IMU3")


@pytest.mark.parametrize(("old", "new"), [("accel_unit", "accel_units"), ("header", "head")])
def test_a_wrong_file_is_named(tmp_path: Path, old: str, new: str) -> None:
    (tmp_path / "new.toml").write_text(NEW_APP.replace(old, new))
    with pytest.raises(PdrbenchError, match=f"new.toml.*{new}"):
        reader_of(tmp_path / "new.toml")


@pytest.mark.parametrize(
    ("absent", "message"), [("Uptime", "no column 'Uptime'"), ("A,B,W", "switch them on in the app")]
)
def test_a_table_that_lacks_columns_is_refused(phone_walk: Rows, tmp_path: Path, absent: str, message: str) -> None:
    (tmp_path / "new.toml").write_text(NEW_APP)
    path = written(tmp_path, phone_walk, is_split=False)
    header, rows = path.read_text().split("\n", 1)
    for name in absent.split(","):
        header = header.replace(name, f"other {name}")
    path.write_text(f"{header}\n{rows}")
    with pytest.raises(RecordingError, match=message):
        reader_of(tmp_path / "new.toml").read(path)


def test_where_times_stand_still_rows_have_the_rate_of_the_set(phone_walk: Rows, tmp_path: Path) -> None:
    path = samples.oxiod(tmp_path, phone_walk)
    path.write_text("\n".join(f"1.4955e+11,{line.partition(',')[2]}" for line in path.read_text().splitlines()))
    log = reader_of(FOLDER / "oxiod.toml").read(path)
    np.testing.assert_allclose(log.rows["gyro"][:, 0], np.arange(len(phone_walk["gyro"])) / 100)
    assert "clock" in [finding.code for finding in log.findings] and len(log.reference) == len(log.rows["gyro"])
