"""Walks with a phone and switches under the feet: `accelerometer.csv` and `stepcounter.csv` of a folder, plain or gzip.

* Times are nanoseconds on one clock; time 0 is the first row of the accelerometer. Rows out of order are sorted and
  counted.
* Accelerometer: time, accuracy, x, y, z in m/s2, at 100 to 406 Hz.
* Switches: time, left, right, 1 while a foot stands, read some ten times a second. A foot that was up and stands makes
  a step. Switches flicker: a foot that comes down again within `STRIDE_S` has not been up; such contacts are counted.
* No place is known. The reference is the number of steps, one metre of a straight line for each.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray, IntArray, read_only
from pdrbench.io.log import Log, ReadReport
from pdrbench.io.reader import Reader
from pdrbench.io.text import read_text
from pdrbench.trajectory import Trajectory
from pdrbench_formats.recordings.delimited import read_delimited

ACCELEROMETER: Final = "accelerometer.csv"
SWITCHES: Final = "stepcounter.csv"
STRIDE_S: Final = 0.6  # ours: the strides of these walks take 0.8 s and more, flicker 0.2 to 0.45 s
STEP_M: Final = 1.0  # of the reference
MIN_ROWS: Final = 10
_ACCEL: Final = ("time", "accuracy", "x", "y", "z")
_FEET: Final = ("time", "left", "right")
_GRAVITY_MPS2: Final = (5.0, 20.0)  # median length of specific force


def read(path: Path | str) -> Log:
    """Reads one walk: accel, and as reference the steps that were made.

    Args:
        path: The folder of a walk, or its accelerometer file.
    """
    path = Path(path)
    folder = path if path.is_dir() else path.parent
    accel, accel_moved = _table(_file(folder, ACCELEROMETER), _ACCEL)
    feet, feet_moved = _table(_file(folder, SWITCHES), _FEET)
    begin_ns = accel[0, 0]
    rows = np.column_stack([(accel[:, 0] - begin_ns) * 1e-9, accel[:, 2:]])
    gravity_mps2 = float(np.median(np.sqrt((rows[:, 1:] ** 2).sum(axis=1))))
    if not _GRAVITY_MPS2[0] <= gravity_mps2 <= _GRAVITY_MPS2[1]:
        raise RecordingError(
            f"{folder}: {ACCELEROMETER}: the median length of the vector is {gravity_mps2:.4g}, expected about 9.81; "
            "convert the columns to m/s^2 with gravity in it"
        )
    if not np.isin(feet[:, 1:], (0.0, 1.0)).all():
        raise RecordingError(f"{folder}: {SWITCHES}: a switch is 0 or 1; copy the file again")
    contacts = [_contacts_s((feet[:, 0] - begin_ns) * 1e-9, foot) for foot in feet[:, 1:].T]
    steps_s = np.sort(np.concatenate([steps_s for steps_s, _ in contacts]))
    return Log(
        rows={"accel": read_only(rows)},
        reference=_counted(steps_s[steps_s > 0]),
        device="",
        report=ReadReport(
            kept={"accel": len(rows), "reference": len(steps_s)},
            dropped={"contact without a swing": sum(count for _, count in contacts)},
            mended={"row out of order": accel_moved + feet_moved},
            longest_gap_s={"accel": float(np.diff(rows[:, 0]).max())},
        ),
    )


def step_times_s(reference: Trajectory) -> FloatArray:
    """(S,) when steps were made, of the reference of a walk."""
    count: IntArray = np.rint(reference.xy_m[:, 0] / STEP_M).astype(np.int64)
    return np.repeat(reference.t_s[1:], count[1:] - count[:-1])


def _file(folder: Path, name: str) -> Path:
    """A file, plain or compressed."""
    for path in (folder / name, folder / f"{name}.gz"):
        if path.is_file():
            return path
    raise RecordingError(f"{folder}: there is neither {name} nor {name}.gz; give the folder that holds them")


def _table(path: Path, names: tuple[str, ...]) -> tuple[FloatArray, int]:
    """Rows in order of time, and how many were out of order."""
    table = read_delimited(read_text(path).content, path, names=names, separator=",", exact=True).table(names)
    if len(table) < MIN_ROWS or not np.isfinite(table).all():
        raise RecordingError(f"{path}: {len(table)} rows, expected {MIN_ROWS} or more, all of them finite numbers")
    order = np.argsort(table[:, 0], kind="stable")
    return table[order], int((np.diff(table[:, 0]) < 0).sum())


def _contacts_s(t_s: FloatArray, stands: FloatArray) -> tuple[FloatArray, int]:
    """When a foot comes down that was up, and how often it only seemed to."""
    found_s = t_s[1:][(stands[1:] > 0) & (stands[:-1] == 0)]
    kept: list[float] = []
    for at_s in found_s.tolist():
        if not kept or at_s - kept[-1] >= STRIDE_S:
            kept.append(at_s)
    return np.array(kept), len(found_s) - len(kept)


def _counted(steps_s: FloatArray) -> Trajectory:
    """The number of steps so far, along x; it begins with none, at a known start."""
    when_s, count = np.unique(steps_s, return_counts=True)
    t_s = np.concatenate([[0.0], when_s])
    x_m = STEP_M * np.concatenate([[0.0], np.cumsum(count)])
    return Trajectory(
        t_s=t_s,
        xy_m=np.column_stack([x_m, np.zeros(len(x_m))]),
        level=np.zeros(len(x_m), dtype=np.int64),
        surveyed=np.arange(len(x_m)) > 0,
    )


READER: Final = Reader(
    read, lambda head: any((head.path / f"{ACCELEROMETER}{ending}").is_file() for ending in ("", ".gz"))
)
