"""Which column of a table is which sensor, concluded from the names in its header and the size of its numbers."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray
from pdrbench_formats.recordings.columnmap import SECONDS_IN, UNITS, ColumnMap
from pdrbench_formats.recordings.delimited import DelimitedTable

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
