"""Recordings with places, made ready: begun where they are known to begin; and radio surveys, of them and of tables."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray, IntArray
from pdrbench.io.geo import GeoFrame
from pdrbench.radio.surveys import survey_of_readings
from pdrbench.recording import RadioMap, Recording, SensorStream
from pdrbench_formats.recordings.delimited import DelimitedTable
from pdrbench_formats.recordings.opaque import opaque_id
from pdrbench_formats.recordings.texts import text_of
from pdrbench_formats.taskfile import places
from pdrbench_formats.taskfile.places import SENDER, STRENGTH, finite

SURVEY_EXAMPLE: Final = f"x_m,y_m,level,{SENDER},{STRENGTH}"
MIN_DBM: Final = -127.0  # of the sensor `wifi`
MAX_NUMBER: Final = 2**53  # exact as a float
MAX_HEADER_BYTES: Final = 65_536  # UJIIndoorLoc names 520 access points
_NOT_RECEIVED: Final = (100.0, 0.0)  # of UJIIndoorLoc; of tables that leave it blank in their own way
_MAX_ABSENT_DBM: Final = -95.0  # a value below it that fills half of a table, or lies apart, stands for none
_APART_DB: Final = 5.0


@dataclasses.dataclass(frozen=True, slots=True)
class Scans:
    """Scans at places.

    Attributes:
        xy_m: (S, 2).
        level: (S,).
        walk: (S,), increasing from 0; scans with one number depend on each other.
        count: (S,) readings of each scan.
        readings: (R, 3) access point, RSSI in dBm, age in s.
    """

    xy_m: FloatArray
    level: IntArray
    walk: IntArray
    count: IntArray
    readings: FloatArray


def begun_at(recording: Recording, begin_s: float) -> Recording:
    """A recording from a time on, which becomes 0; sensors that delivered nothing later are left out."""
    streams = {}
    for name, stream in recording.streams.items():
        later = stream.rows[stream.t_s >= begin_s]
        if len(later):
            streams[name] = SensorStream(stream.spec, later - np.eye(1, later.shape[1]) * begin_s)
    places = recording.reference.rows(recording.reference.t_s >= begin_s)
    return dataclasses.replace(
        recording, streams=streams, reference=dataclasses.replace(places, t_s=places.t_s - begin_s)
    )


def begun_at_first_place(recording: Recording) -> Recording:
    """A recording from its first place on, which is given to localizers and does not count as surveyed."""
    begun = begun_at(recording, float(recording.reference.t_s[0]))
    surveyed = begun.reference.surveyed & (np.arange(len(begun.reference)) > 0)
    return dataclasses.replace(begun, reference=dataclasses.replace(begun.reference, surveyed=surveyed))


def radio_map_of(recordings: Sequence[Recording]) -> RadioMap | None:
    """The WiFi scans of recordings, at places interpolated between theirs; None where there is no scan."""
    return joined([scans_of_recording(recording) for recording in recordings], surveyed=False)


def joined(parts: Sequence[Scans], *, surveyed: bool) -> RadioMap | None:
    """Scans of tables and recordings as one radio map; None where there is none.

    Args:
        parts: Of each table and recording.
        surveyed: Whether all places were surveyed.
    """
    parts = [part for part in parts if len(part.level)]
    if not parts:
        return None
    first_walk = np.cumsum([0, *(int(part.walk[-1]) + 1 for part in parts[:-1])])
    return survey_of_readings(
        np.vstack([part.xy_m for part in parts]),
        np.concatenate([part.level for part in parts]),
        np.concatenate([part.walk + first for part, first in zip(parts, first_walk, strict=True)]),
        np.concatenate([part.count for part in parts]),
        np.vstack([part.readings for part in parts]),
        surveyed=surveyed,
    )


def scans_of_recording(recording: Recording) -> Scans:
    """The WiFi scans of a recording between its first and its last place, at places interpolated between these."""
    way = recording.reference
    rows = recording.streams["wifi"].rows if "wifi" in recording.streams and len(way) else np.zeros((0, 5))
    if len(rows):
        rows = rows[(rows[:, 0] >= way.t_s[0]) & (rows[:, 0] <= way.t_s[-1])]
    scan_s, count = np.unique(rows[:, 0], return_counts=True)
    xy_m = np.zeros((0, 2))
    if len(scan_s):
        xy_m = np.column_stack([np.interp(scan_s, way.t_s, way.xy_m[:, axis]) for axis in (0, 1)])
    level = way.level[np.searchsorted(way.t_s, scan_s, side="right") - 1]
    return Scans(xy_m, level, np.zeros(len(level), dtype=np.int64), count, rows[:, [1, 2, 4]])


def is_survey_table(path: Path) -> bool:
    """True for a text whose header names an access point or its strength, or places and no time."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        content = file.read(MAX_HEADER_BYTES)
    try:
        names = places.table_names(text_of(content, path).content)
    except RecordingError:  # empty, or no text
        return False
    has_places = bool(places.place_columns(names)) and (not names & set(places.CLOCKS) or bool(places.senders(names)))
    return bool(names & {SENDER, STRENGTH}) or has_places


def _by_reading(table: DelimitedTable) -> DelimitedTable:
    """A table with a row for each scan as one with a row for each reading; any other as it is."""
    named = places.senders(table.columns)
    if not named or SENDER in table.columns:
        return table
    rssi_dbm = table.table(named)
    values, counts = np.unique(rssi_dbm[np.isfinite(rssi_dbm)], return_counts=True)
    is_apart = (counts > 1) & (np.diff(values, append=0.0) >= _APART_DB)
    is_absent = (values < MIN_DBM) | (values < _MAX_ABSENT_DBM) & ((counts >= counts.sum() / 2) | is_apart)
    scan, of = np.nonzero(np.isfinite(rssi_dbm) & ~np.isin(rssi_dbm, [*_NOT_RECEIVED, *values[is_absent]]))
    columns = {name: values[scan] for name, values in table.columns.items() if name not in named}
    readings = {SENDER: np.array(named, dtype=object)[of], STRENGTH: rssi_dbm[scan, of], "scan": scan}
    return dataclasses.replace(table, columns={**columns, **readings})


def read_survey_table(path: Path) -> tuple[Scans, GeoFrame | None]:
    """A radio survey from a table with a line for each reading: `x_m,y_m,level,access_point,rssi_dbm`.

    Or with a line for each scan, whose columns are access points, as UJIIndoorLoc has it; also as the Anyplace Logger
    writes it.

    An access point is an address as recordings have it, or the number that stands for it. Lines that follow each other
    with the same place, and the same number in the column `scan` where there is one, are a scan; so an access point
    that comes twice begins a new one. `age_s` says how long before its scan a reading was taken, 0 without. Scans at
    one place depend on each other.

    Returns:
        The scans, at metres of the plan or of the frame that comes with them.

    Raises:
        RecordingError: Names file, line and remedy.
    """
    table = _by_reading(places.read_table(path, SURVEY_EXAMPLE))
    if not places.place_columns(table.columns) or not {SENDER, STRENGTH} <= set(table.columns):
        raise RecordingError(
            f"{path}: line 1: columns {', '.join(table.columns)[:200]}; a table of a survey has {SURVEY_EXAMPLE}, "
            f"with lat_deg,lon_deg for degrees"
        )
    xy_m, level, geo = places.places_in(table)
    rssi_dbm, age_s, scan = finite(table, STRENGTH), finite(table, "age_s", 0.0), finite(table, "scan", 0.0)
    wrong = np.flatnonzero(~((rssi_dbm >= MIN_DBM) & (rssi_dbm <= 0.0) & (age_s >= 0.0)))
    if len(wrong):
        row = int(wrong[0])
        raise table.error(
            row,
            f"{STRENGTH} {rssi_dbm[row]:g} and age_s {age_s[row]:g}; {MIN_DBM:g} to 0 dBm and 0 s or more are "
            f"expected: leave out what was not received",
        )
    texts = table.texts(SENDER)  # the number of an access point, or an address, for which another stands
    known = (int(t) if t.isdecimal() and int(t) < MAX_NUMBER else opaque_id("wifi", t) for t in texts)
    sender = np.fromiter(known, dtype=np.int64)
    place = np.column_stack([xy_m, level])
    begins = np.append(True, (place[1:] != place[:-1]).any(axis=1) | (scan[1:] != scan[:-1]))
    received: set[int] = set()
    for row, number in enumerate(sender.tolist()):
        if begins[row] or number in received:
            begins[row], received = True, set()
        received.add(number)
    first = np.flatnonzero(begins)
    _, earliest, walk = np.unique(place[first], axis=0, return_index=True, return_inverse=True)
    walk = np.argsort(np.argsort(earliest))[walk.reshape(-1)]  # numbered as they come
    order = np.argsort(walk, kind="stable")
    count = np.diff(np.append(first, len(level)))
    rows = np.concatenate([np.arange(first[k], first[k] + count[k]) for k in order])
    readings = np.column_stack([sender, rssi_dbm, age_s])[rows]
    return Scans(xy_m[first][order], level[first][order], walk[order], count[order], readings), geo


def write_survey_table(scans: Scans, path: Path) -> None:
    """Writes scans so that `read_survey_table` gives them back."""
    lines = [f"x_m,y_m,level,scan,{SENDER},{STRENGTH},age_s"]
    scan = np.repeat(np.arange(len(scans.level)), scans.count)
    for number, (sender, rssi_dbm, age_s) in zip(scan.tolist(), scans.readings.tolist(), strict=True):
        x_m, y_m = scans.xy_m[number].tolist()
        place = f"{x_m!r},{y_m!r},{scans.level[number]},{number}"
        lines.append(f"{place},{int(sender)},{rssi_dbm!r},{age_s!r}")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")
