"""Walks of the Indoor Location Competition 2.0: every trap of the format, on small made-up logs."""

from __future__ import annotations

import gzip
import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from pdrbench.errors import RecordingError
from pdrbench.io.log import Log
from pdrbench.sensors import sensor_spec
from pdrbench_formats.recordings.opaque import opaque_ids
from pdrbench_sim.readers import ilc20

T0 = 1_574_559_781_000
HEADER = f"#\tstartTime:{T0}\n#\tSiteID:5dd\tSiteName:某\tFloorId:5de\tFloorName:F2\n#\tBrand:OPPO\tModel:PBCM10\t\n"
NEAR, FAR = "2e:8d:db:93:de:87", "06:74:9c:2b:1a:32"


def row(after_ms: int, kind: str, *values: object) -> str:
    return "\t".join([str(T0 + after_ms), f"TYPE_{kind}", *map(str, values)])


def wifi(after_ms: int, bssid: str = NEAR, rssi: int = -60, seen_ms: int | None = None, ssid: str = "cafe") -> str:
    seen_ms = after_ms - 100 if seen_ms is None else seen_ms
    return row(after_ms, "WIFI", ssid, bssid, rssi, 2462, T0 + seen_ms)


def beacon(after_ms: int, address: str = "E0:78:A3:3E:97:2A") -> str:
    return row(after_ms, "BEACON", "9195B3AD", 0, 0, -56, -79, 12.88, address, T0 + after_ms)


def sensors(count: int = 20, step_ms: int = 20) -> list[str]:
    """A phone lying on its back: gravity on z, a little turn, the field of a mall, attitude unity."""
    lines = []
    for i in range(count):
        t = i * step_ms
        lines += [
            row(t, "ACCELEROMETER", 0.1, "-1.0E-4", 9.81 + i / 100, 2),
            row(t, "MAGNETIC_FIELD", 10.0, 25.0 + i / 100, -30.0, 3),
            row(t, "GYROSCOPE", 0.01, -0.02 - i / 1000, 0.3, 3),
            row(t, "ROTATION_VECTOR", 0.0, 0.0, i / 1000, 3),
        ]
    return lines


def waypoints(*after_ms: int) -> list[str]:
    return [row(t, "WAYPOINT", 120.5 + k, 63.25) for k, t in enumerate(after_ms)]


def put(folder: Path, lines: list[str], *, header: str = HEADER, end: str = "\n", name: str = "walk.txt") -> Path:
    path = folder / name
    path.write_bytes((header + "\n".join(lines) + end).encode())
    return path


def read(folder: Path, lines: list[str]) -> Log:
    return ilc20.read(put(folder, lines))


def assert_same(one: Mapping[str, NDArray[np.float64]], other: Mapping[str, NDArray[np.float64]]) -> None:
    assert list(one) == list(other)
    for name in one:
        np.testing.assert_array_equal(one[name], other[name])


def test_units_axes_and_names(tmp_path: Path) -> None:
    log = read(tmp_path, [*sensors(), wifi(300), beacon(310), *waypoints(0, 380)])
    assert log.device == "OPPO PBCM10"
    np.testing.assert_array_equal(log.rows["accel"][0], [0.0, 0.1, -1e-4, 9.81])
    np.testing.assert_allclose(log.rows["gyro"][1], [0.02, 0.01, -0.021, 0.3], rtol=1e-15)
    np.testing.assert_array_equal(log.rows["mag"][0, 1:], [10.0, 25.0, -30.0])
    np.testing.assert_array_equal(log.rows["wifi"], [[0.3, opaque_ids("wifi", [NEAR.encode()])[0], -60.0, 2462.0, 0.1]])
    np.testing.assert_array_equal(log.rows["ble"][0, [0, 2, 3]], [0.31, -79.0, -56.0])
    np.testing.assert_array_equal(log.reference.xy_m, [[120.5, 63.25], [121.5, 63.25]])
    np.testing.assert_array_equal(log.reference.level, [1, 1])
    assert log.reference.surveyed.all()
    for name, rows in log.rows.items():
        assert rows.shape[1] == len(sensor_spec(name).columns)
        assert not rows.flags.writeable


def test_times_begin_with_the_first_kept_row_and_rows_of_one_time_stay_in_file_order(tmp_path: Path) -> None:
    log = read(tmp_path, [row(-900, "BLUE", "x", -70), *sensors(), *waypoints(-500)])
    assert log.reference.t_s[0] == 0.0
    assert log.rows["accel"][0, 0] == 0.5
    log = read(tmp_path, [wifi(400), wifi(200, FAR, -50), wifi(200, NEAR, -40)])
    np.testing.assert_array_equal(log.rows["wifi"][:, 2], [-50.0, -40.0, -60.0])
    log = read(tmp_path, [wifi(9000, seen_ms=1000), wifi(9000, FAR, seen_ms=9000)])
    np.testing.assert_array_equal(log.rows["wifi"][:, 4], [8.0, 0.0])


def test_file_order_is_not_time_order(tmp_path: Path, rng: np.random.Generator) -> None:
    lines = [*sensors(), wifi(300), wifi(100, FAR), beacon(50), *waypoints(0, 200, 380)]
    ordered = read(tmp_path, lines)
    shuffled = read(tmp_path, [lines[i] for i in rng.permutation(len(lines))])
    assert_same(ordered.rows, {name: shuffled.rows[name] for name in ordered.rows})
    np.testing.assert_array_equal(ordered.reference.xy_m, shuffled.reference.xy_m)
    assert (np.diff(ordered.rows["wifi"][:, 0]) > 0).all()


def test_rotation_vector_becomes_a_unit_quaternion(tmp_path: Path) -> None:
    """Half a turn about z is (0, 0, 1); a component sum just above 1, as phones write it, has qw 0."""
    halves = [("0.0", "0.0", "1.0"), ("0.6", "0.0", "0.80003"), ("0.5", "-0.5", "0.5"), ("0.0", "0.0", "0.0")]
    log = read(tmp_path, [row(i * 20, "ROTATION_VECTOR", *q, 3) for i, q in enumerate(halves)])
    rotation = log.rows["rotation"]
    np.testing.assert_allclose(np.linalg.norm(rotation[:, 1:], axis=1), 1.0, rtol=1e-15)
    np.testing.assert_allclose(rotation[:, 1], [0.0, 0.0, 0.5, 1.0], atol=1e-15)
    np.testing.assert_allclose(rotation[2, 1:], [0.5, 0.5, -0.5, 0.5], atol=1e-15)


def test_sightings_ahead_of_their_row(tmp_path: Path) -> None:
    many = [wifi(k, seen_ms=k - 10) for k in range(200)]
    log = read(tmp_path, [*many, wifi(300, seen_ms=1200), wifi(300, FAR, seen_ms=1301)])
    assert log.rows["wifi"][-1, [0, 4]].tolist() == [0.3, 0.0]
    assert log.report.mended == {"sighted up to a second ahead": 1}
    assert log.report.dropped == {"sighted in the future": 1}
    assert log.report.kept["wifi"] == 201


def test_another_clock_for_last_seen_and_clock_jumps_are_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"line 4: last seen 5\.0 s after the row, as in 1 of 2"):
        read(tmp_path, [wifi(0, seen_ms=5000), wifi(10)])
    with pytest.raises(RecordingError, match="line 4: last seen 7200 s before the row"):
        read(tmp_path, [wifi(0, seen_ms=-7_200_000), wifi(10)])
    with pytest.raises(RecordingError, match=r"line 4: last seen .* the two clocks differ"):
        read(tmp_path, [row(0, "WIFI", "a", NEAR, -60, 2462, 83450044)])
    lines = sensors()
    with pytest.raises(RecordingError, match=r"line 84: the clock goes back by 3600\.\d s"):
        read(tmp_path, [*lines, row(-3_600_000, "GYROSCOPE", 0, 0, 0, 3)])
    with pytest.raises(RecordingError, match="nothing for 3600 s"):
        read(tmp_path, [*lines, *(row(t + 3_600_000, "GYROSCOPE", 0, 0, 0, 3) for t in (380, 400))])


def test_access_point_twice_in_a_scan_keeps_the_freshest_then_the_strongest(tmp_path: Path) -> None:
    log = read(
        tmp_path,
        [
            wifi(500, NEAR, -40, 0),
            wifi(500, NEAR, -70, 400),
            wifi(500, NEAR, -60, 400),
            wifi(500, FAR, -50, 100),
            wifi(900, NEAR, -80, 500),
        ],
    )
    np.testing.assert_array_equal(log.rows["wifi"][:, [0, 2]], [[0.0, -60.0], [0.0, -50.0], [0.4, -80.0]])
    assert log.report.dropped == {"access point twice in a scan": 2}


@pytest.mark.parametrize(
    "ssid", ["", " ", "a b", "#5", '"', "tab\there", "\t\t", "TYPE_WIFI", "x\tTYPE_Y", "奶茶", "T"]
)
def test_names_of_networks_never_matter(tmp_path: Path, ssid: str) -> None:
    plain = read(tmp_path, [wifi(0), wifi(0, FAR, ssid="a"), wifi(50)])
    named = read(tmp_path, [wifi(0), wifi(0, FAR, ssid=ssid), wifi(50)])
    assert_same(plain.rows, named.rows)


def test_no_name_or_address_survives_and_numbers_of_any_form_equal_float(tmp_path: Path) -> None:
    log = read(tmp_path, [wifi(0, ssid="Uniqlo"), beacon(10), row(20, "BLUE", "E0:78", "Annas phone"), *waypoints(0)])
    shown = repr(log)
    for secret in ("Uniqlo", "Annas", "phone", NEAR, "9195B3AD", "E0:78", "某"):
        assert secret not in shown
    forms = ["-0.0", "+1.5", " 2.5", "3.5 ", "1e-3", "9.3078613E-4", ".5", "5.", "007", "0.1234567890123456789"]
    forms += ["-12.345678901234567", "123.456789012345", "0.000000000000001", "-1E-320"]
    log = read(tmp_path, [row(k, "ACCELEROMETER", form, form, 9.81, 2) for k, form in enumerate(forms)])
    expected = np.array([float(form) for form in forms])
    assert log.rows["accel"][:, 1].tobytes() == log.rows["accel"][:, 2].tobytes() == expected.tobytes()


def test_identifiers_are_stable_opaque_and_exact(tmp_path: Path) -> None:
    """The number of an address is part of the contract: stored radio maps rely on it."""
    number = opaque_ids("wifi", [NEAR.encode()])[0]
    assert number == opaque_ids("wifi", [NEAR.upper().encode()])[0]
    assert 0 <= number < 2**48
    assert number != opaque_ids("ble", [NEAR.encode()])[0]
    assert number == 226_655_297_553_128
    log = read(tmp_path, [wifi(0), wifi(0, FAR), beacon(0), beacon(0, "E0:78:A3:3E:92:FD")])
    assert log.rows["wifi"][0, 1] == number
    assert len({*log.rows["wifi"][:, 1], *log.rows["ble"][:, 1]}) == 4


def test_unknown_types_and_repeated_rows_are_counted_and_two_places_at_one_time_refused(tmp_path: Path) -> None:
    log = read(tmp_path, [*sensors(), row(0, "DIST1", 1, 2, 3), row(5, "LIGHT", 9), row(6, "LIGHT", 9), row(7, "X")])
    assert log.report.skipped == {"TYPE_DIST1": 1, "TYPE_LIGHT": 2, "TYPE_X": 1}
    log = read(tmp_path, [*sensors(), sensors()[0], *waypoints(0, 300), *waypoints(0)])
    assert log.report.dropped == {"the same row twice": 2}
    assert log.report.kept["accel"] == 20
    with pytest.raises(RecordingError, match=r"two waypoints at 0\.010 s"):
        read(tmp_path, [*waypoints(0, 10), row(10, "WAYPOINT", 1, 1)])


def test_similar_types_are_not_confused(tmp_path: Path) -> None:
    extra = [
        row(3, "ACCELEROMETER_UNCALIBRATED", *"123456", 3),
        row(3, "WIFI2", 1, 2, 3, 4, 5),
        row(3, "ACCELEROMETE", 1),
    ]
    log = read(tmp_path, [*sensors(), *extra])
    assert log.report.kept["accel"] == 20
    assert "wifi" not in log.rows
    assert log.report.skipped == {"TYPE_ACCELEROMETER_UNCALIBRATED": 1, "TYPE_WIFI2": 1, "TYPE_ACCELEROMETE": 1}


@pytest.mark.parametrize("glue", [(5, 6), (81, 82), (85, 86), (87, 88)])
def test_records_glued_into_one_line_are_split(tmp_path: Path, glue: tuple[int, int]) -> None:
    lines = [*sensors(), wifi(300), wifi(300, FAR), beacon(10), beacon(20), *waypoints(0, 100, 380)]
    lines += [row(5, "DIST1", 1, 2, 3), row(6, "BLUE", "a", -3), row(7, "X", 1)]
    assert len(lines) == 90
    whole = read(tmp_path, lines)
    first, second = glue
    log = read(tmp_path, [*lines[:first], lines[first] + lines[second], *lines[second + 1 :]])
    assert_same(whole.rows, log.rows)
    np.testing.assert_array_equal(whole.reference.xy_m, log.reference.xy_m)
    assert whole.report.skipped == log.report.skipped
    assert log.report.mended == {"records glued into one line": 1}


def test_three_records_and_the_header_glued(tmp_path: Path) -> None:
    lines = sensors()
    whole = read(tmp_path, lines)
    glued = [lines[0] + lines[1] + lines[2], *lines[3:-1], lines[-1] + f"#\tendTime:{T0 + 400}"]
    path = put(tmp_path, glued, header=HEADER.rstrip("\n"))
    log = ilc20.read(path)
    assert_same(whole.rows, log.rows)
    assert log.report.mended == {"records glued into one line": 4}


def test_errors_count_lines_of_the_file_behind_glued_records(tmp_path: Path) -> None:
    lines = sensors()
    bad = row(30, "GYROSCOPE", "x", 0, 0, 3)
    path = put(tmp_path, [lines[0] + lines[1], *lines[2:6], bad, *lines[6:]])
    line = path.read_text().splitlines().index(bad) + 1
    with pytest.raises(RecordingError, match=rf"walk\.txt: line {line}: a number of TYPE_GYROSCOPE is 'x'"):
        ilc20.read(path)


def test_radio_map_only_no_wifi_no_waypoint_and_late_waypoint(tmp_path: Path) -> None:
    radio = read(tmp_path, [wifi(0), beacon(5), *waypoints(0, 900)])
    assert set(radio.rows) == {"wifi", "ble"}
    inertial = read(tmp_path, [*sensors(), *waypoints(0, 9000)])
    assert "wifi" not in inertial.rows
    assert inertial.reference.t_s[-1] == 9.0 > inertial.rows["accel"][-1, 0]
    assert len(read(tmp_path, sensors()).reference) == 0


def test_every_record_is_accounted_for(tmp_path: Path, rng: np.random.Generator) -> None:
    lines = [*sensors(), *[wifi(int(t), [NEAR, FAR][int(t) % 2]) for t in rng.integers(0, 30, 60)], beacon(3)]
    lines += [*waypoints(0, 300), row(1, "Y", 1), sensors()[7]]
    report = read(tmp_path, lines).report
    accounted = sum(report.kept.values()) + sum(report.skipped.values()) + sum(report.dropped.values())
    assert accounted == len(lines)


def test_the_last_line_must_end_however_lines_end(tmp_path: Path) -> None:
    lines = [*sensors(), wifi(300), *waypoints(0, 380)]
    path = put(tmp_path, lines)
    plain = ilc20.read(path)
    content = path.read_bytes()
    for changed in (content.replace(b"\n", b"\r\n"), b"\xef\xbb\xbf" + content, gzip.compress(content)):
        path.write_bytes(changed)
        assert_same(plain.rows, ilc20.read(path).rows)
    with pytest.raises(RecordingError, match="line 5: the last line does not end"):
        ilc20.read(put(tmp_path, waypoints(0, 10), end=""))
    with pytest.raises(RecordingError, match="line 84: the last line does not end"):
        ilc20.read(put(tmp_path, [*sensors(), wifi(300)[:40]], end=""))
    assert len(ilc20.read(put(tmp_path, [*waypoints(0, 10), "#\tendTime:1"], end="")).reference) == 2


@pytest.mark.parametrize(
    ("line", "says"),
    [
        (row(0, "ACCELEROMETER", "0,1", 0, 9.81, 2), "TYPE_ACCELEROMETER is '0,1': a decimal comma; write a point"),
        (row(0, "ACCELEROMETER", "NaN", 0, 9.81, 2), "is 'NaN': not a finite number"),
        (row(0, "ACCELEROMETER", "", 0, 9.81, 2), "is '': not a finite number"),
        (row(0, "ACCELEROMETER", 9810, 0, 0, 2), r"is '9810': outside \[-490, 490\]; check its unit"),
        (row(0, "ROTATION_VECTOR", 0.9, 0.9, 0.1, 3), "the rotation vector has length 1.27"),
        (row(0, "WIFI", "a", NEAR, -600, 2462, T0), "is '-600': outside"),
        (row(0, "WIFI", "a", NEAR, -60, T0), "TYPE_WIFI has 6 fields, expected 7 or more; the line is cut"),
        (row(0, "WAYPOINT", 120.5), "TYPE_WAYPOINT has 3 fields"),
        (f"{T0 // 1000}\tTYPE_WAYPOINT\t1\t2", "the time has 10 characters.*looks like seconds"),
        (f"{T0}000\tTYPE_WAYPOINT\t1\t2", "the time has 16 characters.*looks like microseconds"),
        (f"{T0}000000\tTYPE_WAYPOINT\t1\t2", "the time has 19 characters.*looks like nanoseconds"),
        ("157455978x000\tTYPE_WAYPOINT\t1\t2", "not a whole number of unix milliseconds"),
        ("0000000000001\tTYPE_WAYPOINT\t1\t2", "not a whole number of unix milliseconds"),
        ("some words", "no tab"),
        (f"{T0}\t", "no type behind the time"),
        (f"{T0}\tSENSOR_GYRO\t1\t2\t3", "the second field does not begin with TYPE_"),
    ],
)
def test_a_bad_line_is_named(tmp_path: Path, line: str, says: str) -> None:
    path = put(tmp_path, [*sensors(), line, *sensors(2)])
    with pytest.raises(RecordingError, match=rf"^{re.escape(str(path))}: line 84: .*{says}"):
        ilc20.read(path)


@pytest.mark.parametrize("lines", [[], [row(0, "BLUE", "a", -3)]])
def test_zero_rows_are_refused(tmp_path: Path, lines: list[str]) -> None:
    with pytest.raises(RecordingError, match="no row of any sensor and no waypoint"):
        ilc20.read(put(tmp_path, lines, end="\n" if lines else ""))


@pytest.mark.parametrize(
    ("kind", "factor", "says"),
    [
        ("ACCELEROMETER", 1 / 9.80665, "it looks like g"),
        ("GYROSCOPE", 180 / np.pi, "it looks like degree/s"),
        ("MAGNETIC_FIELD", 0.01, "it looks like gauss"),
    ],
)
def test_other_units_are_recognised(tmp_path: Path, kind: str, factor: float, says: str) -> None:
    lines = []
    for line in sensors():
        time, name, *values, accuracy = line.split("\t")
        if name == f"TYPE_{kind}":
            values = [str(float(v) * factor) for v in values]
        lines.append("\t".join([time, name, *values, accuracy]))
    with pytest.raises(RecordingError, match=says):
        read(tmp_path, lines)


def test_level_comes_from_the_header_or_the_caller(tmp_path: Path) -> None:
    path = put(tmp_path, waypoints(0))
    assert ilc20.read(path, floor="B2").reference.level[0] == -2
    nameless = put(tmp_path, waypoints(0), header="")
    with pytest.raises(RecordingError, match="pass it as floor='F1'"):
        ilc20.read(nameless)
    with pytest.raises(RecordingError, match="names no level"):
        ilc20.read(nameless, floor="Mezzanine")
    (tmp_path / "B1").mkdir()
    kaggle = put(tmp_path / "B1", waypoints(0), header="#\tstartTime:1\n#\tSiteID:5a\tSiteName:b\tFloorId:c\n")
    assert ilc20.read(kaggle).reference.level[0] == -1  # the folder names it


@pytest.mark.data
def test_every_recorded_walk_reads_without_loss(mall_logs: dict[Path, Log]) -> None:
    """Figures of the set's own description: 46 % of WiFi rows repeat an older sighting, staleness has median 3.5 s."""
    logs = mall_logs.values()
    assert sum(len(log.reference) for log in logs) >= len(logs)
    assert not any(log.report.mended for log in logs)
    assert {reason for log in logs for reason in log.report.dropped} <= {"access point twice in a scan"}
    age_s = np.concatenate([log.rows["wifi"][:, 4] for log in logs if "wifi" in log.rows])
    assert np.median(age_s) == pytest.approx(3.5, abs=0.2)
    assert age_s.min() >= 0.0
    for log in logs:
        log.recording("walk", None, sensor_spec)  # within the bounds of every sensor


@pytest.mark.parametrize("digits", [13, 1])
def test_times_from_zero_get_their_clock_from_beacons_or_the_header(tmp_path: Path, digits: int) -> None:
    """As in files whose places are kept secret; last sightings on the clock of the phone, or on that of the file."""
    lines = [*sensors(), wifi(100), wifi(200, FAR), beacon(150)]
    usual = read(tmp_path, lines)
    shifted = [re.sub(r"^\d+", lambda t: str(int(t[0]) - T0).zfill(digits), line) for line in lines]
    assert usual.start_unix_s == T0 / 1000
    own_clock = [re.sub(r"(?<=2462\t)\d+", lambda t: str(int(t[0]) - T0), line) for line in shifted]
    for of_file in (shifted, own_clock):
        path = put(tmp_path, of_file, header="#\tstartTime:0000000000000\n#\tSiteID:5dd\n", name="test.txt")
        log = ilc20.read(path)
        assert log.start_unix_s == usual.start_unix_s and not len(log.reference)
        assert all((log.rows[name] == rows).all() for name, rows in usual.rows.items())
    of_header = put(tmp_path, shifted[:-1], header=f"#\tstartTime:{T0}\n", name="without_beacons.txt")
    assert ilc20.read(of_header).start_unix_s == usual.start_unix_s
