"""What the readers of inertial units share: rows that can be trusted, and the account of those that could not.

* Time 0 is the first row.
* A row without a finite number in each column of a sensor is dropped from that sensor and counted.
* A row that equals the one before it, time included, is dropped and counted.
* Times that go back are refused: a row that is out of place is not one that can be integrated over.
* Units are judged by magnitude: gravity is there all the time, and a foot that walks turns by several rad/s.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np

from pdrbench.errors import RecordingError
from pdrbench.geometry import BoolArray, FloatArray, read_only
from pdrbench.io.log import Log, ReadReport
from pdrbench.trajectory import Trajectory

STANDARD_GRAVITY_MPS2: Final = 9.80665
UT_PER_GAUSS: Final = 100.0
MIRROR_Y: Final = np.array([1.0, -1.0])  # (2,) from a left-handed plane to a right-handed one
MIN_ROWS: Final = 10  # fewer say nothing on units, and are no walk
MAX_PAUSE_S: Final = 60.0  # a clock that was set, or two walks in one file
_STEP_S: Final = (1e-4, 0.1)  # from 10 kHz to 10 Hz; what lies outside is another unit of time
_LIMIT: Final = {"accel": 490.0, "gyro": 69.0, "mag": 5000.0}  # as `pdrbench.sensors` has them
_GRAVITY_MPS2: Final = (5.0, 20.0)  # median length of specific force
_FIELD_UT: Final = (5.0, 500.0)  # median length of a magnetic field in a building
_FASTEST_RADPS: Final = 35.0  # 2000 degree/s, where gyroscopes end; a walk in degree/s has hundreds
_SLOWEST_RADPS: Final = 0.5  # a walk in rad/s, taken for degree/s, ends at 0.2
_WALKS_MPS2: Final = 5.0  # specific force strays that far from its median where a foot walks


def make_log(
    path: Path,
    clock_s: FloatArray,
    axes: Mapping[str, FloatArray],
    reference: Trajectory | None = None,
    *,
    account: ReadReport,
    accel_unit: str = "m/s^2",
    gyro_unit: str = "rad/s",
) -> Log:
    """A log of samples that all sensors took together.

    Args:
        path: Named in errors.
        clock_s: (N,) time of every sample on the clock of the file, finite, in the order of the file.
        axes: (N, 3) by sensor name, in the units of `pdrbench.sensors`, NaN where the file has no number.
        reference: On the clock of the log; None where all that is known is that the walk ends where it began.
        account: Rows that the reader skipped, dropped or mended.
        accel_unit, gyro_unit: Of the columns in the file, for errors.
    """
    keep = kept(path, clock_s, axes)
    t_s = clock_s - clock_s[0]
    if reference is None:
        reference = _closed_loop(float(t_s[-1]))
    rows: dict[str, FloatArray] = {}
    dropped = {**account.dropped, "the same row twice": int((~keep).sum())}
    for name, xyz in axes.items():
        whole = keep & np.isfinite(xyz).all(axis=1)
        dropped[f"{name} is not a number"] = int((keep & ~whole).sum())
        rows[name] = read_only(np.column_stack([t_s[whole], xyz[whole]]))
        if len(rows[name]) < MIN_ROWS:
            raise RecordingError(
                f"{path}: {name}: {len(rows[name])} samples hold numbers, expected {MIN_ROWS} or more; "
                f"export the file again"
            )
    _check_units(path, rows, accel_unit, gyro_unit)
    for name, table in rows.items():
        outside = np.argwhere(np.abs(table[:, 1:]) > _LIMIT[name])
        if len(outside):
            row, axis = outside[0].tolist()
            raise RecordingError(
                f"{path}: {name}: {table[row, 1 + axis]:.6g} at {table[row, 0]:.3f} s, outside [{-_LIMIT[name]:g}, "
                f"{_LIMIT[name]:g}]; check its unit, or whether the row is damaged"
            )
    return Log(
        rows=rows,
        reference=reference,
        device="",
        report=ReadReport(
            kept={**{name: len(table) for name, table in rows.items()}, "reference": len(reference)},
            skipped=account.skipped,
            dropped=dropped,
            mended=account.mended,
            longest_gap_s={name: float(np.diff(table[:, 0]).max()) for name, table in rows.items()},
            constant=tuple(name for name, table in rows.items() if (table[:, 1:] == table[0, 1:]).all()),
        ),
    )


def kept(path: Path, clock_s: FloatArray, axes: Mapping[str, FloatArray]) -> BoolArray:
    """(N,) False where a sample repeats the one before it; refuses a clock that cannot be right."""
    if len(clock_s) < MIN_ROWS:
        raise RecordingError(f"{path}: {len(clock_s)} samples, expected {MIN_ROWS} or more; copy the file again")
    step_s = np.diff(clock_s)
    back = np.flatnonzero(~(step_s >= 0))
    if len(back):
        row = int(back[0]) + 1
        raise RecordingError(
            f"{path}: sample {row + 1}: the time goes from {clock_s[row - 1]:.6f} to {clock_s[row]:.6f} s; "
            f"put the samples in order of time, or split the file where the clock was set"
        )
    usual_s = float(np.median(step_s[step_s > 0])) if (step_s > 0).any() else 0.0
    if not _STEP_S[0] <= usual_s <= _STEP_S[1]:
        raise RecordingError(
            f"{path}: the median step of time is {usual_s:g} s, expected {_STEP_S[0]:g} to {_STEP_S[1]:g} s; "
            f"it looks like another unit: write seconds"
        )
    if step_s.max() > MAX_PAUSE_S:
        row = int(step_s.argmax()) + 1
        raise RecordingError(
            f"{path}: sample {row + 1}: nothing for {step_s.max():.0f} s before it; "
            f"the clock was set or this is more than one walk: split the file there"
        )
    everything = np.column_stack([clock_s, *axes.values()])
    same = (everything[1:] == everything[:-1]) | (np.isnan(everything[1:]) & np.isnan(everything[:-1]))
    return np.append(True, ~same.all(axis=1))


def _closed_loop(duration_s: float) -> Trajectory:
    """Both ends of a walk at the origin."""
    return Trajectory(
        t_s=np.array([0.0, duration_s]),
        xy_m=np.zeros((2, 2)),
        level=np.zeros(2, dtype=np.int64),
        surveyed=np.ones(2, dtype=np.bool_),
        z_m=np.zeros(2),
    )


def _check_units(path: Path, rows: Mapping[str, FloatArray], accel_unit: str, gyro_unit: str) -> None:
    force_mps2 = _lengths(rows["accel"])
    gravity_mps2 = float(np.median(force_mps2))
    if not _GRAVITY_MPS2[0] <= gravity_mps2 <= _GRAVITY_MPS2[1]:
        other = "g" if accel_unit == "m/s^2" else "m/s^2"
        raise RecordingError(
            f"{path}: accel: the median length of the vector is {gravity_mps2:.4g} m/s^2 where {accel_unit} is read, "
            f"expected {_GRAVITY_MPS2[0]:g} to {_GRAVITY_MPS2[1]:g}; it looks like {other}, or gravity was taken out: "
            f"convert the columns to {accel_unit} with gravity"
        )
    fast_radps = float(np.quantile(_lengths(rows["gyro"]), 0.99))
    walks = float(np.quantile(np.abs(force_mps2 - gravity_mps2), 0.99)) > _WALKS_MPS2
    if fast_radps > _FASTEST_RADPS or (walks and fast_radps < _SLOWEST_RADPS):
        other = "degree/s" if fast_radps > _FASTEST_RADPS else "rad/s" if gyro_unit == "degree/s" else "another unit"
        raise RecordingError(
            f"{path}: gyro: the fastest hundredth turns by {fast_radps:.3g} rad/s and more where {gyro_unit} is read, "
            f"expected {_SLOWEST_RADPS:g} to {_FASTEST_RADPS:g} of a foot that walks; it looks like {other}: "
            f"convert the columns to {gyro_unit}"
        )
    if "mag" in rows:
        field_ut = float(np.median(_lengths(rows["mag"])))
        if not _FIELD_UT[0] <= field_ut <= _FIELD_UT[1]:
            raise RecordingError(
                f"{path}: mag: the median length of the vector is {field_ut:.4g} microtesla, expected {_FIELD_UT[0]:g} "
                f"to {_FIELD_UT[1]:g}; convert the columns to the unit that the header names"
            )


def _lengths(rows: FloatArray) -> FloatArray:
    """(T,) length of the vector in each row; what a damaged file holds must not overflow."""
    return np.asarray(np.linalg.norm(np.clip(rows[:, 1:], -1e100, 1e100), axis=1))
