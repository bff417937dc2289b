"""GnssLogger by Google, whose logs the Smartphone Decimeter sets hold.

App: GnssLogger 2 and 3 (Android).
Files: `gnss_log_*.txt`: comments that name the fields of each kind of record, then records that begin with their kind.
Sensors: accel, gyro, mag.
Units: m/s², rad/s, µT.
Frame: of the phone.
Clock: `elapsedRealtimeNanos`, nanoseconds since the phone was started; `utcTimeMillis` says the time of day.
Traps: records without the calibration of the phone hold its bias in fields of their own, which is taken off;
`Raw`, `Fix` and other records say where satellites and the phone are, and are counted.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

import numpy as np

from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray
from pdrbench.io.container import open_container
from pdrbench.io.log import Log
from pdrbench.io.reader import Head, Reader
from pdrbench_formats.recordings.assemble import Origin, Tally, assemble
from pdrbench_formats.recordings.delimited import read_delimited
from pdrbench_formats.recordings.texts import text_of

_SENSORS: Final = {"Accel": "accel", "Gyro": "gyro", "Mag": "mag"}
_FIELDS: Final = re.compile(r"^#[ \t]*(\w+),(.*)$", re.M)
_RECORDS: Final = re.compile(rb"^#[ \t]*(?:Uncal)?(?:Accel|Gyro|Mag),utcTimeMillis,elapsedRealtimeNanos,", re.M)
_NUM_AXES: Final = 3


def read(path: Path | str, *, strict: bool = True) -> Log:
    """Reads one log.

    Raises:
        RecordingError: Names file and remedy.
    """
    path, tally = Path(path), Tally()
    text = text_of(open_container(path).read(path.name), path).content.decode()
    fields = {kind: names.split(",") for kind, names in _FIELDS.findall(text[:65_536])}
    records: dict[str, list[str]] = {}
    for line in text.splitlines():
        kind, _, rest = line.partition(",")
        if rest and kind[:1].isalpha():
            records.setdefault(kind, []).append(rest)
    streams: dict[str, FloatArray] = {}
    clock_s: list[float] = []
    for kind, rows in sorted(records.items()):  # what the phone has calibrated stands first
        sensor = _SENSORS.get(kind.removeprefix("Uncal"), "")
        names = fields.get(kind, [])
        if not sensor or sensor in streams or "elapsedRealtimeNanos" not in names:
            tally.skipped[kind] += len(rows)
            continue
        columns = read_delimited("\n".join(rows).encode(), path, names=names, separator=",")
        tally.dropped += columns.dropped
        table = columns.table(names)
        time, unix = names.index("elapsedRealtimeNanos"), names.index("utcTimeMillis")
        axes = table[:, time + 1 : time + 1 + _NUM_AXES]
        bias = table[:, time + 1 + _NUM_AXES : time + 1 + 2 * _NUM_AXES]
        if bias.shape == axes.shape:
            axes = axes - np.nan_to_num(bias)
        streams[sensor] = np.column_stack([table[:, time] * 1e-9, axes])
        clock_s += (table[:1, unix] * 1e-3 - table[:1, time] * 1e-9).tolist()
    if not streams:
        raise RecordingError(
            f"{path}: records of {', '.join(records) or 'no kind'} only; switch on the sensors in the app, or record "
            f"accelerometer and gyroscope with another one"
        )
    start = clock_s[0] if clock_s and np.isfinite(clock_s[0]) else None
    named = re.search(r"Manufacturer:\s*(\S+)\s+Model:\s*(.+)", text[:4096])
    origin = Origin(device=f"{named[1]} {named[2].strip()}" if named else "", start_unix_s=start)
    return assemble(path, streams, origin=origin, tally=tally, allow_unsorted=tuple(streams), strict=strict)


def sniff(head: Head) -> bool:
    """True for a log of this app."""
    return head.container is None and _RECORDS.search(head.content) is not None


READER: Final = Reader(read, sniff, options=("strict",))
