"""Walks of the Indoor Location Competition 2.0: tab-separated text, `.txt` or `.txt.gz`.

One record a line, `unix_ms TYPE values...`, after a header of lines that begin with `#`. Rules of this reader:

* Fields are split at tabs only: a network may have no name, and a name may hold blanks. A name that holds tabs costs
  nothing, since the fields after it are counted from the right.
* The file is written as sensors answer, not in order of time: each stream is sorted by time, equal times stay as
  they are. A record that is more than a minute older than the one before it of its kind, or ten minutes without any
  record, is a clock that was set during the walk and refused.
* A file whose times begin with 0 counts milliseconds of the walk. The last column of a beacon row is on the clock of
  the phone: less the time of its row it is one constant of the file, which gives its start; without beacons the header
  does. Sightings of networks are on either clock.
* Time 0 is the first row of any stream or waypoint that is kept.
* Two records glued together, where a line feed was lost, are split and counted.
* Sensor rows end in an accuracy (0-3) which is not kept; older files lack it.
* The rotation vector holds three components, qw = sqrt(max(0, 1 - |q|^2)). Android's world (x east, y magnetic
  north, z up) is the building frame, since the maps have y to the north; no declination is added.
* A WiFi row is delivered at its own time, and `age_s` is how long before the access point was last heard. The phone
  repeats old sightings. One that lies up to a second ahead of its row has age 0 and is counted as mended; one
  further ahead is dropped and counted, and where that befalls more than one row in a hundred, the file is refused.
* Of an access point that stands twice in a scan (rows of one time), the freshest sighting is kept, then the strongest.
* Names of networks and of Bluetooth devices are never looked at. An access point becomes a number made from its
  BSSID, a beacon one made from its UUID, major, minor and address: in these malls many beacons share the first three.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from pdrbench.errors import MapError, RecordingError
from pdrbench.geometry import FloatArray, IntArray, read_only
from pdrbench.io.log import Log, ReadReport
from pdrbench.io.reader import Reader
from pdrbench.io.text import Text, read_text
from pdrbench.trajectory import Trajectory
from pdrbench_formats.recordings.opaque import opaque_ids
from pdrbench_sim.readers.ilc20_lines import TYPE_AT, Lines, as_float, index_lines, split_glued
from pdrbench_sim.readers.ilc20_map import level_of_floor

MAX_FUTURE_S: Final = 1.0  # a sighting may lie this far ahead of its row; none of 585 984 rows does
MAX_FUTURE_FRACTION: Final = 0.01
MAX_AGE_S: Final = 3600.0  # the oldest of the public set is 145 s
MAX_BACK_S: Final = 60.0  # within a kind no record of the public set goes back at all
MAX_PAUSE_S: Final = 600.0  # the longest time without a WiFi row in the public set is 22 s
_MIN_ROWS_TO_JUDGE: Final = 10  # a median over fewer rows says nothing on units


@dataclass(frozen=True, slots=True)
class _Kind:
    """One type of record that is kept.

    Attributes:
        type: Second field of its lines.
        stream: Sensor name, or "reference".
        fields, max_fields: Least and usual largest number of fields in a line, time and type included.
        columns: Index of the field of each number; counted from the right where negative.
        low, high: Bounds of these numbers; what lies outside is another unit or damage.
    """

    type: bytes
    stream: str
    fields: int
    max_fields: int
    columns: tuple[int, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]


def _axes(limit: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
    return (-limit,) * 3, (limit,) * 3


_XYZ = (2, 3, 4)
_MS = (1e12, 1e13)  # thirteen digits
_DBM = (-128.0, 127.0)  # one signed byte
_KINDS: Final = {
    kind.type: kind
    for kind in (
        _Kind(b"TYPE_ACCELEROMETER", "accel", 5, 6, _XYZ, *_axes(490.0)),
        _Kind(b"TYPE_GYROSCOPE", "gyro", 5, 6, _XYZ, *_axes(69.0)),
        _Kind(b"TYPE_MAGNETIC_FIELD", "mag", 5, 6, _XYZ, *_axes(5000.0)),
        _Kind(b"TYPE_ROTATION_VECTOR", "rotation", 5, 6, _XYZ, *_axes(1.001)),
        _Kind(b"TYPE_WIFI", "wifi", 7, 7, (-3, -2, -1), (_DBM[0], 0.0, -1e3 * MAX_AGE_S), (_DBM[1], 1e5, _MS[1])),
        _Kind(b"TYPE_BEACON", "ble", 9, 10, (6, 5), (_DBM[0],) * 2, (_DBM[1],) * 2),
        _Kind(b"TYPE_WAYPOINT", "reference", 4, 4, (2, 3), (-1e5,) * 2, (1e5,) * 2),
    )
}
_BEACON, _BEACON_FIELDS = b"TYPE_BEACON", 10
_SAMPLED: Final = ("accel", "gyro", "mag", "rotation")
# Written by the app and of no use here; listed, with their fields, so that counting them is cheap.
_SKIPPED: Final = {
    b"TYPE_ACCELEROMETER_UNCALIBRATED": 9,
    b"TYPE_GYROSCOPE_UNCALIBRATED": 9,
    b"TYPE_MAGNETIC_FIELD_UNCALIBRATED": 9,
    b"TYPE_BLUE": 5,
    b"TYPE_BLU4": 5,
}
_MAX_FIELDS: Final = {name: kind.max_fields for name, kind in _KINDS.items()} | _SKIPPED
_RECORD: Final = re.compile(rb"^(\d{1,13}\tTYPE_|#\s*startTime:)", re.MULTILINE)
_PREFIX, _NUM_INITIALS = 5, 4  # behind TYPE_, four letters distinguish nearly all types and fit into a uint32
# Median of the vector's length while a person walks, and what a median outside means.
_USUAL_NORM: Final = {
    "accel": (5.0, 20.0, "m/s^2 with gravity", "g, or gravity was taken out"),
    "gyro": (0.0, 8.0, "rad/s", "degree/s"),
    "mag": (5.0, 500.0, "microtesla", "gauss, millitesla or nanotesla"),
}


def read(path: Path | str, *, floor: str | None = None) -> Log:
    """Reads one walk.

    Args:
        path: `.txt` or `.txt.gz`; distinguished by content.
        floor: Name of the floor, "F1"; where it is None the one in the header, else the folder of the file, as in the
            Kaggle form of the set.
    """
    path = Path(path)
    return read_content(read_text(path), path, floor=floor)


def read_content(text: Text, path: Path, *, floor: str | None = None) -> Log:
    """The same for a text that has been read, as from an archive; `path` is named in errors."""
    lines = index_lines(text.content, path)
    groups = _group(lines)
    if groups.may_be_glued:
        lines = split_glued(lines)
        groups = _group(lines)
    return _make_log(lines, groups, floor, text.mended)


@dataclass(frozen=True, slots=True)
class _Account:
    """Counts by reason while a file is read."""

    dropped: Counter[str]
    mended: Counter[str]


def _make_log(lines: Lines, groups: _Groups, floor: str | None, mended: Mapping[str, int]) -> Log:
    account = _Account(Counter(), Counter(mended))
    account.mended["records glued into one line"] = len(lines.glued)
    header = _read_header(lines)
    streams = {
        kind.stream: _READ[kind.stream](lines, kind, line, numbers, account)
        for (kind, line), numbers in zip(groups.kinds.items(), _numbers(lines, groups.kinds), strict=True)
    }
    if not streams:
        raise RecordingError(
            f"{lines.path}: no row of any sensor and no waypoint among {len(lines.start)} lines; is it an ILC20 walk?"
        )
    _check_pauses(lines.path, streams)
    first_ms = min(rows[0, 0] for rows in streams.values())
    begin_ms: float | None = 0.0
    if lines.counts_from_zero:
        stated_ms = as_float(header.get("startTime", "").encode())
        begin_ms = _begin_ms(lines) or (stated_ms if _MS[0] <= stated_ms <= _MS[1] else None)
    for rows in streams.values():
        rows[:, 0] = (rows[:, 0] - first_ms) / 1000
    _check_units(lines.path, streams)
    report = _report(streams, groups.skipped, account)
    waypoints = streams.pop("reference", np.zeros((0, 3)))
    return Log(
        rows={name: read_only(rows) for name, rows in streams.items()},
        reference=_reference(waypoints, floor or header.get("FloorName") or lines.path.parent.name, lines.path),
        device=f"{header.get('Brand', '')} {header.get('Model', '')}".strip(),
        report=report,
        start_unix_s=None if begin_ms is None else float(begin_ms + first_ms) / 1000,
    )


def _begin_ms(lines: Lines) -> float | None:
    """When time 0 of a file was that counts from 0, by the clock in its beacon rows; None where it has none."""
    record = np.flatnonzero(lines.is_record)
    beacon = record[lines.equal(lines.start[record] + TYPE_AT, _BEACON)]
    beacon = beacon[lines.num_fields(beacon) >= _BEACON_FIELDS]
    if not len(beacon):
        return None
    clock_ms = lines.numbers(*lines.field(beacon, _BEACON_FIELDS - 1))
    begin_ms = (clock_ms - lines.time_ms(beacon))[(clock_ms >= _MS[0]) & (clock_ms <= _MS[1])]
    return float(np.median(begin_ms)) if len(begin_ms) else None


def _read_header(lines: Lines) -> dict[str, str]:
    """The facts in lines that begin with #: key and value are parted by a colon, facts by tabs."""
    heading = np.flatnonzero(~lines.is_record & (lines.end > lines.start))
    facts: dict[str, str] = {}
    for line in lines.slices(lines.start[heading], lines.end[heading]):
        for fact in line.decode().split("\t")[1:]:
            key, _, value = fact.partition(":")
            facts.setdefault(key, value.strip())
    return facts


@dataclass(frozen=True, slots=True)
class _Groups:
    """Lines by type.

    Attributes:
        kinds: Lines of each kind that is kept.
        skipped: Number of lines of each type that is not.
        may_be_glued: True where a line has more fields than its type has, so that another may begin inside it.
    """

    kinds: Mapping[_Kind, IntArray]
    skipped: Mapping[str, int]
    may_be_glued: bool


def _group(lines: Lines) -> _Groups:
    record = np.flatnonzero(lines.is_record)
    begin = lines.start[record] + TYPE_AT
    initials = lines.words(begin + _PREFIX, _NUM_INITIALS).view(np.uint32)
    _, finish = lines.field(record, 1)
    num_fields = lines.num_fields(record)
    key = initials.astype(np.int64) << 32 | finish - begin
    is_known = np.zeros(len(record), dtype=np.bool_)
    kinds: dict[_Kind, IntArray] = {}
    skipped: Counter[str] = Counter()
    may_be_glued = False
    for name, max_fields in _MAX_FIELDS.items():
        of_type = np.flatnonzero(key == _key_of(name))
        of_type = of_type[lines.equal(begin[of_type], name)]
        if not len(of_type):
            continue
        is_known[of_type] = True
        line = record[of_type]
        may_be_glued |= bool(num_fields[of_type].max() > max_fields)
        if name in _KINDS:
            kinds[_KINDS[name]] = line
        else:
            skipped[name.decode()] = len(line)
    others = lines.slices(begin[~is_known], lines.end[record[~is_known]])
    skipped.update(text.partition(b"\t")[0].decode() for text in others)
    heading = np.flatnonzero(~lines.is_record)
    unsure = others + lines.slices(lines.start[heading], lines.end[heading])
    may_be_glued |= any(b"\tTYPE_" in text or b"#\t" in text[1:] for text in unsure)
    return _Groups(kinds, skipped, may_be_glued)


def _key_of(name: bytes) -> int:
    """Four letters behind TYPE_ and the length: together they distinguish nearly all types."""
    return int(np.frombuffer(name, np.uint32, count=1, offset=_PREFIX)[0]) << 32 | len(name)


def _check_fields(lines: Lines, kind: _Kind, line: IntArray) -> None:
    """Refuses a line with fewer fields than its kind has."""
    num_fields = lines.num_fields(line)
    if num_fields.min() < kind.fields:
        short = int(np.argmax(num_fields < kind.fields))
        raise lines.error(
            int(line[short]),
            f"{kind.type.decode()} has {num_fields[short]} fields, expected {kind.fields} or more; "
            f"the line is cut: delete it or copy the file again",
        )


def _numbers(lines: Lines, kinds: Mapping[_Kind, IntArray]) -> list[FloatArray]:
    """(L, C) the numbers of each line of each kind, within the bounds of the kind, as they stand in the file."""
    fields: list[tuple[IntArray, IntArray]] = []
    for kind, line in kinds.items():
        _check_fields(lines, kind, line)
        fields += [lines.field(line, column) for column in kind.columns]
    if not fields:
        return []
    begin, end = (np.concatenate(offsets) for offsets in zip(*fields, strict=True))
    numbers = lines.numbers(begin, end)  # in one call, which costs as much as some thousand numbers
    sizes = [len(line) * len(kind.columns) for kind, line in kinds.items()]
    tables = []
    for (kind, line), of_kind in zip(kinds.items(), np.split(numbers, np.cumsum(sizes[:-1])), strict=True):
        tables.append(of_kind.reshape(len(kind.columns), len(line)).T)
        if not ((tables[-1] >= kind.low) & (tables[-1] <= kind.high)).all():  # NaN is not
            raise _number_fault(lines, line, kind)
    return tables


def _times_ms(lines: Lines, line: IntArray) -> FloatArray:
    """(L,) unix time in the order of the file; refuses a clock that was set back."""
    time_ms = lines.time_ms(line)
    back_s = (np.maximum.accumulate(time_ms) - time_ms) / 1000
    if back_s.max() > MAX_BACK_S:
        jump = int(np.flatnonzero(back_s > MAX_BACK_S)[0])
        raise lines.error(
            int(line[jump]),
            f"the clock goes back by {back_s[jump]:.1f} s; it was set during the walk: split the log there",
        )
    return time_ms


def _number_fault(lines: Lines, line: IntArray, kind: _Kind) -> RecordingError:
    """The error for the first number that cannot be, found the slow way."""
    what = kind.type.decode()
    for number, record in zip(line.tolist(), lines.slices(lines.start[line], lines.end[line]), strict=True):
        fields = record.split(b"\t")
        for column, low, high in zip(kind.columns, kind.low, kind.high, strict=True):
            value = as_float(fields[column])
            if low <= value <= high:
                continue
            if not np.isnan(value):
                fault = f"outside [{low:g}, {high:g}]; check its unit, or whether the row is cut"
            elif b"," in fields[column]:
                fault = "a decimal comma; write a point"
            else:
                fault = "not a finite number; delete the row or export the log again"
            came = fields[column].decode(errors="replace")[:40]
            return lines.error(number, f"a number of {what} is {came!r}: {fault}")
    raise AssertionError(f"every number of {what} is within its bounds")


def _check_pauses(path: Path, streams: Mapping[str, FloatArray]) -> None:
    """Refuses a clock that was set forward, or two walks in one file."""
    time_ms = np.sort(np.concatenate([rows[:, 0] for rows in streams.values()]))
    pause_s = np.diff(time_ms) / 1000
    if len(pause_s) and pause_s.max() > MAX_PAUSE_S:
        after = int(time_ms[int(np.argmax(pause_s))])
        raise RecordingError(
            f"{path}: nothing for {pause_s.max():.0f} s after the rows of time {after}; "
            f"the clock was set or this is more than one walk: split the log there"
        )


def _check_units(path: Path, streams: Mapping[str, FloatArray]) -> None:
    for name, (low, high, unit, guess) in _USUAL_NORM.items():
        rows = streams.get(name)
        if rows is None or len(rows) < _MIN_ROWS_TO_JUDGE:
            continue
        norm = float(np.median(np.linalg.norm(rows[:, 1:], axis=1)))
        if not low <= norm <= high:
            raise RecordingError(
                f"{path}: {name}: the median length of the vector is {norm:.4g}, expected {low:g} to {high:g} {unit}; "
                f"it looks like {guess}: convert the column"
            )


def _in_order(rows: FloatArray, dropped: Counter[str]) -> FloatArray:
    """`rows` (T, C) sorted by time, equal times as they were, without a row that equals the one before."""
    step = np.diff(rows[:, 0])
    if (step < 0).any():
        rows = rows[np.argsort(rows[:, 0], kind="stable")]
        step = np.diff(rows[:, 0])
    if step.all():
        return rows
    is_repeat = np.append(False, (rows[1:] == rows[:-1]).all(axis=1))
    dropped["the same row twice"] += int(is_repeat.sum())
    return np.asarray(rows[~is_repeat])


def _read_axes(lines: Lines, kind: _Kind, line: IntArray, numbers: FloatArray, account: _Account) -> FloatArray:
    """(T, 4) time and three axes."""
    return _in_order(np.column_stack([_times_ms(lines, line), numbers]), account.dropped)


def _read_rotation(lines: Lines, kind: _Kind, line: IntArray, numbers: FloatArray, account: _Account) -> FloatArray:
    """(T, 5) time, qw, qx, qy, qz."""
    square = (numbers**2).sum(axis=1)
    longest = int(np.argmax(square))
    if square[longest] > kind.high[0] ** 2:
        raise lines.error(
            int(line[longest]),
            f"the rotation vector has length {np.sqrt(square[longest]):.4f}, expected at most 1; "
            f"the columns are of another kind or cut: delete the row or export the log again",
        )
    quaternion = np.column_stack([np.sqrt(np.maximum(0.0, 1.0 - square)), numbers])
    quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
    return _in_order(np.column_stack([_times_ms(lines, line), np.clip(quaternion, -1.0, 1.0)]), account.dropped)


def _read_wifi(lines: Lines, kind: _Kind, line: IntArray, numbers: FloatArray, account: _Account) -> FloatArray:
    """(T, 5) time, access point, RSSI, frequency, age in seconds."""
    rssi_dbm, frequency_mhz, seen_ms = numbers.T
    time_ms = _times_ms(lines, line)
    if lines.counts_from_zero and seen_ms.min() >= _MS[0]:
        begin_ms = _begin_ms(lines)
        seen_ms = seen_ms - (float(np.max(seen_ms - time_ms)) if begin_ms is None else begin_ms)
    address, which = lines.distinct(*lines.field(line, -4))
    access_point = opaque_ids("wifi", address)[which]
    age_s = (time_ms - seen_ms) / 1000
    _check_ages(lines, line, age_s)
    account.mended["sighted up to a second ahead"] += int(((age_s < 0) & (age_s >= -MAX_FUTURE_S)).sum())
    ahead = age_s < -MAX_FUTURE_S
    account.dropped["sighted in the future"] += int(ahead.sum())
    rows = np.column_stack([time_ms, access_point, rssi_dbm, frequency_mhz, np.maximum(age_s, 0.0)])[~ahead]
    if (np.diff(rows[:, 0]) < 0).any():
        rows = rows[np.argsort(rows[:, 0], kind="stable")]
    fresh = _freshest(rows)
    account.dropped["access point twice in a scan"] += len(rows) - len(fresh)
    return np.asarray(rows[fresh])


def _check_ages(lines: Lines, line: IntArray, age_s: FloatArray) -> None:
    """Refuses a file whose sightings are on another clock than its rows."""
    old, ahead = age_s > MAX_AGE_S, age_s < -MAX_FUTURE_S
    if old.any():
        worst = int(np.argmax(age_s))
        raise lines.error(
            int(line[worst]),
            f"last seen {age_s[worst]:.0f} s before the row; the two clocks differ: write both in unix milliseconds",
        )
    if ahead.mean() > MAX_FUTURE_FRACTION:
        first = int(np.flatnonzero(ahead)[0])
        raise lines.error(
            int(line[first]),
            f"last seen {-age_s[first]:.1f} s after the row, as in {ahead.sum()} of {len(ahead)} WiFi rows; "
            f"the two clocks differ: write both in unix milliseconds",
        )


def _freshest(rows: FloatArray) -> IntArray:
    """Index, rising, of the row to keep of each access point in each scan: freshest, then strongest, then first.

    Args:
        rows: (T, 5) as in the `wifi` stream, sorted by time.
    """
    scan = np.cumsum(np.diff(rows[:, 0], prepend=rows[:1, 0]) > 0)
    pair = (scan << 48) + rows[:, 1].astype(np.int64)  # wraps around after 32 768 scans, which costs a look, no row
    by_pair = np.argsort(pair)
    again = np.flatnonzero(np.diff(pair[by_pair]) == 0)
    if not len(again):
        return np.arange(len(rows))
    doubtful = np.unique(np.concatenate([by_pair[again], by_pair[again + 1]]))
    time, access_point, rssi_dbm, _, age_s = rows[doubtful].T
    order = np.lexsort((-rssi_dbm, age_s, access_point, time))
    repeats = (np.diff(time[order]) == 0) & (np.diff(access_point[order]) == 0)
    return np.delete(np.arange(len(rows)), doubtful[order[1:][repeats]])


def _read_ble(lines: Lines, kind: _Kind, line: IntArray, numbers: FloatArray, account: _Account) -> FloatArray:
    """(T, 4) time, beacon, RSSI, power at 1 m."""
    records = [text.split(b"\t") for text in lines.slices(lines.start[line], lines.end[line])]
    beacon = opaque_ids("ble", [b"\t".join((*fields[2:5], fields[8])) for fields in records])
    return _in_order(np.column_stack([_times_ms(lines, line), beacon, numbers]), account.dropped)


_READ: Final = {
    "accel": _read_axes,
    "gyro": _read_axes,
    "mag": _read_axes,
    "rotation": _read_rotation,
    "wifi": _read_wifi,
    "ble": _read_ble,
    "reference": _read_axes,
}


def _reference(waypoints: FloatArray, floor: str, path: Path) -> Trajectory:
    """Waypoints (T, 3) as a trajectory; every one is surveyed."""
    again = np.flatnonzero(np.diff(waypoints[:, 0]) == 0)
    if len(again):
        raise RecordingError(
            f"{path}: two waypoints at {waypoints[again[0], 0]:.3f} s after the start are at different places; "
            f"delete the wrong one"
        )
    return Trajectory(
        t_s=waypoints[:, 0],
        xy_m=waypoints[:, 1:],
        level=np.full(len(waypoints), _level(floor, path) if len(waypoints) else 0),
        surveyed=np.ones(len(waypoints), dtype=np.bool_),
    )


def _level(floor: str, path: Path) -> int:
    try:
        return level_of_floor(floor)
    except MapError as error:
        raise RecordingError(
            f"{path}: {error}; the floor is named in the header (FloorName:F1) or by the folder: pass it as floor='F1'"
        ) from error


def _report(streams: Mapping[str, FloatArray], skipped: Mapping[str, int], account: _Account) -> ReadReport:
    return ReadReport(
        kept={name: len(rows) for name, rows in streams.items()},
        skipped=skipped,
        dropped=account.dropped,
        mended=account.mended,
        longest_gap_s={name: float(np.diff(rows[:, 0]).max()) for name, rows in streams.items() if len(rows) > 1},
        constant=tuple(
            name
            for name, rows in streams.items()
            if name in _SAMPLED and len(rows) >= _MIN_ROWS_TO_JUDGE and (rows[:, 1:] == rows[0, 1:]).all()
        ),
    )


READER: Final = Reader(read, lambda head: bool(_RECORD.search(head.content)))
