"""What the authors of `foot_vicon` published with a trial; it must not reach a localizer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Final

import numpy as np

from pdrbench.geometry import BoolArray, FloatArray, read_only
from pdrbench_formats.recordings.matfile import load
from pdrbench_sim.readers.foot_vicon import samples

DETECTORS: Final = ("shoe", "ared", "amvd", "mbgtd", "vicon")
# Column of `trial_error`. The third repeats the second in every file of the set, also where the labels of the two
# detectors have little in common: no error of amvd was published.
_ERROR_COLUMN: Final = {"shoe": 0, "ared": 1, "mbgtd": 3, "vicon": 4}


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


def read_published(path: Path | str) -> Published:
    """Reads what the authors published with a trial; the clock of the log begins with its first sample."""
    path = Path(path)
    labels = {name: f"zv_{name}_opt" for name in DETECTORS}
    file = load(path, ("imu", "ts", *labels.values(), "trial_error"))
    imu, clock_s, _ = samples(file)
    errors_m = file.vector("trial_error", len(DETECTORS))
    return Published(
        t_s=read_only(clock_s - clock_s[0]),
        zero_velocity={
            name: read_only(file.vector(variable, len(imu)) != 0, np.bool_) for name, variable in labels.items()
        },
        error_m={name: float(errors_m[column]) for name, column in _ERROR_COLUMN.items()},
    )
