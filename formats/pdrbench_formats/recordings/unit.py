"""Logs of one inertial unit, whose sensors take their samples together."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np

from pdrbench.errors import RecordingError
from pdrbench.geometry import BoolArray, FloatArray
from pdrbench.io.log import Log
from pdrbench.trajectory import Trajectory
from pdrbench_formats.recordings.assemble import Tally, assemble

MIRROR_Y: Final = np.array([1.0, -1.0])  # (2,) from a left-handed plane to a right-handed one
MIN_SAMPLES: Final = 10  # fewer are no walk


def make_log(
    path: Path,
    clock_s: FloatArray,
    axes: Mapping[str, FloatArray],
    reference: Trajectory,
    *,
    tally: Tally | None = None,
) -> Log:
    """A log of samples that all sensors took together.

    Args:
        path: Named in errors.
        clock_s: (N,) time of every sample on the clock of the file, in the order of the file.
        axes: (N, 3) by sensor name, in the units of `pdrbench.sensors`, NaN where the file has no number.
        reference: On that clock.
        tally: What the reader skipped, dropped or mended.

    Raises:
        RecordingError: As in `assemble`; or there are too few samples, or one without a time.
    """
    tally = tally or Tally()
    again = repeated(path, clock_s, axes)
    tally.dropped["the same row twice"] += int(again.sum())
    streams = {name: np.column_stack([clock_s[~again], xyz[~again]]) for name, xyz in axes.items()}
    return assemble(path, streams, reference=reference, tally=tally)


def repeated(path: Path, clock_s: FloatArray, axes: Mapping[str, FloatArray]) -> BoolArray:
    """(N,) True where a sample repeats the one before it; refuses few samples, and times that are NaN or go back."""
    if len(clock_s) < MIN_SAMPLES:
        raise RecordingError(f"{path}: {len(clock_s)} samples, expected {MIN_SAMPLES} or more; copy the file again")
    wrong = np.flatnonzero(~(np.diff(clock_s) >= 0)) + 1
    if len(wrong):
        row = int(wrong[0])
        raise RecordingError(
            f"{path}: sample {row + 1}: the time goes from {clock_s[row - 1]:.6f} to {clock_s[row]:.6f} s; "
            f"put the samples in order of time, or split the file where the clock was set"
        )
    if not clock_s[-1] > clock_s[0]:
        raise RecordingError(f"{path}: all {len(clock_s)} samples have one time, {clock_s[0]:g}; export their times")
    everything = np.column_stack([clock_s, *axes.values()])
    same = (everything[1:] == everything[:-1]) | (np.isnan(everything[1:]) & np.isnan(everything[:-1]))
    return np.append(False, same.all(axis=1))
