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

import dataclasses
import re
from pathlib import Path, PurePosixPath
from typing import Final

import numpy as np

from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray
from pdrbench.io.container import Container, open_container
from pdrbench.io.log import Log
from pdrbench.io.reader import Head, Reader
from pdrbench.sensors.checks import SAMPLED
from pdrbench_formats.recordings.assemble import Tally
from pdrbench_formats.recordings.columnnames import sensor_by, sensor_in, split_unit, unit_of
from pdrbench_formats.recordings.delimited import DelimitedTable, read_delimited
from pdrbench_formats.recordings.joined import SensorTable, join_tables

_TIME: Final = re.compile(r"^\w+\s*\((s|с)\)$", re.I)  # in the language of the app
_CLOCK: Final = "t (s)"  # what the column is called once pauses are in it
_EVENTS: Final = ("event", "experiment time", "system time")


def read(path: Path | str, *, strict: bool = True) -> Log:
    """Reads one export.

    Raises:
        RecordingError: Names file, line and remedy.
    """
    path, tally = Path(path), Tally()
    container = open_container(path)
    if any(name.lower().endswith((".xls", ".xlsx")) for name in container.sizes) and not container.names(".csv"):
        raise RecordingError(f"{path}: an Excel export; export the experiment as CSV")
    members = container.names() if container.is_file else container.names(".csv")
    tables = []
    begins_s, shift_s = _pauses(container)
    for name in (name for name in members if PurePosixPath(name).parts[0] != "meta"):
        table = read_delimited(container.read(name), container.label(name))
        sensor = sensor_in(PurePosixPath(name).stem)
        tables.append(SensorTable(name, sensor if sensor in SAMPLED else "", _moved(table, begins_s, shift_s)))
    if not tables:
        raise RecordingError(f"{path}: no table; record with the sensors of the phone and export as CSV")
    return join_tables(path, tables, tally, strict=strict, device=_device(container), may_sort=True)


def _moved(table: DelimitedTable, begins_s: FloatArray, shift_s: FloatArray) -> DelimitedTable:
    """The table with seconds since 1970: each part between two pauses is moved by what they lasted."""
    time = next((column for column in table.columns if _TIME.match(column)), None)
    if time is None:
        return table
    t_s = table.numbers(time)
    if len(begins_s):
        t_s = t_s + shift_s[np.maximum(np.searchsorted(begins_s, t_s, side="right") - 1, 0)]
    others = {name: values for name, values in table.columns.items() if name != time}
    return dataclasses.replace(table, columns={_CLOCK: t_s, **others})


def _pauses(container: Container) -> tuple[FloatArray, FloatArray]:
    """Where each part of the experiment begins, and what makes its seconds those since 1970; none where not known."""
    table = _meta(container, "time")
    if table is None or not set(_EVENTS) <= table.columns.keys():
        return np.zeros(0), np.zeros(0)
    starts = np.array([text.upper() == "START" for text in table.texts("event")], dtype=np.bool_)
    experiment_s, system_s = table.table(_EVENTS[1:])[starts].T
    return experiment_s, system_s - experiment_s


def _meta(container: Container, name: str) -> DelimitedTable | None:
    """A table of the folder `meta`."""
    found = next((member for member in container.sizes if member.lower() == f"meta/{name}.csv"), None)
    return None if found is None else read_delimited(container.read(found), container.label(found))


def _device(container: Container) -> str:
    table = _meta(container, "device")
    if table is None or not {"property", "value"} <= table.columns.keys():
        return ""
    facts = dict(zip(table.texts("property"), table.texts("value"), strict=True))
    return " ".join(filter(None, (facts.get("deviceBrand", ""), facts.get("deviceModel", "")))).replace("nan", "")


def sniff(head: Head) -> bool:
    """True for an export of this app."""
    if head.container is None:
        return _is_table(head.content[:2048])
    names = head.members(".csv")
    return any(name.lower() == "meta/time.csv" for name in names) or any(
        _is_table(head.peek(name))
        for name in names[:12]
        if PurePosixPath(name).stem == "Raw Data" or sensor_in(PurePosixPath(name).stem)
    )


def _is_table(content: bytes) -> bool:
    line = content.partition(b"\n")[0].decode("utf-8", "replace")
    columns = [part.strip().strip('"') for part in re.split(r'[,;\t](?=")', line.strip())]
    units = [split_unit(column)[1] for column in columns[1:] if column.endswith(")")]
    is_known = any(sensor_by(unit) or unit_of("baro_unit", unit) for unit in units)
    return line.startswith('"') and bool(_TIME.match(columns[0])) and is_known


READER: Final = Reader(read, sniff, options=("strict",))
