"""Walks of a foot-mounted inertial unit with a position at every stride (Cetin, Koroglu 2025).

* Walks are MATLAB files of version 5: `imu_data` (N, 6) in m/s^2 and rad/s, `timestamps` in seconds, `strideIndex`
  (S,), and `GCP` (S, 2), the position of the foot at each stride in metres.
* The same strides stand in a table of text beside each walk, and there are such tables for trials of `foot_vicon`.
* A stride index counts samples from 0, although notes on the set say from 1: the tables give the times of exactly
  these samples, the positions in those of `foot_vicon` are its motion capture at exactly these samples (turned and
  shifted, to the last bit), and the last index is the last sample. It is the end of a stance: the foot begins to rise.
* The frame is left-handed against a world with z up: y is mirrored.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray, IntArray
from pdrbench.io.log import Log
from pdrbench.io.reader import Reader
from pdrbench.trajectory import Trajectory
from pdrbench_formats.recordings.assemble import Tally
from pdrbench_formats.recordings.matfile import has_variables, load
from pdrbench_formats.recordings.unit import MIRROR_Y, make_log, repeated


def read(path: Path | str) -> Log:
    """Reads one walk: accel, gyro, and as reference the foot at every stride."""
    path = Path(path)
    file = load(path, ("imu_data", "timestamps", "strideIndex", "GCP"))
    imu = file.matrix("imu_data", 6)
    clock_s = file.vector("timestamps", len(imu))
    index = file.vector("strideIndex")
    places_m = file.matrix("GCP", 2)
    if len(places_m) != len(index):
        raise file.error("GCP", f"has {len(places_m)} rows and strideIndex {len(index)}; export both from one walk")
    sample = _checked_samples(f"{path}: variable 'strideIndex'", index)
    if sample[-1] >= len(imu):
        raise file.error("strideIndex", f"ends with {sample[-1]} and there are {len(imu)} samples, counted from 0")
    axes = {"accel": imu[:, :3], "gyro": imu[:, 3:]}
    repeated(path, clock_s, axes)
    is_number = np.isfinite(places_m).all(axis=1)
    sample = sample[is_number]
    reference = Trajectory(
        t_s=clock_s[sample],
        xy_m=places_m[is_number] * MIRROR_Y,
        level=np.zeros(len(sample), dtype=np.int64),
        surveyed=np.ones(len(sample), dtype=np.bool_),
    )
    tally = Tally()
    tally.dropped["reference is not a number"] += int((~is_number).sum())
    return make_log(path, clock_s, axes, reference, tally=tally)


def _checked_samples(where: str, index: FloatArray) -> IntArray:
    """(S,) int; refuses what does not count samples from 0, each later than the one before."""
    with np.errstate(invalid="ignore"):
        sample = index.astype(np.int64)
    wrong = np.flatnonzero((sample != index) | (np.diff(sample, prepend=-1) <= 0))
    if len(wrong) or not len(sample):
        came = f"is {index[wrong[0]]:g} at stride {wrong[0] + 1}" if len(wrong) else "is empty"
        raise RecordingError(f"{where} {came}; expected whole numbers from 0 that rise: mend the labels")
    return np.asarray(sample)


READER: Final = Reader(read, lambda head: has_variables(head, {"imu_data", "strideIndex"}))
