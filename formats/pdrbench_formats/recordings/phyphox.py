"""phyphox, the app of RWTH Aachen that makes a phone a laboratory.

App: phyphox 1.x (iOS, Android).
Files: the zip of a CSV export, its folder, or its `Raw Data.csv`; not the Excel export.
Sensors: accel, gyro, mag, baro.
Units: m/s², rad/s, µT, hPa, as the headers say.
Frame: of Android, on iPhones too: phyphox turns Apple's sign.
Clock: seconds of the experiment, each sensor with its own rows; `meta/time.csv` gives the time of day and the
length of each pause, by which all rows after it move on.
Traps: the separator is a choice of the export (comma, semicolon, tab), and so is the decimal comma; an iPhone names the
columns `X (m/s^2)` only, so that the name of the file says which sensor it is; names are in the language of the app, so
that units say it; "Linear Acceleration" lacks gravity;
times may be negative and rows may hold NaN.
"""

from __future__ import annotations

import re
from pathlib import Path, PurePosixPath
from typing import Final

import numpy as np

from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray
from pdrbench.io.container import Container, open_container
from pdrbench.io.log import Log
from pdrbench.io.reader import Head, Reader
from pdrbench_formats.recordings.assemble import Origin, Tally, assemble, note_face_down
from pdrbench_formats.recordings.delimited import DelimitedTable, read_delimited

_LINEAR: Final = "linear acceleration"
# what a header or a file name begins with, in the order of trial
_SENSORS: Final = {
    "linear acceleration": _LINEAR,
    "linear accelerometer": _LINEAR,
    "acceleration without g": _LINEAR,
    "acceleration (without g)": _LINEAR,
    "lineare beschleunigung": _LINEAR,
    "acceleration": "accel",
    "accelerometer": "accel",
    "beschleunigung": "accel",
    "gyroscope": "gyro",
    "gyroskop": "gyro",
    "magnetic field": "mag",
    "magnetometer": "mag",
    "magnetfeld": "mag",
    "pressure": "baro",
    "barometer": "baro",
    "druck": "baro",
}
_AXIS: Final = re.compile(r"^(?:(.*?)\s+)?([xyz])\s*\(([^)]*)\)$", re.I)
_UNIT: Final = re.compile(r"\(([^()]*)\)$")
_MIN_GRAVITY_MPS2: Final = 2.0  # of the mean over a recording: a phone turns, but not to every side alike
_TIME: Final = re.compile(r"^\w+\s*\((s|с)\)$", re.I)  # in the language of the app
_UNKNOWN: Final = "acceleration"  # named in another language: numbers say whether gravity is in it
_UNITS: Final = {
    "m/s^2": (_UNKNOWN, 1.0),
    "m/s²": (_UNKNOWN, 1.0),
    "м/с²": (_UNKNOWN, 1.0),
    "g": (_UNKNOWN, 9.80665),
    "rad/s": ("gyro", 1.0),
    "рад/с": ("gyro", 1.0),
    "1/s": ("gyro", 1.0),
    "°/s": ("gyro", np.pi / 180.0),
    "µt": ("mag", 1.0),
    "μt": ("mag", 1.0),
    "ut": ("mag", 1.0),
    "мктл": ("mag", 1.0),
    "t": ("mag", 1e6),
    "mt": ("mag", 1e3),
    "hpa": ("baro", 1.0),
    "гпа": ("baro", 1.0),
    "mbar": ("baro", 1.0),
    "pa": ("baro", 0.01),
    "kpa": ("baro", 10.0),
}


def read(path: Path | str, *, strict: bool = True) -> Log:
    """Reads one export.

    Raises:
        RecordingError: Names file, line and remedy.
    """
    path = Path(path)
    tally, container = Tally(), open_container(path)
    if any(name.lower().endswith((".xls", ".xlsx")) for name in container.sizes) and not container.names(".csv"):
        raise RecordingError(f"{path}: an Excel export; export the experiment as CSV")
    members = container.names() if not container.is_zip and path.is_file() else container.names(".csv")
    streams: dict[str, FloatArray] = {}
    sources: dict[str, str] = {}
    for name in members:
        if PurePosixPath(name).parts[0] == "meta":
            continue
        for sensor, rows in _read_table(container, name, tally).items():
            if sensor in streams:
                raise RecordingError(
                    f"{path}: {sources[sensor]} and {name} both hold {sensor}: two devices or two recordings; "
                    f"read the folder of one of them"
                )
            streams[sensor], sources[sensor] = rows, name
    linear = streams.pop(_LINEAR, None)
    if linear is not None:
        if "accel" in streams:
            tally.skipped["linear acceleration"] += len(linear)
        else:
            streams["accel"] = linear  # without gravity: a finding says so
    if not streams:
        raise RecordingError(
            f"{path}: no acceleration, rotation, magnetic field or pressure among "
            f"{', '.join(members[:6]) or 'no CSV files'}; record with the sensors of the phone and export as CSV"
        )
    if "accel" in streams and linear is None:
        remedy = "the app writes the sign of Android on every phone; turn the columns round that something else changed"
        note_face_down(tally, streams["accel"][:, 1:], remedy)
    start_unix_s = _move_by_pauses(container, streams)
    return assemble(
        path,
        streams,
        origin=Origin(device=_device(container), start_unix_s=start_unix_s),
        tally=tally,
        allow_unsorted=tuple(streams),
        strict=strict,
    )


def _read_table(container: Container, name: str, tally: Tally) -> dict[str, FloatArray]:
    """Rows by sensor of one file; {} where it holds no sensor that is read."""
    table = read_delimited(container.read(name), container.label(name))
    tally.mended += table.mended
    tally.dropped += table.dropped
    time = next((column for column in table.columns if _TIME.match(column)), None)
    found = {} if time is None else _columns(table, name)
    if time is None or not found:
        tally.skipped[PurePosixPath(name).stem] += len(table)
        return {}
    t_s = table.numbers(time)
    streams = {}
    for sensor, axes in found.items():
        rows = np.column_stack([t_s, *(table.numbers(column) * factor for column, factor in axes)])
        if sensor == _UNKNOWN:
            sensor = "accel" if np.linalg.norm(np.nanmean(rows[:, 1:], axis=0)) > _MIN_GRAVITY_MPS2 else _LINEAR
        streams[sensor] = rows
    return streams


def _columns(table: DelimitedTable, name: str) -> dict[str, list[tuple[str, float]]]:
    """Columns and factors by sensor: by the words of the header, those of the file, or the unit."""
    of_file = _sensor(PurePosixPath(name).stem)
    axes: dict[str, dict[str, tuple[str, float]]] = {}
    for column in table.columns:
        if not (match := _UNIT.search(column)):
            continue
        axis = _AXIS.match(column)
        of_unit, factor = _UNITS.get(match[1].strip().lower(), ("", 0.0))
        sensor = _sensor((axis[1] or "") if axis else column) or (of_file if axis else "") or of_unit
        if axis is None and sensor != "baro":
            continue
        if sensor and not factor:
            raise RecordingError(
                f"{table.path}: line {table.first_line - 1}: the unit of {column!r} is not known; "
                f"read it as csv with a column map"
            )
        if sensor:
            axes.setdefault(sensor, {})[axis[2].lower() if axis else "x"] = column, factor
    return {
        sensor: [columns[axis] for axis in sorted(columns)]
        for sensor, columns in axes.items()
        if len(columns) == (1 if sensor == "baro" else 3)
    }


def _sensor(text: str) -> str:
    plain = text.strip().lower()
    return next((sensor for begin, sensor in _SENSORS.items() if plain.startswith(begin)), "")


def _move_by_pauses(container: Container, streams: dict[str, FloatArray]) -> float | None:
    """Moves the rows after each pause by what it lasted; returns the time of day of second 0."""
    name = next((name for name in container.sizes if name.lower() == "meta/time.csv"), None)
    if name is None:
        return None
    table = read_delimited(container.read(name), container.label(name))
    if not {"event", "experiment time", "system time"} <= table.columns.keys() or not len(table):
        return None
    events = [text.upper() for text in table.texts("event")]
    experiment_s, system_s = table.numbers("experiment time"), table.numbers("system time")
    starts = [row for row, event in enumerate(events) if event == "START"]
    if not starts:
        return None
    shift_s = system_s[starts] - experiment_s[starts]
    for rows in streams.values():
        part = np.maximum(np.searchsorted(experiment_s[starts], rows[:, 0], side="right") - 1, 0)
        rows[:, 0] += (shift_s - shift_s[0])[part]
    return float(shift_s[0])


def _device(container: Container) -> str:
    name = next((name for name in container.sizes if name.lower() == "meta/device.csv"), None)
    if name is None:
        return ""
    table = read_delimited(container.read(name), container.label(name))
    if not {"property", "value"} <= table.columns.keys():
        return ""
    facts = dict(zip(table.texts("property"), table.texts("value"), strict=True))
    return (
        " ".join(filter(None, (facts.get("deviceBrand", ""), facts.get("deviceModel", "")))).replace("nan", "").strip()
    )


def sniff(head: Head) -> bool:
    """True for an export of this app."""
    if head.container is not None:
        return any(name.lower() == "meta/time.csv" for name in head.members(".csv")) or any(
            _is_table(head.peek(name), name)
            for name in head.members(".csv")[:12]
            if PurePosixPath(name).stem == "Raw Data" or _sensor(PurePosixPath(name).stem)
        )
    return _is_table(head.content[:2048], head.path.name)


def _is_table(content: bytes, name: str) -> bool:
    line = content.partition(b"\n")[0].decode("utf-8", "replace")
    columns = [part.strip().strip('"') for part in re.split(r'[,;\t](?=")', line.strip())]
    return (
        line.startswith('"')
        and bool(_TIME.match(columns[0]))
        and any(
            (match := _AXIS.match(c))
            and (_sensor(match[1] or "") or _sensor(PurePosixPath(name).stem) or match[3].strip().lower() in _UNITS)
            for c in columns
        )
    )


READER: Final = Reader(read, sniff, options=("strict",))
