"""Sensor Logger, an app for iPhone and Android by Kelvin Choi.

App: Sensor Logger 1.x (iOS, Android).
Files: the exported zip, its folder, loose CSV files of it, or the JSON export.
Sensors: accel, gyro, mag, rotation, baro, wifi, ble.
Units: m/s², rad/s, µT, hPa, dBm; `AccelerometerUncalibrated` of an iPhone is in g unless "Standardise Units & Frames"
is on.
Frame: an iPhone writes accelerations with the opposite sign of Android's on all axes unless that option is on; both are
turned into Android's. The attitude of an iPhone counts from north along x and is turned to x east.
Clock: `time`, nanoseconds since 1970, one clock for all files.
Traps: columns are in the order z, y, x; `Accelerometer` has no gravity on either platform, so it is added from
`Gravity` or replaced by `TotalAcceleration`; the uncalibrated magnetometer keeps its bias of hundreds of µT; files of 0
bytes; the JSON export holds numbers as text; files without `Metadata` do not say which phone recorded them, which is
then judged by the numbers; the direction of the quaternion is not documented and is found by gravity.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, Final

import msgspec
import numpy as np

from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray, IntArray
from pdrbench.io.compressed import plain_name
from pdrbench.io.container import Container, open_container
from pdrbench.io.log import Log
from pdrbench.io.reader import Head, Reader
from pdrbench_formats.recordings.assemble import (
    STANDARD_GRAVITY_MPS2,
    Origin,
    Tally,
    assemble,
    note_face_down,
    seconds,
    unit_quaternions,
    with_gravity,
)
from pdrbench_formats.recordings.attitude import device_to_building
from pdrbench_formats.recordings.delimited import DelimitedTable, read_delimited
from pdrbench_formats.recordings.opaque import opaque_ids

TIME: Final = "time"
_XYZ: Final = ("x", "y", "z")
_WXYZ: Final = ("qw", "qx", "qy", "qz")
_VECTORS: Final = (
    "TotalAcceleration",
    "Accelerometer",
    "Gravity",
    "AccelerometerUncalibrated",
    "Gyroscope",
    "GyroscopeUncalibrated",
    "Magnetometer",
    "MagnetometerUncalibrated",
)
USED: Final = (*_VECTORS, "Orientation", "Barometer", "WiFi", "Bluetooth")
_SYSTEM: Final = {True: "an iPhone", False: "Android"}
_JSON_START: Final = b'"sensor"'
_TABLE_START: Final = b"time,seconds_elapsed"
_G_RANGE: Final = (0.5, 2.0)  # median length of an accelerometer in g
_INVERSE: Final = np.array([1.0, -1.0, -1.0, -1.0])
_TURN_EAST: Final = np.array([np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])  # x north, y west to x east, y north: +90° about z


@dataclass(frozen=True, slots=True)
class Export:
    """The tables of one export, by name of the sensor, and the time from which their rows count."""

    path: Path
    tables: Mapping[str, DelimitedTable]
    metadata: Mapping[str, str]
    origin_ns: int

    def rows(self, name: str, columns: tuple[str, ...]) -> FloatArray | None:
        """(T, 1 + C) seconds since `origin_ns`, and columns of a sensor; None where it delivered nothing."""
        table = self.tables.get(name)
        if table is None or not len(table):
            return None
        table.require([TIME, *columns])
        return np.column_stack([seconds(_times_ns(table), self.origin_ns), table.table(columns)])


def _times_ns(table: DelimitedTable) -> IntArray:
    """(T,) nanoseconds since 1970, 0 where there are none."""
    whole = table.whole(TIME)
    return whole if whole is not None else np.nan_to_num(table.numbers(TIME), posinf=0.0, neginf=0.0).astype(np.int64)


def _origin_ns(tables: Mapping[str, DelimitedTable]) -> int:
    """The earliest time in tables, from which their rows count."""
    return min((int(_times_ns(table).min()) for table in tables.values() if len(table)), default=0)


@dataclass(frozen=True, slots=True)
class Convention:
    """What a phone does not say of its numbers, as its first seconds or a whole recording show it.

    Attributes:
        is_apple: Whether accelerations have Apple's sign, and attitudes count from north along x.
        in_g: Whether the uncalibrated accelerometer is in g.
        signs: (4,) that make of its quaternions turns from the device to the building; None where none do.
    """

    is_apple: bool
    in_g: bool
    signs: FloatArray | None


def read(path: Path | str, *, strict: bool = True) -> Log:
    """Reads one recording.

    Raises:
        RecordingError: Names file, line and remedy.
    """
    path = Path(path)
    tally = Tally()
    export = _open(path, tally)
    streams = streams_of(export, convention_of(export, tally), tally)
    if not streams:
        raise RecordingError(
            f"{path}: no accelerometer, gyroscope, barometer or WiFi in it, only "
            f"{', '.join(sorted(tally.skipped)) or 'empty files'}; switch these sensors on in the app and record again"
        )
    origin_ns = export.origin_ns
    device = export.metadata.get("device name", "") or export.metadata.get("deviceName", "")
    if "'" in device or "’" in device:  # a name that a person gave: Anna's iPhone
        device = export.metadata.get("platform", "")
    return assemble(
        path,
        streams,
        origin=Origin(device=device, start_unix_s=origin_ns * 1e-9 if origin_ns > 1e17 else None),
        tally=tally,
        allow_unsorted=("wifi", "ble", "baro", "accel", "gyro", "mag", "rotation"),
        strict=strict,
    )


def convention_of(export: Export, tally: Tally) -> Convention:
    """What the numbers of an export mean."""
    vectors = _vectors(export)
    is_apple, in_g = _platform(export, vectors, tally)
    accel = _acceleration(vectors, is_apple, in_g, Tally())
    if accel is None:
        return Convention(is_apple, in_g, None)
    attitude, signs = export.rows("Orientation", _WXYZ), None
    if attitude is not None:
        signs = _signs(attitude, accel)
        if signs is None and (turned := _signs(attitude, accel * [1.0, -1.0, -1.0, -1.0])) is not None:
            signs, is_apple = turned, not is_apple
            seen = f"the attitude of the phone turns gravity down: the sign is that of {_SYSTEM[is_apple]}"
            tally.found("accel-sign, attitude", "accel", seen)
    elif "Gravity" in vectors or "Accelerometer" not in vectors:
        remedy = "keep Metadata.csv beside the other files, or record with Standardise Units & Frames"
        note_face_down(tally, accel[:, 1:], remedy)
    return Convention(is_apple, in_g, signs)


def streams_of(export: Export, convention: Convention, tally: Tally) -> dict[str, FloatArray]:
    """Rows (T, C) by sensor, as `pdrbench.sensors` has them, in seconds since `origin_ns` of the export."""
    vectors, streams = _vectors(export), {}
    accel = _acceleration(vectors, convention.is_apple, convention.in_g, tally)
    if accel is not None:
        streams["accel"] = accel
    for sensor, names in (
        ("gyro", ("Gyroscope", "GyroscopeUncalibrated")),
        ("mag", ("Magnetometer", "MagnetometerUncalibrated")),
    ):
        name = next((name for name in names if name in vectors), None)
        if name is not None:
            streams[sensor] = vectors[name]
            tally.skipped.update({n: len(vectors[n]) for n in names if n in vectors and n != name})
    if accel is not None and (attitude := export.rows("Orientation", _WXYZ)) is not None:
        if convention.signs is None:
            tally.skipped["Orientation (does not turn gravity up)"] += len(attitude)
        else:
            q = attitude[:, 1:] * convention.signs
            q = _east(q) if convention.is_apple else unit_quaternions(q)
            streams["rotation"] = np.column_stack([attitude[:, 0], q])
    others = {"baro": export.rows("Barometer", ("pressure",)), "wifi": _wifi(export), "ble": _ble(export)}
    return streams | {name: rows for name, rows in others.items() if rows is not None}


def _vectors(export: Export) -> dict[str, FloatArray]:
    return {name: rows for name in _VECTORS if (rows := export.rows(name, _XYZ)) is not None}


def _signs(attitude: FloatArray, accel: FloatArray) -> FloatArray | None:
    """(4,) that make of its quaternions turns to the building; None where neither way turns that acceleration up."""
    q = attitude[:, 1:]
    turned = device_to_building(attitude[:, 0], q, accel[:, 0], accel[:, 1:])
    return None if turned is None else np.ones(4) if turned is q else _INVERSE


def _open(path: Path, tally: Tally) -> Export:
    container = open_container(path)
    if container.is_zip or path.is_dir():
        jsons = [name for name in container.names(".json") if _JSON_START in container.read(name, 4096)]
        if not container.names(".csv") and len(jsons) == 1:
            return _from_json(path, container.read(jsons[0]), tally)
        return _from_tables(path, container, tally)
    if container.names(".json") or container.read(path.name, 64).lstrip().startswith((b"[", b"{")):
        return _from_json(path, container.read(path.name), tally)
    return _from_tables(path, container, tally)


def _from_tables(path: Path, container: Container, tally: Tally) -> Export:
    tables: dict[str, DelimitedTable] = {}
    metadata: dict[str, str] = {}
    homes: dict[str, list[str]] = defaultdict(list)
    for name in container.sizes:
        stem = PurePosixPath(name).stem
        if name.lower().endswith(".csv"):
            homes["Bluetooth" if stem.startswith("Bluetooth-") else stem].append(name)
        else:
            tally.skipped[PurePosixPath(name).suffix or name] += 1
    for stem, names in homes.items():
        if stem not in (*USED, "Metadata"):
            tally.skipped[stem] += len(names)
            continue
        if len(names) > 1 and stem != "Bluetooth":
            raise RecordingError(
                f"{path}: {names[0]} and {names[1]} are of two recordings or two phones; read the folder of one of them"
            )
        whole = [name for name in names if container.sizes[name]]
        tally.skipped[f"{stem} (empty file)"] += len(names) - len(whole)
        parts = [read_delimited(container.read(name), container.label(name)) for name in whole]
        for part in parts:
            tally.mended += part.mended
            tally.dropped += part.dropped
        if parts and stem == "Metadata":
            metadata = {key: texts[0] for key in parts[0].columns if (texts := parts[0].texts(key))}
        elif parts:
            tables[stem] = parts[0] if len(parts) == 1 else _joined(parts)
    return Export(path, tables, metadata, _origin_ns(tables))


def _joined(parts: list[DelimitedTable]) -> DelimitedTable:
    """The rows of one table after those of the other, in the columns that all have: a file for each beacon."""
    shared = [name for name in parts[0].columns if all(name in part.columns for part in parts)]
    columns = {name: np.concatenate([part.columns[name] for part in parts]) for name in shared}
    return DelimitedTable(parts[0].path.parent, columns, parts[0].first_line, Counter(), Counter())


def _from_json(path: Path, content: bytes, tally: Tally) -> Export:
    """The JSON export: one list of samples, each with its sensor, all values as text."""
    try:
        samples = msgspec.json.decode(content, type=list[dict[str, Any]])
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise RecordingError(f"{path}: not the JSON export of Sensor Logger: {error}; export it again") from error
    return export_of(path, ((str(sample.get("sensor")), sample) for sample in samples), tally)


def export_of(path: Path, samples: Iterable[tuple[str, Mapping[str, Any]]], tally: Tally) -> Export:
    """The tables of samples, each with the name of its sensor as files have it; those of other sensors are skipped."""
    by_sensor: dict[str, list[Mapping[str, Any]]] = defaultdict(list)
    for sensor, sample in samples:
        by_sensor[sensor].append(sample)
    metadata = {key: str(value) for row in by_sensor.pop("Metadata", []) for key, value in row.items()}
    tables = {}
    for sensor, rows in by_sensor.items():
        if sensor not in USED:
            tally.skipped[sensor] += len(rows)
            continue
        columns: dict[str, Any] = {}
        for key in rows[0]:
            values = ["" if (value := row.get(key)) is None else str(value) for row in rows]
            try:
                columns[key] = np.array(list(map(int, values)))
            except ValueError:
                columns[key] = np.array(values, dtype=object)
        tables[sensor] = DelimitedTable(path / sensor, columns, 1, tally.mended, tally.dropped)
    return Export(path, tables, metadata, _origin_ns(tables))


def _platform(export: Export, vectors: Mapping[str, Any], tally: Tally) -> tuple[bool, bool]:
    """Whether accelerations have Apple's sign, and whether the uncalibrated accelerometer is in g."""
    platform = export.metadata.get("platform", "").lower()
    standardised = export.metadata.get("standardisation", "").lower() == "true"
    raw = vectors.get("AccelerometerUncalibrated")
    raw_length = float(np.nanmedian(np.linalg.norm(raw[:, 1:], axis=1))) if raw is not None else 0.0
    in_g = _G_RANGE[0] <= raw_length <= _G_RANGE[1]
    if platform:
        return platform == "ios" and not standardised, in_g
    if "TotalAcceleration" in vectors:
        return False, in_g
    is_apple = in_g
    name = "AccelerometerUncalibrated"
    if raw is None and "Gravity" in vectors:
        name, is_apple = "Gravity", float(np.nanmedian(vectors["Gravity"][:, 3])) < 0.0
    if raw is not None or "Gravity" in vectors:
        seen = f"missing: which phone is not said; {name} looks like {'an iPhone' if is_apple else 'Android'}"
        tally.found("platform", "Metadata.csv", seen)
    return is_apple, in_g


def _acceleration(vectors: Mapping[str, FloatArray], is_apple: bool, in_g: bool, tally: Tally) -> FloatArray | None:
    """(T, 4) times and specific force in Android's sign, from the best of the files."""
    best = ("TotalAcceleration", "Accelerometer", "AccelerometerUncalibrated")
    if "Gravity" not in vectors:  # which the second lacks: a finding says so where there is no other
        best = ("TotalAcceleration", "AccelerometerUncalibrated", "Accelerometer")
    name = next((name for name in best if name in vectors), None)
    if name is None:
        return None
    rows = vectors[name]
    if name == "Accelerometer" and "Gravity" in vectors:
        gravity = vectors["Gravity"]
        if not np.array_equal(rows[:, 0], gravity[:, 0]):
            tally.mended["gravity interpolated to the times of the accelerometer"] += len(rows)
        rows = with_gravity(rows, gravity)
    scale = (-1.0 if is_apple else 1.0) * (STANDARD_GRAVITY_MPS2 if in_g and name.endswith("Uncalibrated") else 1.0)
    return rows * [1.0, scale, scale, scale]


def _east(q: FloatArray) -> FloatArray:
    """Attitudes (T, 4) against x north, y west as attitudes against x east, y north: a turn of the frame by 90°."""
    w, x, y, z = q.T
    c, s = _TURN_EAST[0], _TURN_EAST[3]
    return unit_quaternions(np.column_stack([c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w]))


def _wifi(export: Export) -> FloatArray | None:
    rows = export.rows("WiFi", ("level", "frequency"))
    if rows is None:
        return None
    address = [text.encode() for text in export.tables["WiFi"].texts("bssid")]
    return np.column_stack([rows[:, 0], opaque_ids("wifi", address), rows[:, 1:], np.zeros(len(rows))])


def _ble(export: Export) -> FloatArray | None:
    rows = export.rows("Bluetooth", ("rssi",))
    if rows is None:
        return None
    table = export.tables["Bluetooth"]
    power = table.numbers("txPowerLevel") if "txPowerLevel" in table.columns else np.zeros(len(rows))
    address = [text.encode() for text in table.texts("id")]
    return np.column_stack([rows[:, 0], opaque_ids("ble", address), rows[:, 1], np.nan_to_num(power)])


def sniff(head: Head) -> bool:
    """True for an export of this app."""
    if head.container is None:
        begin = head.content[:4096].lstrip()
        if begin.startswith(b"[") and _JSON_START in begin and b"seconds_elapsed" in head.content:
            return True
        return PurePosixPath(plain_name(head.path.name)).stem in USED and begin.startswith(_TABLE_START)
    if any(head.peek(name).startswith(_TABLE_START) for name in head.members(".csv")):
        return True
    return any(
        head.peek(name).lstrip().startswith(b"[") and b"seconds_elapsed" in head.peek(name)
        for name in head.members(".json")[:3]
    )


READER: Final = Reader(read, sniff, options=("strict",))
