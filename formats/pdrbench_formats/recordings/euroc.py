"""EuRoC MAV and TUM-VI, the layout of visual-inertial sets.

App: any recorder that writes the ASL format.
Files: the folder or zip of a sequence with `imu0/data.csv`, or that file alone.
Sensors: accel, gyro; `state_groundtruth_estimate0`, `mocap0`, `vicon0` or `leica0` as the reference, one level.
Units: m/s², rad/s, m.
Frame: of the inertial unit; the reference has z up.
Clock: nanoseconds, one clock for all files.
Traps: angular rates stand before accelerations; quaternions are w, x, y, z.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray
from pdrbench.io.container import Container, open_container
from pdrbench.io.log import Log
from pdrbench.io.reader import Head, Reader
from pdrbench_formats.recordings.assemble import Origin, Tally, assemble, places, seconds
from pdrbench_formats.recordings.delimited import DelimitedTable, read_delimited

_IMU: Final = "imu0/data.csv"
_REFERENCES: Final = tuple(
    f"{name}/data.csv" for name in ("state_groundtruth_estimate0", "mocap0", "vicon0", "leica0", "gt")
)


def read(path: Path | str, *, strict: bool = True) -> Log:
    """Reads one sequence.

    Raises:
        RecordingError: Names file, line and remedy.
    """
    path, tally = Path(path), Tally()
    container = open_container(path)
    names = [name for name in container.sizes if f"/{name}".endswith(f"/{_IMU}")]
    if path.is_file() and not container.is_zip:
        names = [path.name]
    elif not names:
        names = container.names("data.csv")
    if len(names) != 1:
        raise RecordingError(f"{path}: {len(names)} files {_IMU}; read the folder of one sequence")
    imu = _table(container, names[0], 7, tally)
    time_ns = _stamps(imu)
    values = imu.table(list(imu.columns)[1:7])
    origin_ns = int(time_ns[0])
    t_s = seconds(time_ns, origin_ns)
    reference = None
    truth = next((name for end in _REFERENCES for name in container.sizes if f"/{name}".endswith(f"/{end}")), None)
    if truth is not None:
        table = _table(container, truth, 4, tally)
        xyz = table.table(list(table.columns)[1:4])
        reference = places(seconds(_stamps(table), origin_ns), xyz[:, :2], z_m=xyz[:, 2], tally=tally)
    streams = {
        "accel": np.column_stack([t_s, values[:, 3:6]]),
        "gyro": np.column_stack([t_s, values[:, 0:3]]),
    }
    start = origin_ns * 1e-9
    origin = Origin(start_unix_s=start if start > 6e8 else None)
    return assemble(path, streams, reference=reference, origin=origin, tally=tally, strict=strict)


def _table(container: Container, name: str, columns: int, tally: Tally) -> DelimitedTable:
    table = read_delimited(container.read(name), container.label(name))
    tally.mended += table.mended
    tally.dropped += table.dropped
    if len(table.columns) < columns or not len(table):
        raise RecordingError(
            f"{table.path}: line {table.first_line}: {len(table.columns)} columns and {len(table)} rows, expected "
            f"{columns} columns or more; copy the file again"
        )
    return table


def _stamps(table: DelimitedTable) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    name = next(iter(table.columns))
    whole = table.whole(name)
    if whole is not None:
        return whole
    stamps: FloatArray = table.numbers(name)
    return np.nan_to_num(stamps).astype(np.int64)


def sniff(head: Head) -> bool:
    """True for a sequence in this layout."""
    if head.container is not None:
        return any(_is_header(head.peek(name)) for name in head.members("data.csv", depth=3) if "imu" in f"/{name}")
    return _is_header(head.content[:512])


def _is_header(content: bytes) -> bool:
    line = content.partition(b"\n")[0]
    return line.lstrip(b"#").strip().startswith(b"timestamp") and b"w_RS_S_x" in line and b"a_RS_S_x" in line


READER: Final = Reader(read, sniff, options=("strict",))
