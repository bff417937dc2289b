"""Tables as strangers bring them: a thousand ways to write one walk, and logs with odd lines, files and clocks."""

from __future__ import annotations

import gzip
import json
import os
import re
import tomllib
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import recording_samples as samples

from pdrbench.errors import RecordingError
from pdrbench_formats.detect import read

Rows = dict[str, np.ndarray]
NUM = int(os.environ.get("DIALECTS", "50"))  # DIALECTS=1000 reads a thousand
MIN_READ = 0.98

TIMES: dict[str, tuple[float, tuple[str, ...]]] = {  # factor from seconds, words of a header that states it
    "s": (1.0, ("time (s)", "t_s", "seconds", "time [sec]", "elapsed_seconds", "Time(Seconds)")),
    "ms": (1e3, ("time_ms", "timestamp [msec]", "millis", "time (milliseconds)", "epoch (ms)", "timestampMs")),
    "us": (1e6, ("t_us", "time [µs]", "timestamp (usec)", "micros", "time_microseconds", "time us")),
    "ns": (1e9, ("Timestamp[nanosec]", "time_ns", "t (nsec)", "timestampNanos", "elapsedRealtimeNanos", "timens")),
}
SILENT_TIMES = ("timestamp", "time", "t", "Time", "elapsed", "#timestamp", "clock", "utc")
EPOCHS_S = (0.0, 66_000.961, 2_100_000.5, 1_700_000_000.0)
ACCEL = ("acc_{}", "ax ay az", "Accelerometer {}", "accel.{}", "Acceleration {} {{u}}", "acc{} {{u}}", "a{}[{{u}}]")
GYRO = ("gyr_{}", "wx wy wz", "Gyroscope {}", "gyro.{}", "Angular velocity {} {{u}}", "gyro{} {{u}}")
ACCEL += ("LSM6DS3 Accelerometer.{}", "Beschl. {} {{u}}", "imu.accelerometer.{}.value")
GYRO += ("LSM6DS3 Gyroscope.{}", "Drehrate {} {{u}}", "rot_rate_{}", "g{}[{{u}}]", "imu.gyro.{}/{{u}}", "imu_w{}")
ACCEL_UNITS = {"m/s^2": (1.0, ("m/s2", "m/s²", "mps2")), "g": (1 / 9.80665, ("g",)), "mg": (1e3 / 9.80665, ("mg",))}
GYRO_UNITS = {"rad/s": (1.0, ("rad/s", "rps")), "deg/s": (180 / np.pi, ("deg/s", "dps", "°/s", "deg s^-1"))}
LIES = 0.06  # of headers that state a wrong unit of time


def pick(rng: np.random.Generator, options: Any) -> Any:
    options = list(options)
    return options[int(rng.integers(len(options)))]


def names_of(rng: np.random.Generator, patterns: tuple[str, ...], units: tuple[str, ...]) -> list[str]:
    """Three names, with the unit or without."""
    pattern = pick(rng, patterns)
    names = pattern.split() if "{" not in pattern else [pattern.format(axis) for axis in pick(rng, ("xyz", "XYZ"))]
    unit = pick(rng, units)
    return [name.replace("{u}", f"({unit})" if "[" not in name else unit) for name in names]


def dialect(rng: np.random.Generator, walk: Rows) -> tuple[str, bool]:
    """A walk as text with a header, in words, order, decimals, units and a clock of chance; whether its time lies."""
    step = int(pick(rng, (1, 2, 4)))
    t_s, accel, gyro = walk["accel"][::step, 0], walk["accel"][::step, 1:], walk["gyro"][::step, 1:]
    unit = pick(rng, TIMES)
    factor, words = TIMES[unit]
    lies = bool(rng.random() < LIES)
    stated = lies or bool(rng.random() < 0.5)
    others = [word for other in TIMES if other != unit for word in TIMES[other][1]]
    time_name = pick(rng, others if lies else words if stated else SILENT_TIMES)
    t = (t_s + pick(rng, EPOCHS_S)) * factor
    form = f"%.{ {'s': 4, 'ms': int(pick(rng, (0, 1))), 'us': 0, 'ns': 0}[unit] }f"
    columns = [(time_name, [form % value for value in t])]
    for values, patterns, units in ((accel, ACCEL, ACCEL_UNITS), (gyro, GYRO, GYRO_UNITS)):
        scale, texts = units[pick(rng, units)]
        names = names_of(rng, patterns, texts)
        digits = 2 if scale > 50 else 5
        texts = [[f"{value:.{digits}f}" for value in axis] for axis in values.T * scale]
        columns += zip(names, texts, strict=True)
    if rng.random() < 0.3:
        other = pick(rng, ("battery", "note", "heart rate", "accuracy"))
        columns.append((other, [str(7 + k % 3) for k in range(len(t))]))
    if rng.random() < 0.3:  # what is no rate, and a place that the phone took for its own
        others = (*map("gyro bias {}".format, "xyz"), *map("userAccel{}".format, "XYZ"), "latitude", "longitude")
        columns += [(name, [str(0.1 + k % 7) for k in range(len(t))]) for name in others]
    order = [0, *(1 + rng.permutation(len(columns) - 1))] if rng.random() < 0.3 else range(len(columns))
    columns = [columns[k] for k in order]
    separator = pick(rng, (",", ";", "\t"))
    lines = [separator.join(column[1][row] for column in columns) for row in range(len(t))]
    if separator != "," and rng.random() < 0.5:
        lines = [line.replace(".", ",") for line in lines]
    if rng.random() < 0.3:
        lines.insert(int(rng.integers(1, len(lines))), pick(rng, ("# pause", "", "// marker 3", "cut off", "%")))
    above = pick(rng, ((), (), ("# made by hand",), ("Device: Foo, 3", ""), ("sep=" + separator,)))
    text = pick(rng, ("\n", "\r\n")).join([*above, separator.join(name for name, _ in columns), *lines, ""])
    return text, lies


def is_right(log: Any, walk: Rows) -> bool:
    """Times to a millisecond and vectors to their printed digits."""
    for sensor in ("accel", "gyro"):
        rows = log.rows.get(sensor)
        if rows is None or len(rows) < 60 or len(log.reference):
            return False
        at = np.rint(rows[:, 0] * samples.RATE_HZ).astype(int)
        if np.abs(rows[:, 0] - at / samples.RATE_HZ).max() > 2e-3 or at[-1] >= len(walk[sensor]):
            return False
        if np.abs(rows[:, 1:] - walk[sensor][at, 1:]).max() > 0.02:
            return False
    return True


def read_or_follow(path: Path) -> tuple[Any, bool]:
    """A log; where it is refused with a column map, that which the map gives."""
    try:
        return read(path), True
    except RecordingError as error:
        columns = re.search(r"(    \[columns\]\n(?:    .*\n?)+)", str(error))
        assert columns is not None, error
        return read(path, "csv", columns=tomllib.loads(columns[1].replace("    ", ""))["columns"]), False


def test_a_thousand_ways_to_write_a_walk(tmp_path: Path) -> None:
    rng = np.random.default_rng(48)
    walk = {name: rows[:600] for name, rows in samples.make_walk(6.0).items()}
    path, num_read, num_honest = tmp_path / "walk.csv", 0, 0
    for _ in range(NUM):
        text, lies = dialect(rng, walk)
        path.write_text(text, encoding="utf-8")
        log, at_once = read_or_follow(path)
        assert is_right(log, walk), text[:600]
        assert not (lies and at_once), text[:300]
        num_honest += not lies
        num_read += at_once
    assert num_read >= MIN_READ * num_honest, f"{num_read} of {num_honest}"


def table(walk: Rows, *sensors: str, t: float = 1.0, begin: float = 0.0) -> np.ndarray:
    """Rows (T, C) of a time, from `begin` in units of which `t` are a second, and the axes of some sensors."""
    return np.column_stack([np.round((walk["accel"][:, 0] + begin) * t), *(walk[name][:, 1:] for name in sensors)])


def imu_recorder(walk: Rows) -> samples.Files:
    """A file for each sensor, without a header, nanoseconds since boot; the attitude as x, y, z, w."""
    files = {}
    rows = {"acce": "accel", "gyro": "gyro", "magnet": "mag", "game_rv": "rotation"}
    rows |= {"gravity": "gravity", "rv": "rotation", "linacce": "gravity"}  # the name says that gravity is not in it
    for name, sensor in rows.items():
        columns = table(walk, sensor, t=1e9, begin=14_378.66)
        columns = columns[:, [0, 2, 3, 4, 1]] if sensor == "rotation" else columns
        text = samples.text_of("# Created at Fri Apr 23 03:53:31 GMT+07:00 2021", columns, " ", "%.15g")
        files[f"2021-04-23/{name}.txt"] = text
    return {**files, "2021-04-23/reference_time.txt": b"0\n", "2021-04-23/README.md": b"mine"}


def meta_base(walk: Rows) -> samples.Files:
    """Two files whose names and units say the sensor, and whose elapsed seconds begin each at its own zero."""
    files, units = {}, {"accel": ("Accelerometer", "g", 1 / 9.80665), "gyro": ("Gyroscope", "deg/s", 180 / np.pi)}
    for sensor, (name, unit, factor) in units.items():
        part = walk[sensor][50 if sensor == "gyro" else 0 :]
        ms = np.round(part[:, 0] * 1e3) + 1_700_000_000_000
        rows = [
            f"{ms[k]:.0f},2023-11-14T17:13:20.000,{0.01 * k:.3f}," + ",".join(f"{v * factor:.7f}" for v in part[k, 1:])
            for k in range(len(part))
        ]
        axes = ",".join(f"{axis}-axis ({unit})" for axis in "xyz")
        text = "\n".join([f"epoch (ms),time (-05:00),elapsed (s),{axes}", *rows, ""])
        files[f"MetaWear_2023-11-14T17.13.20.000_D1A2B3C4D5E6_{name}_100.000Hz_1.7.3.csv"] = text.encode()
    return files


def gnss_logger(walk: Rows) -> samples.Files:
    """Without satellites, with calibrated records beside the others, in the folder of a whole recording."""
    lines = ["# ", "# Version: v3.0.0.1 Platform: 10 Manufacturer: Foo Model: Bar 5"]
    kinds = {"Accel": ("accel", "Mps2"), "UncalGyro": ("gyro", "RadPerSec"), "UncalMag": ("mag", "MicroT")}
    kinds["UncalAccel"] = kinds["Accel"]
    for kind, (_, unit) in kinds.items():
        names = (kind, "Bias") if kind.startswith("Uncal") else (kind,)
        fields = ",".join(f"{what}{axis}{unit}" for what in names for axis in "XYZ")
        lines.append(f"# {kind},utcTimeMillis,elapsedRealtimeNanos,{fields}")
    for row, t in enumerate(walk["accel"][:, 0]):
        for kind, (sensor, _) in kinds.items():
            bias = [0.1, 0.2, 0.3] if kind.startswith("Uncal") else []
            values = [*(walk[sensor][row, 1:] + (bias or 0.0)), *bias]
            stamps = f"{1.7e12 + t * 1e3:.0f},{(65_972 + t) * 1e9:.0f}"
            lines.append(f"{kind},{stamps}," + ",".join(f"{value:.7f}" for value in values))
    text = "\n".join([*lines, ""]).encode()
    return {"gnss_log.txt": text, "gnss_log.nmea": b"$GPGGA,1,2,3\n", "notes.txt": b"mine\n"}


def wit_motion(walk: Rows) -> samples.Files:
    units = {"Acc": "g", "As": "°/s"}
    names = [f"{name}{axis}({unit})" for name, unit in units.items() for axis in "XYZ"]
    lines = ["StartTime: 2023-11-14 22:13:20.000", "\t".join(["time", "DeviceName", *names])]
    for a, w in zip(walk["accel"], walk["gyro"], strict=True):
        values = [*(a[1:] / 9.80665), *(w[1:] * 180 / np.pi)]
        second, ms = divmod(round(a[0] * 1000), 1000)
        lines.append(f"2023-11-4 8:3:{second}:{ms}\tWT901\t" + "\t".join(f"{v:.6f}" for v in values))
    return {"data.txt": "\n".join([*lines, ""]).encode()}


def mars(walk: Rows) -> samples.Files:
    names = ", ".join([*(f"g{axis}[rad/s]" for axis in "xyz"), *(f"a{axis}[m/s^2]" for axis in "xyz")])
    columns = table(walk, "gyro", "accel", t=1e9, begin=328_551.5)
    columns = np.column_stack([columns, columns[:, 0] - 328_551.5e9 + 1.7e18])
    text = samples.text_of(f"Timestamp[nanosec], {names}, Unix time[nanosec]", columns, ", ", "%.15g")
    frames = "Timestamp[nanosec],fx[px],fy[px],Frame No.\n" + "".join(f"{3.3e14 + k:.0f},9,9,{k}\n" for k in range(9))
    return {"gyro_accel.csv": text, "movie_metadata.csv": frames.encode(), "movie.mp4": b"\0\0\0 ftypmp42"}


def table_and_labels(walk: Rows) -> samples.Files:
    """Seconds as Apple counts them, from 2001, and last columns that have a number now and then."""
    pulse = np.where(np.arange(len(walk["accel"])) % 100 == 50, 70.0, np.nan)
    columns = np.column_stack([walk["accel"] + [7.2e8, 0, 0, 0], walk["gyro"][:, 1:], pulse, pulse, pulse])
    text = samples.text_of("timestamp,ax,ay,az,gx,gy,gz,pulse,lap,speed", columns, form="%.12g").replace(b"nan", b"")
    labels, places = b"t,what\n0,walk\n1,stop\n", b"t,lat,lon\n0,48,11\n"
    return {"day/walk.csv.gz": gzip.compress(text), "day/labels.csv": labels, "day/gps.csv": places}


def xsens_commas(walk: Rows) -> samples.Files:
    """MT Manager with commas and without the lines above the header."""
    columns = table(walk, "accel", "gyro", t=1e4)
    header = "PacketCounter,SampleTimeFine,Acc_X,Acc_Y,Acc_Z,Gyr_X,Gyr_Y,Gyr_Z"
    return {"MT.csv": samples.text_of(header, np.column_stack([np.arange(len(columns)), columns]))}


def shimmer(walk: Rows) -> samples.Files:
    """Names and units in two lines, and a tab behind the last column."""
    names = [f"Shimmer_40AC_{name}_CAL" for name in ("Timestamp_Unix", *(f"Accel_LN_{axis}" for axis in "XYZ"))]
    names += [f"Shimmer_40AC_{name}_CAL" for name in ("Battery", *(f"Gyro_{axis}" for axis in "XYZ"))]
    units = ["ms", *["m/(s^2)"] * 3, "mV", *["deg/s"] * 3]
    t_s, gyro = walk["accel"][:, 0], np.degrees(walk["gyro"][:, 1:])
    columns = np.column_stack([1.7e12 + t_s * 1e3, walk["accel"][:, 1:], 0 * t_s + 4000.0, gyro])
    rows = samples.lines_of(columns, "\t", "%.15g")
    return {"a.csv": "".join(f"{line}\t\n" for line in ["sep=", "\t".join(names), "\t".join(units), *rows]).encode()}


def stamps_of_ros(walk: Rows) -> samples.Files:
    """Seconds and what is left of them in two columns, and a force that is named by its axes alone."""
    ns = np.round(walk["accel"][:, 0] * 1e9)
    columns = np.column_stack([1.7e9 + ns // 10**9, ns % 10**9, walk["accel"][:, 1:], walk["gyro"][:, 1:]])
    return {"a.csv": samples.text_of("stamp.secs,stamp.nsecs,x,y,z,gx,gy,gz", columns, form="%.12g")}


def kinds(walk: Rows, header: str, *names: str) -> samples.Files:
    lines = [header] if header else []
    for a, w in zip(walk["accel"], walk["gyro"], strict=True):
        for kind, row in zip(names, (a, w), strict=True):
            lines.append(f"{kind},{a[0] * 1e9 + 5e13:.0f},{row[1]:.7f},{row[2]:.7f},{row[3]:.7f}")
    return {"log.csv": "\n".join([*lines, ""]).encode()}


def gravity_beside_the_rest(walk: Rows) -> samples.Files:
    """In files whose lines end in a carriage return."""
    linear = walk["accel"] - walk["gravity"] * [0, 1, 1, 1]
    parts = {"Gravity.csv": walk["gravity"], "Linear Acceleration.csv": linear, "Gyro.csv": walk["gyro"]}
    return {name: samples.text_of("time,x,y,z", rows).replace(b"\n", b"\r") for name, rows in parts.items()}


def objects(walk: Rows) -> samples.Files:
    rows = np.column_stack([walk["accel"], walk["gyro"][:, 1:]]).tolist()
    return {"a.jsonl": "\n".join(json.dumps({"t": r[0], "acc": r[1:4], "gyr": r[4:]}) for r in rows).encode()}


def rows_in_a_document(walk: Rows) -> samples.Files:
    """JSON with a list for each sensor."""
    names = {"Accelerometer": "accel", "Gyroscope": "gyro"}
    lists = {name: [dict(zip("txyz", row, strict=True)) for row in walk[of].tolist()] for name, of in names.items()}
    return {"a.json": json.dumps({"device": {"name": "x"}, "data": lists}).encode()}


def columns_in_a_document(walk: Rows) -> samples.Files:
    """JSON with a list for each column."""
    columns = np.column_stack([walk["accel"], walk["gyro"][:, 1:]]).T.tolist()
    return {"a.json": json.dumps(dict(zip(("t", "ax", "ay", "az", "gx", "gy", "gz"), columns, strict=True))).encode()}


def serial_monitor(walk: Rows) -> samples.Files:
    """Of Arduino, with its own times; words of a language that is not known, axes as numbers in brackets."""
    rows = samples.lines_of(np.column_stack([walk["accel"][:, 1:], walk["gyro"][:, 1:]]))
    names = ",".join(f"{name}[{axis}]" for name in ("kiihtyvyys", "kulmanopeus") for axis in range(3))
    lines = (f"22:13:{0.01 * k:06.3f} -> {row}\n" for k, row in enumerate([names, *rows], -1 + 100))
    return {"a.txt": "".join(lines).encode()}


def named_fields(walk: Rows) -> samples.Files:
    rows = zip(walk["accel"].tolist(), walk["gyro"].tolist(), strict=True)
    form = "t:{:.3f}, ax:{:.7f}, ay:{:.7f}, az:{:.7f}, gx:{:.7f}, gy:{:.7f}, gz:{:.7f}\n"
    return {"a.txt": "".join(form.format(*a, *w[1:]) for a, w in rows).encode()}


def odd_lines(walk: Rows) -> samples.Files:
    rows = samples.lines_of(np.column_stack([walk["accel"], walk["gyro"][:, 1:]]))
    rows[300:300] = [rows[5], rows[6].replace("0.06", "99.9", 1)]
    rows[100:100] = ["# marker: door", "zebra", "", "t,ax,ay,az,gx,gy,gz", "// lap 2", "1.0,2.0"]
    return {"a.csv": "\n".join(["t,ax,ay,az,gx,gy,gz,", *rows, ""]).replace("-", "\u2212").encode()}


def two_clocks_in_a_table(walk: Rows) -> samples.Files:
    """Sensors side by side, each behind its own time; a title above, and empty columns at both sides, as of Excel."""
    accel, gyro = (samples.lines_of(rows, ";") for rows in (walk["accel"], walk["gyro"][200:]))
    rows = [f";{a};{gyro[k] if k < len(gyro) else ';;;'};" for k, a in enumerate(accel)]
    text = "\n".join(["Walk 3;;;;;;;;;", ";t_acc;ax;ay;az;t_gyro;gx;gy;gz;", *rows, ""]).replace(".", ",")
    return {"a.csv": text.encode() + b"\0" * 100}


def days_of_a_spreadsheet(walk: Rows) -> samples.Files:
    """Of Google in German: commas between columns and in numbers, which stand in quotes."""
    t_d = 45_244.9 + walk["accel"][:, :1] / 86_400.0
    columns = np.hstack([t_d, walk["accel"][:, 1:] * 100.0, walk["gyro"][:, 1:] * 30 / np.pi])
    rows = [",".join(f'"{value:.10f}"'.replace(".", ",") for value in row) for row in columns.tolist()]
    names = [f"acc {axis} (cm/s²)" for axis in "xyz"] + [f"gyr {axis} (rpm)" for axis in "xyz"]
    return {"a.csv": "\n".join([",".join(["Zeit", *names]), *rows, ""]).encode()}


def a_counter_that_wraps(walk: Rows) -> samples.Files:
    columns = table(walk, "accel", "gyro", t=1e6, begin=4290.0)
    columns[:, 0] %= 2**32
    return {"a.csv": samples.text_of("micros,ax,ay,az,gx,gy,gz", columns, form="%.12g")}


def rows_with_keys(walk: Rows) -> samples.Files:
    """As Firebase exports them: to the second, with milliseconds beside; readings in lists."""
    rows = {}
    for k, (a, w) in enumerate(zip(walk["accel"].tolist(), walk["gyro"].tolist(), strict=True)):
        read = [dict(zip(("sensor", "x", "y", "z"), row, strict=True)) for row in (["acc", *a[1:]], ["gyr", *w[1:]])]
        time = f"{22 + k // 360_000}:{13 + k // 6000:02d}:{k // 100 % 60:02d}"
        rows[f"-N{k:05d}"] = {"time": time, "ms": k % 100 * 10, "readings": read}
    return {"a.json": json.dumps(rows).encode()}


def whole_vectors(walk: Rows) -> samples.Files:
    """As programs print vectors, at dates without signs."""
    rows = zip(walk["accel"].tolist(), walk["gyro"].tolist(), strict=True)
    lines = [
        f"202311142213{2000 + round(a[0] * 100):04d}0;({a[1]:.7f}, {a[2]:.7f}, {a[3]:.7f});{w[1:]}" for a, w in rows
    ]
    return {"a.csv": "\n".join(["date;acc;gyro", *lines, ""]).encode()}


def ticks(walk: Rows) -> samples.Files:
    """A clock of 100 ns without a name, rates about axes that have names of their own."""
    return {
        "a.csv": samples.text_of("time,p,q,r,fx,fy,fz", table(walk, "gyro", "accel", t=1e7, begin=3600.0), form="%.12g")
    }


DOORS = (imu_recorder, meta_base, gnss_logger, wit_motion, mars, table_and_labels, xsens_commas, shimmer)
DOORS += (two_clocks_in_a_table, days_of_a_spreadsheet, a_counter_that_wraps, rows_with_keys)
FOLDERS = {"Acelerómetro/data.csv": "accel", "Giroscopio/data.csv": "gyro"}
DOORS += (stamps_of_ros, odd_lines, whole_vectors, ticks)
DOORS += (lambda walk: {name: samples.text_of("tiempo,x,y,z", walk[sensor]) for name, sensor in FOLDERS.items()},)
DOORS += (
    lambda walk: kinds(walk, "sensor_type,timestamp,v0,v1,v2", "1", "4"),
    lambda walk: kinds(walk, "", "ACC", "GYR"),
)
DOORS += (
    lambda walk: kinds(walk, "sensor,timestamp_ns,x,y,z", "android.sensor.accelerometer", "android.sensor.gyroscope"),
)
DOORS += (gravity_beside_the_rest, objects, named_fields, rows_in_a_document, columns_in_a_document, serial_monitor)


@pytest.mark.parametrize("write", DOORS, ids=lambda write: write.__name__)
def test_logs_of_strangers(write: Any, phone_walk: Rows, tmp_path: Path) -> None:
    files = write(phone_walk)
    samples.folder_of(tmp_path, files)
    log = read(tmp_path if len(files) > 1 else tmp_path / next(iter(files)), strict=True)
    assert {"accel", "gyro"} <= log.rows.keys()
    for sensor in log.rows.keys() & phone_walk.keys():
        rows = phone_walk[sensor][len(phone_walk[sensor]) - len(log.rows[sensor]) :]
        np.testing.assert_allclose(log.rows[sensor], rows, atol=2e-3 if sensor != "gyro" else 1e-4)
    if write in (gnss_logger, mars, table_and_labels):  # one file of a folder, on a clock that may count from 1970
        assert log.report.skipped.keys() >= {Path(name).name for name in list(files)[1:]}
        assert (log.start_unix_s is None) is (write is not gnss_logger)
    if write is imu_recorder:
        assert log.report.skipped.keys() >= {"reference_time.txt", "README.md", "rv.txt"}
    if write is odd_lines:
        odd = {"comment": 2, "line with another number of fields": 2, "t is no number": 1}
        odd["gyro has a time that does not fit the rows around it"] = 2
        assert log.report.dropped.items() >= odd.items()


def test_backslashes_in_an_archive_are_folders(phone_walk: Rows, tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        for name, content in meta_base(phone_walk).items():
            member = zipfile.ZipInfo(name)
            member.filename = f"walk\\{name}"  # zipfile would write a slash on Windows
            archive.writestr(member, content)
    assert read(tmp_path / "a.zip").rows.keys() == {"accel", "gyro"}
    with zipfile.ZipFile(tmp_path / "b.zip", "w") as archive:
        archive.writestr("..\\a.csv", b"x")
    with pytest.raises(RecordingError, match="outside the archive"):
        read(tmp_path / "b.zip")


def two_headers(walk: Rows) -> bytes:
    """As gaitmap exports two feet: no time."""
    values = np.column_stack([walk["accel"][:, 1:], walk["gyro"][:, 1:] * 180 / np.pi])
    values = np.repeat(values, 2, axis=1) + np.tile([0.0, 0.01], 6)
    names = [f"{kind}_{axis}" for kind in ("acc", "gyr") for axis in "xyz"]
    header = "sensor," + ",".join(["left_sensor,right_sensor"] * 6) + "\naxis," + ",".join(f"{n},{n}" for n in names)
    return samples.text_of(header, np.column_stack([np.arange(len(values)), values]))


def counts(walk: Rows) -> bytes:
    """Of a converter of many bits, as sketches for an MPU-6050 name them: 8192 for 1 g at 16 bits."""
    columns = [walk["accel"][:, 1:] / samples.GRAVITY_MPS2 * 8192, np.degrees(walk["gyro"][:, 1:]) * 65.536]
    return samples.text_of(
        "t_ms,AcX,AcY,AcZ,GyX,GyY,GyZ", np.column_stack([walk["accel"][:, 0] * 1e3, *map(np.round, columns)])
    )


def numbered_rows(walk: Rows) -> bytes:
    """As MotionSense has it: no time, and acceleration in g without gravity beside gravity."""
    gravity = walk["gravity"][:, 1:] / samples.GRAVITY_MPS2
    values = [walk["accel"][:, 1:] / samples.GRAVITY_MPS2 - gravity, gravity, walk["gyro"][:, 1:]]
    names = [f"{name}.{axis}" for name in ("userAcceleration", "gravity", "rotationRate") for axis in "xyz"]
    return samples.text_of("," + ",".join(names), np.column_stack([np.arange(len(gravity)), *values]))


def numbers_alone(walk: Rows) -> bytes:
    """With a number of the sensor before each vector."""
    columns = table(walk, "gyro", "accel", t=1e9, begin=60_000.0)
    return samples.text_of("", np.insert(columns, (1, 4), (4, 3), axis=1), "\t", "%.15g")


def two_suffixes(walk: Rows) -> bytes:
    columns = table(walk, "accel", "gyro", t=1e3)
    names = [f"{name}_{side}" for side in ("left", "right") for name in ("ax", "ay", "az", "gx", "gy", "gz")]
    return samples.text_of(",".join(["t_ms", *names]), np.hstack([columns, -columns[:, 1:]]))


def cut_to_the_second(walk: Rows) -> bytes:
    rows = samples.lines_of(np.column_stack([walk["accel"][:, 1:], walk["gyro"][:, 1:]]))
    lines = [f"2023-11-14 22:13:{k // 100:02d},{row}" for k, row in enumerate(rows)]
    return "\n".join(["Time,ax,ay,az,gx,gy,gz", *lines, ""]).encode()


def sign_of_an_iphone(walk: Rows) -> bytes:
    columns = np.hstack([-walk["accel"] * [-1, 1, 1, 1], walk["gyro"][:, 1:], walk["rotation"][:, 1:]])
    return samples.text_of("t,ax,ay,az,gx,gy,gz,qw,qx,qy,qz", columns)


@pytest.mark.parametrize(
    ("write", "message"),
    [
        (counts, r"counts of a converter.*gyro_unit is right"),
        (two_headers, r"right_sensor acc_x.*accel and gyro: two devices.*state the rate"),
        (numbered_rows, "state the rate"),
        (numbers_alone, r"numbers without a header.*header_line = 0"),
        (two_suffixes, "several accelerometers and gyroscopes.*two devices"),
        (cut_to_the_second, "the same time in 99 of 100 rows"),
        (sign_of_an_iphone, "the attitude turns gravity down"),
    ],
)
def test_the_map_in_the_message_reads_the_file(write: Any, message: str, phone_walk: Rows, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(write(phone_walk))
    with pytest.raises(RecordingError, match=message):
        read(tmp_path / "a.csv")
    log, _ = read_or_follow(tmp_path / "a.csv")
    for sensor in ("accel", "gyro"):
        np.testing.assert_allclose(log.rows[sensor], phone_walk[sensor], atol=2e-3 if write is counts else 1e-6)


@pytest.mark.parametrize(("name", "above"), [("walk_50Hz.csv", b""), ("a.csv", b"# rate: 50\n"), ("50 hz/a.csv", b"")])
def test_a_stated_rate_is_proposed_and_can_be_passed(name: str, above: bytes, phone_walk: Rows, tmp_path: Path) -> None:
    (tmp_path / name).parent.mkdir(exist_ok=True)
    (tmp_path / name).write_bytes(above + numbered_rows(phone_walk))
    with pytest.raises(RecordingError, match=r"rate_hz = 50\.0  # as (line 1|the file's name|the folder's name) says"):
        read(tmp_path / name)
    assert read(tmp_path / name, "csv", columns={"rate_hz": 50.0}).rows["gyro"][50, 0] == pytest.approx(1.0)


def test_rows_of_two_devices_name_their_column(phone_walk: Rows, tmp_path: Path) -> None:
    first, header, *rows = wit_motion(phone_walk)["data.txt"].decode().splitlines()
    both = [row.replace("WT901", f"WT{k}") for row in rows for k in (1, 2)]
    (tmp_path / "a.txt").write_text("\n".join([first, header, *both, ""]), encoding="utf-8")
    with pytest.raises(RecordingError, match="column 'DeviceName' has WT1, WT2"):
        read(tmp_path / "a.txt")


def test_two_clocks_are_an_error_that_names_both(tmp_path: Path) -> None:
    walk = samples.make_walk(6.0)
    walk["accel"][:, 0] += 600.0
    for name, sensor in {"Accelerometer.csv": "accel", "Gyroscope.csv": "gyro"}.items():
        (tmp_path / name).write_bytes(samples.text_of("time,x,y,z", walk[sensor]))
    with pytest.raises(RecordingError, match=r"Accelerometer.csv begins at 600.000 s, Gyroscope.csv"):
        read(tmp_path)
