"""Which column of a table is which sensor, in which unit, as a `[columns]` table of TOML states it: docs/formats.md."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import msgspec
import numpy as np

from pdrbench.errors import RecordingError
from pdrbench.geometry import BoolArray, FloatArray, IntArray
from pdrbench.io.geo import GeoFrame, frame_at
from pdrbench.io.log import Log
from pdrbench.trajectory import Trajectory
from pdrbench_formats.recordings.assemble import (
    STANDARD_GRAVITY_MPS2,
    Origin,
    Tally,
    assemble,
    places,
    seconds,
    unit_quaternions,
)
from pdrbench_formats.recordings.delimited import DelimitedTable, most_odd
from pdrbench_formats.toml import explained, read_toml, toml_value

UNITS: Final[Mapping[str, Mapping[str, float]]] = {
    "accel_unit": {"m/s^2": 1.0, "g": STANDARD_GRAVITY_MPS2, "mg": STANDARD_GRAVITY_MPS2 * 1e-3}
    | {"mm/s^2": 0.001, "cm/s^2": 0.01, "ft/s^2": 0.3048},
    "gyro_unit": {"rad/s": 1.0, "deg/s": np.pi / 180.0, "mdeg/s": np.pi / 180.0e3, "mrad/s": 1e-3}
    | {"rpm": np.pi / 30.0, "rev/s": 2.0 * np.pi, "deg/h": np.pi / 648e3},
    "mag_unit": {"uT": 1.0, "mT": 1e3, "T": 1e6, "nT": 1e-3, "G": 100.0, "mG": 0.1},
    "baro_unit": {"hPa": 1.0, "Pa": 0.01, "kPa": 10.0, "mbar": 1.0, "bar": 1e3, "inHg": 33.863886},
}
_PAGE: Final = "Formats"
_DAY_NS: Final = 86_400 * 10**9
_TIME_OF_DAY: Final = r"\d{1,2}:\d{1,3}:\d{1,2}(?:[.,]\d+)?"
_MINUTES: Final = r"(\d{1,3}:\d{2}(?:[.,]\d+)?)"  # and seconds, as of a stop watch
_CLOCK_COLON: Final = r"(\d:\d{1,2}:\d{1,2})[:,](\d+)"  # 13:45:12:123
_FEW_MS: Final = r"(:\d{1,2}):(\d{1,2})$"  # 8:18:9:94 among 8:18:9:104 are milliseconds
_COMPACT: Final = r"^(20\d\d)([01]\d)([0-3]\d)([0-2]\d)([0-5]\d)([0-5]\d)\.?(\d*)$"  # 20231114221320123
_COMPACT_TIME: Final = r"^([012]?\d)([0-5]\d)([0-5]\d(?:\.\d+)?)$"  # 221320.12
_FIRST_COMPACT: Final = 2e13  # of the year 2000
_DAY_FIRST: Final = r"\d{1,2}\.\d{1,2}\.\d{4}"
SECONDS_IN: Final = {unit: ns * 1e-9 for unit, ns in {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1}.items()}
TIME_UNITS: Final = {**SECONDS_IN, "100ns": 1e-7, "min": 60.0, "d": 86_400.0}
Scale = Annotated[float, msgspec.Meta(gt=0.0)]  # what one count is, of a clock or a converter: s, m/s^2, rad/s, uT
_MAX_MISSED: Final = 20  # rows between which a counter may begin anew
FIRST_DAY: Final = 25_569.0  # of 1970, in the days of spreadsheets
_FIRST_DAYS: Final = (719_529.0, FIRST_DAY)  # of MATLAB before


class ColumnMap(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, omit_defaults=True):
    """The `[columns]` table.

    Attributes:
        time, time_unit: Column of the time; "datetime" where it holds dates; a number says what one count is.
        rate_hz: Rows a second, where no column is a time. Of a map that names no sensor, the rest is guessed.
        accel, accel_unit: Columns x, y, z of the specific force; a minus before a name turns it round.
        gravity: Columns that are added to `accel` where that lacks gravity; in the same unit.
        gyro, gyro_unit: Of angular rates.
        mag, mag_unit: Of the magnetic field.
        rotation: Columns w, x, y, z of the attitude.
        rotation_turns: From where to where it turns vectors.
        baro, baro_unit: Column of the air pressure.
        place, place_unit: Columns x, y in metres, or latitude, longitude in "deg", where the file holds them.
        level: Column of the level at those places.
        surveyed: True where the places are truth to be scored against.
        separator, decimal, header_line: Of the file; found where they are left out. With 0 for a header line there is
            none, and the columns are named "1", "2" and so on.
        device, mounting: As in "Pixel 7", "hand".
    """

    time: str = ""
    time_unit: Literal["s", "ms", "us", "ns", "100ns", "min", "d", "datetime"] | Scale = "s"
    rate_hz: Scale | None = None
    accel: tuple[str, str, str] | None = None
    accel_unit: Literal["m/s^2", "g", "mg", "mm/s^2", "cm/s^2", "ft/s^2"] | Scale = "m/s^2"
    gravity: tuple[str, str, str] | None = None
    gyro: tuple[str, str, str] | None = None
    gyro_unit: Literal["rad/s", "deg/s", "mdeg/s", "mrad/s", "rpm", "rev/s", "deg/h"] | Scale = "rad/s"
    mag: tuple[str, str, str] | None = None
    mag_unit: Literal["uT", "mT", "T", "nT", "G", "mG"] | Scale = "uT"
    rotation: tuple[str, str, str, str] | None = None
    rotation_turns: Literal["device to building", "building to device"] = "device to building"
    baro: str | None = None
    baro_unit: Literal["hPa", "Pa", "kPa", "mbar", "bar", "inHg"] = "hPa"
    place: tuple[str, str] | None = None
    place_unit: Literal["m", "deg"] = "m"
    level: str | None = None
    surveyed: bool = True
    separator: str | None = None
    decimal: Literal[".", ","] | None = None
    header_line: int | None = None
    device: str = ""
    mounting: str = ""

    @property
    def is_rate(self) -> bool:
        """Whether it leaves all columns to be guessed."""
        sensors = ("accel", "gyro", "mag", "rotation", "baro", "place")
        return self.rate_hz is not None and not self.time and all(getattr(self, name) is None for name in sensors)

    def toml(self) -> str:
        """As a table that can be pasted into a file."""
        lines = ["[columns]"]
        for name, value in msgspec.to_builtins(self).items():
            unit = f"{name}_unit"
            lines.append(f"{name} = {toml_value(value)}")
            if hasattr(self, unit) and f"{unit} = " not in "\n".join(lines) and unit not in msgspec.to_builtins(self):
                lines.append(f"{unit} = {toml_value(getattr(self, unit))}")
        return "\n".join(lines) + "\n"


def read_column_map(source: Path | str | Mapping[str, Any] | ColumnMap) -> ColumnMap:
    """A column map from a TOML file, or from its `[columns]` table.

    Raises:
        RecordingError: Names the key that is unknown or wrong, and the nearest one.
    """
    if isinstance(source, ColumnMap):
        return source
    where: object = "[columns]"
    table: Any = source
    if isinstance(source, (str, Path)):
        where, document = source, read_toml(Path(source), dict[str, Any], _PAGE)
        table = document.get("columns", document)
    try:
        found = msgspec.convert(table, ColumnMap)
    except msgspec.ValidationError as error:
        raise RecordingError(f"{where}: {explained(error, ColumnMap, _PAGE)}") from error
    if not found.time and found.rate_hz is None:
        raise RecordingError(f"{where}: no `time`; name its column, or state rate_hz where there is none")
    return found


def read_mapped(
    path: Path,
    table: DelimitedTable,
    columns: ColumnMap,
    *,
    tally: Tally | None = None,
    strict: bool = True,
    reference: Trajectory | None = None,
) -> Log:
    """A log from a table whose columns are known; `reference` is on its clock, where the table holds no places.

    Raises:
        RecordingError: A column is missing or holds no numbers; or as `assemble` says.
    """
    tally = tally or Tally()
    t_s, first_s = times_of(table, columns)
    own, geo = _reference(table, columns, t_s, tally)
    streams = streams_of(table, columns, t_s, tally)
    return assemble(
        path,
        streams,
        reference=reference if own is None else own,
        origin=Origin(device=columns.device, start_unix_s=unix_s(first_s), geo=geo, mounting=columns.mounting),
        tally=tally,
        strict=strict,
    )


def streams_of(table: DelimitedTable, columns: ColumnMap, t_s: FloatArray, tally: Tally) -> dict[str, FloatArray]:
    """(T, C) rows by sensor of one table at times (N,); columns that are not read are counted."""
    streams: dict[str, FloatArray] = {}
    for name in ("accel", "gyro", "mag"):
        axes = getattr(columns, name)
        if axes is not None:
            factor = scale_of(f"{name}_unit", getattr(columns, f"{name}_unit"))
            xyz = np.column_stack([_signed(table, axis) for axis in axes])
            if name == "accel" and columns.gravity is not None:
                xyz = xyz + np.column_stack([_signed(table, axis) for axis in columns.gravity])
            streams[name] = _given(np.column_stack([t_s, xyz * factor]))
    if columns.rotation is not None:
        q = unit_quaternions(np.column_stack([_signed(table, axis) for axis in columns.rotation]))
        if columns.rotation_turns == "building to device":
            q = q * [1.0, -1.0, -1.0, -1.0]
        streams["rotation"] = _given(np.column_stack([t_s, q]))
    if columns.baro is not None:
        pressure = table.numbers(columns.baro) * UNITS["baro_unit"][columns.baro_unit]
        streams["baro"] = _given(np.column_stack([t_s, np.where(pressure == 0.0, np.nan, pressure)]))
    used = {columns.time, columns.baro, columns.level, *(columns.place or ())}
    for name in ("accel", "gravity", "gyro", "mag", "rotation"):
        used |= {axis if axis in table.columns else axis.removeprefix("-") for axis in getattr(columns, name) or ()}
    tally.skipped.update({f"column {name}": len(table) for name in table.columns if name not in used})
    tally.mended += table.mended
    tally.dropped += table.dropped
    return streams


def scale_of(key: str, unit: str | float) -> float:
    """What a unit that stands under a key of a column map is, in the unit of the streams."""
    return unit if isinstance(unit, (int, float)) else (TIME_UNITS if key == "time_unit" else UNITS[key])[unit]


def times_of(table: DelimitedTable, columns: ColumnMap) -> tuple[FloatArray, float]:
    """As `clock`, of the column that a map names, or of the rate that it states."""
    if columns.rate_hz is not None and not columns.time:
        return np.arange(len(table)) / columns.rate_hz, 0.0
    return clock(table, columns.time, columns.time_unit)


def clock(table: DelimitedTable, name: str, unit: str | float) -> tuple[FloatArray, float]:
    """(N,) seconds since the first row, and the time of that row on the clock of the column."""
    if unit == "datetime":
        ns, is_date = _stamps_ns(table, name)
        first_ns = int(ns[is_date.argmax()])
        return np.where(is_date, seconds(ns, first_ns), np.nan), first_ns * 1e-9
    whole, scale_s = table.whole(name), scale_of("time_unit", unit)
    if whole is not None and len(whole):
        whole = _counted_on(whole)
        return (whole - whole[0]).astype(np.float64) * scale_s, float(whole[0]) * scale_s
    numbers = table.numbers(name)
    finite = numbers[np.isfinite(numbers)]
    first = float(finite[0]) if len(finite) else 0.0
    since = next((day for day in _FIRST_DAYS if unit == "d" and first > day), 0.0)
    return (numbers - first) * scale_s, (first - since) * scale_s


def _counted_on(whole: IntArray) -> IntArray:
    """Counts (N,) of a device, which go on where its counter of 16 or 32 bits began anew."""
    steps = np.diff(whole)
    for size in (1 << 16, 1 << 32):
        back = steps < -size // 2
        if back.any() and whole.min() >= 0 and whole.max() < size:
            usual = max(int(np.median(steps)), 1)
            if ((steps[back] + size >= 0) & (steps[back] + size <= _MAX_MISSED * usual)).all():
                return np.asarray(whole + size * np.cumsum(np.append(0, back)))
    return whole


def is_compact(table: DelimitedTable, name: str) -> bool:
    """Whether numbers are dates written without signs, or times of day, by how they step where a minute begins."""
    t = table.numbers(name)
    t = t[np.isfinite(t)]
    if len(t) and t.min() > _FIRST_COMPACT:
        return all(map(re.compile(_COMPACT).match, table.texts(name)))
    before, after = t[:-1], t[1:]
    jumps = (before % 100.0 > 58.0) & (after % 100.0 < 2.0) & (np.abs((after - before) % 4000.0 - 41.0) < 2.0)
    return bool(jumps.any() and t.max() < 240_000.0 and (t % 100.0 < 60.0).all() and (t // 100.0 % 100.0 < 60.0).all())


def unix_s(first_s: float) -> float | None:
    """A time where it counts from 1970: one from 2005 to 2160; Apple's count from 2001 is before."""
    return first_s if 1.1e9 < first_s < 6e9 else None


def _stamps_ns(table: DelimitedTable, name: str) -> tuple[IntArray, BoolArray]:
    """(N,) nanoseconds of dates, or of times of day, which go on after midnight; and (N,) where there is one."""
    import pandas as pd

    texts = pd.Series(table.texts(name), dtype=object)
    texts = texts.str.replace(_COMPACT, r"\1-\2-\3 \4:\5:\6.\7", regex=True)
    texts = texts.str.replace(_COMPACT_TIME, r"0\1:\2:\3", regex=True)
    if texts.str.fullmatch(r".*\d:\d+:\d+:\d{3}").any():
        texts = texts.str.replace(_FEW_MS, lambda match: f"{match[1]}:{match[2]:0>3}", regex=True)
    texts = texts.str.replace(_CLOCK_COLON, r"\1.\2", regex=True)
    if texts.str.fullmatch(_MINUTES).sum() > len(texts) / 2:
        texts = texts.str.replace(f"^{_MINUTES}$", r"0:\1", regex=True)
    of_day = texts.str.fullmatch(_TIME_OF_DAY)
    if of_day.sum() > len(texts) / 2:
        times = pd.to_timedelta(texts.str.replace(",", "."), errors="coerce")
        ns: IntArray = times.to_numpy().astype("timedelta64[ns]").astype(np.int64)
        ns[~of_day] = np.interp(np.flatnonzero(~of_day), np.flatnonzero(of_day), ns[of_day])
        return ns + _DAY_NS * np.cumsum(np.diff(ns, prepend=ns[:1]) < -_DAY_NS // 2), of_day.to_numpy(bool)
    try:
        day_first = bool(texts.str.match(_DAY_FIRST).any())
        stamps = pd.to_datetime(texts, utc=True, format="mixed", errors="coerce", dayfirst=day_first)
        stamps = stamps.dt.tz_localize(None)
    except (ValueError, TypeError, OverflowError) as error:  # pandas raises all of them for texts of other kinds
        raise RecordingError(f"{table.path}: {name}: not a date: {error}; write ISO dates or seconds") from error
    is_date = stamps.notna().to_numpy()
    if not is_date.any() or (~is_date).sum() > most_odd(len(texts)):
        came = texts[int((~is_date).argmax())]
        raise RecordingError(f"{table.path}: {name}: {came[:40]!r} is not a date; write ISO dates or seconds")
    if not is_date.all():
        table.dropped[f"{name} is no date"] = int((~is_date).sum())
    return stamps.to_numpy().astype("datetime64[ns]").astype(np.int64), is_date


def _signed(table: DelimitedTable, name: str) -> FloatArray:
    if name not in table.columns and name.startswith("-"):
        return -table.numbers(name[1:])
    return table.numbers(name)


def _given(rows: FloatArray) -> FloatArray:
    """Without rows in which the sensor has no number at all: several sensors share one table at different rates."""
    missing = np.isnan(rows[:, 1:])
    if not missing.any():
        return rows
    kept: FloatArray = rows[~missing.all(axis=1)]
    return kept


def _reference(
    table: DelimitedTable, columns: ColumnMap, t_s: FloatArray, tally: Tally
) -> tuple[Trajectory | None, GeoFrame | None]:
    if columns.place is None:
        return None, None
    at = table.table(columns.place)
    level = np.zeros(len(t_s)) if columns.level is None else table.numbers(columns.level)
    there = np.isfinite(at).all(axis=1) & np.isfinite(level)
    t_s, at = t_s[there], at[there]
    if not len(at):
        return None, None
    geo = None
    if columns.place_unit == "deg":
        geo = frame_at(at[:, 0], at[:, 1])
        at = geo.to_local(at[:, 0], at[:, 1])
    floors = np.round(level[there]).astype(np.int64)
    return places(t_s, at, floors, surveyed=columns.surveyed, tally=tally), geo
