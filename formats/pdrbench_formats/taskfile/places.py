"""Frames and places: plans turned to x east, truth from a table, walks and plans on one plane."""

from __future__ import annotations

import dataclasses
import re
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from pdrbench.errors import RecordingError
from pdrbench.geometry import BoolArray, FloatArray, IntArray
from pdrbench.io.container import open_container
from pdrbench.io.geo import GeoFrame, frame_at
from pdrbench.trajectory import Trajectory
from pdrbench_formats.maps.features import level_number
from pdrbench_formats.recordings.columnmap import FIRST_DAY, SECONDS_IN, unix_s
from pdrbench_formats.recordings.columnmap import clock as clock_of
from pdrbench_formats.recordings.columnnames import LEVEL_NAMES, TIME_NAMES, split_unit, unit_in, unit_of
from pdrbench_formats.recordings.delimited import DelimitedTable, find_layout, read_delimited
from pdrbench_formats.recordings.texts import WORDS, text_of

CLOCKS: Final = {"t_s": 1.0, "unix_s": 1.0, "unix_ms": 1e-3}  # columns of time, and their unit in seconds
FRAMES: Final = (("x_m", "y_m"), ("lat_deg", "lon_deg"))
EXAMPLE: Final = "t_s,x_m,y_m,level"
SENDER, STRENGTH = "access_point", "rssi_dbm"
_ALIASES: Final[Mapping[str, Sequence[str]]] = {**WORDS["places"], "level": LEVEL_NAMES}
_KNOWN: Final = {base: name for name, bases in _ALIASES.items() for base in bases}
_METRES: Final = {"": 1.0, "m": 1.0, "cm": 0.01, "mm": 0.001, "ft": 0.3048, "in": 0.0254, "yd": 0.9144}
_TUM: Final = ("timestamp", "x_m", "y_m", "z", "qx", "qy", "qz", "qw")  # without a header, as evo and others write
_WITHOUT_HEADER: Final = {8: _TUM, 3: _TUM[:3], 4: (*_TUM[:3], "level")}  # by the number of columns
_STRENGTHS_DBM: Final = (-127.0, -10.0)  # a column `level` of them is that of Android's ScanResult
_ACCESS_POINT: Final = re.compile(
    r"(?:WAP|AP|MAC|BSSID|RSSI?|i?beacon|ble|b)_?\d+|(?:[0-9a-f]{2}[:-]){5}[0-9a-f]{2}", re.I
)
_OF_A_POSE: Final = re.compile(r".*(?:pose|position|translation|location|pos)\.?([xy01])")
_MIN_RISE_M: Final = 2.0  # of a height, that may be another level
_MIN_SENDERS: Final = 3  # columns that make a table one with a row for each scan
_MAX_DEGREES: Final = 0.02  # between places named x and y that are degrees: 2 km, and in metres nowhere to walk to
_NEAR_DEG: Final = 0.1  # between frames of one site
_STEPS_S: Final = (0.0009, 100.0)  # between places


def moved(reference: Trajectory, xy_m: FloatArray, turn_rad: float = 0.0) -> Trajectory:
    """The same trajectory at other places (T, 2), headings turned."""
    heading_rad = None if reference.heading_rad is None else reference.heading_rad + turn_rad
    return dataclasses.replace(reference, xy_m=xy_m, heading_rad=heading_rad)


def read_places(path: Path, start_unix_s: float | None) -> tuple[Trajectory, GeoFrame | None, str]:
    """Places from a table, in any dialect that recordings are read in: `t_s,x_m,y_m,level`, TUM, dates, degrees.

    Args:
        path: Of the table. Without a column of levels all is on level 0; rows without a place are left out.
        start_unix_s: Time 0 of the walk in seconds since 1970; needed for times since 1970.

    Returns:
        The places in the order of time, all surveyed; their frame where they are degrees; and what was left out.

    Raises:
        RecordingError: Names file, line and remedy.
    """
    table = read_table(path, EXAMPLE)
    clock = next((name for name in CLOCKS if name in table.columns), None)
    if clock is None or not (frame := place_columns(table.columns)):
        raise RecordingError(
            f"{path}: line 1: columns {', '.join(table.columns)[:200]}; a table of places has {EXAMPLE}, with unix_s "
            f"or unix_ms for times since 1970 and lat_deg,lon_deg for degrees"
        )
    known = np.asarray(np.isfinite(table.table(frame)).any(axis=1))
    known |= not known.any()
    t_s = finite(table, clock, known=known) * CLOCKS[clock]
    if clock != "t_s":
        if start_unix_s is None:
            raise RecordingError(
                f"{path}: {clock} counts from 1970, and the recording does not say when it began; give t_s, the "
                f"seconds from its first row"
            )
        t_s = t_s - start_unix_s
    xy_m, level, geo = places_in(table, known)
    rows = np.column_stack([t_s, xy_m, level])
    again = known & np.append(False, (rows[1:] == rows[:-1]).all(axis=1))
    dropped = table.dropped + Counter({"without a place": int((~known).sum()), "that stand twice": int(again.sum())})
    kept = np.flatnonzero(known & ~again)
    order = kept[np.argsort(t_s[kept], kind="stable")]
    left = [f"lines left out: {', '.join(f'{num} {why}' for why, num in (+dropped).items())}"] * bool(dropped.total())
    if unread := [name for name in table.columns if name not in (*CLOCKS, *frame, "level", *_TUM)]:
        left.append(f"columns left out: {', '.join(unread)[:200]}")
    z = table.columns.get("z", np.zeros(len(table)))
    if "level" not in table.columns and z.dtype.kind in "iuf" and (rise := np.ptp(z[kept])) > _MIN_RISE_M:
        left.append(f"without a column of levels all is on level 0, though z goes over {rise:.1f} m")
    left_out = f"{path.name}: {'; '.join(left)}"
    try:
        places = Trajectory(t_s[order], xy_m[order], level[order], np.ones(len(order), dtype=np.bool_))
        return places, geo, left_out if left else ""
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from error


def check_not_exchanged(one: GeoFrame, other: GeoFrame, whose: str) -> None:
    """Raises `RecordingError` where two frames lie together only with latitude and longitude of one exchanged."""
    apart = np.hypot(one.lat_deg - other.lat_deg, one.lon_deg - other.lon_deg)
    if np.hypot(one.lat_deg - other.lon_deg, one.lon_deg - other.lat_deg) < _NEAR_DEG < apart:
        raise RecordingError(
            f"{whose} lie at latitude {one.lat_deg:.2f}, longitude {one.lon_deg:.2f}, and the other places at "
            f"{other.lat_deg:.2f}, {other.lon_deg:.2f}: exchange the two names in the one that is wrong"
        )


def place_columns(names: Collection[str]) -> Sequence[str]:
    """The pair of columns of places, () where there is none."""
    return next((pair for pair in FRAMES if set(pair) <= set(names)), ())


def places_in(table: DelimitedTable, known: BoolArray | bool = True) -> tuple[FloatArray, IntArray, GeoFrame | None]:
    """Metres (N, 2) and level (N,), which rows that are not `known` may lack, and a frame where there are degrees."""
    frame = place_columns(table.columns)
    xy = np.column_stack([finite(table, name, known=known) for name in frame])
    level = finite(table, "level", 0.0, known)
    if (odd := known & (level != np.rint(level))).any():
        row = int(odd.argmax())
        raise table.error(row, f"a level is a whole number, 0 for the ground; got {level[row]:g}")
    geo = None
    if frame != FRAMES[0]:
        geo = frame_at(xy[:, 0], xy[:, 1])
        xy = geo.to_local(xy[:, 0], xy[:, 1])
    return xy, np.nan_to_num(level).astype(np.int64), geo


def finite(table: DelimitedTable, name: str, usual: float | None = None, known: BoolArray | bool = True) -> FloatArray:
    """(N,) one column, with a number in rows that are `known`; `usual` where there is none, or it has no number.

    Raises:
        RecordingError: A field is no finite number.
    """
    numbers = table.numbers(name) if name in table.columns else np.full(len(table), np.nan)
    if usual is not None and not np.isfinite(numbers).any():
        return np.full(len(table), usual)
    if (odd := known & ~np.isfinite(numbers)).any():
        row = int(odd.argmax())
        raise table.error(row, f"{name} is {table.texts(name)[row]!r}, no finite number; leave the line out")
    return numbers


def read_table(path: Path, example: str) -> DelimitedTable:
    """Reads a small table, with columns under the names of `example` whatever they are called.

    Args:
        path: Of the table: any separator, decimals, encoding and comments that recordings are read with.
        example: A header, for messages.

    Raises:
        RecordingError: It cannot be read, has no line below the header, or a line has another number of fields.
    """
    content = open_container(path).read(path.name)
    layout = find_layout(text_of(content, path).content) if content.strip() else None
    nothing = RecordingError(f"{path}: no places; write a line {example} and one for each place below it")
    if layout is None:
        raise nothing
    table = read_delimited(
        content,
        path,
        names=None if layout.line else _WITHOUT_HEADER.get(len(layout.names)),
        separator=layout.separator,
        header_line=None if layout.line else 0,
        texts=[name for name in layout.names if name_of(name) == SENDER],
        exact=True,
    )
    if not len(table):
        raise nothing
    return dataclasses.replace(table, columns=_canonical(table))


def table_names(content: bytes) -> set[str]:
    """Names of the columns of a table under the names that are used here; none of anything else."""
    layout = find_layout(content)
    return set() if layout is None else {name_of(name) for name in layout.names}


def name_of(name: str) -> str:
    """What `EXAMPLE` and surveys call a column, "t_s" for any time; the name itself of any other."""
    last = name.rpartition(".")[2]  # of what a document of JSON holds within other things
    own = last if _ACCESS_POINT.fullmatch(last) else _KNOWN.get(split_unit(last)[0])
    if last != name and own in (last, "level", SENDER, STRENGTH):
        return own
    base = _OF_A_POSE.sub(r"position\1", split_unit(name)[0])
    is_time = base in TIME_NAMES or bool(unit_in(base)) or base.endswith(("time", "timestamp"))
    return name if name in CLOCKS or name in _ALIASES else _KNOWN.get(base, "t_s" if is_time else name)


def _canonical(table: DelimitedTable) -> dict[str, NDArray[Any]]:
    """Columns by the names of `EXAMPLE` and of surveys, in metres, degrees and seconds; others as they are."""
    found: dict[str, NDArray[Any]] = {}
    names = {name: name_of(name) for name in table.columns}
    if SENDER in names.values() and STRENGTH not in names.values():
        names |= {name: STRENGTH for name, own in names.items() if own == "level" and _are_strengths(table, name)}
    for name, values in table.columns.items():
        own, unit = names[name], split_unit(name)[1]
        scale = _METRES[unit_of("length_unit", unit)]
        if own in FRAMES[0] and unit and not unit_of("length_unit", unit):
            known = ", ".join(filter(None, _METRES))
            raise table.error(0, f"{name!r} states the unit {unit!r}, which is none of {known}; convert it to one")
        if own in found or (own == "t_s" and found.keys() & CLOCKS.keys()):
            found[name] = values
        elif own == "t_s" and name != own:
            clock, times = _clock(table, name)
            found[clock] = times
        elif own == "level" and values.dtype.kind not in "iuf":
            levels = [level_number(text) if text else np.nan for text in table.texts(name)]
            found[own] = values if None in levels else np.array(levels, dtype=np.float64)
        else:
            found[own] = values if scale == 1.0 or own not in FRAMES[0] else table.numbers(name) * scale
    if found.keys() >= set(FRAMES[0]) and not found.keys() & set(FRAMES[1]) and _are_degrees(table, found):
        found["lat_deg"], found["lon_deg"] = found.pop("x_m"), found.pop("y_m")
    if found.keys() >= set(FRAMES[1]) and len(table):
        lat_deg, lon_deg = dataclasses.replace(table, columns=found).table(FRAMES[1]).T
        if 90.0 < np.nanmax(np.abs(lat_deg), initial=0.0) <= 180.0 and np.nanmax(np.abs(lon_deg)) <= 90.0:
            raise table.error(0, "a latitude above 90 degrees: exchange the names of latitude and longitude")
        if np.nanmax(np.abs(lat_deg), initial=0.0) > 90.0:
            found["x_m"], found["y_m"] = found.pop("lon_deg"), found.pop("lat_deg")  # as UJIIndoorLoc has them
    return found


def senders(names: Iterable[str]) -> list[str]:
    """Columns that are access points, of a table with a row for each scan."""
    found = [name for name in names if _ACCESS_POINT.fullmatch(name)]
    return found if len(found) >= _MIN_SENDERS else []


def _are_strengths(table: DelimitedTable, name: str) -> bool:
    """Whether a column holds strengths of signals, and no levels."""
    values = table.numbers(name)
    return bool(((values >= _STRENGTHS_DBM[0]) & (values <= _STRENGTHS_DBM[1])).all())


def _are_degrees(table: DelimitedTable, found: Mapping[str, NDArray[Any]]) -> bool:
    """Whether columns called X and Y, as the Anyplace Logger has them, are latitude and longitude."""
    named = [name for name in table.columns if name_of(name) in FRAMES[0]]
    is_survey = SENDER in found or senders(found)
    if not is_survey or not all(name.strip().lstrip("# ") in ("X", "Y", "x", "y") for name in named):
        return False
    xy = dataclasses.replace(table, columns=found).table(FRAMES[0])
    return bool((np.abs(xy).min(axis=0) > 1.0).all() and (np.ptp(xy, axis=0) < _MAX_DEGREES).all())


def _clock(table: DelimitedTable, name: str) -> tuple[str, FloatArray]:
    """Column of `CLOCKS` and its values, of times in a unit, of dates, or of numbers whose unit their steps say."""
    base, unit = split_unit(name)
    stated = unit_of("time_unit", unit) or unit_of("time_unit", unit_in(base))
    try:
        times = table.numbers(name)
    except RecordingError:
        t_s, first_s = clock_of(table, name, "datetime")
        return ("unix_s" if unix_s(first_s) is not None else "t_s"), first_s + t_s
    first, steps = (float(np.nanmin(times)) if len(times) else 0.0), np.diff(np.sort(times))
    usual = float(np.median(steps[steps > 0])) if (steps > 0).any() else 1.0
    likely = [one for one, s in SECONDS_IN.items() if unix_s(first * s) is not None]
    likely += [one for one, s in SECONDS_IN.items() if _STEPS_S[0] <= usual * s <= _STEPS_S[1]]
    if stated not in SECONDS_IN and (stated or (FIRST_DAY < first < 4 * FIRST_DAY and np.ptp(times) < 1.0)):
        t_s, first_s = clock_of(table, name, stated or "d")
        return ("unix_s" if unix_s(first_s) is not None else "t_s"), first_s + t_s
    scale = SECONDS_IN[stated or next(iter(likely), "s")]
    return ("unix_s" if unix_s(first * scale) is not None else "t_s"), times * scale
