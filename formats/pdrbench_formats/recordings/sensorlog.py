"""SensorLog, an app for iPhone and Apple Watch by Bernd Thomas.

App: SensorLog (iOS).
Files: one CSV; commas, semicolons or bars.
Sensors: accel, gyro, mag, baro.
Units: g, rad/s, µT, kPa, as the headers say.
Frame: of Apple; the sign of acceleration and gravity is turned into Android's.
Clock: seconds since the phone was started; `loggingTime` gives the time of day.
Traps: a column repeats its last value until there is a new one, and holds 0 or `null` where the sensor was off; the raw
magnetometer keeps its bias, `motionMagneticField` does not; the attitude counts from a direction that is a setting of
the app and is not read.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np

from pdrbench.errors import RecordingError
from pdrbench.io.container import open_container
from pdrbench.io.log import Log
from pdrbench.io.reader import Head, Reader
from pdrbench_formats.recordings.columnmap import ColumnMap, read_mapped
from pdrbench_formats.recordings.delimited import DelimitedTable, read_delimited

_NAME: Final = b"loggingTime(txt)"
_CLOCKS: Final = ("accelerometer", "motion", "gyro")  # as in accelerometerTimestamp_sinceReboot(s)
_ACCEL: Final = "accelerometerAcceleration{}(G)"
_USER, _GRAVITY = "motionUserAcceleration{}(G)", "motionGravity{}(G)"
_GYRO: Final = ("motionRotationRate{}(rad/s)", "gyroRotation{}(rad/s)")
_MAG: Final = ("motionMagneticField{}(µT)", "magnetometer{}(µT)")
_BARO: Final = "altimeterPressure(kPa)"


def read(path: Path | str, *, strict: bool = True) -> Log:
    """Reads one recording.

    Raises:
        RecordingError: Names file, line and remedy.
    """
    path = Path(path)
    table = read_delimited(open_container(path).read(path.name), path)
    found: dict[str, Any] = {"time": "loggingTime(txt)", "time_unit": "datetime"}
    for clock in (f"{sensor}Timestamp_sinceReboot(s)" for sensor in _CLOCKS):
        if _is_on(table, clock):
            found |= {"time": clock, "time_unit": "s"}
            break
    if axes := _axes(table, _ACCEL):
        found |= {"accel": tuple(f"-{name}" for name in axes), "accel_unit": "g"}
    elif (axes := _axes(table, _USER)) and (gravity := _axes(table, _GRAVITY)):
        found |= {"accel": tuple(f"-{name}" for name in axes), "accel_unit": "g"}
        found["gravity"] = tuple(f"-{name}" for name in gravity)
    for sensor, names in (("gyro", _GYRO), ("mag", _MAG)):
        if axes := next((axes for name in names if (axes := _axes(table, name))), None):
            found[sensor] = axes
    if _is_on(table, _BARO):
        found |= {"baro": _BARO, "baro_unit": "kPa"}
    if not found.keys() & {"accel", "gyro"}:
        raise RecordingError(f"{path}: line 1: no accelerometer and no device motion; switch them on in the app")
    return read_mapped(path, table, ColumnMap(**found), strict=strict)


def _axes(table: DelimitedTable, form: str) -> tuple[str, ...] | None:
    names = tuple(form.format(axis) for axis in "XYZ")
    return names if all(_is_on(table, name) for name in names) else None


def _is_on(table: DelimitedTable, name: str) -> bool:
    """Whether a column is there and holds more than zeros and `null`."""
    return name in table.columns and bool(np.nan_to_num(table.numbers(name)).any())


def sniff(head: Head) -> bool:
    """True for a recording of this app."""
    line = head.content.partition(b"\n")[0]
    return head.container is None and (_NAME in line or b"motionUserAccelerationX(G)" in line)


READER: Final = Reader(read, sniff, options=("strict",))
