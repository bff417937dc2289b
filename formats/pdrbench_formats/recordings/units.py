"""Units of a recording, judged by what is there all the time: gravity, the field of the Earth, the air."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from pdrbench.geometry import FloatArray
from pdrbench.io.log import Finding
from pdrbench_formats.recordings.windows import MAX_ROWS, MIN_ROWS, WINDOW_S, Rows, lengths, windows

_GRAVITY_MPS2: Final = (9.0, 10.6)  # a phone of IPIN 2023 reads 10.1
_MIN_MPS2, _MAX_MPS2 = 5.0, 25.0  # of gravity in any scale, and of a foot that runs from end to end of a recording
_MIN_STEADY: Final = 0.6  # mean over a second against the median; without gravity it cancels
_MAX_SPREAD_MPS2: Final = 2.0  # of a rest that shows the scale
_FIELD_UT: Final = (20.0, 75.0)  # of the Earth, 22 to 67 uT, with what iron a building adds on average


def gravity(rows: Rows) -> Iterator[Finding]:
    """Unit of acceleration, and whether gravity is in it."""
    accel = rows.get("accel")
    if accel is None or len(accel) < MIN_ROWS:
        return
    usual, mean, rest, spread = _levels(accel[:MAX_ROWS])
    where = "accel"
    if _is_gravity(usual, mean, rest):
        if not _GRAVITY_MPS2[0] <= rest <= _GRAVITY_MPS2[1] and spread < _MAX_SPREAD_MPS2:
            yield Finding(
                "warning", "accel-scale", where, f"gravity reads {rest:.2f} m/s^2", "calibrate the accelerometer"
            )
        return
    seen = f"the median length is {usual:.4g} m/s^2, of means over a second {mean:.4g}, where it is quiet {rest:.4g}"
    for unit, low, high in (
        ("g", 0.8, 2.0),
        ("mg", 800.0, 2000.0),
        ("feet/s^2", 29.0, 50.0),
        ("g, converted twice", 78.0, 200.0),
    ):
        if low <= mean <= high and low <= min(rest, usual) <= high and mean > _MIN_STEADY * usual:
            yield Finding(
                "error", "accel-unit", where, seen, f"it looks like {unit}: state the unit, or convert to m/s^2"
            )
            return
    if mean < _MIN_MPS2:
        yield Finding(
            "error",
            "no-gravity",
            where,
            seen,
            "gravity was taken out: record the accelerometer with gravity, or add the gravity sensor",
        )
        return
    yield Finding("error", "accel-unit", where, seen, "expected 9.81 m/s^2: state the unit, or convert to m/s^2")


def gravity_mps2(accel: FloatArray) -> float | None:
    """What rows (T, 4) of acceleration read where they are quiet; None where that is not gravity in m/s^2."""
    usual, mean, rest, _ = _levels(accel[:MAX_ROWS])
    return rest if _is_gravity(usual, mean, rest) else None


def _is_gravity(usual: float, mean: float, rest: float) -> bool:
    """Half of the samples of a foot that runs exceed 2 g: its rests and its means over strides do not."""
    return _MIN_MPS2 <= min(rest, usual) <= _MAX_MPS2 and mean > _MIN_STEADY * usual


def _levels(accel: FloatArray) -> tuple[float, float, float, float]:
    """Lengths of specific force (T, 4): median; of vectors averaged over a second; at rest, and how they spread there.

    At rest is the quietest tenth of half-second windows. Over a second shaking cancels, gravity stays.
    """
    length = lengths(accel[:, 1:])
    usual = float(np.median(length))
    means, counts = windows(accel, 2 * WINDOW_S)
    mean = float(np.median(lengths(means[counts > 0]))) if len(counts) else usual
    with np.errstate(over="ignore"):
        moments, counts = windows(np.column_stack([accel[:, 0], length, length**2]), WINDOW_S)
    moments = moments[counts > 3]
    if not len(moments):
        return usual, mean, usual, np.inf
    with np.errstate(invalid="ignore", over="ignore"):  # what a damaged file holds
        variance = np.nan_to_num(np.maximum(moments[:, 1] - moments[:, 0] ** 2, 0.0), nan=np.inf)
    quiet = variance <= np.quantile(variance, 0.1)
    return usual, mean, float(np.median(moments[quiet, 0])), float(np.sqrt(np.median(variance[quiet])))


def magnetometer(rows: Rows) -> Iterator[Finding]:
    mag = rows.get("mag")
    if mag is None or len(mag) < MIN_ROWS:
        return
    field_ut = float(np.median(lengths(mag[:MAX_ROWS, 1:])))
    seen = f"the median length is {field_ut:.4g} uT"
    for unit, low, high in (
        ("gauss", 0.2, 0.75),
        ("millitesla", 0.02, 0.075),
        ("tesla", 2e-5, 7.5e-5),
        ("nanotesla", 2e4, 7.5e4),
        ("milligauss", 200.0, 750.0),
    ):
        # a field of 200 to 750 of a part that is not calibrated is as likely
        if low <= field_ut <= high and unit != "milligauss":
            yield Finding("error", "mag-unit", "mag", seen, f"it looks like {unit}: state the unit")
            return
    if not _FIELD_UT[0] <= field_ut <= _FIELD_UT[1]:
        yield Finding(
            "warning",
            "mag-uncalibrated",
            "mag",
            f"{seen}; the field of the Earth has 25 to 65",
            "do not use it for headings before it is calibrated; record the calibrated magnetometer",
        )


def barometer(rows: Rows) -> Iterator[Finding]:
    baro = rows.get("baro")
    if baro is None or len(baro) < MIN_ROWS:
        return
    pressure = float(np.median(baro[:, 1]))
    if 500.0 <= pressure <= 1100.0:  # 5500 m up, where people live
        return
    unit = next(
        (
            name
            for name, low, high in (
                ("pascal", 5e4, 1.1e5),
                ("kilopascal", 50.0, 110.0),
                ("inches of mercury", 15.0, 32.5),
                ("bar", 0.5, 1.1),
            )
            if low <= pressure <= high
        ),
        "another unit",
    )
    yield Finding(
        "error", "baro-unit", "baro", f"the median is {pressure:.5g} hPa", f"it looks like {unit}: state the unit"
    )
