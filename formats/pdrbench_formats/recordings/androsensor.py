"""AndroSensor, an Android app by Fiv Asim.

App: AndroSensor 1.9 (Android).
Files: one CSV; commas or semicolons.
Sensors: accel, gyro, mag, baro.
Units: m/s², rad/s, µT, hPa, as the headers say.
Frame: of Android.
Clock: `Time since start in ms`.
Traps: columns depend on the phone; names have blanks around them; units come as UTF-8 or Latin-1; by default the app
records two rows a second, with which no steps can be found; where the accelerometer is off, gravity and linear
acceleration are added.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, Final

from pdrbench.errors import RecordingError
from pdrbench.io.container import open_container
from pdrbench.io.log import Log
from pdrbench.io.reader import Head, Reader
from pdrbench_formats.recordings.columnmap import ColumnMap, read_mapped
from pdrbench_formats.recordings.delimited import read_delimited

_TIME: Final = "time since start in ms"
_VECTORS: Final = {
    "accel": "ACCELEROMETER",
    "gravity": "GRAVITY",
    "linear": "LINEAR ACCELERATION",
    "gyro": "GYROSCOPE",
    "mag": "MAGNETIC FIELD",
}


def read(path: Path | str, *, strict: bool = True) -> Log:
    """Reads one recording.

    Raises:
        RecordingError: Names file, line and remedy.
    """
    path = Path(path)
    table = read_delimited(open_container(path).read(path.name), path)
    time = next((name for name in table.columns if name.lower().startswith(_TIME)), None)
    if time is None:
        raise RecordingError(f"{path}: line 1: no column 'Time since start in ms'; export with it")
    found: dict[str, Any] = {}
    for sensor, begin in _VECTORS.items():
        axes = [
            next((name for name in table.columns if re.match(rf"{begin} {axis}\b", name, re.I)), None) for axis in "XYZ"
        ]
        if None not in axes:
            found[sensor] = tuple(axes)
    linear = found.pop("linear", None)
    if "accel" in found:
        found.pop("gravity", None)
    elif linear is not None:
        found["accel"] = linear
    else:
        found.pop("gravity", None)
    baro = next((name for name in table.columns if name.upper().startswith("ATMOSPHERIC PRESSURE")), None)
    if not found and baro is None:
        raise RecordingError(f"{path}: line 1: no accelerometer, gyroscope or barometer; switch them on in the app")
    return read_mapped(path, table, ColumnMap(time=time, time_unit="ms", baro=baro, **found), strict=strict)


def sniff(head: Head) -> bool:
    """True for a recording of this app."""
    lines = head.content[:4096].lower().split(b"\n", 3)  # `sep=;` and comments may stand above the header
    return head.container is None and any(_TIME.encode() in line and b" x" in line for line in lines)


READER: Final = Reader(read, sniff, options=("strict",))
