"""Recordings that people bring: one walk in every format, and real files where they are found."""

from __future__ import annotations

import gzip
import math
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import recording_samples as samples
from hypothesis import given, settings
from hypothesis import strategies as st
from recording_samples import SAMPLES

from pdrbench.errors import RecordingError
from pdrbench.io import READERS
from pdrbench.io.log import Log
from pdrbench_formats.detect import detect, read
from pdrbench_formats.recordings import getsensordata
from pdrbench_formats.recordings.getsensordata import _parse_wifi
from pdrbench_formats.recordings.opaque import opaque_id

Rows = dict[str, np.ndarray]
ADDRESS = "02:00:00:00:00:0A"


def needed(name: str) -> samples.Sample:
    """A sample; skips where the library that writes it is missing."""
    sample = SAMPLES[name]
    if sample.needs:
        pytest.importorskip(sample.needs, reason="pip install pdrbench[formats]")
    return sample


class TestOneWalkInEveryFormat:
    """The same motion, written as each app or device writes it, gives the same streams."""

    @pytest.mark.parametrize("name", SAMPLES)
    def test_streams_are_those_of_the_walk(self, name: str, phone_walk: Rows, tmp_path: Path) -> None:
        sample = needed(name)
        path = sample.write(tmp_path, phone_walk)
        assert detect(path) == sample.reader
        log = read(path)
        assert isinstance(log, Log)
        for sensor in sample.streams:
            if sensor == "reference":
                assert len(log.reference) >= 2
                assert log.reference.surveyed.all()
            elif sensor in ("wifi", "ble"):
                assert len(log.rows[sensor]) == 1
            else:
                rows, truth = log.rows[sensor], phone_walk[sensor]
                assert rows.shape == truth.shape
                np.testing.assert_allclose(rows[:, 0] - rows[0, 0], truth[:, 0], atol=2e-4)
                values = rows[:, 1:]
                if sensor == "rotation":  # q and -q are one attitude
                    values = values * np.sign((values * truth[:, 1:]).sum(axis=1))[:, None]
                np.testing.assert_allclose(values, truth[:, 1:], atol=2e-4)
        assert not [finding for finding in log.findings if finding.severity == "error"]

    def test_the_reference_is_in_metres_about_its_place(self, phone_walk: Rows, tmp_path: Path) -> None:
        log = read(samples.getsensordata(tmp_path, phone_walk))
        assert log.geo is not None
        assert log.reference.level.tolist() == [1, -1]
        north_m = float(np.diff(log.reference.xy_m[:, 1])[0])
        assert north_m == pytest.approx(2450e-6 * 111_240, rel=1e-3)  # metres in a degree at 49.46 north
        assert (log.device, log.start_unix_s) == ("samsung SM-A520F", pytest.approx(1_700_000_000, abs=1.0))

    def test_radio_has_numbers_in_place_of_addresses(self, phone_walk: Rows, tmp_path: Path) -> None:
        log = read(samples.getsensordata(tmp_path, phone_walk))
        same = opaque_id("wifi", "02:00:00:00:00:01")
        assert log.rows["wifi"][0, 1:4].tolist() == [same, -61.0, 2412.0]
        assert log.rows["wifi"][0, 4] == pytest.approx(0.297, abs=2e-3)  # arrived at 1.5 s, received at 1.2 s
        assert log.rows["ble"][0, 2:].tolist() == [-90.0, -59.0]
        other = read(samples.zip_of(tmp_path / "a.zip", samples.sensor_logger(phone_walk, apple=True)))
        assert other.rows["wifi"][0, 1] == same
        assert other.rows["ble"][:, 1].tolist() == [opaque_id("ble", "a"), opaque_id("ble", "b")]

    def test_a_log_is_read_in_parts(self, phone_walk: Rows, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        path = samples.getsensordata(tmp_path, phone_walk)
        whole = read(path)
        monkeypatch.setattr(getsensordata, "CHUNK_BYTES", 50_000)
        parts = read(path)
        (tmp_path / "log.txt.gz").write_bytes(gzip.compress(path.read_bytes()))
        for log in (parts, read(tmp_path / "log.txt.gz")):
            for sensor, rows in whole.rows.items():
                np.testing.assert_array_equal(log.rows[sensor], rows)

    def test_an_archive_of_one_file_is_that_file(self, phone_walk: Rows, tmp_path: Path) -> None:
        log = samples.getsensordata(tmp_path, phone_walk)
        packed = samples.zip_of(tmp_path / "a.zip", {"logs/log.txt": log.read_bytes()})
        assert detect(packed) == "getsensordata"
        np.testing.assert_array_equal(read(packed).rows["accel"], read(log).rows["accel"])
        broken = samples.zip_of(tmp_path / "b.zip", {"log.txt": log.read_bytes() + b"ACCE;a;b;c;d;e;3\n%\n"})
        with pytest.raises(RecordingError, match=r"b\.zip/log\.txt: line \d+: 'ACCE;a;b"):
            read(broken)

    def test_a_pause_of_phyphox_moves_all_sensors(self, phone_walk: Rows, tmp_path: Path) -> None:
        path = samples.phyphox(tmp_path, phone_walk)
        with zipfile.ZipFile(path) as archive:
            files: dict[str, Any] = {name: archive.read(name) for name in archive.namelist()}
        files["meta/time.csv"] += b'"PAUSE",10.0,1700000010.0,"a"\n"START",10.0,1700000025.0,"b"\n'
        log = read(samples.zip_of(tmp_path / "b.zip", files))
        assert log.rows["accel"][-1, 0] == pytest.approx(29.99 + 15.0)
        assert [finding.code for finding in log.findings] == ["gap", "gap"]

    def test_only_quaternions_say_what_is_missing(self, phone_walk: Rows, tmp_path: Path) -> None:
        log = read(samples.xsens_dot(tmp_path, phone_walk, free=True))
        assert [finding.code for finding in log.findings] == ["cannot-localize"]
        assert "gyroscope" in log.findings[0].remedy


@given(value=st.floats(-1e12, 1e12), digits=st.integers(1, 15))
@settings(max_examples=60, deadline=None, derandomize=True)
def test_numbers_of_logs_are_read_to_the_last_bit(value: float, digits: int) -> None:
    written = f"{value:.{digits}g}"
    begin = b"ACCE;" + b";".join([written.encode()] * 5) + b";3\n"
    parts = getsensordata._Parts()
    getsensordata._read_chunk(Path("a"), begin, 1, parts, getsensordata.Tally(), is_last=False)
    got = parts.rows["accel"][0][0, 1]
    assert got == pytest.approx(float(written), rel=4e-16, abs=1e-30)


@pytest.mark.parametrize(
    ("pattern", "kind", "sensors", "codes"),
    [
        ("sensor_logger/*.zip", "sensor_logger", "accel gyro", set()),
        ("sensor_logger/simorxb_uncalibrated", "sensor_logger", "accel gyro mag", {"platform", "mag-uncalibrated"}),
        ("xsens_dot/LF*.csv", "xsens", "accel rotation", {"lost-packets", "cannot-localize"}),
        ("xsens_mt/*.txt", "xsens", "accel rotation", {"cannot-localize"}),
        ("ros1_bag/test2.bag", "ros", "accel gyro rotation", {"clock", "reference"}),
        ("ros2_converted/test2_imu_db3", "ros", "accel gyro rotation", {"clock"}),
        (
            "../ipin2023_track3/logs/*21_repetition01.txt",
            "getsensordata",
            "accel gyro mag baro rotation wifi ble",
            set(),
        ),
    ],
)
def test_real_files(data_root: Path, pattern: str, kind: str, sensors: str, codes: set[str]) -> None:
    if kind == "ros":
        pytest.importorskip("rosbags", reason="pip install pdrbench[formats]")
    (path,) = sorted((data_root / "samples").glob(pattern))
    assert detect(path) == kind
    log = READERS[kind].read(path)
    assert set(log.rows) == set(sensors.split())
    assert {finding.code for finding in log.findings} == codes
    force = np.linalg.norm(log.rows["accel"][:, 1:], axis=1)
    assert np.median(force) == pytest.approx(9.8, abs=0.9)


@pytest.mark.parametrize("name", ["home", "a;b;c", "", "x;02:00:00:00:00:09;5", "02:00:00:00:00:09"])
@pytest.mark.parametrize(("frequency", "mhz"), [("2412;", 2412.0), ("", 0.0)])
@pytest.mark.parametrize(("seen", "seen_s"), [("12,5", 12.5), ("", math.nan)])
def test_the_last_fields_count_from_the_right(name: str, frequency: str, mhz: float, seen: str, seen_s: float) -> None:
    *numbers, address = _parse_wifi(f"WIFI;1.5;{seen};{name};{ADDRESS};{frequency}-60;".encode())
    assert numbers == pytest.approx([1.5, seen_s, mhz, -60.0], nan_ok=True)
    assert address == ADDRESS.encode()


@pytest.mark.parametrize("rest", ["home;zz:00:00:00:00:01;-60", "home;02:00:00:00:00;-60", f"a;{ADDRESS};x", ""])
def test_what_has_no_address_or_strength_is_refused(rest: str) -> None:
    with pytest.raises(ValueError, match="no address"):
        _parse_wifi(f"WIFI;1.5;1.2;{rest}".encode())
