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
from pdrbench.geometry import FloatArray
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
    """The tables of one export, by name of the sensor."""

    path: Path
    tables: Mapping[str, DelimitedTable]
    metadata: Mapping[str, str]

    def rows(self, name: str, columns: tuple[str, ...]) -> tuple[np.ndarray[Any, Any], FloatArray] | None:
        """Times in nanoseconds (T,) and columns (T, C) of a sensor; None where it delivered nothing."""
        table = self.tables.get(name)
        if table is None or not len(table):
            return None
        table.require([TIME, *columns])
        time_ns = table.whole(TIME)
        if time_ns is None:
            stamp = table.numbers(TIME)
            time_ns = np.where(np.isfinite(stamp), stamp, 0).astype(np.int64)
        return time_ns, table.table(columns)


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
    origin_ns = min(int(time_ns.min()) for time_ns, _ in streams.values())
    device = export.metadata.get("device name", "") or export.metadata.get("deviceName", "")
    if "'" in device or "’" in device:  # a name that a person gave: Anna's iPhone
        device = export.metadata.get("platform", "")
    return assemble(
        path,
        {name: np.column_stack([seconds(time_ns, origin_ns), rows]) for name, (time_ns, rows) in streams.items()},
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
        if signs is None and (turned := _signs(attitude, (accel[0], -accel[1]))) is not None:
            signs, is_apple = turned, not is_apple
            seen = f"the attitude of the phone turns gravity down: the sign is that of {_SYSTEM[is_apple]}"
            tally.found("accel-sign, attitude", "accel", seen)
    elif "Gravity" in vectors or "Accelerometer" not in vectors:
        remedy = "keep Metadata.csv beside the other files, or record with Standardise Units & Frames"
        note_face_down(tally, accel[1], remedy)
    return Convention(is_apple, in_g, signs)


def streams_of(export: Export, convention: Convention, tally: Tally) -> dict[str, tuple[Any, FloatArray]]:
    """Times in nanoseconds (T,) and values (T, C - 1) by sensor, as `pdrbench.sensors` has them."""
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
            tally.skipped.update({n: len(vectors[n][0]) for n in names if n in vectors and n != name})
    if accel is not None and (attitude := export.rows("Orientation", _WXYZ)) is not None:
        time_ns, q = attitude
        if convention.signs is None:
            tally.skipped["Orientation (does not turn gravity up)"] += len(q)
        else:
            q = q * convention.signs
            streams["rotation"] = time_ns, _east(q) if convention.is_apple else unit_quaternions(q)
    others = {"baro": export.rows("Barometer", ("pressure",)), "wifi": _wifi(export), "ble": _ble(export)}
    return streams | {name: rows for name, rows in others.items() if rows is not None}


def _vectors(export: Export) -> dict[str, tuple[Any, FloatArray]]:
    return {name: rows for name in _VECTORS if (rows := export.rows(name, _XYZ)) is not None}


def _signs(attitude: tuple[Any, FloatArray], accel: tuple[Any, FloatArray]) -> FloatArray | None:
    """(4,) that make of its quaternions turns to the building; None where neither way turns that acceleration up."""
    (time_ns, q), origin_ns = attitude, int(attitude[0].min())
    turned = device_to_building(seconds(time_ns, origin_ns), q, seconds(accel[0], origin_ns), accel[1])
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
    homes: dict[str, list[str]] = defaultdict(list)
    metadata: dict[str, str] = {}
    for name in container.names(".csv"):
        stem = PurePosixPath(name).stem
        if stem.startswith("Bluetooth-"):
            stem = "Bluetooth"
        homes[stem].append(name)
    for name in container.sizes:
        if not name.lower().endswith(".csv"):
            tally.skipped[PurePosixPath(name).suffix or name] += 1
    for stem, names in homes.items():
        if stem == "Metadata":
            if len(names) > 1:
                _refuse_second(path, names)
            table = read_delimited(container.read(names[0]), container.label(names[0]))
            metadata = {key: texts[0] for key in table.columns if (texts := table.texts(key))}
        elif stem in USED:
            if len(names) > 1 and stem != "Bluetooth":
                _refuse_second(path, names)
            parts = []
            for name in names:
                if container.sizes[name] == 0:
                    tally.skipped[f"{stem} (empty file)"] += 1
                    continue
                parts.append(read_delimited(container.read(name), container.label(name)))
                tally.mended += parts[-1].mended
                tally.dropped += parts[-1].dropped
            if parts:
                tables[stem] = parts[0] if len(parts) == 1 else _joined(parts)
        else:
            tally.skipped[stem] += len(names)
    return Export(path, tables, metadata)


def _joined(parts: list[DelimitedTable]) -> DelimitedTable:
    """The rows of one table after those of the other, in the columns that all have: a file for each beacon."""
    shared = [name for name in parts[0].columns if all(name in part.columns for part in parts)]
    columns = {name: np.concatenate([part.columns[name] for part in parts]) for name in shared}
    return DelimitedTable(parts[0].path.parent, columns, parts[0].first_line, Counter(), Counter())


def _refuse_second(path: Path, names: list[str]) -> None:
    raise RecordingError(
        f"{path}: {names[0]} and {names[1]} are of two recordings or two phones; read the folder of one of them"
    )


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
            values = ["" if row.get(key) is None else str(row[key]) for row in rows]
            try:
                columns[key] = np.array([int(value) for value in values])
            except ValueError:
                columns[key] = np.array(values, dtype=object)
        tables[sensor] = DelimitedTable(path / sensor, columns, 1, tally.mended, tally.dropped)
    return Export(path, tables, metadata)


def _platform(export: Export, vectors: Mapping[str, Any], tally: Tally) -> tuple[bool, bool]:
    """Whether accelerations have Apple's sign, and whether the uncalibrated accelerometer is in g."""
    platform = export.metadata.get("platform", "").lower()
    standardised = export.metadata.get("standardisation", "").lower() == "true"
    raw = vectors.get("AccelerometerUncalibrated")
    raw_length = float(np.nanmedian(np.linalg.norm(raw[1], axis=1))) if raw is not None else 0.0
    in_g = _G_RANGE[0] <= raw_length <= _G_RANGE[1]
    if platform:
        return platform == "ios" and not standardised, in_g
    if "TotalAcceleration" in vectors:
        return False, in_g
    is_apple = in_g
    name = "AccelerometerUncalibrated"
    if raw is None and "Gravity" in vectors:
        name, is_apple = "Gravity", float(np.nanmedian(vectors["Gravity"][1][:, 2])) < 0.0
    if raw is not None or "Gravity" in vectors:
        seen = f"missing: which phone is not said; {name} looks like {'an iPhone' if is_apple else 'Android'}"
        tally.found("platform", "Metadata.csv", seen)
    return is_apple, in_g


def _acceleration(
    vectors: Mapping[str, Any], is_apple: bool, in_g: bool, tally: Tally
) -> tuple[Any, FloatArray] | None:
    """Times and specific force in Android's sign, from the best of the files."""
    sign = -1.0 if is_apple else 1.0
    if "TotalAcceleration" in vectors:
        time_ns, force = vectors["TotalAcceleration"]
        return time_ns, sign * force
    if "Accelerometer" in vectors and "Gravity" in vectors:
        (time_ns, linear), (gravity_ns, gravity) = vectors["Accelerometer"], vectors["Gravity"]
        if len(time_ns) == len(gravity_ns) and (time_ns == gravity_ns).all():
            return time_ns, sign * (linear + gravity)
        tally.mended["gravity interpolated to the times of the accelerometer"] += len(time_ns)
        pairs = ((time_ns, linear), (gravity_ns, gravity))
        force = with_gravity(*(np.column_stack([seconds(ns, int(gravity_ns.min())), rows]) for ns, rows in pairs))
        return time_ns, sign * force[:, 1:]
    if "AccelerometerUncalibrated" in vectors:
        time_ns, force = vectors["AccelerometerUncalibrated"]
        return time_ns, sign * force * (STANDARD_GRAVITY_MPS2 if in_g else 1.0)
    if "Accelerometer" in vectors:
        time_ns, linear = vectors["Accelerometer"]
        return time_ns, sign * linear  # without gravity: a finding says so
    return None


def _east(q: FloatArray) -> FloatArray:
    """Attitudes (T, 4) against x north, y west as attitudes against x east, y north: a turn of the frame by 90°."""
    w, x, y, z = q.T
    c, s = _TURN_EAST[0], _TURN_EAST[3]
    return unit_quaternions(np.column_stack([c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w]))


def _wifi(export: Export) -> tuple[Any, FloatArray] | None:
    rows = export.rows("WiFi", ("level", "frequency"))
    if rows is None:
        return None
    time_ns, values = rows
    address = [text.encode() for text in export.tables["WiFi"].texts("bssid")]
    return time_ns, np.column_stack([opaque_ids("wifi", address), values, np.zeros(len(values))])


def _ble(export: Export) -> tuple[Any, FloatArray] | None:
    rows = export.rows("Bluetooth", ("rssi",))
    if rows is None:
        return None
    time_ns, values = rows
    table = export.tables["Bluetooth"]
    power = table.numbers("txPowerLevel") if "txPowerLevel" in table.columns else np.zeros(len(values))
    address = [text.encode() for text in table.texts("id")]
    return time_ns, np.column_stack([opaque_ids("ble", address), values, np.nan_to_num(power)])


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
