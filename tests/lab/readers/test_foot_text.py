"""Recordings of the foot in text files: `foot_loops` and `foot_short`."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pdrbench.errors import RecordingError
from pdrbench.sensors import sensor_spec
from pdrbench_lab.readers import foot_loops, foot_short

NUM_SAMPLES = 300
TICKS = 78_720
NAMES = (
    "Header", "a_x [g]", "a_y [g]", "a_z [g]", "ar_x [rad/s]", "ar_y [rad/s]", "ar_z [rad/s]", "Counter", "Checksum",
    "Nr", "Filtered ts[s]", "Unfiltered ts[s]", "Pred. ts[s]", "Freq. [Hz]", "m_x [G]", "m_y [G]", "m_z [G]",
)  # fmt: skip
G = 9.80665
Row = list[str]


def loop_rows() -> list[Row]:
    """A shoe that swings, z up; the counter begins high and starts anew after 100 samples."""
    rows = []
    for k in range(NUM_SAMPLES):
        swing = max(np.sin(2 * np.pi * k / 250), 0.0)
        counter = 130_000_000 + k * TICKS if k < 100 else 1234 + (k - 100) * TICKS
        host_s = 1274434048.5 + k * 0.004
        rows.append([
            "0xcb", "-0.1", "+0.05", f"{1 + 1.5 * swing:+.8f}", "+0.01", f"{6 * swing:+.8f}", "-0.002", str(counter),
            "0x15fd", str(k + 1), f"{host_s:.6f}", f"{host_s:.6f}", f"{host_s:.6f}", "250.0", "-0.12", "-0.01", "-0.46",
        ])  # fmt: skip
    return rows


def put_loop(folder: Path, rows: list[Row], *, names: tuple[str, ...] = NAMES, end: str = "\r\n") -> Path:
    lines = ["", "Inertial data.", "", ": ".join(names) + ":", *("   ".join(row) + " " for row in rows)]
    path = folder / "data_inert.txt"
    path.write_bytes(end.join([*lines, ""]).encode())
    return path


def test_units_clock_and_reference_of_a_loop(tmp_path: Path) -> None:
    """g, rad/s and gauss in the file; the clock runs on through the counter's new start."""
    log = foot_loops.read(put_loop(tmp_path, loop_rows()))
    assert set(log.rows) == {"accel", "gyro", "mag"}
    np.testing.assert_allclose(log.rows["accel"][0], [0, -0.1 * G, 0.05 * G, G], rtol=1e-12)
    np.testing.assert_allclose(log.rows["gyro"][50, 1:], [0.01, 6 * np.sin(2 * np.pi / 5), -0.002], rtol=1e-7)
    np.testing.assert_allclose(log.rows["mag"][7, 1:], [-12, -1, -46], rtol=1e-12)
    np.testing.assert_allclose(log.rows["accel"][:, 0], np.arange(NUM_SAMPLES) * TICKS / 19_660_800, atol=1e-12)
    np.testing.assert_array_equal(log.reference.xy_m, np.zeros((2, 2)))
    np.testing.assert_array_equal(log.reference.t_s, log.rows["accel"][[0, -1], 0])
    assert log.report.mended["carriage return at the end of a line"] == NUM_SAMPLES + 4
    assert log.report.longest_gap_s["gyro"] == pytest.approx(TICKS / 19_660_800)
    assert set(log.recording("walk", None, sensor_spec).streams) == {"accel", "gyro", "mag"}


def test_columns_are_found_by_name(tmp_path: Path, rng: np.random.Generator) -> None:
    """The word at the front of the header stays there."""
    expected = foot_loops.read(put_loop(tmp_path, loop_rows()))
    order = [0, *(1 + rng.permutation(len(NAMES) - 1))]
    moved = put_loop(tmp_path, [[row[i] for i in order] for row in loop_rows()], names=tuple(NAMES[i] for i in order))
    for name, rows in foot_loops.read(moved).rows.items():
        np.testing.assert_array_equal(rows, expected.rows[name])
    with pytest.raises(RecordingError, match=r"no column 'm_z \[G\]'; the header names Header, a_x"):
        foot_loops.read(put_loop(tmp_path, [row[:-1] for row in loop_rows()], names=NAMES[:-1]))


def test_rows_without_a_field_and_a_cut_last_line_are_counted(tmp_path: Path) -> None:
    """The recorder was stopped in the middle of a line; the magnetometer pauses now and then."""
    rows = loop_rows()
    rows[5][14:] = ["+nan"] * 3
    rows[9][1] = "nan"
    path = put_loop(tmp_path, rows)
    path.write_bytes(path.read_bytes() + b"   0xcb   -0.0951   +0.15")
    log = foot_loops.read(path)
    assert dict(log.report.dropped) == {
        "the last line is cut off": 1, "mag is not a number": 1, "accel is not a number": 1,
    }  # fmt: skip
    assert [len(log.rows[name]) for name in ("accel", "gyro", "mag")] == [299, 300, 299]


def test_ten_seconds_without_numbers_are_a_gap(tmp_path: Path) -> None:
    """2500 samples at 250 Hz; the counter has started anew meanwhile, so the numbers of the rows carry the clock."""
    rows = loop_rows()
    for row in rows[150:]:
        row[9] = str(int(row[9]) + 2500)
        row[7] = str((int(row[7]) + 2500 * TICKS) % 19_689_126)
        for column in (10, 11, 12):
            row[column] = f"{float(row[column]) + 10:.6f}"
    log = foot_loops.read(put_loop(tmp_path, rows))
    assert log.report.longest_gap_s["accel"] == pytest.approx(2501 * TICKS / 19_660_800, abs=1e-6)
    assert dict(log.report.skipped) == {"numbers of rows that are not there": 2500}


def test_a_repeated_row_is_dropped(tmp_path: Path) -> None:
    rows = loop_rows()
    log = foot_loops.read(put_loop(tmp_path, rows[:50] + rows[49:]))
    assert log.report.dropped["the same row twice"] == 1
    assert len(log.rows["accel"]) == NUM_SAMPLES


def _scaled(columns: range, factor: float) -> Callable[[list[Row]], None]:
    def change(rows: list[Row]) -> None:
        for row in rows:
            row[columns.start : columns.stop] = [f"{float(row[i]) * factor:+.8f}" for i in columns]

    return change


def _at(row: int, column: int, text: str) -> Callable[[list[Row]], None]:
    def change(rows: list[Row]) -> None:
        rows[row][column] = text

    return change


def _swap(rows: list[Row]) -> None:
    rows[20], rows[21] = rows[21], rows[20]


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (_scaled(range(1, 4), G), r"accel: .*looks like g, converted twice"),
        (_scaled(range(4, 7), 57.3), r"gyro: .*looks like degree/s: state the unit, or multiply"),
        (_scaled(range(4, 7), 0.01), r"gyro: .* of a device that is shaken; it was converted from degree/s twice"),
        (_scaled(range(14, 17), 0.01), r"mag: the median length is 0\.47\d+ uT; it looks like gauss"),
        (_at(12, 2, "-0,05"), r"line 17: a_y \[g\] is '-0,05': a decimal comma; write a point"),
        (_at(12, 5, "x"), r"line 17: ar_y \[rad/s\] is 'x': no number"),
        (_at(12, 2, "1 2"), r"line 17: 18 fields, expected 17"),
        (lambda rows: rows[8].pop(), r"line 13: 16 fields, expected 17"),
        (_swap, r"line 26: row number 21 after 22; put the rows in order"),
        (lambda rows: rows.clear(), r"0 rows, expected 10 or more"),
        (lambda rows: [row.__setitem__(7, "5") for row in rows], r"all 300 samples have one time"),
    ],
)
def test_a_loop_that_cannot_be_right_is_refused(tmp_path: Path, change: Callable[[list[Row]], None], says: str) -> None:
    rows = loop_rows()
    change(rows)
    with pytest.raises(RecordingError, match=says) as caught:
        foot_loops.read(put_loop(tmp_path, rows))
    assert "data_inert.txt" in str(caught.value) and "\n" not in str(caught.value)


def test_another_tick_rate_is_noticed(tmp_path: Path) -> None:
    rows = [[*row] for _ in range(7) for row in loop_rows()]
    for k, row in enumerate(rows):
        row[7], row[9], row[10] = str(k * TICKS), str(k + 1), f"{1274434048.5 + k * 0.005:.6f}"
    with pytest.raises(RecordingError, match=r"8\.4 s by the counter .* and 10\.5 s by the host"):
        foot_loops.read(put_loop(tmp_path, rows))


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "line 1: the file is empty"),
        (b"\r\nInertial data.\r\n", "no line in front begins with 'Header:'"),
        (b"Header: a_x [g]:\n1 2\n", "line 2: 2 fields, expected 2|no column 'a_y"),
        (b"Header: a_x [g]", "no line in front begins with 'Header:'"),
        (b"Header:\0", "NUL"),
        (b"Header: \xff\n", "not UTF-8"),
        (b"Header:" + b" " * 70_000 + b"\n", "longer than 64 KiB"),
    ],
)
@pytest.mark.parametrize("read", [foot_loops.read, foot_short.read])
def test_other_text_is_refused(tmp_path: Path, read: Callable[[Path], Any], content: bytes, says: str) -> None:
    path = tmp_path / "walk.txt"
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=f"{says}|no column 'Time|no names of columns"):
        read(path)


SHORT = (
    "Time (s)", "Gyroscope X (deg/s)", "Gyroscope Y (deg/s)", "Gyroscope Z (deg/s)",
    "Accelerometer X (g)", "Accelerometer Y (g)", "Accelerometer Z (g)",
)  # fmt: skip


def short_rows() -> list[Row]:
    swing = np.maximum(np.sin(2 * np.pi * np.arange(400) / 400), 0.0)
    return [
        [f"{k / 400:.6f}", "0.5", f"{300 * s:.6f}", "-0.25", "-0.1", "0.05", f"{1 + 1.5 * s:.6f}"]
        for k, s in enumerate(swing)
    ]


def put_short(folder: Path, rows: list[Row], *, names: tuple[str, ...] = SHORT, end: str = "\n") -> Path:
    path = folder / "short_walk.csv"
    path.write_bytes((end.join([",".join(names), *(",".join(row) for row in rows)]) + end).encode())
    return path


def test_units_and_reference_of_a_short_walk(tmp_path: Path) -> None:
    log = foot_short.read(put_short(tmp_path, short_rows()))
    np.testing.assert_allclose(log.rows["accel"][0], [0, -0.1 * G, 0.05 * G, G], rtol=1e-12)
    np.testing.assert_allclose(log.rows["gyro"][100], [0.25, *np.radians([0.5, 300, -0.25])], rtol=1e-12)
    np.testing.assert_array_equal(log.reference.t_s, [0.0, 399 / 400])
    np.testing.assert_array_equal(log.reference.xy_m, np.zeros((2, 2)))


def test_order_of_columns_line_ends_and_a_mark_do_not_matter(tmp_path: Path, rng: np.random.Generator) -> None:
    expected = foot_short.read(put_short(tmp_path, short_rows()))
    order = [*rng.permutation(len(SHORT)), 0]
    names = (*(SHORT[i] for i in order[:-1]), "Magnetometer X (uT)")
    path = put_short(tmp_path, [[row[i] for i in order] for row in short_rows()], names=names, end="\r\n")
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes() + b"\r\n")
    log = foot_short.read(path)
    for name, rows in expected.rows.items():
        np.testing.assert_array_equal(log.rows[name], rows)
    assert dict(log.report.skipped) == {"Magnetometer X (uT)": 400}
    assert log.report.mended["byte-order mark"] == 1


def test_rows_that_the_logger_repeated_are_dropped(tmp_path: Path) -> None:
    rows = short_rows()
    log = foot_short.read(put_short(tmp_path, rows[:7] + rows[6:]))
    assert dict(log.report.dropped) == {"the same row twice": 1}
    assert len(log.rows["gyro"]) == 400


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (_scaled(range(4, 7), G), r"accel: .*looks like g, converted twice"),
        (
            _scaled(range(1, 4), np.pi / 180),
            r"gyro: .* of a device that is shaken; it was converted from degree/s twice",
        ),
        (_scaled(range(1), 1e6), r"median step of time is 2500 s; it looks like microseconds"),
        (_swap, r"sample 22: the time goes from 0\.052500 to 0\.050000 s"),
        (_at(12, 0, "nan"), r"sample 13: the time goes from 0\.027500 to nan"),
        (lambda rows: [row.__setitem__(0, "1") for row in rows], r"all 400 samples have one time, 1;"),
        (_at(12, 2, "1,5"), r"line 14: 8 fields, expected 7; .*decimal commas"),
        (lambda rows: rows.clear(), r"0 samples, expected 10"),
    ],
)
def test_a_short_walk_that_cannot_be_right_is_refused(
    tmp_path: Path, change: Callable[[list[Row]], None], says: str
) -> None:
    rows = short_rows()
    change(rows)
    with pytest.raises(RecordingError, match=says) as caught:
        foot_short.read(put_short(tmp_path, rows))
    assert "short_walk.csv" in str(caught.value) and "\n" not in str(caught.value)


def test_a_field_without_a_number_is_counted(tmp_path: Path) -> None:
    rows = short_rows()
    rows[12][2], rows[13][2] = "", "1e400"
    log = foot_short.read(put_short(tmp_path, rows))
    assert dict(log.report.dropped) == {"gyro is not a number": 2}
    assert [len(log.rows[name]) for name in ("accel", "gyro")] == [400, 398]


def test_a_missing_column_and_a_cut_end_are_named(tmp_path: Path) -> None:
    names = (*SHORT[:3], "Gyroscope Z (rad/s)", *SHORT[4:])
    with pytest.raises(RecordingError, match=r"no column 'Gyroscope Z \(deg/s\)'; the header names Time"):
        foot_short.read(put_short(tmp_path, short_rows(), names=names))
    path = put_short(tmp_path, short_rows())
    path.write_bytes(path.read_bytes()[:-12])
    assert dict(foot_short.read(path).report.dropped) == {"last line cut": 1}


def test_the_recorded_loops_have_their_known_facts(data_root: Path) -> None:
    """9.88 m/s^2 and a still shoe at both ends, a field of 49 microtesla, 249.76 Hz; read in a fifth of a second."""
    paths = sorted((data_root / "foot_loops").glob("Measurement_*/data_inert.txt"))
    if not paths:
        pytest.skip("foot_loops is not under PDRBENCH_DATA")
    took_s = []
    for path in paths[:7]:
        began = time.process_time()
        log = foot_loops.read(path)
        took_s.append(time.process_time() - began)
        accel, gyro, mag = (log.rows[name] for name in ("accel", "gyro", "mag"))
        for end in (slice(0, 250), slice(-250, None)):
            assert np.linalg.norm(accel[end, 1:], axis=1).mean() == pytest.approx(9.88, abs=0.02)
            assert np.linalg.norm(gyro[end, 1:], axis=1).max() < 0.1
        assert np.median(np.linalg.norm(mag[:, 1:], axis=1)) == pytest.approx(49, abs=2)
        steps_s = np.diff(accel[:, 0])
        assert 1 / steps_s.mean() == pytest.approx(249.756, abs=0.001)
        assert np.abs(steps_s - steps_s.mean()).max() < 6e-6
        assert len(accel) - len(mag) == pytest.approx(0.03 * len(accel), rel=0.25)
    assert min(took_s) < 0.2


def test_the_recorded_short_walk_has_its_known_facts(data_root: Path) -> None:
    path = data_root / "foot_short" / "short_walk.csv"
    if not path.is_file():
        pytest.skip("foot_short is not under PDRBENCH_DATA")
    log = foot_short.read(path)
    t_s = log.rows["accel"][:, 0]
    assert t_s[-1] == pytest.approx(41.6, abs=0.05)
    assert np.median(np.diff(t_s)) == pytest.approx(1 / 398, rel=0.01)
    assert dict(log.report.dropped) == {"the same row twice": 205}
    assert np.linalg.norm(log.rows["accel"][:400, 1:], axis=1).mean() == pytest.approx(G, abs=0.02)
