"""What other programs keep: recognised, and refused with what to export instead.

App: Excel, SQLite, MATLAB and MATLAB Mobile, Parquet, archives, saved states of apps.
Files: workbooks, databases, MAT-files, `.mvnx`, `.mtb`, `.phyphox`, `.gpx`, `.kml` and the like.
Sensors: none; the export as CSV gives them.
Units: those of the export.
Clock: that of the export.
Traps: a workbook or a database may hold several recordings; export one at a time.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final, NamedTuple

from pdrbench.errors import RecordingError
from pdrbench.io.reader import Head, Reader, head_of

_CSV: Final = "export the tables as CSV"
_MATLAB: Final = (  # timetables, as MATLAB Mobile records them, are objects that MATLAB alone can read
    "write a table with writetable in MATLAB; of a recording of MATLAB Mobile: "
    "T = synchronize(Acceleration, AngularVelocity, 'union', 'linear'); "
    "T.Properties.VariableNames = {'accel_x_mps2','accel_y_mps2','accel_z_mps2',"
    "'gyro_x_radps','gyro_y_radps','gyro_z_radps'}; "
    "T.t_s = seconds(T.Timestamp - T.Timestamp(1)); writetable(timetable2table(T), 'walk.csv')"
)


class _Kind(NamedTuple):
    """How files of a kind begin, what they are, and what to do."""

    begins: bytes
    what: str
    remedy: str


_KINDS: Final = (
    _Kind(b"SQLite format 3\0", "an SQLite database", f"{_CSV}; from Sensor Logger, export the zip"),
    _Kind(b"\xd0\xcf\x11\xe0", "an Excel workbook (.xls)", f"{_CSV}; from phyphox, choose CSV"),
    _Kind(b"MATLAB 5.0 MAT-file", "a MAT-file", _MATLAB),
    _Kind(b"MATLAB 7.3 MAT-file", "a MAT-file", _MATLAB),
    _Kind(b"\x89HDF\r\n\x1a\n", "an HDF5 file of no set that pdrbench knows", _CSV),
    _Kind(b"PAR1", "a Parquet file", _CSV),
    _Kind(b"ARROW1", "a Feather file", _CSV),
    _Kind(b"\x93NUMPY", "a NumPy array", "write it with numpy.savetxt and a header"),
    _Kind(b"\x80\x04", "a pickle, which is a program", f"{_CSV}; open none from strangers"),
    _Kind(b"\xfa\xff", "a recording of Xsens (.mtb)", "export it as text in MT Manager"),
    _Kind(b"7z\xbc\xaf\x27\x1c", "a 7z archive", "unpack it"),
    _Kind(b"Rar!\x1a\x07", "a RAR archive", "unpack it"),
    _Kind(b"$G", "NMEA sentences, which hold positions only", "record accelerometer and gyroscope"),
)
_TAR: Final = _Kind(b"ustar", "a tar archive", "unpack it and name the folder")
_TAR_AT: Final = 257  # bytes from the beginning, POSIX.1-1988
_XML: Final = (
    _Kind(b"<phyphox", "a saved state of phyphox", "open it in the app and export it as CSV"),
    _Kind(b"<mvnx", "a recording of Xsens MVN", "export the sensor data as CSV, or read the .mtb in MT Manager"),
    _Kind(b"<gpx", "a GPX track, which holds positions only", "record accelerometer and gyroscope"),
    _Kind(b"<kml", "a KML track, which holds positions only", "export the recording as CSV"),
    _Kind(b"<Workbook", "an Excel workbook", _CSV),
)
_MEMBERS: Final = (
    _Kind(b"xl/workbook.xml", "an Excel workbook (.xlsx)", f"{_CSV}; from phyphox, choose CSV"),
    _Kind(b"content.xml", "an OpenDocument file", _CSV),
    _Kind(b"word/document.xml", "a Word document", _CSV),
)


def read(path: Path | str) -> None:
    """Raises `RecordingError` with what to export instead."""
    kind = _kind(head_of(Path(path)))
    if kind is None:
        raise RecordingError(f"{path}: of no program that is known; name another format")
    raise RecordingError(f"{path}: {kind.what}, which is not read; {kind.remedy}")


def sniff(head: Head) -> bool:
    """True for a file of such a program."""
    return _kind(head) is not None


def _kind(head: Head) -> _Kind | None:
    if head.container is not None:
        names = [name.encode() for name in head.container.sizes]
        prefix = head.container.prefix.encode()
        found = (kind for kind in _MEMBERS if any(prefix + name == kind.begins for name in names))
        return next(found, None) if head.container.is_zip else None
    begin = head.content[:4096].lstrip()
    if begin.startswith(b"<"):
        return next((kind for kind in _XML if kind.begins in begin), None)
    if head.content[_TAR_AT:].startswith(_TAR.begins):
        return _TAR
    return next((kind for kind in _KINDS if head.content.startswith(kind.begins)), None)


READER: Final = Reader(read, sniff, fallback=True)
