"""OxIOD, a set of iPhone walks with motion capture as reference (Chen et al. 2018).

App: the recorder of the set (iOS).
Files: `imu*.csv` of a walk without a header, with `vi*.csv` of the same number beside it as the reference.
Sensors: accel, gyro, mag.
Units: g, rad/s, µT, m.
Frame: Apple's sign of acceleration is turned; the reference is that of the motion capture, one level.
Clock: the first column; in the folders `syn` the rows of both files belong together one by one.
Traps: gravity and the acceleration of the user stand in columns of their own and are added; the attitude is in angles
against an arbitrary heading and not read.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

import numpy as np

from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray
from pdrbench.io.compressed import found_file, plain_name
from pdrbench.io.container import open_container
from pdrbench.io.log import Log
from pdrbench.io.reader import Head, Reader
from pdrbench.trajectory import Trajectory
from pdrbench_formats.recordings.assemble import STANDARD_GRAVITY_MPS2, Tally, assemble, places
from pdrbench_formats.recordings.columnmap import SECONDS_IN
from pdrbench_formats.recordings.delimited import read_delimited

_NUM_COLUMNS: Final = 16
_NAME: Final = re.compile(r"imu(\d*)\.csv$", re.I)


def read(path: Path | str, *, strict: bool = True) -> Log:
    """Reads one walk.

    Raises:
        RecordingError: Names file, line and remedy.
    """
    path, tally = Path(path), Tally()
    if path.is_dir():
        walks = [name for name in open_container(path).names(".csv") if _NAME.search(name)]
        if len(walks) != 1:
            raise RecordingError(f"{path}: {len(walks)} walks ({', '.join(walks[:4])}); name one of the files")
        path = found_file(path / walks[0])
    names = [f"column {place + 1}" for place in range(_NUM_COLUMNS)]
    table = read_delimited(open_container(path).read(path.name), path, names=names, separator=",")
    tally.dropped += table.dropped
    values = table.table(names)
    if not len(values):
        raise RecordingError(f"{path}: line 1: no rows; copy the file again")
    unit_s = _unit_s(values[:, 0])
    first = values[0, 0]
    t_s = (values[:, 0] - first) * unit_s
    force = -STANDARD_GRAVITY_MPS2 * (values[:, 7:10] + values[:, 10:13])
    streams = {
        "accel": np.column_stack([t_s, force]),
        "gyro": np.column_stack([t_s, values[:, 4:7]]),
        "mag": np.column_stack([t_s, values[:, 13:16]]),
    }
    reference = _reference(path, t_s, first * unit_s, tally)
    return assemble(path, streams, reference=reference, tally=tally, strict=strict)


def _unit_s(t: FloatArray) -> float:
    steps = np.diff(t[np.isfinite(t)])
    usual = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.01
    return next((s for s in SECONDS_IN.values() if 1e-3 <= usual * s <= 0.3), 1.0)


def _reference(path: Path, t_s: FloatArray, first_s: float, tally: Tally) -> Trajectory | None:
    match = _NAME.search(plain_name(path.name))
    beside = found_file(path.with_name(f"vi{match[1]}.csv")) if match else path
    if beside == path or not beside.is_file():
        tally.note("note", "reference", "vi*.csv", "not beside the file", "copy it there to have a reference")
        return None
    names = ["Time", "Header", "x", "y", "z", "qx", "qy", "qz", "qw"]
    table = read_delimited(open_container(beside).read(beside.name), beside, names=names, separator=",")
    xyz = table.table(["x", "y", "z"])
    stamps = table.numbers("Time")
    if len(stamps) == len(t_s):
        at_s = t_s
    else:
        at_s = stamps * _unit_s(stamps) - first_s
        if not ((at_s > -1.0) & (at_s < t_s[-1] + 1.0)).any():
            tally.note(
                "warning",
                "reference",
                beside.name,
                "is on another clock and has another number of rows",
                "read the files in the folder syn",
            )
            return None
    return places(at_s, xyz[:, :2], z_m=xyz[:, 2], tally=tally)


def sniff(head: Head) -> bool:
    """True for a walk of this set."""
    if head.container is not None and not head.container.is_zip:
        return any(_NAME.search(name) and _is_walk(head.peek(name)) for name in head.members(".csv"))
    return bool(_NAME.search(plain_name(head.path.name))) and _is_walk(head.content)


def _is_walk(content: bytes) -> bool:
    fields = content.partition(b"\n")[0].split(b",")
    try:
        numbers = [float(field) for field in fields]
    except ValueError:
        return False
    return len(numbers) == _NUM_COLUMNS and 0.9 < float(np.linalg.norm(numbers[7:10])) < 1.1


READER: Final = Reader(read, sniff, options=("strict",))
