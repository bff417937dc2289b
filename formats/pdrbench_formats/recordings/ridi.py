"""RIDI, a set of phone walks with a Tango tablet as reference (Yan, Shan, Furukawa 2018).

App: the recorder of the set (Android).
Files: `processed/data.csv` of a walk, or its folder.
Sensors: accel, gyro, mag, rotation; positions of the tablet as the reference, one level.
Units: m/s², rad/s, µT, m.
Frame: of Android; `rv` is the attitude of the phone; `ori` is the tablet's and not read.
Clock: `time` in nanoseconds.
Traps: the first column has no name; the frame of the positions is the tablet's, turned against east by an angle that
the file does not hold.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import msgspec

from pdrbench.errors import RecordingError
from pdrbench.io.container import open_container
from pdrbench.io.log import Log
from pdrbench.io.reader import Head, Reader
from pdrbench_formats.recordings.columnmap import ColumnMap, read_mapped
from pdrbench_formats.recordings.delimited import read_delimited

_MAP: Final = ColumnMap(
    time="time",
    time_unit="ns",
    accel=("acce_x", "acce_y", "acce_z"),
    gyro=("gyro_x", "gyro_y", "gyro_z"),
    mag=("magnet_x", "magnet_y", "magnet_z"),
    rotation=("rv_w", "rv_x", "rv_y", "rv_z"),
    place=("pos_x", "pos_y"),
    separator=",",
)


def read(path: Path | str, *, strict: bool = True) -> Log:
    """Reads one walk.

    Raises:
        RecordingError: Names file, line and remedy.
    """
    path = Path(path)
    container = open_container(path)
    names = [name for name in container.sizes if name.endswith("data.csv")] if path.is_dir() else [path.name]
    if len(names) != 1:
        raise RecordingError(f"{path}: {len(names)} files data.csv; read the folder of one walk")
    table = read_delimited(container.read(names[0]), container.label(names[0]), separator=",")
    absent = {name: None for name in ("mag", "rotation", "place") if getattr(_MAP, name)[0] not in table.columns}
    return read_mapped(path, table, msgspec.structs.replace(_MAP, **absent), strict=strict)


def sniff(head: Head) -> bool:
    """True for a walk of this set."""
    if head.container is not None:
        return any(_is_header(head.peek(name)) for name in head.members("data.csv", depth=2)[:3])
    return _is_header(head.content[:1024])


def _is_header(content: bytes) -> bool:
    line = content.partition(b"\n")[0]
    return line.startswith((b",time,", b"time,")) and b"acce_x" in line and b"grav_x" in line


READER: Final = Reader(read, sniff, options=("strict",))
