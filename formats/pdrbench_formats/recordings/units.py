"""Units of a recording, judged by what is there all the time: the field of the Earth, the air."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from pdrbench.sensors.checks import MAX_ROWS, MIN_ROWS, Finding, Rows, lengths

_FIELD_UT: Final = (20.0, 75.0)  # of the Earth, 22 to 67 uT, with what iron a building adds on average


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
