"""Trials of a foot-mounted inertial unit under motion capture: MATLAB version 5 (Wagstaff, Peretroukhin, Kelly 2019).

* `imu` (N, 6) holds m/s^2 and rad/s, body axes as recorded (z down); `ts` the time in seconds of the computer that
  logged them, which jitters by a few milliseconds. Both are kept as they are; a time that the jitter puts before the
  last one is set to the last one, and counted.
* `gt` (N, 3) is the foot in the frame of the motion capture, which is left-handed against a world with z up: y is
  mirrored.
* Where the motion capture lost the foot it repeats its last position for some 0.3 s and then jumps, by up to a metre.
  Such rows are kept and not marked as surveyed.
* What the authors published with a trial, such as labels of zero velocity, is never part of a log.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from pdrbench.geometry import BoolArray, FloatArray
from pdrbench.io.log import Log
from pdrbench.io.reader import Reader
from pdrbench.trajectory import Trajectory
from pdrbench_formats.recordings.assemble import Tally
from pdrbench_formats.recordings.matfile import MatFile, has_variables, load
from pdrbench_formats.recordings.unit import MIRROR_Y, make_log, repeated

_JITTER_S: Final = 0.01  # the time of the logger wanders by 4 ms; what goes back by more is out of order
_LOST_SAMPLES: Final = 4  # repeats of one position; captured positions repeat once or twice, lost ones 8 to 183 times


def read(path: Path | str) -> Log:
    """Reads one trial: accel, gyro, and the foot by motion capture at every sample."""
    path = Path(path)
    file = load(path, ("imu", "ts", "gt"))
    imu, clock_s, mended = samples(file)
    captured_m = file.matrix("gt", 3)
    if len(captured_m) != len(imu):
        raise file.error("gt", f"has {len(captured_m)} rows and imu has {len(imu)}; export both from one trial")
    axes = {"accel": imu[:, :3], "gyro": imu[:, 3:]}
    keep = ~repeated(path, clock_s, axes) & np.append(True, np.diff(clock_s) > 0)
    is_number = np.isfinite(captured_m).all(axis=1)
    tally = Tally()
    tally.dropped["reference is not a number"] += int((keep & ~is_number).sum())
    tally.mended["the clock jittered back"] += mended
    keep &= is_number
    reference = Trajectory(
        t_s=clock_s[keep],
        xy_m=captured_m[keep, :2] * MIRROR_Y,
        level=np.zeros(int(keep.sum()), dtype=np.int64),
        surveyed=~_is_lost(captured_m)[keep],
        z_m=captured_m[keep, 2],
    )
    return make_log(path, clock_s, axes, reference, tally=tally)


def samples(file: MatFile) -> tuple[FloatArray, FloatArray, int]:
    """(N, 6) specific force and angular rate, (N,) their times, and how many of these were mended."""
    imu = file.matrix("imu", 6)
    clock_s = file.vector("ts", len(imu))
    forward_s = np.maximum.accumulate(clock_s)
    if (forward_s - clock_s > _JITTER_S).any():
        return imu, clock_s, 0
    return imu, forward_s, int((forward_s > clock_s).sum())


def _is_lost(captured_m: FloatArray) -> BoolArray:
    """(N,) True where a position is repeated as one that was captured is not."""
    repeats = np.append(False, (captured_m[1:] == captured_m[:-1]).all(axis=1))
    run = np.cumsum(~repeats)  # number of the run of equal positions that each row belongs to
    is_long: BoolArray = np.bincount(run, weights=repeats)[run] >= _LOST_SAMPLES
    return repeats & is_long


READER: Final = Reader(read, lambda head: has_variables(head, {"imu", "gt"}))
