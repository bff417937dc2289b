"""Tables as apps, spreadsheets and scripts write them: what stands above the rows, separators, encodings, names."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import recording_samples as samples

from pdrbench.errors import RecordingError
from pdrbench_formats.detect import detect, read
from pdrbench_formats.recordings.delimited import read_delimited

Rows = dict[str, np.ndarray]


def rows_of(walk: Rows, separator: str = ",", decimal: str = ".") -> list[str]:
    """Lines of time, specific force and angular rates."""
    table = np.column_stack([walk["accel"], walk["gyro"][:, 1:]])
    return [separator.join(f"{value:.7f}" for value in row).replace(".", decimal) for row in table]


@pytest.mark.parametrize(
    ("above", "separator", "decimal", "encoding"),
    [
        ("t,ax,ay,az,gx,gy,gz", ",", ".", "utf-16"),
        ("t;ax;ay;az;gx;gy;gz", ";", ",", "utf-16-be"),
        ("# device: Foo, 3\n# rate: 100 Hz\nt,ax,ay,az,gx,gy,gz", ",", ".", "utf-8"),
        ("sep=;\nt;ax;ay;az;gx;gy;gz", ";", ",", "latin-1"),
        ("Recorded by me\n\nname, value\nt,ax,ay,az,gx,gy,gz", ",", ".", "utf-8-sig"),
        ("t ax  ay az   gx gy gz", "   ", ".", "ascii"),
        ("t,ax,ay,az,gx,gy,gz\ns,m/s^2,m/s^2,m/s^2,rad/s,rad/s,rad/s", ",", ".", "utf-8"),
        ("#t|ax|ay|az|gx|gy|gz", "|", ".", "utf-8"),
        ("时间,加速度x,加速度y,加速度z,角速度x,角速度y,角速度z", ",", ".", "gbk"),
    ],
)
def test_what_stands_above_the_rows(
    phone_walk: Rows, tmp_path: Path, above: str, separator: str, decimal: str, encoding: str
) -> None:
    text = "\r\n".join([*above.split("\n"), *rows_of(phone_walk, separator, decimal), ""])
    mark = b"\xfe\xff" if encoding == "utf-16-be" else b""
    (tmp_path / "a.txt").write_bytes(mark + text.encode(encoding))
    log = read(tmp_path / "a.txt", "csv")
    assert detect(tmp_path / "a.txt") == "csv"
    np.testing.assert_allclose(log.rows["accel"], phone_walk["accel"], atol=1e-6)
    np.testing.assert_allclose(log.rows["gyro"], phone_walk["gyro"], atol=1e-6)


def test_of_two_accelerations_the_one_with_gravity_is_read(phone_walk: Rows, tmp_path: Path) -> None:
    """Physics Toolbox writes forces in g beside the acceleration without gravity, and pressure as p."""
    t, a = phone_walk["accel"][:, 0], phone_walk["accel"][:, 1:]
    linear, gyro = a - phone_walk["gravity"][:, 1:], phone_walk["gyro"][:, 1:]
    table = np.column_stack([t, a / 9.80665, linear, gyro, 1009.0 + 0.01 * t])
    header = "time,gFx,gFy,gFz,ax,ay,az,wx,wy,wz,p"
    np.savetxt(tmp_path / "a.csv", table, delimiter=",", header=header, comments="")
    log = read(tmp_path / "a.csv")
    np.testing.assert_allclose(log.rows["accel"][:, 1:], a, atol=1e-6)
    assert set(log.rows) == {"accel", "gyro", "baro"}
    assert [finding.code for finding in log.findings] == ["columns-guessed"]


def test_a_device_on_its_face_may_have_the_sign_of_an_iphone(phone_walk: Rows, tmp_path: Path) -> None:
    table = np.column_stack([phone_walk["accel"] * [1, -1, -1, -1], phone_walk["gyro"][:, 1:]])
    np.savetxt(tmp_path / "a.csv", table, delimiter=",", header="t,ax,ay,az,gx,gy,gz", comments="")
    (found,) = [finding for finding in read(tmp_path / "a.csv").findings if finding.code == "accel-sign"]
    assert (found.severity, '"-ax", "-ay", "-az"' in found.remedy) == ("warning", True)


@pytest.mark.parametrize("said", [b"android", b"ios"])
def test_the_attitude_of_a_phone_says_which_sign_its_acceleration_has(
    phone_walk: Rows, tmp_path: Path, said: bytes
) -> None:
    """Metadata of the other system than the one that recorded."""
    files = samples.sensor_logger(phone_walk, apple=said == b"android")
    files["Metadata.csv"] = files["Metadata.csv"].replace(b"ios" if said == b"android" else b"android", said)
    log = read(samples.zip_of(tmp_path / "a.zip", files))
    np.testing.assert_allclose(log.rows["accel"][:, 1:], phone_walk["accel"][:, 1:], atol=1e-5)
    assert abs((log.rows["rotation"] * phone_walk["rotation"])[:, 1:].sum(axis=1)) == pytest.approx(1.0, abs=1e-4)
    assert [finding.code for finding in log.findings] == ["accel-sign"]
    assert "it was turned round" in log.findings[0].remedy


@pytest.mark.parametrize(
    ("form", "coarse"),
    [
        ("%H:%M:%S:{ms:03d}", False),
        ("%H:%M:%S.{ms:03d}", False),
        ("%Y-%m-%d %H:%M:%S:{ms:03d}", False),
        ("%d.%m.%Y %H:%M:%S.{ms:03d}", False),
        ("%Y-%m-%d %H:%M:%S", True),
    ],
)
def test_times_of_day_and_dates(phone_walk: Rows, tmp_path: Path, form: str, coarse: bool) -> None:
    """Over midnight; where dates are to the second, another column says the time."""
    from datetime import UTC, datetime, timedelta

    begin = datetime(2024, 4, 5, 23, 59, 50, tzinfo=UTC)
    lines = ["Date,elapsed ms,ax,ay,az" if coarse else "Time(s),number,ax,ay,az"]
    for row in phone_walk["accel"]:
        at = begin + timedelta(seconds=row[0])
        date = at.strftime(form).format(ms=at.microsecond // 1000)
        lines.append(f"{date},{row[0] * 1e3 if coarse else 7:.0f},{row[1]:.6f},{row[2]:.6f},{row[3]:.6f}")
    (tmp_path / "a.csv").write_text("\n".join(lines) + "\n")
    log = read(tmp_path / "a.csv", "csv")
    np.testing.assert_allclose(log.rows["accel"], phone_walk["accel"], atol=1e-3)


def test_tables_of_two_devices_are_refused(phone_walk: Rows, tmp_path: Path) -> None:
    names = {"acc_left.csv": "accel", "gyro.csv": "gyro", "acc.csv": "accel", "acceleration.csv": "accel"}
    for name, sensor in names.items():
        text = samples.text_of("time,x,y,z", phone_walk[sensor], form="%.7f").decode()
        (tmp_path / name).write_text(text if name == "gyro.csv" else text.replace("9.", f"9.{len(name)}"))
    with pytest.raises(RecordingError, match="both hold accel: two devices or two recordings"):
        read(tmp_path)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"SQLite format 3\0" + bytes(100), "an SQLite database.*export the tables as CSV"),
        (b"\xd0\xcf\x11\xe0" + bytes(100), "Excel workbook.*choose CSV"),
        (b'<?xml version="1.0"?>\n<mvnx version="4">', "Xsens MVN"),
        (b'<phyphox version="1.18">', "saved state of phyphox.*export it as CSV"),
        (b"MATLAB 5.0 MAT-file, Platform: GLNXA64" + bytes(100), "writetable"),
        (b"\x80\x04\x95" + bytes(50), "a pickle"),
        (b"[" + 5000 * b"0, " + b"0]", "in no format"),  # nor a table of one row, which took 3 s
        (b"a,b,c,d\n1,2,3,4\n", "no time and sensor"),
        (b"[" + 30_000 * b" " + b"1]", "in no format"),  # took the square of its spaces to search
    ],
)
def test_files_of_other_programs_are_refused_with_the_way_out(tmp_path: Path, content: bytes, message: str) -> None:
    (tmp_path / "a").write_bytes(content)
    with pytest.raises(RecordingError, match=message):
        read(tmp_path / "a")


def test_phyphox_in_any_language(phone_walk: Rows, tmp_path: Path) -> None:
    """Units say which sensor it is, and gravity which of two accelerations."""
    linear = phone_walk["accel"] - phone_walk["gravity"] * [0, 1, 1, 1]
    tables = {
        "Kaiken": (linear, "加速度", "m/s^2"),
        "A": (phone_walk["accel"], "加速度", "m/s^2"),
        "B": (phone_walk["gyro"], "回転", "rad/s"),
    }
    files = {"meta/time.csv": b'"event","experiment time","system time"\n"START",0,1700000000\n'}
    for name, (rows, word, unit) in tables.items():
        header = ",".join(f'"{text}"' for text in ["時間 (s)", *(f"{word} {axis} ({unit})" for axis in "xyz")])
        files[f"{name}.csv"] = samples.text_of(header, rows, form="%.7E")
    log = read(samples.zip_of(tmp_path / "a.zip", files))
    assert detect(tmp_path / "a.zip") == "phyphox"
    np.testing.assert_allclose(log.rows["accel"], phone_walk["accel"], atol=1e-5)
    np.testing.assert_allclose(log.rows["gyro"], phone_walk["gyro"], atol=1e-5)


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("value", ["1e308", "nan", "inf", "", "99999999999999999999", "-9223372036854775808"])
def test_numbers_that_are_none_are_left_out_or_refused(tmp_path: Path, value: str) -> None:
    """In the time, in a sensor and in every field, at once and in half of the rows."""
    for place in (0, 2, None):
        rows = [[f"{0.01 * k:.2f}", "1.0", "2.0", "9.3", "0.1", "0.2", "0.3"] for k in range(60)]
        for row in rows[::2]:
            row[slice(None) if place is None else slice(place, place + 1)] = [value] * (7 if place is None else 1)
        text = "\n".join(",".join(row) for row in rows)
        (tmp_path / "a.csv").write_text(f"t,ax,ay,az,gx,gy,gz\n{text}\n")
        try:
            log = read(tmp_path / "a.csv", strict=False)
        except RecordingError as error:
            assert "a.csv" in str(error)
        else:
            assert sum(log.report.dropped.values()) or any(found.severity == "error" for found in log.findings)


def test_a_point_that_parts_thousands_parts_those_of_smaller_numbers_too(tmp_path: Path) -> None:
    content = b"t;x;y\n0;1.234;1,5\n1;1.234.567;2,5\n2;12;3,5\n"
    table = read_delimited(content, tmp_path / "a.csv")
    assert table.numbers("x").tolist() == [1234.0, 1234567.0, 12.0]
