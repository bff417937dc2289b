"""Units of a recording, judged by what is there all the time: the field of the Earth, the air."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from pdrbench.sensors.checks import MAX_ROWS, MIN_ROWS, Finding, Rows, found, lengths

UNITS: Final = {  # what one of them is in microtesla or hectopascal
    "mag": {"gauss": 100.0, "millitesla": 1e3, "tesla": 1e6, "nanotesla": 1e-3},  # 200 mG is as likely uncalibrated
    "baro": {"pascal": 0.01, "kilopascal": 10.0, "inches of mercury": 33.863886, "bar": 1e3},
}
USUAL: Final = {
    "mag": (20.0, 75.0),  # of the Earth, 22 to 67 uT, with what iron a building adds on average
    "baro": (500.0, 1100.0),  # 5500 m up, where people live
}


def magnetometer(rows: Rows) -> Iterator[Finding]:
    size, unit = _judged(rows, "mag")
    if unit and unit != "another unit":
        yield Finding(
            "error", "mag-unit", "mag", f"the median length is {size:.4g} uT", f"it looks like {unit}: state the unit"
        )
    elif unit:
        seen = f"the median length is {size:.4g} uT; the field of the Earth has 25 to 65"
        yield found("mag-uncalibrated", "mag", seen)


def barometer(rows: Rows) -> Iterator[Finding]:
    size, unit = _judged(rows, "baro")
    if unit:
        seen = f"the median is {size:.5g} hPa"
        yield Finding("error", "baro-unit", "baro", seen, f"it looks like {unit}: state the unit")


def _judged(rows: Rows, sensor: str) -> tuple[float, str]:
    """The usual size of what a sensor measures, and the unit in which it would be usual; "" where it is as it is."""
    if len(rows.get(sensor, ())) < MIN_ROWS:
        return 0.0, ""
    size, (low, high) = float(np.median(lengths(rows[sensor][:MAX_ROWS, 1:]))), USUAL[sensor]
    fitting = (unit for unit, factor in UNITS[sensor].items() if low <= size * factor <= high)
    return size, "" if low <= size <= high else next(fitting, "another unit")
