"""Tables of numbers with a column map, stated or guessed."""

from __future__ import annotations

import gzip
import tomllib
from pathlib import Path

import numpy as np
import pytest
import recording_samples as samples
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pdrbench.errors import RecordingError
from pdrbench_formats.detect import read
from pdrbench_formats.recordings import csv_columns
from pdrbench_formats.recordings.columnmap import read_column_map

Rows = dict[str, np.ndarray]


class TestTables:
    """Tables of numbers with a column map, stated or guessed."""

    MAP = """
        [columns]
        time = "when"
        time_unit = "us"
        accel = ["-c", "a", "b"]
        accel_unit = "g"
        gyro = ["w1", "w2", "w3"]
        gyro_unit = "deg/s"
        place = ["lat", "lon"]
        place_unit = "deg"
        level = "floor"
        mounting = "hand"
    """

    @pytest.fixture
    def table(self, phone_walk: Rows, tmp_path: Path) -> Path:
        t, a = phone_walk["accel"][:, 0], phone_walk["accel"][:, 1:] / samples.GRAVITY_MPS2
        w = np.degrees(phone_walk["gyro"][:, 1:])
        values = [np.round(t * 1e6), a[:, 1], a[:, 2], -a[:, 0], w, 49.46 + 1e-6 * t, np.full(len(t), 11.11), t // 10]
        (tmp_path / "columns.toml").write_text(self.MAP)
        content = samples.text_of("when,a,b,c,w1,w2,w3,lat,lon,floor", np.column_stack(values), form="%.12g")
        (tmp_path / "a.csv").write_bytes(content)
        return tmp_path / "a.csv"

    def test_a_stated_map(self, table: Path, phone_walk: Rows) -> None:
        log = read(table, "csv", columns=table.with_name("columns.toml"))
        np.testing.assert_allclose(log.rows["accel"], phone_walk["accel"], atol=1e-6)
        np.testing.assert_allclose(log.rows["gyro"], phone_walk["gyro"], atol=1e-6)
        assert (log.mounting, log.findings, np.unique(log.reference.level).tolist()) == ("hand", (), [0, 1, 2])
        assert log.geo is not None

    @pytest.mark.parametrize(
        ("old", "new", "message"),
        [
            ('gyro_unit = "deg/s"', 'gyro_unit = "turn"', "Invalid enum value 'turn'"),
            ("gyro_unit", "gyr_unit", "did you mean 'gyro_unit'"),
            ('"w1"', '"w9"', "no column 'w9'; the header names when, a, b"),
            ('time = "when"', "", "no `time`; name its column, or state rate_hz"),
            ('"deg/s"', '"rad/s"', "looks like degree/s"),
            ("[columns]", "[columns", "not TOML"),
        ],
    )
    def test_a_wrong_map(self, table: Path, old: str, new: str, message: str) -> None:
        table.with_name("columns.toml").write_text(self.MAP.replace(old, new))
        with pytest.raises(RecordingError, match=message):
            read(table, "csv", columns=table.with_name("columns.toml"))

    def test_a_guess_can_be_pasted(self, phone_walk: Rows, tmp_path: Path) -> None:
        path = samples.csv(tmp_path, phone_walk)
        (tmp_path / "columns.toml").write_text(csv_columns.column_map_of(path))
        stated = read(path, "csv", columns=tmp_path / "columns.toml")
        assert stated.findings == ()
        for sensor, rows in read(path).rows.items():
            np.testing.assert_array_equal(stated.rows[sensor], rows)

    def test_units_by_size_are_a_warning(self, phone_walk: Rows, tmp_path: Path) -> None:
        path, table = tmp_path / "a.csv", np.column_stack([phone_walk["accel"], phone_walk["gyro"][:, 1:]])
        path.write_bytes(samples.text_of("t,ax,ay,az,gx,gy,gz", table))
        log = read(path)
        assert [finding.code for finding in log.findings] == ["columns-guessed"]
        assert "# by the size" in csv_columns.column_map_of(path)

    @pytest.mark.parametrize(
        ("header", "expected"),
        [
            ("Time (s),Linear Acceleration x (m/s^2),y,z", {}),
            ("timestamp [ns],accel_x [g],accel_y [g],accel_z [g]", {"time_unit": "ns", "accel_unit": "g"}),
            ("t_s,accel_x_mps2,accel_y_mps2,accel_z_mps2", {"time_unit": "s", "accel_unit": "m/s^2"}),
            ("time_ms,gyr_x_dps,gyr_y_dps,gyr_z_dps", {"time_unit": "ms", "gyro_unit": "deg/s"}),
            ("#time,AccX,AccY,AccZ,MagX (uT),MagY (uT),MagZ (uT)", {"mag_unit": "uT"}),
            ("loggingTime,foo,bar,baz", {}),
            ("time_ms,accelerometer_0 (g),accelerometer_1 (g),accelerometer_2 (g)", {"accel_unit": "g"}),
        ],
    )
    def test_names_of_columns(self, header: str, expected: dict[str, str], tmp_path: Path) -> None:
        width = header.count(",")
        rows = "\n".join(f"{k}" + ",1.0" * width for k in range(30))
        path = tmp_path / "a.csv"
        path.write_text(f"{header}\n{rows}\n")
        found = csv_columns.column_map_of(path)
        assert bool(found) is bool(expected)
        for name, unit in expected.items():
            assert f'{name} = "{unit}"' in found

    @given(
        values=st.lists(
            st.tuples(*[st.floats(-400.0, 400.0, allow_subnormal=False)] * 3, *[st.floats(-60.0, 60.0)] * 3),
            min_size=2,
            max_size=30,
        ),
        separator=st.sampled_from(",;\t"),
        gzipped=st.booleans(),
    )
    @settings(
        max_examples=25, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture]
    )
    def test_round_trip_keeps_every_bit(
        self, tmp_path: Path, values: list[tuple[float, ...]], separator: str, gzipped: bool
    ) -> None:
        header = separator.join(
            ["t_s", *(f"{s}_{a}_{u}" for s, u in (("accel", "mps2"), ("gyro", "radps")) for a in "xyz")]
        )
        rows = [separator.join(map(repr, (0.01 * k, *row))) for k, row in enumerate(values)]
        content = "\n".join([header, *rows, ""]).encode()
        path = tmp_path / "a.csv"
        path.write_bytes(gzip.compress(content) if gzipped else content)
        log = read(path, "csv", strict=False)
        np.testing.assert_array_equal(log.rows["accel"][:, 1:], np.array(values)[:, :3])
        np.testing.assert_array_equal(log.rows["gyro"][:, 1:], np.array(values)[:, 3:])


def test_a_column_map_knows_every_key_that_it_prints() -> None:
    full = read_column_map({"time": "t", "accel": ["a", "b", "c"], "baro": "p", "surveyed": False, "mounting": "hand"})
    assert read_column_map(tomllib.loads(full.toml())["columns"]) == full
