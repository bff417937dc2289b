"""What is wrong with a recording, found in its numbers: units, axes, clocks, gaps, sensors that are stuck.

Every check is a pure function of assembled streams. Units are judged by gravity, which is there all the time; axes and
signs as in `axes`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Final

import numpy as np

from pdrbench.geometry import FloatArray
from pdrbench.io.log import Finding
from pdrbench.recording import MAX_WALK_S
from pdrbench.sensors import SENSORS
from pdrbench_formats.recordings.axes import turning

Rows = Mapping[str, FloatArray]

MAX_PAUSE_S: Final = 60.0  # a clock that was set, or two walks in one file
MAX_GAP_S: Final = 1.0  # a step and a half: longer, and step detectors miss one
MIN_ROWS: Final = 20  # fewer say nothing on units
MIN_RATE_HZ: Final = 15.0  # steps come at up to 3 Hz and have harmonics
SAMPLED: Final = ("accel", "gyro", "mag", "rotation", "baro")
_GRAVITY_MPS2: Final = (9.0, 10.6)  # a phone of IPIN 2023 reads 10.1
_FIELD_UT: Final = (20.0, 75.0)  # of the Earth, 22 to 67 uT, with what iron a building adds on average
_MAX_TURN_RADPS: Final = 35.0  # 2000 degree/s, where gyroscopes end
_WINDOW_S: Final = 0.5
_MAX_POSES: Final = 4000
_MAX_ROWS: Final = 60_000  # that units and axes are judged by: ten minutes at 100 Hz
_INVERTED: Final = "from building to device"


def examine(rows: Rows) -> tuple[Finding, ...]:
    """Everything that the checks find in streams, errors first.

    Args:
        rows: (T, C) by sensor name, columns and units as in `pdrbench.sensors`, times non-decreasing.
    """
    found = [finding for check in _CHECKS for finding in check(rows)]
    order = ("error", "warning", "note")
    return tuple(sorted(found, key=lambda finding: order.index(finding.severity)))


def _bounds(rows: Rows) -> Iterator[Finding]:
    for name, table in rows.items():
        spec = SENSORS[name]
        outside = ~((table >= spec.low) & (table <= spec.high))
        if outside.any():
            row, column = (int(place) for place in np.argwhere(outside)[0])
            yield Finding(
                "error",
                "out-of-bounds",
                f"{name}, row {row + 1}",
                f"{spec.columns[column]} is {table[row, column]:.6g}, outside [{spec.low[column]:g}, "
                f"{spec.high[column]:g}], as in {outside.any(axis=1).sum()} of {len(table)} rows",
                f"write times in seconds and walks shorter than {MAX_WALK_S / 3600:.0f} h"
                if column == 0
                else "check the unit, or whether the row is damaged",
            )


def _clock(rows: Rows) -> Iterator[Finding]:
    """Unit of time and rate, from the stream with most rows; pauses, from all of them together."""
    name = max((n for n in SAMPLED if n in rows), key=lambda n: len(rows[n]), default="")
    if not name or len(rows[name]) < MIN_ROWS:
        return
    t_s = rows[name][:, 0]
    steps_s = np.diff(t_s)
    usual_s = float(np.median(steps_s[steps_s > 0])) if (steps_s > 0).any() else 0.0
    for unit, factor in (("milliseconds", 1e-3), ("microseconds", 1e-6), ("nanoseconds", 1e-9)):
        if 2e-3 <= usual_s * factor <= 0.1:  # a row each second is slow, one each 2 s is a row each 2 ms
            yield Finding(
                "error",
                "time-unit",
                name,
                f"the median step of time is {usual_s:g} s",
                f"it looks like {unit}: state the unit of time",
            )
            return
    if usual_s < 1e-4:
        yield Finding(
            "error",
            "time-unit",
            name,
            f"the median step of time is {usual_s:g} s",
            "write the time of each sample in seconds",
        )
        return
    every_s = [rows[n][:, 0] for n in SAMPLED if n in rows]
    outside_s = max(t_s[0] - min(s[0] for s in every_s), max(s[-1] for s in every_s) - t_s[-1])
    all_s = t_s
    if max(float(steps_s.max()), outside_s) > MAX_PAUSE_S:  # then another sensor may have rows in that time
        all_s = np.sort(np.concatenate(every_s))
    pause_s = np.diff(all_s)
    if pause_s.max(initial=0.0) > MAX_PAUSE_S:
        after_s = all_s[int(pause_s.argmax())]
        yield Finding(
            "error",
            "clock-jump",
            f"every sensor, after {after_s:.3f} s",
            f"nothing for {pause_s.max():.0f} s",
            "the clock was set or this is more than one walk: split the file there",
        )
        return
    for name in ("accel", "gyro"):
        if name not in rows or len(rows[name]) < MIN_ROWS:
            continue
        t_s = rows[name][:, 0]
        steps_s = np.diff(t_s)
        rate_hz = (len(t_s) - 1) / max(float(t_s[-1] - t_s[0]), 1e-9)
        if rate_hz < MIN_RATE_HZ:
            yield Finding(
                "warning",
                "low-rate",
                name,
                f"{rate_hz:.2g} rows a second",
                f"steps cannot be found below {MIN_RATE_HZ:g} Hz: record at 50 Hz or more",
            )
        elif steps_s.max() > MAX_GAP_S:
            long = np.flatnonzero(steps_s > MAX_GAP_S)
            yield Finding(
                "warning",
                "gap",
                f"{name}, after {t_s[long[0]]:.3f} s",
                f"{len(long)} gaps longer than {MAX_GAP_S:g} s, the longest {steps_s.max():.2f} s",
                "keep the app in the foreground while recording",
            )
        same = float((steps_s == 0).mean())
        if same > 0.01:
            yield Finding(
                "warning" if same > 0.2 else "note",
                "equal-times",
                name,
                f"{same:.0%} of rows have the time of the row before them",
                "record with the time of the sensor, not of its arrival",
            )


def _gravity(rows: Rows) -> Iterator[Finding]:
    accel = rows.get("accel")
    if accel is None or len(accel) < MIN_ROWS:
        return
    accel = accel[:_MAX_ROWS]
    force = float(np.median(_lengths(accel[:, 1:])))
    means, counts = _windows(accel, 2 * _WINDOW_S)
    mean = float(np.median(_lengths(means[counts > 0]))) if len(counts) else force  # shaking cancels, gravity stays
    where = "accel"
    if 5.0 <= force <= 20.0 and mean > 0.6 * force:
        at_rest = _at_rest(accel)
        if not _GRAVITY_MPS2[0] <= at_rest <= _GRAVITY_MPS2[1]:
            yield Finding(
                "warning", "accel-scale", where, f"gravity reads {at_rest:.2f} m/s^2", "calibrate the accelerometer"
            )
        return
    seen = f"the median length is {force:.4g} m/s^2, of means over a second {mean:.4g}"
    for unit, low, high in (
        ("g", 0.8, 1.25),
        ("mg", 800.0, 1250.0),
        ("feet/s^2", 29.0, 35.0),
        ("g, converted twice", 78.0, 123.0),
    ):
        if low <= mean <= high and low <= force <= high:
            yield Finding(
                "error", "accel-unit", where, seen, f"it looks like {unit}: state the unit, or convert to m/s^2"
            )
            return
    if mean < 5.0:
        yield Finding(
            "error",
            "no-gravity",
            where,
            seen,
            "gravity was taken out: record the accelerometer with gravity, or add the gravity sensor",
        )
        return
    yield Finding("error", "accel-unit", where, seen, "expected 9.81 m/s^2: state the unit, or convert to m/s^2")


def _at_rest(accel: FloatArray) -> float:
    """Median length of specific force in the quietest tenth of half-second windows; standard gravity of few rows."""
    length = _lengths(accel[:, 1:])
    moments, counts = _windows(np.column_stack([accel[:, 0], length, length**2]), _WINDOW_S)
    moments = moments[counts > 3]
    if not len(moments):
        return 9.80665
    spread = moments[:, 1] - moments[:, 0] ** 2
    return float(np.median(moments[spread <= np.quantile(spread, 0.1), 0]))


def _turning(rows: Rows) -> Iterator[Finding]:
    """Unit, signs and axes of the gyroscope, by gravity as it turns in the frame of the device."""
    gyro = rows.get("gyro")
    if gyro is None or len(gyro) < MIN_ROWS:
        return
    gyro = gyro[:_MAX_ROWS]
    fast = float(np.quantile(_lengths(gyro[:, 1:]), 0.99))
    remedy = "it looks like degree/s: state the unit, or convert to rad/s"
    if fast > _MAX_TURN_RADPS:
        yield Finding("error", "gyro-unit", "gyro", f"a hundredth of it turns by {fast:.3g} rad/s or more", remedy)
        return
    accel = rows.get("accel")
    if accel is None or len(accel) < MIN_ROWS:
        return
    accel = accel[:_MAX_ROWS]
    usual_s = min(float(np.median(np.diff(rows[name][:, 0]))) for name in ("accel", "gyro"))
    if 5.0 <= float(np.median(_lengths(accel[:, 1:]))) <= 20.0 and 1e-4 < usual_s < 1.0:  # in their units
        yield from turning({**rows, "gyro": gyro, "accel": accel})


def _attitude(rows: Rows) -> Iterator[Finding]:
    """Order and direction of the quaternion: it turns gravity to +z of the building."""
    rotation, accel = rows.get("rotation"), rows.get("accel")
    if rotation is None or len(rotation) < MIN_ROWS:
        return
    off = np.abs(_lengths(rotation[:, 1:]) - 1.0)
    if off.max() > 0.05:
        row = int(off.argmax())
        yield Finding(
            "error",
            "quaternion-length",
            f"rotation, row {row + 1}",
            f"length {1.0 + off.max():.3f} or {1.0 - off.max():.3f}, expected 1",
            "the columns are of another kind, or cut",
        )
        return
    if accel is None or len(accel) < MIN_ROWS:
        return
    sums = _ups(rotation, accel)
    if not sums:
        return
    given = sums["as given"]
    if given[2] > 0.7:
        return
    way = max(sums, key=lambda way: sums[way][2])
    if sums[way][2] > 0.8:
        yield Finding(
            "error",
            "quaternion",
            "rotation",
            f"it turns gravity up only where it is read {way} ({sums[way][2]:.2f} against {given[2]:.2f} of 1)",
            "write w, x, y, z of the turn from the device to the building, x east, y north, z up",
        )
        return
    axis = int(np.abs(given).argmax())
    steady = abs(given[axis]) > 0.8
    yield Finding(
        "error" if steady else "warning",
        "quaternion",
        "rotation",
        f"it turns gravity to {'-' if given[axis] < 0 else '+'}{'xyz'[axis]}"
        if steady
        else f"it turns gravity to no lasting direction (mean {np.round(given, 2).tolist()})",
        "the frame of the building has z up, or the accelerometer has the other sign"
        if steady
        else "leave the attitude out",
    )


def device_to_building(
    t_s: FloatArray, q: FloatArray, accel_s: FloatArray, accel_mps2: FloatArray
) -> FloatArray | None:
    """Quaternions of a format that does not say what they turn, as turns from the device to the building.

    Args:
        t_s, q: (T,), (T, 4) w first.
        accel_s, accel_mps2: (N,), (N, 3) with gravity, in the sign of Android.

    Returns:
        (T, 4) as they are or inverted, whichever turns gravity up; None where neither does.
    """
    order, other = np.argsort(t_s, kind="stable"), np.argsort(accel_s, kind="stable")
    sums = _ups(np.column_stack([t_s[order], q[order]]), np.column_stack([accel_s[other], accel_mps2[other]]))
    if not sums or max(sums["as given"][2], sums[_INVERTED][2]) < 0.7:
        return None
    return q if sums["as given"][2] >= sums[_INVERTED][2] else q * [1.0, -1.0, -1.0, -1.0]


def _ups(rotation: FloatArray, accel: FloatArray) -> dict[str, FloatArray]:
    """Mean direction into which gravity is turned, by the way in which the quaternions are read; {} of few rows."""
    force = accel[:: len(accel) // _MAX_POSES + 1]
    force = force[np.isfinite(force).all(axis=1)]
    at = np.searchsorted(rotation[:, 0], force[:, 0], side="right") - 1
    force, q = force[at >= 0], rotation[at[at >= 0], 1:]
    if len(force) < MIN_ROWS:
        return {}
    up = force[:, 1:] / np.maximum(_lengths(force[:, 1:]), 1e-9)[:, None]
    ways: dict[str, FloatArray] = {
        "as given": q,
        _INVERTED: q * [1.0, -1.0, -1.0, -1.0],
        "in the order x, y, z, w": q[:, [3, 0, 1, 2]],
        "from building to device in the order x, y, z, w": q[:, [3, 0, 1, 2]] * [1.0, -1.0, -1.0, -1.0],
    }
    return {way: np.nanmean(_turned(quaternion, up), axis=0) for way, quaternion in ways.items()}


def _magnetometer(rows: Rows) -> Iterator[Finding]:
    mag = rows.get("mag")
    if mag is None or len(mag) < MIN_ROWS:
        return
    field_ut = float(np.median(_lengths(mag[:_MAX_ROWS, 1:])))
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


def _barometer(rows: Rows) -> Iterator[Finding]:
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


def _stuck(rows: Rows) -> Iterator[Finding]:
    for name in SAMPLED:
        table = rows.get(name)
        if table is None or len(table) < MIN_ROWS:
            continue
        if (table[:_MAX_ROWS, 1:] == table[0, 1:]).all() and (table[:, 1:] == table[0, 1:]).all():
            yield Finding(
                "error" if name in ("accel", "gyro") else "warning",
                "constant",
                name,
                f"one value from end to end in {len(table)} rows",
                "the sensor is off or missing: record again, or leave it out",
            )
        elif name in ("accel", "gyro"):
            yield from _saturated(name, table)


def _saturated(name: str, table: FloatArray) -> Iterator[Finding]:
    low = {"accel": 1.5 * 9.80665, "gyro": 2.0}[name]  # parts end at 2 g and 250 degree/s or above
    for axis in range(3):
        values = table[:, 1 + axis]
        most = max(float(values.max()), -float(values.min()))
        if most <= low:
            continue
        at_end = int((np.abs(values) > most * (1.0 - 1e-4)).sum())
        if at_end > max(5, len(values) // 2000):
            yield Finding(
                "warning",
                "saturated",
                f"{name}, axis {'xyz'[axis]}",
                f"{at_end} rows at its largest value, {most:.5g}",
                "the range of the sensor is too small: record with a larger one",
            )


def _two_devices(rows: Rows) -> Iterator[Finding]:
    """Rows of two devices in turn: the next row is far away, the one after it near."""
    for name in ("accel", "mag"):
        table = rows.get(name)
        if table is None or len(table) < 10 * MIN_ROWS:
            continue
        table = table[:_MAX_POSES]
        near = float(np.median(_lengths(table[2:, 1:] - table[:-2, 1:])))
        next_one = float(np.median(_lengths(table[1:, 1:] - table[:-1, 1:])))
        if next_one > 4.0 * near and next_one > 0.1 * float(np.median(_lengths(table[:, 1:]))):
            yield Finding(
                "error",
                "two-devices",
                name,
                f"rows differ by {next_one:.3g} from the next and by {near:.3g} from the one after it",
                "rows of two devices take turns: split the file by device",
            )
            return


def _few(rows: Rows) -> Iterator[Finding]:
    for name in ("accel", "gyro"):
        if name in rows and len(rows[name]) < MIN_ROWS:
            yield Finding(
                "warning",
                "few-rows",
                name,
                f"{len(rows[name])} rows, too few to judge units and axes",
                "copy or export the whole recording",
            )


def _use(rows: Rows) -> Iterator[Finding]:
    """What a localizer will lack."""
    if "wifi" in rows or "ble" in rows or {"accel", "gyro"} <= rows.keys() or rows.keys() & {"stride", "position"}:
        return
    missing = [name for name in ("accel", "gyro") if name not in rows]
    yield Finding(
        "warning",
        "cannot-localize",
        f"sensors {', '.join(sorted(rows)) or 'none'}",
        f"no {' and no '.join(missing)}, no WiFi and no Bluetooth",
        "dead reckoning needs acceleration with gravity and angular rates: record "
        + " and ".join({"accel": "the accelerometer", "gyro": "the gyroscope"}[name] for name in missing),
    )


_CHECKS: Final[tuple[Callable[[Rows], Iterator[Finding]], ...]] = (
    _clock,
    _bounds,
    _gravity,
    _turning,
    _attitude,
    _magnetometer,
    _barometer,
    _stuck,
    _two_devices,
    _few,
    _use,
)


def _lengths(vectors: FloatArray) -> FloatArray:
    """(T,) length of each vector; what a damaged file holds must not overflow."""
    with np.errstate(over="ignore"):
        lengths: FloatArray = np.sqrt(np.einsum("...i,...i", vectors, vectors))
    return lengths


def _windows(rows: FloatArray, window_s: float) -> tuple[FloatArray, FloatArray]:
    """(K, C - 1) means over equal windows, NaN where one is empty, and (K,) rows in each."""
    if not len(rows) or rows[-1, 0] > (50 * len(rows) + 1000) * window_s:  # another unit of time: a finding of its own
        return np.zeros((0, rows.shape[1] - 1)), np.zeros(0)
    at = (rows[:, 0] // window_s).astype(np.int64)
    counts = np.bincount(at).astype(np.float64)
    sums = np.stack([np.bincount(at, weights=column) for column in rows[:, 1:].T], axis=1)
    with np.errstate(invalid="ignore"):
        return sums / counts[:, None], counts


def _turned(q: FloatArray, v: FloatArray) -> FloatArray:
    """(T, 3) vectors (T, 3) turned by quaternions (T, 4), w first: v + 2 w (u x v) + 2 u x (u x v)."""
    u = q[:, 1:]
    once = np.cross(u, v)
    turned: FloatArray = v + 2.0 * (q[:, :1] * once + np.cross(u, once))
    return turned
