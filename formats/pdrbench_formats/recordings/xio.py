"""x-IMU3, NGIMU and other inertial units of x-io Technologies.

App: x-IMU3 GUI, NGIMU GUI, Gait-Tracking examples.
Files: one table with `Gyroscope X (deg/s)` and `Accelerometer X (g)` in its header, or the folder or zip of a recording
with `Inertial.csv` (x-IMU3) or `sensors.csv` (NGIMU).
Sensors: accel, gyro, mag.
Units: g, °/s, µT or a.u., as the header says.
Frame: of the unit, +1 g upwards at rest.
Clock: `Time (s)` or `Timestamp (us)` of the unit.
Traps: rows with equal times and gaps; magnetometers in arbitrary units are left out, as is the attitude, whose frame is
a setting of the unit.
"""

from __future__ import annotations

from pathlib import Path, PurePosixPath
from typing import Final

import msgspec

from pdrbench.errors import RecordingError
from pdrbench.io.container import open_container
from pdrbench.io.log import Log
from pdrbench.io.reader import Head, Reader
from pdrbench_formats.recordings.assemble import Tally
from pdrbench_formats.recordings.columnguess import guess
from pdrbench_formats.recordings.columnmap import read_mapped
from pdrbench_formats.recordings.delimited import read_delimited

_INERTIAL: Final = ("inertial.csv", "sensors.csv")  # of x-IMU3, of NGIMU


def read(path: Path | str, *, strict: bool = True) -> Log:
    """Reads one recording.

    Raises:
        RecordingError: Names file, line and remedy.
    """
    path, tally = Path(path), Tally()
    container = open_container(path)
    is_table = path.is_file() and not container.is_zip
    names = container.names() if is_table else [name for end in _INERTIAL for name in container.names(end)]
    if len(names) != 1:
        raise RecordingError(
            f"{path}: {len(names)} files named Inertial.csv or sensors.csv ({', '.join(names[:3])}); "
            f"read the folder of one unit"
        )
    table = read_delimited(container.read(names[0]), container.label(names[0]))
    found, _ = guess(table)
    if found is None or found.accel is None or found.gyro is None:
        table.require(["Gyroscope X (deg/s)", "Accelerometer X (g)"])
        raise RecordingError(f"{table.path}: line 1: no time among the columns; export with the time of each sample")
    for name in container.names(".csv"):
        if name != names[0]:
            tally.skipped[PurePosixPath(name).stem] += 1
    arbitrary = found.mag is not None and "a.u." in found.mag[0].lower()
    return read_mapped(
        path,
        table,
        msgspec.structs.replace(found, rotation=None, place=None, mag=None if arbitrary else found.mag),
        tally=tally,
        strict=strict,
    )


def sniff(head: Head) -> bool:
    """True for a table of such a unit."""
    if head.container is not None:
        return any(_is_header(head.peek(name)) for end in _INERTIAL for name in head.members(end))
    return _is_header(head.content[:1024])


def _is_header(content: bytes) -> bool:
    line = content.partition(b"\n")[0]
    return line.startswith((b"Time (s)", b"Timestamp (us)", b'"Time')) and b"Gyroscope X (deg/s)" in line


READER: Final = Reader(read, sniff, options=("strict",), fallback=True)
