"""Damaged and malicious files in every format: one error that says what to do, or an account of what was left out."""

from __future__ import annotations

import contextlib
import stat
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import recording_samples as samples
from recording_samples import SAMPLES

from pdrbench.errors import RecordingError
from pdrbench_formats.detect import detect, read

Rows = dict[str, np.ndarray]

FAULTS: dict[str, Callable[[bytes], bytes]] = {
    "empty": lambda content: b"",
    "blank": lambda content: b"\n\n  \n",
    "byte-order mark": lambda content: b"\xef\xbb\xbf" + content,
    "CRLF": lambda content: content.replace(b"\n", b"\r\n"),
    "NUL": lambda content: content[:5000] + b"\0" + content[5000:],
    "not UTF-8": lambda content: content[:5000] + b"\xff\xfe\xfd" + content[5000:],
    "UTF-16": lambda content: content.decode("utf-8", "replace").encode("utf-16"),
    "a line of a megabyte": lambda content: content + b"1" * (1 << 20),
    "truncated": lambda content: content[: len(content) - 7],
    "half": lambda content: content[: len(content) // 2],
    "header only": lambda content: content.partition(b"\n")[0] + b"\n",
    "two headers": lambda content: content.partition(b"\n")[0] + b"\n" + content,
    "not a number": lambda content: content[:6000] + b"\nNaN,NaN;NaN\n" + content[6000:],
    "1e400": lambda content: content.replace(b"9.", b"9e400", 50),
    "text for a number": lambda content: content[: len(content) // 2] + b"zebra" + content[len(content) // 2 :],
    "twice": lambda content: content + content.partition(b"\n")[2],
    "backwards": lambda content: b"\n".join([content.partition(b"\n")[0], *content.splitlines()[:0:-1], b""]),
    "nothing but separators": lambda content: b"PRES;;;;\nPRES;;;\n" * 5000,
    "tags": lambda content: b'<?xml version="1.0"?><!DOCTYPE a [<!ENTITY b "c">]><a>&b;</a>',
}
TEXTS = ("getsensordata", "androsensor", "xio", "xsens dot", "xsens mt", "ridi", "oxiod", "csv", "sensor logger, JSON")


class TestBadInput:
    """Whatever is wrong with a file, there is one error that names it and says what to do, or an account of it."""

    @pytest.mark.parametrize("name", TEXTS)
    def test_damaged_texts(self, name: str, phone_walk: Rows, tmp_path: Path) -> None:
        sample = SAMPLES[name]
        path = sample.write(tmp_path, {sensor: rows[:300] for sensor, rows in phone_walk.items()})
        whole, content = read(path, sample.reader, strict=False), path.read_bytes()
        for fault, damage in FAULTS.items():
            path.write_bytes(damage(content))
            try:
                log = read(path, sample.reader, strict=False)
            except RecordingError as error:
                assert str(path) in str(error) and ";" in str(error), fault
                continue
            account = log.report
            changed = account.dropped or account.mended or log.findings or account.skipped != whole.report.skipped
            same = {s: len(r) for s, r in log.rows.items()} == {s: len(r) for s, r in whole.rows.items()}
            assert changed or same or fault == "half", fault

    def test_a_bag_that_is_cut_is_read_to_its_end(self, phone_walk: Rows, tmp_path: Path) -> None:
        pytest.importorskip("mcap", reason="pip install pdrbench[test]")
        path = SAMPLES["mcap, JSON"].write(tmp_path, phone_walk)
        path.write_bytes(path.read_bytes()[: path.stat().st_size * 9 // 10])
        log = read(path)
        assert [finding.code for finding in log.findings] == ["cut"]
        assert 0 < len(log.rows["accel"]) < len(phone_walk["accel"])

    @pytest.mark.parametrize(
        ("member", "content", "message"),
        [
            ("../a.csv", b"x", "outside the archive"),
            ("/etc/a.csv", b"x", "outside the archive"),
            ("a.csv", b"\0" * (70 << 20), "zip bomb"),
            ("other.zip", b"PK", "holds other archives"),
            ("9" * 300 + ".csv", b"x", "under a shorter name"),
        ],
    )
    def test_a_malicious_archive(self, member: str, content: bytes, message: str, tmp_path: Path) -> None:
        path = samples.zip_of(tmp_path / "a.zip", {member: content})
        with pytest.raises(RecordingError, match=message):
            detect(path)

    def test_an_archive_with_changed_bytes(self, tmp_path: Path, rng: np.random.Generator) -> None:
        for method in (zipfile.ZIP_DEFLATED, zipfile.ZIP_LZMA):
            with zipfile.ZipFile(path := tmp_path / f"{method}.zip", "w", method) as archive:
                archive.writestr("a.csv", "t,x,y,z\n" + "".join(f"{i / 50},{i % 7},0,9.8\n" for i in range(300)))
            whole = np.frombuffer(path.read_bytes(), np.uint8)
            for _ in range(100):
                path.write_bytes(np.where(rng.random(len(whole)) < 0.002, 255 - whole, whole).tobytes())
                with contextlib.suppress(RecordingError):
                    detect(path)

    def test_a_link_in_an_archive(self, tmp_path: Path) -> None:
        link = zipfile.ZipInfo("Accelerometer.csv")
        link.external_attr = (stat.S_IFLNK | 0o777) << 16
        with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
            archive.writestr(link, "/etc/passwd")
        with pytest.raises(RecordingError, match="is a link"):
            detect(tmp_path / "a.zip")

    def test_a_second_phone_in_the_archive(self, phone_walk: Rows, tmp_path: Path) -> None:
        files = {**samples.sensor_logger(phone_walk, apple=True)}
        both = {f"{phone}/{name}": content for phone in ("mine", "yours") for name, content in files.items()}
        with pytest.raises(RecordingError, match=r"mine/\w+.csv and yours/\w+.csv are of two"):
            read(samples.zip_of(tmp_path / "a.zip", both))

    def test_data_outside_an_hdf5_file(self, phone_walk: Rows, tmp_path: Path) -> None:
        path = samples.ronin(tmp_path, phone_walk)
        h5py = pytest.importorskip("h5py")
        with h5py.File(path / "data.hdf5", "a") as file:
            del file["synced/acce"]
            file["synced/acce"] = h5py.ExternalLink("other.hdf5", "/acce")
        with pytest.raises(RecordingError, match="synced/acce is a link"):
            read(path)

    def test_an_hdf5_file_that_unpacks_to_gigabytes(self, phone_walk: Rows, tmp_path: Path) -> None:
        h5py = pytest.importorskip("h5py")
        path = SAMPLES["ronin"].write(tmp_path, phone_walk)
        with h5py.File(path / "data.hdf5", "a") as file:
            del file["synced/acce"]
            file.create_dataset("synced/acce", (60_000_000, 3), chunks=(1000, 3))  # nothing is written into it
        with pytest.raises(RecordingError, match=r"synced/acce has type .* expected numbers of one walk"):
            read(path)

    @pytest.mark.parametrize(
        ("damage", "shown"),
        [
            (b"GYRO;12.1;0.2", "'GYRO;12.1;0.2'"),
            (b"WIFI;12.1;ho", "'WIFI;12.1;ho'"),
            (b"WIFI;0..651;0.4;home;02:00:00:00:00:01;2412;-60", "'WIFI;0..651;0.4"),
            (b"BLE4;12.1;", "'BLE4;12.1;'"),
            (b"3.25;0.11;3", "'3.25;0.11;3'"),
            ("\u00ff\u00fe?".encode("latin-1"), "is no whole record"),
            (b"GYRO;12.1;0.2\nwhat is this?", "'GYRO;12.1;0.2' is no whole record, nor are 1 other lines"),
        ],
    )
    def test_lines_that_are_cut_off_or_rubbish_are_one_finding(
        self, damage: bytes, shown: str, phone_walk: Rows, tmp_path: Path
    ) -> None:
        path = samples.getsensordata(tmp_path, {sensor: rows[:300] for sensor, rows in phone_walk.items()})
        whole = read(path)
        lines = path.read_bytes().split(b"\n")
        lines[100:100] = damage.split(b"\n")
        path.write_bytes(b"\n".join(lines))
        log = read(path)
        (found,) = [finding for finding in log.findings if finding.code == "damaged-lines"]
        assert (found.severity, found.where) == ("warning", f"{path.name}, line 101")
        assert shown in found.seen
        assert "copy the log from the phone again" in found.remedy
        np.testing.assert_array_equal(log.rows["accel"], whole.rows["accel"])

    def test_a_log_of_weeks_is_refused_before_it_is_read(self, phone_walk: Rows, tmp_path: Path) -> None:
        path = samples.getsensordata(tmp_path, phone_walk)
        with path.open("a") as file:
            file.write("ACCE;90000.0;95000.0;0.1;0.2;9.8;3\n")
        with pytest.raises(RecordingError, match="25 h after the first record, expected a walk of at most 24"):
            read(path, strict=False)
