"""MATLAB Mobile: recognised, and refused with the way out.

App: MATLAB Mobile (iOS, Android).
Files: `.mat` with the timetables Acceleration, AngularVelocity, MagneticField, Orientation, Position.
Sensors: none; the export as CSV gives accel and gyro.
Units: m/s², rad/s.
Clock: that of the phone.
Traps: timetables are objects that MATLAB alone can read; two lines in MATLAB write a table that `csv` reads.
"""

from __future__ import annotations

import zlib
from pathlib import Path
from typing import Final

from pdrbench.errors import RecordingError
from pdrbench.io.reader import Head, Reader

_MAT5: Final = b"MATLAB 5.0 MAT-file"
_MAT73: Final = b"MATLAB 7.3 MAT-file"
_NAMES: Final = (b"Acceleration", b"AngularVelocity", b"MagneticField", b"Orientation", b"Position")
_HEADER_BYTES, _COMPRESSED = 128, 15
_PEEK_BYTES: Final = 512


def read(path: Path | str) -> None:
    """Raises `RecordingError` with the lines of MATLAB that export the recording."""
    raise RecordingError(
        f"{path}: timetables of MATLAB Mobile, which MATLAB alone can read; in MATLAB: "
        f"T = synchronize(Acceleration, AngularVelocity, 'union', 'linear'); "
        f"T.Properties.VariableNames = {{'accel_x_mps2','accel_y_mps2','accel_z_mps2',"
        f"'gyro_x_radps','gyro_y_radps','gyro_z_radps'}}; "
        f"T.t_s = seconds(T.Timestamp - T.Timestamp(1)); writetable(timetable2table(T), 'walk.csv')"
    )


def sniff(head: Head) -> bool:
    """True for a `.mat` file whose first variables are named as that app names them."""
    if head.content.startswith(_MAT73):
        return any(name in head.content for name in _NAMES) and b"timetable" in head.content
    if not head.content.startswith(_MAT5):
        return False
    place, content = _HEADER_BYTES, head.content
    while place + 8 <= len(content):
        kind = int.from_bytes(content[place : place + 4], "little")
        size = int.from_bytes(content[place + 4 : place + 8], "little")
        begin = content[place + 8 : place + 8 + size]
        if kind == _COMPRESSED:
            try:
                begin = zlib.decompressobj().decompress(begin, _PEEK_BYTES)
            except zlib.error:
                return False
        if (b"timetable" in begin[:_PEEK_BYTES] or b"MCOS" in begin[:_PEEK_BYTES]) and any(
            name in begin[:_PEEK_BYTES] for name in _NAMES
        ):
            return True
        place += 8 + size
    return False


READER: Final = Reader(read, sniff)
