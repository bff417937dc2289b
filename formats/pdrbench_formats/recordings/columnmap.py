"""Which column of a table is which sensor, in which unit: stated in a `[columns]` table of TOML, or guessed.

[columns]
time = "timestamp"
time_unit = "ms"                  # s, ms, us, ns, datetime
accel = ["ax", "ay", "az"]        # x right, y to the top edge, z out of the screen; "-ay" turns a column round
accel_unit = "g"                  # m/s^2, g, mg
gyro = ["gx", "gy", "gz"]
gyro_unit = "deg/s"               # rad/s, deg/s
"""

from __future__ import annotations

import difflib
import re
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, Literal

import msgspec
import numpy as np

from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray
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
from pdrbench_formats.recordings.delimited import DelimitedTable

UNITS: Final[Mapping[str, Mapping[str, float]]] = {
    "accel_unit": {"m/s^2": 1.0, "g": STANDARD_GRAVITY_MPS2, "mg": STANDARD_GRAVITY_MPS2 * 1e-3},
    "gyro_unit": {"rad/s": 1.0, "deg/s": np.pi / 180.0, "mdeg/s": np.pi / 180.0e3},
    "mag_unit": {"uT": 1.0, "mT": 1e3, "T": 1e6, "nT": 1e-3, "G": 100.0, "mG": 0.1},
    "baro_unit": {"hPa": 1.0, "Pa": 0.01, "kPa": 10.0, "mbar": 1.0, "bar": 1e3, "inHg": 33.863886},
}
TIME_NS: Final = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1}
SECONDS_IN: Final = {unit: ns * 1e-9 for unit, ns in TIME_NS.items()}


class ColumnMap(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, omit_defaults=True):
    """The `[columns]` table.

    Attributes:
        time, time_unit: Column of the time; "datetime" where it holds dates.
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

    time: str
    time_unit: Literal["s", "ms", "us", "ns", "datetime"] = "s"
    accel: tuple[str, str, str] | None = None
    accel_unit: Literal["m/s^2", "g", "mg"] = "m/s^2"
    gravity: tuple[str, str, str] | None = None
    gyro: tuple[str, str, str] | None = None
    gyro_unit: Literal["rad/s", "deg/s", "mdeg/s"] = "rad/s"
    mag: tuple[str, str, str] | None = None
    mag_unit: Literal["uT", "mT", "T", "nT", "G", "mG"] = "uT"
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

    def toml(self) -> str:
        """As a table that can be pasted into a file."""
        lines = ["[columns]"]
        for name, value in msgspec.to_builtins(self).items():
            unit = f"{name}_unit"
            lines.append(f"{name} = {_toml(value)}")
            if hasattr(self, unit) and f"{unit} = " not in "\n".join(lines) and unit not in msgspec.to_builtins(self):
                lines.append(f"{unit} = {_toml(getattr(self, unit))}")
        return "\n".join(lines) + "\n"


def _toml(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(_toml(item) for item in value)}]"
    return msgspec.json.encode(value).decode()


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
        where = source
        try:
            document = tomllib.loads(Path(source).read_text(encoding="utf-8-sig"))
        except OSError as error:
            raise RecordingError(f"{source}: cannot be read: {error.strerror}; check the path") from error
        except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
            raise RecordingError(f"{source}: not TOML: {error}; put names of columns into quotes") from error
        table = document.get("columns", document)
    known = ColumnMap.__struct_fields__
    for key in table if isinstance(table, Mapping) else ():
        if key not in known:
            near = difflib.get_close_matches(str(key), known, n=1, cutoff=0.5)
            hint = f"did you mean {near[0]!r}?" if near else f"known: {', '.join(known)}"
            raise RecordingError(f"{where}: no key {key!r} in a column map; {hint}")
    try:
        return msgspec.convert(table, ColumnMap)
    except msgspec.ValidationError as error:
        raise RecordingError(f"{where}: {error}; see docs/formats.md for column maps") from error


def read_mapped(
    path: Path, table: DelimitedTable, columns: ColumnMap, *, tally: Tally | None = None, strict: bool = True
) -> Log:
    """A log from a table whose columns are known.

    Raises:
        RecordingError: A column is missing or holds no numbers; or as `assemble` says.
    """
    tally = tally or Tally()
    tally.mended += table.mended
    tally.dropped += table.dropped
    t_s, origin_s = times(table, columns.time, columns.time_unit)
    streams: dict[str, FloatArray] = {}
    for name in ("accel", "gyro", "mag"):
        axes = getattr(columns, name)
        if axes is not None:
            factor = UNITS[f"{name}_unit"][getattr(columns, f"{name}_unit")]
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
        streams["baro"] = _given(
            np.column_stack([t_s, table.numbers(columns.baro) * UNITS["baro_unit"][columns.baro_unit]])
        )
    reference, geo = _reference(table, columns, t_s, tally)
    used = {columns.time, columns.baro, columns.level, *(columns.place or ())}
    for name in ("accel", "gravity", "gyro", "mag", "rotation"):
        used |= {axis if axis in table.columns else axis.removeprefix("-") for axis in getattr(columns, name) or ()}
    tally.skipped.update({f"column {name}": len(table) for name in table.columns.keys() - used})
    return assemble(
        path,
        streams,
        reference=reference,
        origin=Origin(device=columns.device, start_unix_s=origin_s, geo=geo, mounting=columns.mounting),
        tally=tally,
        strict=strict,
    )


def times(table: DelimitedTable, name: str, unit: str) -> tuple[FloatArray, float | None]:
    """(N,) seconds since the first row, and the unix time of that where the column counts from 1970."""
    whole = table.whole(name) if unit != "datetime" else None
    if unit == "datetime":
        import pandas as pd

        try:
            stamps = pd.to_datetime(pd.Series(table.texts(name)), utc=True, format="mixed")
        except (ValueError, OverflowError) as error:
            raise RecordingError(f"{table.path}: {name}: not a date: {error}; write ISO dates or seconds") from error
        ns = stamps.to_numpy().astype("datetime64[ns]").astype(np.int64)
        return seconds(ns, int(ns[0])), float(ns[0]) * 1e-9
    if whole is not None and len(whole):
        t_s = (whole - whole[0]).astype(np.float64) * SECONDS_IN[unit]
        first_s = float(whole[0]) * SECONDS_IN[unit]
    else:
        numbers = table.numbers(name)
        finite = numbers[np.isfinite(numbers)]
        first = float(finite[0]) if len(finite) else 0.0
        t_s, first_s = (numbers - first) * SECONDS_IN[unit], first * SECONDS_IN[unit]
    return t_s, first_s if 6e8 < first_s < 6e9 else None  # 1989 to 2160


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


_UNIT_TEXT: Final = re.compile(r"\(([^()]*)\)|\[([^\[\]]*)\]")
_CAMEL: Final = re.compile(r"(?<=[a-z])(?=[A-Z])")
_UNIT_NAMES: Final = {
    "accel_unit": {"m/s^2": ("m/s2", "m/s^2", "m/s²", "mps2", "ms2", "ms-2", "m s^-2"), "g": ("g",), "mg": ("mg",)},
    "gyro_unit": {
        "rad/s": ("rad/s", "radps", "rps", "rad s^-1", "radians/s", "1/s"),
        "deg/s": ("deg/s", "degps", "dps", "°/s", "degrees/s"),
        "mdeg/s": ("mdps", "mdeg/s"),
    },
    "mag_unit": {
        "uT": ("ut", "µt", "μt", "microtesla", "microteslas"),
        "mT": ("mt",),
        "nT": ("nt",),
        "T": ("t", "tesla"),
        "G": ("gauss",),
        "mG": ("mgauss",),
    },
    "baro_unit": {"hPa": ("hpa",), "Pa": ("pa",), "kPa": ("kpa",), "mbar": ("mbar", "millibar"), "bar": ("bar",)},
    "time_unit": {
        "s": ("s", "sec", "secs", "seconds", "second"),
        "ms": ("ms", "msec", "milliseconds", "millis"),
        "us": ("us", "µs", "μs", "usec", "microseconds", "micros"),
        "ns": ("ns", "nsec", "nanoseconds", "nanos"),
    },
}
_SENSOR_NAMES: Final = {
    "accel": ("a", "acc", "acce", "accel", "accelerometer", "acceleration", "linearacceleration", "accelerationwithg"),
    "linear": ("linacc", "linacce", "linearacc", "useracc", "useracceleration", "freeacc", "accelerationwithoutg"),
    "gravity": ("grav", "gravity"),
    "gyro": (
        "g", "w", "omega", "gyr", "gyro", "gyroscope", "angularvelocity", "angvel", "rotationrate", "angularrate",
    ),
    "mag": ("m", "b", "mag", "magn", "magnet", "magnetometer", "magneticfield", "field"),
    "rotation": ("q", "quat", "quaternion", "ori", "orientation", "rv", "rotation", "attitude"),
}  # fmt: skip
_TIME_NAMES: Final = (
    "t", "time", "timestamp", "ts", "seconds", "sec", "secs", "millis", "elapsed", "secondselapsed", "timeelapsed",
    "elapsedtime", "timesincestart", "date", "datetime", "unixtime", "unix", "epoch", "sampletime", "header stamp",
)  # fmt: skip
_BARO_NAMES: Final = ("pressure", "baro", "barometer", "pres", "press", "airpressure", "atmosphericpressure")
_PLACE_NAMES: Final = {
    "m": (("x", "y"), ("posx", "posy"), ("positionx", "positiony"), ("px", "py"), ("gtx", "gty"), ("refx", "refy")),
    "deg": (("lat", "lon"), ("latitude", "longitude"), ("lat", "lng"), ("lat", "long")),
}
_LEVEL_NAMES: Final = ("level", "floor", "floorid", "storey")


def guess(table: DelimitedTable) -> tuple[ColumnMap | None, list[str]]:
    """What the columns of a table are, by their names; the units by names, else by the numbers.

    Returns:
        The map, None where no time or no sensor is recognised; and what was concluded from the numbers alone.
    """
    named = {name: _split_unit(name) for name in table.columns}
    found: dict[str, Any] = {}
    assumed: list[str] = []
    axes: dict[str, dict[str, str]] = {}
    for name, (base, _) in named.items():
        for sensor, spellings in _SENSOR_NAMES.items():
            axis = _axis_of(base, spellings)
            if axis:
                axes.setdefault(sensor, {}).setdefault(axis, name)
    xyz = {sensor: tuple(of[a] for a in "xyz") for sensor, of in axes.items() if of.keys() >= set("xyz")}
    if "linear" in xyz and "accel" not in xyz:
        xyz["accel"] = xyz["linear"]
    elif "accel" in xyz:
        xyz.pop("gravity", None)
    for sensor in ("accel", "gravity", "gyro", "mag"):
        if sensor in xyz and (sensor != "gravity" or "accel" in xyz):
            found[sensor] = xyz[sensor]
    quaternion = axes.get("rotation", {})
    if quaternion.keys() >= set("wxyz"):
        found["rotation"] = tuple(quaternion[axis] for axis in "wxyz")
    bases = {base: name for name, (base, _) in reversed(named.items())}
    if baro := next((bases[base] for base in _BARO_NAMES if base in bases), None):
        found["baro"] = baro
    for unit, pairs in _PLACE_NAMES.items():
        for x, y in pairs:
            if x in bases and y in bases and "place" not in found:
                found |= {"place": (bases[x], bases[y]), "place_unit": unit}
    level = next((bases[base] for base in _LEVEL_NAMES if base in bases), None)
    if level is not None and "place" in found:
        found["level"] = level
    time = next((bases[base] for base in _TIME_NAMES if base in bases), None)
    if time is None or not found.keys() & {"accel", "gyro", "mag", "rotation", "baro"}:
        return None, assumed
    found["time"] = time
    found["time_unit"] = _unit_of("time_unit", named[time][1]) or _time_unit(table, time, assumed)
    for sensor in ("accel", "gyro", "mag", "baro"):
        if sensor in found:
            name = found[sensor] if sensor == "baro" else found[sensor][0]
            unit = _unit_of(f"{sensor}_unit", named[name][1])
            found[f"{sensor}_unit"] = unit or _unit_by_size(table, sensor, found, assumed)
    return ColumnMap(**found), assumed


def _split_unit(name: str) -> tuple[str, str]:
    """A column name in small letters without blanks and without its unit, and the unit."""
    unit = ""
    if match := _UNIT_TEXT.search(name):
        unit = (match[1] or match[2] or "").strip().lower()
        name = _UNIT_TEXT.sub(" ", name)
    parts = [part for part in re.split(r"[^a-z0-9]+", _CAMEL.sub(" ", name.lstrip("#")).lower()) if part]
    endings = {
        text: u for units in _UNIT_NAMES.values() for u, texts in units.items() for text in texts if text.isalnum()
    }
    letter = parts[-1:] in (["g"], ["t"], ["s"])  # of a name as often as of a unit
    if not unit and len(parts) > 1 and parts[-1] in endings and (not letter or parts[0] in _TIME_NAMES):
        unit = parts.pop()
    return "".join(parts), unit


def _axis_of(base: str, spellings: Sequence[str]) -> str:
    for spelling in spellings:
        for axis in "wxyz":
            if base in (spelling + axis, axis + spelling):
                return axis
    return ""


def _unit_of(kind: str, text: str) -> str:
    return next((unit for unit, texts in _UNIT_NAMES[kind].items() if text in texts), "") if text else ""


def _time_unit(table: DelimitedTable, name: str, assumed: list[str]) -> str:
    if table.columns[name].dtype.kind not in "iuf":
        try:
            table.numbers(name)
        except RecordingError:
            assumed.append("time_unit")
            return "datetime"
    t = table.numbers(name)
    first = float(t[np.isfinite(t)][0]) if np.isfinite(t).any() else 0.0
    steps = np.diff(t)
    steps = steps[np.isfinite(steps) & (steps > 0)]
    usual = float(np.median(steps)) if len(steps) else 0.0
    assumed.append("time_unit")
    if first > 6e8:  # counted since 1970
        return next(unit for unit, s in SECONDS_IN.items() if first * s < 6e9 or unit == "ns")
    return next((unit for unit, s in SECONDS_IN.items() if 1e-3 <= usual * s <= 0.3), "s")


def _unit_by_size(table: DelimitedTable, sensor: str, found: Mapping[str, Any], assumed: list[str]) -> str:
    assumed.append(f"{sensor}_unit")
    names = [found[sensor]] if sensor == "baro" else list(found[sensor])
    values = table.table(names)
    values = values[np.isfinite(values).all(axis=1)]
    if not len(values):
        return next(iter(UNITS[f"{sensor}_unit"]))
    size = np.sqrt((values**2).sum(axis=1))
    usual = float(np.median(size))
    if sensor == "accel":
        return "g" if 0.8 < usual < 1.25 else "mg" if 800 < usual < 1250 else "m/s^2"
    if sensor == "gyro":
        return "deg/s" if float(np.quantile(size, 0.99)) > 35.0 else "rad/s"
    if sensor == "mag":
        return "G" if 0.2 < usual < 0.75 else "uT"
    return "Pa" if usual > 5e4 else "kPa" if 50.0 < usual < 110.0 else "hPa"
