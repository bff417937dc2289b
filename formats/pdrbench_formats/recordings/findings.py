"""What is wrong with a recording, found in its numbers: units, axes, clocks, gaps, sensors that are stuck.

Every check is a pure function of assembled streams. Units are judged by what is there all the time: gravity, the field
of the Earth, the air; axes and signs as in `axes`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Final

import numpy as np

from pdrbench.geometry import FloatArray
from pdrbench.inertial.checks import GRAVITY_MPS2, swings
from pdrbench.inertial.pairing import SamplePairs
from pdrbench.sensors import SENSORS, checks
from pdrbench.sensors.checks import MAX_ROWS, MIN_ROWS, SAMPLED, Finding, Rows, extremes, found, lengths
from pdrbench_formats.recordings.attitude import attitude
from pdrbench_formats.recordings.axes import moves_as_shoe, turning

_MAX_NEIGHBOURS: Final = 4000  # rows that are compared with the next ones
_UNITS: Final = {  # what one of them is in microtesla or hectopascal
    "mag": {"gauss": 100.0, "millitesla": 1e3, "tesla": 1e6, "nanotesla": 1e-3},  # 200 mG is as likely uncalibrated
    "baro": {"pascal": 0.01, "kilopascal": 10.0, "inches of mercury": 33.863886, "bar": 1e3},
}
_USUAL: Final = {
    "mag": (20.0, 75.0),  # of the Earth, 22 to 67 uT, with what iron a building adds on average
    "baro": (500.0, 1100.0),  # 5500 m up, where people live
}


def examine(rows: Rows, found: Sequence[Finding] = ()) -> tuple[Finding, ...]:
    """Everything that the checks find in streams, errors first, without what follows from another fault.

    Args:
        rows: (T, C) by sensor name, columns and units as in `pdrbench.sensors`, times non-decreasing.
        found: What a reader has found, which is among what is returned.
    """
    if moves_as_shoe(rows):  # a shoe has units at every angle: z down says nothing of a sign
        found = [one for one in found if one.code != "accel-sign" or one.severity == "error"]
    every = [*found, *(finding for check in _CHECKS for finding in check(rows))]
    kept = [finding for place, finding in enumerate(every) if not _follows(finding, every[:place], every)]
    order = ("error", "warning", "note")
    return tuple(sorted(kept, key=lambda finding: order.index(finding.severity)))


def _follows(finding: Finding, before: Sequence[Finding], every: Sequence[Finding]) -> bool:
    codes = checks.known(finding.code).get("follows", ())
    causes = [cause for cause in (before if finding.code in codes else every) if cause.code in codes]
    if finding.severity == "error" or finding.code == "gyro-unit":
        causes = [cause for cause in causes if cause.severity == "error"]  # or the log would pass as sound
    if finding.code == "out-of-bounds":
        stream = finding.where.partition(",")[0]
        return any(cause.where == stream or cause.code == "time-unit" for cause in causes)
    return bool(causes)


def _bounds(rows: Rows) -> Iterator[Finding]:
    for name, table in rows.items():
        spec = SENSORS[name]
        low, high = extremes(table)
        if not ((low >= spec.low) & (high <= spec.high)).all():
            outside = ~((table >= spec.low) & (table <= spec.high))
            row, column = (int(place) for place in np.argwhere(outside)[0])
            seen = (
                f"{spec.columns[column]} is {table[row, column]:.6g}, outside [{spec.low[column]:g}, "
                f"{spec.high[column]:g}], as in {outside.any(axis=1).sum()} of {len(table)} rows"
            )
            yield found("out-of-bounds" if column else "out-of-bounds, time", f"{name}, row {row + 1}", seen)


def _turning(rows: Rows) -> Iterator[Finding]:
    """Signs and axes of the gyroscope, and its unit, by gravity as it turns in the frame of the device."""
    found = list(checks.gyroscope(rows))
    yield from found
    if found or any(len(rows.get(name, ())) < MIN_ROWS for name in ("accel", "gyro")):
        return
    gyro, accel = rows["gyro"][:MAX_ROWS], rows["accel"][:MAX_ROWS]
    usual_s = min(float(np.median(np.diff(rows[name][:, 0]))) for name in ("accel", "gyro"))
    rest_mps2 = checks.gravity_mps2(accel)
    if rest_mps2 is not None and 1e-4 < usual_s < 1.0:  # in their units
        if moves_as_shoe(rows):
            pairs = SamplePairs().update(accel * [1.0, *3 * [GRAVITY_MPS2 / rest_mps2]], gyro)
            yield from swings(pairs[:, 0], pairs[:, 1:4], pairs[:, 4:])
            return
        others = {name: table for name, table in rows.items() if name != "mag" or not checks.is_constant(table)}
        yield from turning({**others, "gyro": gyro, "accel": accel}, rest_mps2)


def _magnetometer(rows: Rows) -> Iterator[Finding]:
    size, unit = _judged(rows, "mag")
    if unit and unit != "another unit":
        yield Finding(
            "error", "mag-unit", "mag", f"the median length is {size:.4g} uT", f"it looks like {unit}: state the unit"
        )
    elif unit:
        seen = f"the median length is {size:.4g} uT; the field of the Earth has 25 to 65"
        yield found("mag-uncalibrated", "mag", seen)


def _barometer(rows: Rows) -> Iterator[Finding]:
    size, unit = _judged(rows, "baro")
    if unit:
        seen = f"the median is {size:.5g} hPa"
        yield Finding("error", "baro-unit", "baro", seen, f"it looks like {unit}: state the unit")


def _judged(rows: Rows, sensor: str) -> tuple[float, str]:
    """The usual size of what a sensor measures, and the unit in which it would be usual; "" where it is as it is."""
    if len(rows.get(sensor, ())) < MIN_ROWS:
        return 0.0, ""
    size, (low, high) = float(np.median(lengths(rows[sensor][:MAX_ROWS, 1:]))), _USUAL[sensor]
    fitting = (unit for unit, factor in _UNITS[sensor].items() if low <= size * factor <= high)
    return size, "" if low <= size <= high else next(fitting, "another unit")


def _stuck(rows: Rows) -> Iterator[Finding]:
    for name in SAMPLED:
        table = rows.get(name)
        if table is None or len(table) < MIN_ROWS:
            continue
        if checks.is_constant(table):
            seen = f"one value from end to end in {len(table)} rows"
            yield found("constant", name, seen, "error" if name in ("accel", "gyro") else "warning")
        elif name in ("accel", "gyro"):
            yield from _saturated(name, table)


def _saturated(name: str, table: FloatArray) -> Iterator[Finding]:
    low = {"accel": 1.5 * 9.80665, "gyro": 2.0}[name]  # parts end at 2 g and 250 degree/s or above
    least, greatest = extremes(table)
    for axis, most in enumerate(np.maximum(greatest, -least)[1:].tolist()):
        if most <= low:
            continue
        values = table[:, 1 + axis]
        at_end = int((np.abs(values) > most * (1.0 - 1e-4)).sum())
        if at_end > max(5, len(values) // 2000):
            yield found("saturated", f"{name}, axis {'xyz'[axis]}", f"{at_end} rows at its largest value, {most:.5g}")


def _two_devices(rows: Rows) -> Iterator[Finding]:
    """Rows of two devices in turn: the next row is far away, the one after it near."""
    for name in ("accel", "mag"):
        table = rows.get(name)
        if table is None or len(table) < 10 * MIN_ROWS:
            continue
        table = table[:_MAX_NEIGHBOURS]
        near = float(np.median(lengths(table[2:, 1:] - table[:-2, 1:])))
        next_one = float(np.median(lengths(table[1:, 1:] - table[:-1, 1:])))
        if next_one > 4.0 * near and next_one > 0.1 * float(np.median(lengths(table[:, 1:]))):
            seen = f"rows differ by {next_one:.3g} from the next and by {near:.3g} from the one after it"
            yield found("two-devices", name, seen)
            return


def _few(rows: Rows) -> Iterator[Finding]:
    for name in ("accel", "gyro"):
        if name in rows and len(rows[name]) < MIN_ROWS:
            yield found("few-rows", name, f"{len(rows[name])} rows, too few to judge units and axes")


def _use(rows: Rows) -> Iterator[Finding]:
    """What a localizer will lack."""
    if "wifi" in rows or "ble" in rows or {"accel", "gyro"} <= rows.keys() or rows.keys() & {"stride", "position"}:
        return
    missing = [name for name in ("accel", "gyro") if name not in rows]
    where, seen = (
        f"sensors {', '.join(sorted(rows)) or 'none'}",
        f"no {' and no '.join(missing)}, no WiFi and no Bluetooth",
    )
    lacking = " and ".join({"accel": "the accelerometer", "gyro": "the gyroscope"}[name] for name in missing)
    remedy = f"dead reckoning needs acceleration with gravity and angular rates: record {lacking}"
    yield Finding("warning", "cannot-localize", where, seen, remedy)


_CHECKS: Final[tuple[Callable[[Rows], Iterator[Finding]], ...]] = (
    checks.clock,
    checks.gravity,
    _turning,
    attitude,
    _magnetometer,
    _barometer,
    _bounds,
    _stuck,
    _two_devices,
    _few,
    _use,
)
