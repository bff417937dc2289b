"""Trials of a foot-mounted inertial unit under motion capture: MATLAB version 5 (Wagstaff, Peretroukhin, Kelly 2019).

* `imu` (N, 6) holds m/s^2 and rad/s, body axes as recorded (z down); `ts` the time in seconds of the computer that
  logged them, which jitters by a few milliseconds. Both are kept as they are; a time that the jitter puts before the
  last one is set to the last one, and counted.
* `gt` (N, 3) is the foot in the frame of the motion capture, which is left-handed against a world with z up: y is
  mirrored.
* Where the motion capture lost the foot it repeats its last position for some 0.3 s and then jumps, by up to a metre.
  Such rows are kept and not marked as surveyed.
* What the authors published with a trial, such as labels of zero velocity, is read by `read_published` and never
  part of a log.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Final

import numpy as np

from pdrbench.geometry import BoolArray, FloatArray, read_only
from pdrbench.io.log import Log
from pdrbench.io.reader import Reader
from pdrbench.trajectory import Trajectory
from pdrbench_formats.recordings.assemble import Tally
from pdrbench_formats.recordings.unit import MIRROR_Y, make_log, repeated
from pdrbench_sim.readers.matfile import MatFile, has_variables, load

DETECTORS: Final = ("shoe", "ared", "amvd", "mbgtd", "vicon")
# Column of `trial_error`. The third repeats the second in every file of the set, also where the labels of the two
# detectors have little in common: no error of amvd was published.
_ERROR_COLUMN: Final = {"shoe": 0, "ared": 1, "mbgtd": 3, "vicon": 4}
_JITTER_S: Final = 0.01  # the time of the logger wanders by 4 ms; what goes back by more is out of order
_LOST_SAMPLES: Final = 4  # repeats of one position; captured positions repeat once or twice, lost ones 8 to 183 times


@dataclass(frozen=True, slots=True)
class Published:
    """What the authors published with a trial.

    Attributes:
        t_s: (N,) time of every sample on the clock of the log.
        zero_velocity: (N,) True where the foot rests, by detector; thresholds were chosen for each trial by its error.
        error_m: By detector, as far as published: RMS of position after alignment, as the authors define it.
    """

    t_s: FloatArray
    zero_velocity: Mapping[str, BoolArray]
    error_m: Mapping[str, float]

    def __post_init__(self) -> None:
        for name in ("zero_velocity", "error_m"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))


def read(path: Path | str) -> Log:
    """Reads one trial: accel, gyro, and the foot by motion capture at every sample."""
    path = Path(path)
    file = load(path, ("imu", "ts", "gt"))
    imu, clock_s, mended = _samples(file)
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


def read_published(path: Path | str) -> Published:
    """Reads what the authors published with a trial; it must not reach a localizer."""
    path = Path(path)
    labels = {name: f"zv_{name}_opt" for name in DETECTORS}
    file = load(path, ("imu", "ts", *labels.values(), "trial_error"))
    imu, clock_s, _ = _samples(file)
    errors_m = file.vector("trial_error", len(DETECTORS))
    return Published(
        t_s=read_only(clock_s - clock_s[0]),
        zero_velocity={
            name: read_only(file.vector(variable, len(imu)) != 0, np.bool_) for name, variable in labels.items()
        },
        error_m={name: float(errors_m[column]) for name, column in _ERROR_COLUMN.items()},
    )


def _samples(file: MatFile) -> tuple[FloatArray, FloatArray, int]:
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
