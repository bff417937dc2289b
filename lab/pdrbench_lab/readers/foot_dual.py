"""One foot of a walk with units on both feet (Hu, Hu 2025): comma-separated text at 60 Hz.

`imuMeasLeft.csv` and `imuMeasRight.csv` hold the samples in m/s^2 and rad/s, `positionGt.csv` beside them where both
feet were at the same indices, in a frame that is left-handed against a world with z up: y is mirrored. The flag of zero
velocity is not read.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from pdrbench.errors import RecordingError
from pdrbench.io.log import Log
from pdrbench.io.text import read_text
from pdrbench.trajectory import Trajectory
from pdrbench_formats.recordings.delimited import DelimitedTable, read_delimited
from pdrbench_formats.recordings.unit import MIRROR_Y, make_log

RATE_HZ: Final = 60.0
PLACES: Final = "positionGt.csv"


def read(path: Path | str) -> Log:
    """Reads the samples of one foot, and as reference where it was.

    Raises:
        RecordingError: A column is missing, or the two files differ in their indices.
    """
    path = Path(path)
    side = "left" if "Left" in path.name else "right"
    samples, places = _table(path), _table(path.with_name(PLACES))
    index = samples.numbers("time_index")
    if not np.array_equal(index, places.numbers("time_index")):
        raise RecordingError(f"{path}: its indices are not those of {PLACES}; copy both files of one walk")
    axes = {"accel": samples.table(("acc_x", "acc_y", "acc_z")), "gyro": samples.table(("gyro_x", "gyro_y", "gyro_z"))}
    place_m = places.table([f"pos_{side}_{axis}" for axis in "xyz"])
    reference = Trajectory(
        t_s=index / RATE_HZ,
        xy_m=place_m[:, :2] * MIRROR_Y,
        level=np.zeros(len(index), dtype=np.int64),
        surveyed=np.ones(len(index), dtype=np.bool_),
        z_m=place_m[:, 2],
    )
    return make_log(path, index / RATE_HZ, axes, reference)


def _table(path: Path) -> DelimitedTable:
    return read_delimited(read_text(path).content, path, separator=",", exact=True)
