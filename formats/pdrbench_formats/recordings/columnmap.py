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
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, Literal

import msgspec
import numpy as np

from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray, IntArray
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
_DAY_NS: Final = 86_400 * 10**9
_TIME_OF_DAY: Final = r"\d{1,2}:\d{2}:\d{2}(?:[.,]\d+)?"
_CLOCK_COLON: Final = r"(\d:\d{2}:\d{2})[:,](\d+)"  # 13:45:12:123
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
    t_s, first_s = clock(table, columns.time, columns.time_unit)
    streams = streams_of(table, columns, t_s, tally)
    reference, geo = _reference(table, columns, t_s, tally)
    return assemble(
        path,
        streams,
        reference=reference,
        origin=Origin(device=columns.device, start_unix_s=unix_s(first_s), geo=geo, mounting=columns.mounting),
        tally=tally,
        strict=strict,
    )


def streams_of(table: DelimitedTable, columns: ColumnMap, t_s: FloatArray, tally: Tally) -> dict[str, FloatArray]:
    """(T, C) rows by sensor of one table at times (N,); columns that are not read are counted."""
    tally.mended += table.mended
    tally.dropped += table.dropped
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
        pressure = table.numbers(columns.baro) * UNITS["baro_unit"][columns.baro_unit]
        streams["baro"] = _given(np.column_stack([t_s, np.where(pressure == 0.0, np.nan, pressure)]))
    used = {columns.time, columns.baro, columns.level, *(columns.place or ())}
    for name in ("accel", "gravity", "gyro", "mag", "rotation"):
        used |= {axis if axis in table.columns else axis.removeprefix("-") for axis in getattr(columns, name) or ()}
    tally.skipped.update({f"column {name}": len(table) for name in table.columns if name not in used})
    return streams


def clock(table: DelimitedTable, name: str, unit: str) -> tuple[FloatArray, float]:
    """(N,) seconds since the first row, and the time of that row on the clock of the column."""
    if unit == "datetime":
        ns = _stamps_ns(table, name)
        return seconds(ns, int(ns[0])), float(ns[0]) * 1e-9
    whole = table.whole(name)
    if whole is not None and len(whole):
        return (whole - whole[0]).astype(np.float64) * SECONDS_IN[unit], float(whole[0]) * SECONDS_IN[unit]
    numbers = table.numbers(name)
    finite = numbers[np.isfinite(numbers)]
    first = float(finite[0]) if len(finite) else 0.0
    return (numbers - first) * SECONDS_IN[unit], first * SECONDS_IN[unit]


def unix_s(first_s: float) -> float | None:
    """A time where it counts from 1970: one from 1989 to 2160."""
    return first_s if 6e8 < first_s < 6e9 else None


def _stamps_ns(table: DelimitedTable, name: str) -> IntArray:
    """(N,) nanoseconds of dates, or of times of day, which go on after midnight."""
    import pandas as pd

    texts = pd.Series(table.texts(name), dtype=object).str.replace(_CLOCK_COLON, r"\1.\2", regex=True)
    try:
        if texts.str.fullmatch(_TIME_OF_DAY).all():
            ns = pd.to_timedelta(texts).to_numpy().astype("timedelta64[ns]").astype(np.int64)
            return ns + _DAY_NS * np.cumsum(np.diff(ns, prepend=ns[:1]) < -_DAY_NS // 2)
        stamps = pd.to_datetime(texts, utc=True, format="mixed").dt.tz_localize(None)
    except (ValueError, TypeError, OverflowError) as error:  # pandas raises all of them for texts of other kinds
        raise RecordingError(f"{table.path}: {name}: not a date: {error}; write ISO dates or seconds") from error
    return stamps.to_numpy().astype("datetime64[ns]").astype(np.int64)


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
    "accel_unit": {
        "m/s^2": ("m/s2", "m/s^2", "m/s²", "m/s/s", "mps2", "ms2", "ms-2", "m s^-2"),
        "g": ("g",),
        "mg": ("mg",),
    },
    "gyro_unit": {
        "rad/s": ("rad/s", "rads", "radps", "rps", "rad/sec", "rad s^-1", "radians/s", "1/s"),
        "deg/s": ("deg/s", "degs", "degps", "dps", "deg/sec", "°/s", "degrees/s"),
        "mdeg/s": ("mdps", "mdeg/s"),
    },
    "mag_unit": {
        "uT": ("ut", "µt", "μt", "microtesla", "microteslas"),
        "mT": ("mt",),
        "nT": ("nt",),
        "T": ("t", "tesla"),
        "G": ("gauss", "g"),
        "mG": ("mgauss", "mg"),
    },
    "baro_unit": {"hPa": ("hpa",), "Pa": ("pa",), "kPa": ("kpa",), "mbar": ("mbar", "millibar"), "bar": ("bar",)},
    "time_unit": {
        "s": ("s", "sec", "secs", "seconds", "second"),
        "ms": ("ms", "msec", "milliseconds", "millis"),
        "us": ("us", "µs", "μs", "usec", "microseconds", "micros"),
        "ns": ("ns", "nsec", "nanoseconds", "nanos"),
    },
}
_ENDINGS: Final = sorted(
    {text for units in _UNIT_NAMES.values() for texts in units.values() for text in texts}, key=len, reverse=True
)
_LETTERS: Final = ("g", "t", "s")  # of a name as often as of a unit
# names that are a sensor as they stand, and words that are one at the end of a longer name
_SENSOR_NAMES: Final = {
    "accel": ("a", "f", "gf", "linearacceleration"),
    "gyro": ("g", "w", "omega"),
    "mag": ("m", "b", "field", "compass"),
    "rotation": ("q", "ori", "orientation", "rv", "rotation", "attitude"),
}
_SENSOR_WORDS: Final = {
    "gravity": ("gravity", "grav"),
    "accel": (
        "accelerometer", "acceleration", "accel", "acce", "acc", "specificforce", "gforce", "accelerationwithg",
        "beschleunigung", "beschl",
    ),
    "gyro": (
        "gyroscope", "gyro", "gyr", "angularvelocity", "angvel", "angularrate", "rotationrate", "rotrate",
        "gyrorotation", "drehrate", "gyroskop",
    ),
    "mag": ("magnetometer", "magneticfield", "magnetic", "magnet", "magn", "mag", "magnetfeld"),
    "rotation": ("quaternion", "quat"),
    "baro": ("barometer", "airpressure", "pressure", "druck"),
}  # fmt: skip
_LINEAR: Final = ("lin", "user", "free", "without", "nog")  # before or in a word of acceleration: gravity is not in it
_OTHER: Final = (
    "uncal", "bias", "offset", "std", "sigma", "cov", "accuracy", "temp", "norm", "abs", "ref", "truth", "watch",
    "wrist", "headphone", "angularacceleration",
)  # fmt: skip
_FILLERS: Final = ("raw", "data", "value", "values", "val", "calibrated", "cal", "axis", "sensor")
_TIME_NAMES: Final = (
    "t", "time", "timestamp", "ts", "seconds", "sec", "secs", "millis", "elapsed", "secondselapsed", "timeelapsed",
    "elapsedtime", "timesincestart", "date", "datetime", "unixtime", "unix", "epoch", "sampletime", "zeit", "temps",
    "tiempo", "tempo", *(text for texts in _UNIT_NAMES["time_unit"].values() for text in texts if len(text) > 1),
)  # fmt: skip
_BARO_NAMES: Final = ("pressure", "baro", "barometer", "pres", "press", "airpressure", "atmosphericpressure", "p")
_PRESSURE_RANGES: Final = ((500.0, 1100.0), (5e4, 1.1e5), (50.0, 110.0))  # hPa, Pa, kPa
_PLACE_NAMES: Final = {
    "m": (("x", "y"), ("posx", "posy"), ("positionx", "positiony"), ("px", "py"), ("gtx", "gty"), ("refx", "refy")),
    "deg": (("lat", "lon"), ("latitude", "longitude"), ("lat", "lng"), ("lat", "long")),
}
_LEVEL_NAMES: Final = ("level", "floor", "floorid", "storey")
_MOST: Final = 1e12  # of any value: nothing of a walk comes near
_MAX_SEEN: Final = 5000  # rows that names in doubt are judged by


def guess(table: DelimitedTable, sensor: str = "") -> tuple[ColumnMap | None, list[str]]:
    """What the columns of a table are, by their names; the units by names, else by the numbers.

    Args:
        table: Any.
        sensor: Of columns that are named by their axis only, as the name of the file says: a key of `SENSORS`.

    Returns:
        The map, None where no time or no sensor is recognised; and what was concluded from the numbers alone, or chosen
        among several that it might be.
    """
    named = {name: _split_unit(name) for name in table.columns}
    named |= {name: (named[name][0], unit.strip("()[] ").lower()) for name, unit in table.units.items() if unit}
    found: dict[str, Any] = {}
    assumed: list[str] = []
    groups: dict[tuple[int, str, str], dict[str, str]] = {}
    for name, (base, _) in named.items():
        for axis, stem in _axes_of(base):
            kind, rank = (sensor, 0) if sensor and stem in ("", *_FILLERS) else sensor_of(stem)
            if kind and axis not in groups.setdefault((rank, kind, stem), {}):
                groups[rank, kind, stem][axis] = name
    whole = {
        key: tuple(axes[axis] for axis in ("wxyz" if key[1] == "rotation" else "xyz"))
        for key, axes in groups.items()
        if axes.keys() >= set("wxyz" if key[1] == "rotation" else "xyz")
    }
    for kind in ("accel", "gravity", "gyro", "mag", "rotation"):
        of = {
            key: names for key, names in whole.items() if key[1] in ((kind, "linear") if kind == "accel" else (kind,))
        }
        if kind == "accel" and len(of) > 1:
            of = {key: names for key, names in of.items() if _has_gravity(table, names)} or of
        if kind == "gravity" and ("accel" not in found or _has_gravity(table, found["accel"])):
            continue
        best = min(of, key=lambda key: (key[1] == "linear", key[0]), default=None)
        if best is not None:
            found[kind] = of[best]
            if sum(key[:2] == best[:2] for key in of) > 1:
                assumed.append(kind)
    bases = {base: name for name, (base, _) in reversed(named.items())}
    baro = next((bases[base] for base in _BARO_NAMES if base in bases), None)
    if baro is None and sensor == "baro":
        baro = next((bases[base] for base in ("x", *_FILLERS) if base in bases), None)
    if baro is not None and (named[baro][0] != "p" or _is_pressure(table, baro)):
        found["baro"] = baro
    level = next((bases[base] for base in _LEVEL_NAMES if base in bases), None)
    for unit, pairs in _PLACE_NAMES.items():
        for x, y in pairs:
            # latitude and longitude in a log are what the phone itself took for its place, unless a person was there
            if x in bases and y in bases and "place" not in found and not sensor and (unit == "m" or level is not None):
                found |= {"place": (bases[x], bases[y]), "place_unit": unit}
    if level is not None and "place" in found:
        found["level"] = level
    time = _time_column(table, {name: base for name, (base, _) in named.items()})
    if time is None or not found.keys() & {"accel", "gyro", "mag", "rotation", "baro"}:
        return None, assumed
    found["time"] = time
    stated = _unit_of("time_unit", named[time][1] or named[time][0])
    found["time_unit"] = stated or _time_unit(table, time, assumed)
    for kind in ("accel", "gyro", "mag", "baro"):
        if kind in found:
            name = found[kind] if kind == "baro" else found[kind][0]
            unit = _unit_of(f"{kind}_unit", named[name][1])
            found[f"{kind}_unit"] = unit or _unit_by_size(table, kind, found, assumed)
    return ColumnMap(**found), assumed


def sensor_of(name: str) -> tuple[str, int]:
    """The sensor that a name without axis, unit and blanks stands for, or "linear", or ""; and how far it is from sure.

    >>> sensor_of("gyro"), sensor_of("lsm6ds3accelerometer"), sensor_of("useraccel"), sensor_of("gyrobias")
    (('gyro', 0), ('accel', 1), ('linear', 1), ('', 0))
    """
    if kind := next((kind for kind, names in _SENSOR_NAMES.items() if name in names), ""):
        return kind, 0
    name = _without_fillers(name)
    if any(word in name for word in _OTHER):
        return "", 0
    for kind, words in _SENSOR_WORDS.items():
        if word := next((word for word in sorted(words, key=len, reverse=True) if name.endswith(word)), ""):
            if kind == "accel" and any(other in name for other in _LINEAR):
                return "linear", 1
            return kind, int(word != name)
    return "", 0


def _without_fillers(name: str) -> str:
    while filler := next((filler for filler in _FILLERS if name.endswith(filler) and name != filler), ""):
        name = name.removesuffix(filler)
    return name


def _split_unit(name: str) -> tuple[str, str]:
    """A column name in small letters without blanks and without its unit, and the unit."""
    unit = ""
    if match := _UNIT_TEXT.search(name):
        unit = (match[1] or match[2] or "").strip().lower()
        name = _UNIT_TEXT.sub(" ", name)
    plain = name.lstrip("#").strip()
    spaced = _CAMEL.sub(" ", plain).lower()
    for text in (plain.lower(), spaced) if not unit else ():
        ends = (end for end in _ENDINGS if text.endswith(end) and text[: -len(end)][-1:] in tuple(" _-.,/"))
        unit = next((end for end in ends if _is_unit(end, _bare(text.removesuffix(end)))), "")
        if unit:
            return _bare(text.removesuffix(unit)), unit
    return _bare(spaced), unit


def _bare(name: str) -> str:
    return "".join(re.split(r"[\W_]+", name))


def _is_unit(text: str, base: str) -> bool:
    """Whether the end of a name is a unit; a letter is one of times, and g of accelerations."""
    if text == "g":
        return any(sensor_of(stem)[0] in ("accel", "linear") for _, stem in _axes_of(base))
    return text not in _LETTERS or base in _TIME_NAMES


def _axes_of(base: str) -> list[tuple[str, str]]:
    """Each way to read a name as an axis and the rest."""
    base = _without_fillers(base)
    return [(base[-1:], base[:-1])] * (base[-1:] in tuple("wxyz")) + [(base[:1], base[1:])] * (
        base[:1] in tuple("wxyz")
    )


def _unit_of(kind: str, text: str) -> str:
    return next((unit for unit, texts in _UNIT_NAMES[kind].items() if text in texts), "") if text else ""


def finite(values: FloatArray) -> FloatArray:
    """The rows of a table in which all are numbers, cut to what squares do not overflow."""
    return np.clip(values[np.isfinite(values).all(axis=1)], -_MOST, _MOST)


def _seen(table: DelimitedTable, names: Sequence[str]) -> FloatArray:
    """The first rows of some columns in which all have a number."""
    part = DelimitedTable(
        table.path, {name: table.columns[name][:_MAX_SEEN] for name in names}, table.first_line, Counter(), Counter()
    )
    try:
        values = part.table(names)
    except RecordingError:  # a text in it, which reading the column refuses with the line
        return np.zeros((0, len(names)))
    return finite(values)


def _has_gravity(table: DelimitedTable, names: Sequence[str]) -> bool:
    """Whether the mean of a vector over some rows is about as long as the vector: the shaking of a walk cancels."""
    values = _seen(table, names)
    if not len(values):
        return False
    num = max(len(values) // 50, 1)
    means = values[: len(values) // num * num].reshape(num, -1, 3).mean(axis=1)
    lengths = [float(np.median(np.sqrt((vectors**2).sum(axis=1)))) for vectors in (means, values)]
    return lengths[0] > 0.6 * lengths[1]


def _is_pressure(table: DelimitedTable, name: str) -> bool:
    values = _seen(table, [name])
    middle = float(np.median(values)) if len(values) else 0.0
    return any(low < middle < high for low, high in _PRESSURE_RANGES)


def _time_column(table: DelimitedTable, bases: Mapping[str, str]) -> str | None:
    """The column of the time; of several the one with most different values: dates may be to the second."""
    exact = sorted((_TIME_NAMES.index(base), name) for name, base in bases.items() if base in _TIME_NAMES)
    found = [name for _, name in exact] or [name for name, base in bases.items() if "time" in base]
    values = [[str(value) for value in table.columns[name][:_MAX_SEEN]] for name in found]
    return max(zip(found, values, strict=True), key=lambda pair: len(set(pair[1])))[0] if found else None


def _time_unit(table: DelimitedTable, name: str, assumed: list[str]) -> str:
    if table.columns[name].dtype.kind not in "iuf":
        try:
            table.numbers(name)
        except RecordingError:
            assumed.append("time_unit")
            return "datetime"
    t = table.numbers(name)
    t = t[np.isfinite(t)]
    first = float(t[0]) if len(t) else 0.0
    steps = np.diff(t)
    steps = steps[steps > 0]
    usual = float(np.median(steps)) if len(steps) else 0.0
    assumed.append("time_unit")
    if first > 6e8:  # counted since 1970
        return next(unit for unit, s in SECONDS_IN.items() if first * s < 6e9 or unit == "ns")
    return next((unit for unit, s in SECONDS_IN.items() if 1e-3 <= usual * s <= 0.3), "s")


def _unit_by_size(table: DelimitedTable, sensor: str, found: Mapping[str, Any], assumed: list[str]) -> str:
    assumed.append(f"{sensor}_unit")
    names = [found[sensor]] if sensor == "baro" else list(found[sensor])
    values = finite(table.table(names))
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
