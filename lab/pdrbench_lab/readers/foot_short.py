"""Walks of x-io's gait-tracking example: comma-separated text, found by the names of the columns.

* Time in seconds, angular rate in degree/s, specific force in g, at some 398 Hz.
* The logger repeats a sample, time included, wherever it lost the next; such rows are dropped and counted.
* The reference holds the two ends of the walk, which ends where it began.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from pdrbench.io.log import Log
from pdrbench.io.reader import Head, Reader
from pdrbench.io.text import read_text
from pdrbench_formats.recordings.assemble import STANDARD_GRAVITY_MPS2, Tally
from pdrbench_formats.recordings.delimited import read_delimited
from pdrbench_formats.recordings.unit import make_log
from pdrbench_lab.readers.foot_loops import closed

TIME: Final = "Time (s)"
_GYRO: Final = ("Gyroscope X (deg/s)", "Gyroscope Y (deg/s)", "Gyroscope Z (deg/s)")
_FIRST_ROW: Final = b"0,-0.1428319,-0.7708032,"  # of the one walk that ends where it began
_ACCEL: Final = ("Accelerometer X (g)", "Accelerometer Y (g)", "Accelerometer Z (g)")


def read(path: Path | str) -> Log:
    """Reads one walk: accel, gyro, and as reference its two ends at the origin."""
    path = Path(path)
    text, tally = read_text(path), Tally()
    table = read_delimited(text.content, path, separator=",", exact=True)
    table.require((TIME, *_GYRO, *_ACCEL))
    axes = {"accel": table.table(_ACCEL) * STANDARD_GRAVITY_MPS2, "gyro": np.radians(table.table(_GYRO))}
    others = [name for name in table.columns if name not in (TIME, *_GYRO, *_ACCEL)]
    tally.skipped.update(dict.fromkeys(others, len(table)))
    tally.mended.update(text.mended)
    tally.dropped += table.dropped
    clock_s = table.numbers(TIME)
    return make_log(path, clock_s, axes, closed(path, clock_s, axes), tally=tally)


def sniff(head: Head) -> bool:
    """True for the walk of this set; other files of x-io are read as `xio`, which knows nothing of where they end."""
    header, _, rows = head.content.partition(b"\n")
    return TIME.encode() in header and rows.startswith(_FIRST_ROW)


READER: Final = Reader(read, sniff)
