"""GetSensorData, the Android app of CSIC that every IPIN competition records with.

App: GetSensorData 1.x to 2.21 (Android); logs of IPIN 2016 to 2023.
Files: one `.txt` log, `%` comments, one record a line, fields parted by semicolons.
Sensors: accel, gyro, mag, rotation, baro, wifi, ble; landmarks as the reference, with level.
Units: m/s², rad/s, µT, hPa (mbar), dBm, degrees of latitude and longitude.
Frame: of Android; the reference is in metres about a place near the landmarks.
Clock: of the sensor, in seconds since the phone was switched on, moved to the clock of the app by the shortest delay of
a record; the clock of the app where the first is missing or runs otherwise.
Traps: a network name may hold semicolons, so that WiFi fields count from the right; before 2019 WiFi records have no
frequency and BLE4 records no address; empty lines; numbers with decimal commas; a separator at the end of a record or
none; records without time of the sensor; lists of landmarks elsewhere have the longitude first.
"""

from __future__ import annotations

import codecs
import contextlib
import math
import re
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Final

import numpy as np

from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray
from pdrbench.io.compressed import pieces
from pdrbench.io.geo import GeoFrame, frame_at
from pdrbench.io.log import Log
from pdrbench.io.reader import Head, Reader
from pdrbench.recording import MAX_WALK_S
from pdrbench.trajectory import Trajectory
from pdrbench_formats.recordings.assemble import Origin, Tally, assemble, places
from pdrbench_formats.recordings.opaque import opaque_ids

CHUNK_BYTES: Final = 2 << 20
MAX_TEXT_BYTES: Final = 16 << 30  # a day of a phone is 4 GB
MAX_LAG_S: Final = 2.0  # between the two clocks, beyond what a record usually takes from one to the other
MAX_AGE_S: Final = 3600.0
_MAX_STAMPS: Final = 20_000  # of a stream, that say how the two clocks lie
# numbers behind the type: time of the app, time of the sensor, then these; and where they begin among them
_KINDS: Final = {
    b"ACCE;": ("accel", 2, 3),
    b"GYRO;": ("gyro", 2, 3),
    b"MAGN;": ("mag", 2, 3),
    b"PRES;": ("baro", 2, 1),
    b"AHRS;": ("rotation", 5, 3),
}
_SKIPPED: Final = (b"LIGH;", b"SOUN;", b"GNSS;", b"PROX;", b"HUMI;", b"TEMP;", b"RFID;", b"IMUX;", b"IMUL;", b"BLUE;")
_RECORD: Final = re.compile(rb"^(ACCE|GYRO|MAGN|PRES|AHRS|WIFI|BLE4|POSI|GNSS|LIGH|SOUN|RFID|PROX);\s*-?\d", re.M)
_TYPE: Final = re.compile(rb"[A-Z][A-Z0-9]{3};")
# times of app and sensor, name of the network, address, frequency where it is given, strength
_WIFI: Final = re.compile(
    rb"^WIFI;(-?\d+(?:[.,]\d*)?);(-?\d+(?:[.,]\d*)?|);.*;\s*([0-9A-Fa-f]{2}(?:[:-][0-9A-Fa-f]{2}){5})\s*;"
    rb"(?:(\d+);)?\s*(-?\d+)[; ]*$",
    re.M,
)
_NUMBER: Final = re.compile(rb"[+-]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][+-]?\d+)?")
_DATE: Final = re.compile(r"creation:\s*\w{3} (\w{3} +\d+ \d\d:\d\d:\d\d) (?:GMT|UTC)?([+-]\d\d:\d\d) ?(\d{4})")


@dataclass(slots=True)
class _Parts:
    """What has been read so far: rows (T, 1 + C) by sensor, with the time of the app; the times of the sensor (T,);
    WiFi records as times of app and sensor, frequency, strength and address; other records that are not of numbers
    alone; and how many lines are no whole records, and the first."""

    rows: dict[str, list[FloatArray]] = field(default_factory=lambda: defaultdict(list))
    stamps: dict[str, list[FloatArray]] = field(default_factory=lambda: defaultdict(list))
    wifi: list[tuple[float, float, float, float, bytes]] = field(default_factory=list)
    ble: list[tuple[float, bytes, float, float]] = field(default_factory=list)
    places: list[tuple[float, float, float, float]] = field(default_factory=list)
    header: list[str] = field(default_factory=list)
    num_damaged: int = 0
    damaged: tuple[int, bytes] = (0, b"")

    def lose(self, line: int, record: bytes) -> None:
        """Counts a line that is cut off or no record, and keeps the first."""
        if not self.num_damaged or line < self.damaged[0]:
            self.damaged = line, record[:60]
        self.num_damaged += 1


def read(path: Path | str, *, strict: bool = True) -> Log:
    """Reads one log, a few megabytes at a time.

    Args:
        path: Of the log.
        strict: As in `pdrbench_formats.recordings.assemble.assemble`.

    Raises:
        RecordingError: Names file, line and remedy.
    """
    path = Path(path)
    tally, parts = Tally(), _Parts()
    line = 1
    num_records = 0
    for chunk, is_last in _chunks(path):
        num_lines, found = _read_chunk(path, chunk, line, parts, tally, is_last=is_last)
        num_records += found
        line += num_lines
        span_s = max((tables[-1][-1, 0] - tables[0][0, 0] for tables in parts.rows.values()), default=0.0)
        if span_s > MAX_WALK_S:  # before memory is spent on the rest
            raise RecordingError(
                f"{path}: line {line}: {span_s / 3600:.0f} h after the first record, expected a walk of at most "
                f"{MAX_WALK_S / 3600:.0f}; split the log into walks"
            )
    if not num_records:
        raise RecordingError(f"{path}: no record of GetSensorData among {line - 1} lines; is it another app's log?")
    offset_s = _offsets(parts, tally)
    streams = {}
    for name, *_ in _KINDS.values():
        if tables := parts.rows.pop(name, None):
            streams[name] = _stream(name, tables, parts.stamps.pop(name), offset_s.get(name), tally)
    streams["wifi"] = _wifi(parts.wifi, offset_s.get(""))
    streams["ble"] = _ble(parts.ble)
    if parts.num_damaged:
        first, record = parts.damaged
        seen = f"{record.decode(errors='replace')!r} is no whole record, nor are {parts.num_damaged - 1} other lines"
        tally.found("damaged-lines", f"{path.name}, line {first}", seen)
    if lost := tally.dropped["POSI cannot be read"]:
        tally.found("reference, landmarks", "POSI", f"{lost} landmarks hold no latitude and longitude in degrees")
    reference, geo = _reference(parts.places, tally)
    return assemble(
        path,
        {name: table for name, table in streams.items() if len(table)},
        reference=reference,
        origin=Origin(device=_device(parts.header), start_unix_s=_created(parts.header), geo=geo),
        tally=tally,
        allow_unsorted=tuple(streams),
        strict=strict,
    )


def _chunks(path: Path) -> Iterator[tuple[bytes, bool]]:
    """Whole lines of a plain or compressed file, some megabytes at a time, and whether they are the last."""
    pending, total = b"", 0
    try:
        with path.open("rb") as file:
            for piece in pieces(file, path, CHUNK_BYTES):
                piece = piece if total else piece.removeprefix(codecs.BOM_UTF8)
                total += len(piece)
                if total > MAX_TEXT_BYTES:
                    raise RecordingError(f"{path}: more than {MAX_TEXT_BYTES >> 30} GiB; split the log into walks")
                cut = piece.rfind(b"\n") + 1
                if cut:
                    yield pending + piece[:cut], False
                    pending = b""
                pending += piece[cut:]
                if len(pending) > CHUNK_BYTES:
                    longest = f"a line is longer than {CHUNK_BYTES >> 20} MiB"
                    raise RecordingError(f"{path}: {longest}; check whether it is a log")
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise RecordingError(f"{path}: cannot be read: {reason}; check the path and its permissions") from error
    yield pending, True


def _read_chunk(path: Path, chunk: bytes, line: int, parts: _Parts, tally: Tally, *, is_last: bool) -> tuple[int, int]:
    """Adds the records of some lines; returns how many lines and how many records of sensors there were."""
    found = 0
    kinds: dict[bytes, list[bytes]] = {start: [] for start in (*_KINDS, *_SKIPPED)}
    add = {start: records.append for start, records in kinds.items()}
    lines = chunk.split(b"\n")
    for number, record in enumerate(lines, line):
        if append := add.get(record[:5]):
            append(record)
        elif whole := record.rstrip(b"\r "):
            found += _read_other(whole, number, parts, tally)
    for start, records in kinds.items():
        found += len(records)
        if records and start in _SKIPPED:
            tally.skipped[start[:4].decode()] += len(records)
        elif records:
            name, first, width = _KINDS[start]
            table = _table(records, first, width, tally)
            if table is None:
                at = (place for place in enumerate(lines, line) if place[1].startswith(start))
                read = (_read_numbers(path, record, number, parts, tally, is_cut=is_last) for number, record in at)
                table = np.array([values for values in read if values is not None]).reshape(-1, width + 2)
            if len(table):
                parts.rows[name].append(table[:, 1:])
                parts.stamps[name].append(table[:, 0])
    return len(lines) - (not lines[-1]), found


def _table(records: list[bytes], first: int, width: int, tally: Tally) -> FloatArray | None:
    """(n, 2 + width) what `_read_numbers` returns of records of one kind; None where anything in them is odd."""
    columns = (2, 1, *range(first + 1, first + width + 1))
    commas = sum(record.count(b",") for record in records) if b"," in records[0] else 0
    lines = [record.replace(b",", b".") for record in records] if commas else records
    with contextlib.suppress(ValueError):
        table = np.loadtxt(lines, delimiter=";", comments=None, usecols=columns, encoding="latin1", ndmin=2)
        if len(table) == len(records) and np.isfinite(table).all():
            tally.mended.update({"decimal commas": commas} if commas else {})
            return table
    return None


def _read_numbers(
    path: Path, record: bytes, line: int, parts: _Parts, tally: Tally, *, is_cut: bool
) -> list[float] | None:
    """Reads a record of numbers; in some they follow the time of the app at once.

    Returns:
        Time of the sensor, NaN where there is none, time of the app, and the numbers; None of one that is left out.
    """
    name, first, width = _KINDS[record[:5]]
    fields = record.rstrip(b"\r; ").split(b";")[1:]
    is_whole = len(fields) >= first + width
    if not is_whole:  # without the time of the sensor
        fields = [*fields[:1], b"", *fields[1:]]
    if len(fields) < first + width:
        tally.dropped[f"{name} lacks fields"] += 1
        parts.lose(line, record)
        return None
    wanted = (fields[1], fields[0], *fields[first : first + width])
    try:
        values = [_number(text) for text in wanted]
    except ValueError:
        if is_whole and not is_cut:
            raise RecordingError(
                f"{path}: line {line}: {record[:80].decode(errors='replace')!r} holds a field that is no number; "
                f"delete the line or export it again"
            ) from None
        tally.dropped["last line cut" if is_whole else f"{name} cannot be read"] += 1
        parts.lose(line, record)
        return None
    if commas := sum(b"," in text for text in wanted):
        tally.mended["decimal commas"] += commas
    return values


def _read_other(record: bytes, line: int, parts: _Parts, tally: Tally) -> int:
    """Adds a record of radio or a landmark; counts any other. Returns 1 for a record of this app."""
    if record.startswith(b"%"):
        if len(parts.header) < 1000:
            parts.header.append(record.decode("utf-8", "replace"))
        return 0
    name = record[:4]
    try:
        if name == b"WIFI" and record[4:5] == b";":
            parts.wifi.append(_parse_wifi(record))
        elif name == b"BLE4":
            parts.ble.append(_parse_ble(record))
        elif name == b"POSI":
            parts.places.append(_parse_place(record))
        else:
            what = record.partition(b";")[0][:16].decode("utf-8", "replace")
            if not _TYPE.match(record):
                parts.lose(line, record)
            elif len(tally.skipped) < 100:
                tally.skipped[what] += 1
            return int(_RECORD.match(record) is not None)
    except (ValueError, IndexError):
        tally.dropped[f"{name.decode()} cannot be read"] += 1
        if name != b"POSI":  # which has a finding of its own
            parts.lose(line, record)
    return 1


def _float(text: bytes) -> float:
    return float(text.replace(b",", b"."))


def _number(text: bytes) -> float:
    """A number in digits; NaN where the field is empty or says so."""
    text = text.strip()
    if not text or text.lower() == b"nan":
        return math.nan
    if not _NUMBER.fullmatch(text):
        raise ValueError(text)
    return _float(text)


def _parse_wifi(record: bytes) -> tuple[float, float, float, float, bytes]:
    """Times of app and sensor (NaN where it is not given), frequency (0 where it is not given), strength, address."""
    match = _WIFI.match(record)
    if match is None:
        raise ValueError("no address and strength")
    app_s, sensor_s, address, frequency, strength = match.groups(b"")
    return _float(app_s), _float(sensor_s or b"nan"), _float(frequency or b"0"), _float(strength), address


def _parse_ble(record: bytes) -> tuple[float, bytes, float, float]:
    """Time of the app, identity, strength, power at 1 m (0 where it is not given)."""
    fields = record.rstrip(b"; ").split(b";")
    if len(fields) < 4:
        raise ValueError("no strength")
    if fields[2].strip().lower() in (b"ibeacon", b"eddystone"):
        is_beacon = fields[2].strip().lower() == b"ibeacon"
        power = _float(fields[5]) if is_beacon and len(fields) >= 9 else 0.0
        return _float(fields[1]), fields[3].strip(), _float(fields[4]), power
    return _float(fields[1]), b":".join(fields[2:-1]), _float(fields[-1]), 0.0


def _parse_place(record: bytes) -> tuple[float, float, float, float]:
    """Time of the app, latitude, longitude, level."""
    fields = record.rstrip(b"; ").split(b";")
    lat_deg, lon_deg = _float(fields[3]), _float(fields[4])
    if not (abs(lat_deg) < 90.0 and abs(lon_deg) <= 360.0):
        raise ValueError("no place in degrees")
    return _float(fields[1]), lat_deg, lon_deg, _float(fields[5]) if len(fields) > 5 else 0.0


def _offsets(parts: _Parts, tally: Tally) -> dict[str, float]:
    """Time of the app minus time of the sensor by stream, at the least delay; under "" that of most streams.

    The twentieth quantile is taken, which a few records out of place do not move. Streams that agree to a tenth of a
    second share one offset, so that the times between their rows stay as the phone measured them.
    """
    found: dict[str, float] = {}
    weights: dict[str, int] = {}
    for name, tables in parts.rows.items():
        every = sum(len(table) for table in tables) // _MAX_STAMPS + 1
        app_s = np.concatenate([table[::every, 0] for table in tables])
        sensor_s = np.concatenate([stamps[::every] for stamps in parts.stamps[name]])
        both = np.isfinite(app_s) & np.isfinite(sensor_s)
        app_s, sensor_s = app_s[both], sensor_s[both]
        if len(app_s) < 2:
            continue
        lag_s = app_s - sensor_s
        low = float(np.quantile(lag_s, 0.05))
        if float(np.quantile(lag_s, 0.99)) - low > MAX_LAG_S or (np.diff(sensor_s) < -MAX_LAG_S).any():
            tally.found("sensor-clock", name, "the clock of the sensor does not run as that of the app")
            continue
        found[name], weights[name] = low, len(app_s) * every
    if found:
        common = found[max(weights, key=lambda name: weights[name])]
        found = {name: common if abs(low - common) < 0.1 else low for name, low in found.items()}
        found[""] = common
    return found


def _stream(
    name: str, tables: list[FloatArray], stamps: list[FloatArray], offset_s: float | None, tally: Tally
) -> FloatArray:
    """Rows (T, 1 + C) of a stream from tables with the time of the app, which are given up, and times of the sensor."""
    rows = np.concatenate(tables)
    tables.clear()
    if offset_s is not None:
        moved_s = np.concatenate(stamps) + offset_s
        off_s = rows[:, 0] - moved_s
        if not (off_s.max() <= MAX_LAG_S and off_s.min() >= -MAX_LAG_S):  # NaN where there is no time of the sensor
            late = ~(np.abs(moved_s - rows[:, 0]) <= MAX_LAG_S)
            tally.mended[f"{name} by the clock of the app"] += int(late.sum())
            moved_s = np.where(late, rows[:, 0], moved_s)
        rows[:, 0] = moved_s
    if name != "rotation":
        return rows
    square = rows[:, 1] ** 2 + rows[:, 2] ** 2 + rows[:, 3] ** 2  # one after the other: einsum adds otherwise
    q = np.column_stack([rows[:, 0], np.sqrt(np.maximum(0.0, 1.0 - square)), rows[:, 1:]])
    long = np.flatnonzero(square > 1.0)
    q[long, 1:] /= np.sqrt(square[long])[:, None]
    wrong = square > 1.01
    if wrong.any():
        tally.dropped["rotation is longer than 1"] += int(wrong.sum())
        q = q[~wrong]
    return q


def _wifi(records: list[tuple[float, float, float, float, bytes]], offset_s: float | None) -> FloatArray:
    """(T, 5) rows of the `wifi` stream, in the order of their lines."""
    if not records:
        return np.zeros((0, 5))
    t_s, seen_s, frequency, rssi = np.array([record[:4] for record in records]).T
    known = opaque_ids("wifi", [record[4] for record in records])
    age_s = np.zeros(len(t_s))
    if offset_s is not None:
        age_s = t_s - (seen_s + offset_s)
        age_s = np.where((age_s >= 0.0) & (age_s <= MAX_AGE_S), age_s, 0.0)  # another clock, or a fresh sighting
    return np.column_stack([t_s, known, rssi, frequency, age_s])


def _ble(records: list[tuple[float, bytes, float, float]]) -> FloatArray:
    if not records:
        return np.zeros((0, 4))
    t_s, identity, rssi, power = zip(*records, strict=True)
    return np.column_stack([t_s, opaque_ids("ble", identity), rssi, power])


def _reference(
    rows: list[tuple[float, float, float, float]], tally: Tally
) -> tuple[Trajectory | None, GeoFrame | None]:
    if not rows:
        return None, None
    t_s, lat, lon, level = (np.array(column) for column in zip(*rows, strict=True))
    geo = frame_at(lat, lon)
    return places(t_s, geo.to_local(lat, lon), np.round(level).astype(np.int64), tally=tally), geo


def _device(header: list[str]) -> str:
    facts = [line.split(":", 1)[1].strip() for key in ("Manufacturer", "Model") for line in header if f"{key}:" in line]
    return " ".join(facts[:2])


def _created(header: list[str]) -> float | None:
    """Unix time of the first comment that states when the file was made, where it names its offset from UTC."""
    for line in header:
        if match := _DATE.search(line):
            with contextlib.suppress(ValueError, OverflowError):  # no such day
                return datetime.strptime(" ".join(match.groups()), "%b %d %H:%M:%S %z %Y").timestamp()
    return None


def sniff(head: Head) -> bool:
    """True for a log of this app."""
    return head.container is None and _RECORD.search(head.content) is not None


READER: Final = Reader(read, sniff, options=("strict",))
