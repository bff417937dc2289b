"""Which column of a table is which sensor, concluded from the names in its header and the size of its numbers."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, Final

import numpy as np

from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray
from pdrbench.sensors.checks import MAX_RATE_RADPS, MIN_ROWS
from pdrbench_formats.recordings.axes import turns_gravity, turns_in_degrees
from pdrbench_formats.recordings.columnmap import SECONDS_IN, UNITS, ColumnMap, clock
from pdrbench_formats.recordings.delimited import DelimitedTable
from pdrbench_formats.recordings.texts import WORDS

_UNIT_TEXT: Final = re.compile(r"\(([^()]*)\)|\[([^\[\]]*)\]")
_INDEX: Final = re.compile(r"[(\[]\s*(\d+|[wxyzWXYZ])\s*[)\]]")  # the axis, as of `accel[0]` and `Accelerometers[X]`
_CAMEL: Final = re.compile(r"(?<=[a-z])(?=[A-Z])")
_SECONDS: Final = ("s", "sec", "secs", "second", "seconds", "sekunden")
_UNIT_NAMES: Final[Mapping[str, Mapping[str, Sequence[str]]]] = {
    **WORDS["units"],
    "time_unit": {
        unit: [f"{short}{word}" for short in shorts for word in _SECONDS]
        for unit, shorts in WORDS["units"]["time_unit"].items()
    },
}
_AFTER_AXIS: Final = re.compile(r"(.*)[\W_]?([wxyz])[\W_]+(.+)")  # a name, its axis, and what can only be a unit
_ENDINGS: Final = sorted(
    {text for units in _UNIT_NAMES.values() for texts in units.values() for text in texts}, key=len, reverse=True
)
_W3C: Final = {"alpha": "z", "beta": "x", "gamma": "y"}  # rates in the DeviceMotion of browsers
_LETTERS: Final = ("g", "t", "s")  # of a name as often as of a unit
_SENSOR_NAMES: Final[Mapping[str, Sequence[str]]] = WORDS["sensors"]["alone"]
_SENSOR_WORDS: Final[Mapping[str, Sequence[str]]] = WORDS["sensors"]["ending"]
_OTHER, _FILLERS = WORDS["columns"]["other"], WORDS["columns"]["fillers"]
_LINEAR: Final = re.compile("|".join(WORDS["columns"]["linear"]))
TIME_NAMES: Final[Sequence[str]] = [
    *WORDS["columns"]["time"],
    *(text for texts in _UNIT_NAMES["time_unit"].values() for text in texts if len(text) > 1),
]
_BARO_NAMES: Final[Sequence[str]] = WORDS["columns"]["baro"]
LEVEL_NAMES: Final[Sequence[str]] = WORDS["columns"]["level"]
_PRESSURE_RANGES: Final = ((500.0, 1100.0), (5e4, 1.1e5), (50.0, 110.0))  # hPa, Pa, kPa
_PLACE_NAMES: Final = {unit: WORDS["columns"][f"place_{unit}"] for unit in ("m", "deg")}
_MOST: Final = 1e12  # of any value: nothing of a walk comes near
_MAX_SEEN: Final = 5000  # rows that names in doubt are judged by
_STEPS_S: Final = (1e-3, 0.5)  # between rows: 1000 to 2 Hz, less than the thousand between two units
_SAMPLED_S: Final = (1e-3, 0.05)  # of inertial sensors: 1000 to 20 Hz
_MIN_FIELD_UT: Final = 5.0  # less is no field of the Earth, in whatever is taken for the unit
_RARE_S: Final = (1e-4, 2.0)  # no less and no more, whatever a header states


def guess(table: DelimitedTable, sensor: str = "", *, shared: bool = False) -> tuple[ColumnMap | None, list[str]]:
    """What the columns of a table are, by their names; the units by names, else by the numbers.

    Args:
        table: Any.
        sensor: Of columns that are named by their axis only, as the name of the file says: a key of `SENSORS`.
        shared: Whether other tables are on the clock: a time since 1970 is taken where there is one.

    Returns:
        The map, None where no sensor is recognised, and without `time` where no time is; and what was concluded from
        the numbers alone, or chosen among several that it might be.
    """
    named = {name: split_unit(name) for name in table.columns}
    named |= _by_number(named)
    named |= {name: (named[name][0], unit.strip("()[] ").lower()) for name, unit in table.units.items() if unit}
    found: dict[str, Any] = {}
    assumed: list[str] = []
    groups: dict[tuple[int, str, str], dict[str, str]] = {}
    unknown: dict[str, dict[str, str]] = {}  # columns of vectors whose word is not known, by it
    for name, (base, unit) in named.items():
        for axis, stem in _axes_of(base):
            kind, rank = (sensor or sensor_by(unit), 0) if stem in ("", *_FILLERS) else sensor_of(stem)
            if not kind and not any(word in stem for word in _OTHER):
                # a word of another language, or before another, or a letter after what all names begin with
                kind, rank = sensor_by(unit) or sensor_in(name) or sensor_of(_letter_before(axis, name))[0], 2
            owner = f"{stem} {unit}" if unit and unit not in _ENDINGS else stem  # what no unit is called names a device
            if kind:
                groups.setdefault((rank, kind, owner), {}).setdefault(axis, name)
            elif stem not in ("", *_FILLERS) and not any(word in stem for word in _OTHER):
                unknown.setdefault(stem, {}).setdefault(axis, name)
    whole = {
        key: tuple(axes[axis] for axis in ("wxyz" if key[1] == "rotation" else "xyz"))
        for key, axes in groups.items()
        if axes.keys() >= set("wxyz" if key[1] == "rotation" else "xyz")
    }
    bases = {base: name for name, (base, _) in reversed(named.items())}
    plain = [bases.get(axis, "") for axis in "xyz"]
    kinds = {key[1] for key in whole}
    if all(plain) and "gyro" in kinds and not kinds & {"accel", "linear"} and _is_force(table, plain):
        whole[2, "accel", ""] = tuple(plain)
        bases = {base: name for base, name in bases.items() if name not in plain}
        assumed.append("accel")
    vectors = [tuple(axes[axis] for axis in "xyz") for axes in unknown.values() if axes.keys() >= set("xyz")]
    if not kinds & {"accel", "linear"} and len(forces := [names for names in vectors if _is_force(table, names)]) == 1:
        whole.setdefault((2, "accel", ""), forces[0])
    for kind in ("accel", "gravity", "gyro", "mag", "rotation"):
        of = {
            key: names for key, names in whole.items() if key[1] in ((kind, "linear") if kind == "accel" else (kind,))
        }
        if kind == "accel" and len(of) > 1:
            of = {key: names for key, names in of.items() if has_gravity(table, names)} or of
        if kind == "gravity" and ("accel" not in found or has_gravity(table, found["accel"])):
            continue
        best = min(of, key=lambda key: (key[1] == "linear", key[0]), default=None)
        if best is not None:
            found[kind] = of[best]
            if sum(key[:2] == best[:2] for key in of) > 1:
                assumed.append(kind)
    baro = next((bases[base] for base in _BARO_NAMES if base in bases), None)
    if baro is None and sensor == "baro":
        baro = next((bases[base] for base in ("x", *_FILLERS) if base in bases), None)
    in_pressure = (name for name, (_, unit) in named.items() if unit_of("baro_unit", unit))
    baro = baro or next((name for name in in_pressure if _is_pressure(table, name)), None)
    if baro is not None and (named[baro][0] != "p" or _is_pressure(table, baro)):
        found["baro"] = baro
    level = next((bases[base] for base in LEVEL_NAMES if base in bases), None)
    for unit, pairs in _PLACE_NAMES.items():
        for x, y in pairs:
            # latitude and longitude in a log are what the phone itself took for its place, unless a person was there
            if x in bases and y in bases and "place" not in found and not sensor and (unit == "m" or level is not None):
                found |= {"place": (bases[x], bases[y]), "place_unit": unit}
    if level is not None and "place" in found:
        found["level"] = level
    if not found.keys() & {"accel", "gyro", "mag", "rotation", "baro"}:
        return None, assumed
    bases_of = {name: base for name, (base, _) in named.items()}
    taken = {name for value in found.values() if not isinstance(value, str) for name in value} | {baro or ""}
    time = _time_column(table, bases_of, shared=shared) or _time_by_growth(table, set(table.columns) - taken)
    if time is not None:
        found["time"] = time
        stated = unit_of("time_unit", named[time][1]) or unit_of("time_unit", unit_in(named[time][0]))
        found["time_unit"] = stated if stated and _is_numeric(table, time) else time_unit_of(table, time)
        assumed += [] if stated else ["time_unit"]
    if "gyro" not in found and len(turning := [one for one in vectors if _turns(table, {**found, "gyro": one})]) == 1:
        found["gyro"] = turning[0]
    for kind in ("accel", "gyro", "mag", "baro"):
        if kind in found:
            name = found[kind] if kind == "baro" else found[kind][0]
            unit = unit_of(f"{kind}_unit", named[name][1])
            found[f"{kind}_unit"] = unit or _unit_by_size(table, kind, found, assumed)
    if "mag_unit" in assumed and _length_of(table, found["mag"]) * UNITS["mag_unit"][found["mag_unit"]] < _MIN_FIELD_UT:
        assumed.remove("mag_unit")
        del found["mag"], found["mag_unit"]  # of no unit: listed among the columns that are not read
    return ColumnMap(**found), assumed


def _by_number(named: Mapping[str, tuple[str, str]]) -> dict[str, tuple[str, str]]:
    """The names and units whose names end in 0, 1, 2 or in 1, 2, 3, with the axes x, y, z in their place."""
    bases = [base for base, _ in named.values() if len(base) > 1]
    ends = {base[:-1]: "".join(sorted(one[-1] for one in bases if one[:-1] == base[:-1])) for base in bases}
    # digits behind axes number devices
    numbered = [
        (stem, digits)
        for stem, digits in ends.items()
        if digits in ("012", "123") and not {f"{stem[:-1]}{axis}" for axis in "xyz"} <= ends.keys()
    ]
    axes = {f"{stem}{digits[k]}": f"{stem}{'xyz'[k]}" for stem, digits in numbered for k in range(3)}
    for base in bases:
        for word, axis in _W3C.items():
            stem = base.removesuffix(word)
            axes |= {base: f"{stem}{axis}"} if stem != base and sensor_of(stem)[0] == "gyro" else {}
    return {name: (axes[base], unit) for name, (base, unit) in named.items() if base in axes}


def named_by_place(table: DelimitedTable, sensor: str) -> DelimitedTable:
    """Columns without names, in the order of Android: the first that is a time, then x, y, z, and w of an attitude."""
    names, listed = ("time", *("xyzw" if sensor == "rotation" else "xyz")), list(table.columns)
    first = listed.index(next(iter(_growing(table, listed)), listed[0]))
    columns = dict(zip(names, list(table.columns.values())[first:], strict=False))
    return DelimitedTable(table.path, columns, table.first_line, table.mended, table.dropped)


def sensor_by(unit: str) -> str:
    """The sensor with axes that alone is measured in a unit; g is of accelerations."""
    return next((kind for kind in ("accel", "gyro", "mag") if unit_of(f"{kind}_unit", unit)), "")


def unit_in(base: str) -> str:
    """The unit of a time whose name has no separator before it: `timens`, `tms`."""
    if unit_of("time_unit", base):
        return base
    texts = sorted((text for texts in _UNIT_NAMES["time_unit"].values() for text in texts), key=len, reverse=True)
    ends = (text for text in texts if len(text) > 1 and base.endswith(text))
    return next((text for text in ends if base.removesuffix(text) in TIME_NAMES or "time" in base), "")


def doubted_unit(table: DelimitedTable, columns: ColumnMap) -> str:
    """The unit that the step of a time fits, where it does not fit the one that is stated; "" where it does."""
    if columns.time_unit == "datetime" or not columns.time:
        return ""
    step = usual_step(table, columns.time)
    is_likely = _RARE_S[0] <= step * SECONDS_IN[columns.time_unit] < _RARE_S[1]
    fitting = [unit for unit, s in SECONDS_IN.items() if _SAMPLED_S[0] <= step * s <= _SAMPLED_S[1]]
    return fitting[0] if fitting and not is_likely else ""


def usual_step(table: DelimitedTable, name: str) -> float:
    """The median step of a column of times, 0 where none is positive."""
    t = table.numbers(name)
    steps = np.diff(t[np.isfinite(t)])
    steps = steps[steps > 0]
    return float(np.median(steps)) if len(steps) else 0.0


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
            if kind == "accel" and _LINEAR.search(name):
                return "linear", 1
            return kind, int(word != name)
    return "", 0


def sensor_in(text: str) -> str:
    """The sensor that the name of a file or of a kind of records says, "linear", or "".

    >>> sensor_in("MetaWear_D1A2_Accelerometer_100.000Hz"), sensor_in("android.sensor.gyroscope"), sensor_in("walk 3")
    ('accel', 'gyro', '')
    """
    words = re.findall(r"[^\W\d_]+", _CAMEL.sub(" ", text).lower())
    joined = "".join(words)
    kind = sensor_of(joined)[0] if len(joined) > 1 else ""
    if kind or any(word in joined for word in _OTHER):
        return kind
    kinds = {kind for word in words if len(word) > 2 and (kind := sensor_of(word)[0])}
    if "accel" in kinds and _LINEAR.search(joined):
        return "linear"
    return kinds.pop() if len(kinds) == 1 else ""


def guess_by_place(table: DelimitedTable) -> ColumnMap | None:
    """What columns without names may be: a time that grows, then vectors, the first with gravity being the force."""
    names = list(table.columns)
    times = _growing(table, names)[:1]
    names = names[names.index(times[0]) + 1 if times else 0 :]
    changing = [name for name in names if len(values := _seen(table, [name])) and np.ptp(values)]
    vectors = [tuple(changing[k : k + 3]) for k in range(0, len(changing) - 2, 3)]
    force = next((vector for vector in vectors if _is_force(table, vector)), None)
    if force is None:
        return None
    found: dict[str, Any] = {"accel": force, "header_line": 0}
    found |= {"time": times[0], "time_unit": time_unit_of(table, times[0])} if times else {"rate_hz": 100.0}
    assumed: list[str] = []
    found["accel_unit"] = _unit_by_size(table, "accel", found, assumed)
    if others := [vector for vector in vectors if vector != force]:
        found["gyro"] = next((vector for vector in others if _turns(table, {**found, "gyro": vector})), others[0])
        found["gyro_unit"] = _unit_by_size(table, "gyro", found, assumed)
    return ColumnMap(**found)


def _without_fillers(name: str) -> str:
    while filler := next((filler for filler in _FILLERS if name.endswith(filler) and name != filler), ""):
        name = name.removesuffix(filler)
    return name


def split_unit(name: str) -> tuple[str, str]:
    """A column name in small letters without blanks and without its unit, and the unit."""
    unit = ""
    name = _INDEX.sub(r" \1 ", name)
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
    after = _AFTER_AXIS.fullmatch(plain.lower()) if not unit else None
    if after is not None and sensor_of(_bare(after[1]))[0]:
        return _bare(after[1]) + after[2], after[3]
    return _bare(spaced), unit


def _bare(name: str) -> str:
    return "".join(re.split(r"[\W_]+", name))


def _is_unit(text: str, base: str) -> bool:
    """Whether the end of a name is a unit; a letter is one of times, and g of accelerations."""
    if text == "g":
        return any(sensor_of(stem)[0] in ("accel", "linear") for _, stem in _axes_of(base))
    return text not in _LETTERS or base in TIME_NAMES


def _axes_of(base: str) -> list[tuple[str, str]]:
    """Each way to read a name as an axis and the rest."""
    base = _without_fillers(base)
    return [(base[-1:], base[:-1])] * (base[-1:] in tuple("wxyz")) + [(base[:1], base[1:])] * (
        base[:1] in tuple("wxyz")
    )


def _letter_before(axis: str, name: str) -> str:
    """The letter before an axis that ends a name of several words: a of `imu_ax`."""
    match = re.search(rf"[\W_]([a-z])[\W_]?{axis}[\W_]*$", _UNIT_TEXT.sub("", _CAMEL.sub("_", name)).lower())
    return "" if match is None else match[1]


def unit_of(kind: str, text: str) -> str:
    return next((unit for unit, texts in _UNIT_NAMES[kind].items() if text in texts), "") if text else ""


def finite(values: FloatArray) -> FloatArray:
    """The rows of a table in which all are numbers, cut to what squares do not overflow."""
    return np.clip(values[np.isfinite(values).all(axis=1)], -_MOST, _MOST)


def _beginning(table: DelimitedTable, names: Sequence[str]) -> DelimitedTable:
    """The first rows of some columns."""
    columns = {name: table.columns[name][:_MAX_SEEN] for name in names}
    return DelimitedTable(table.path, columns, table.first_line, Counter(), Counter())


def _seen(table: DelimitedTable, names: Sequence[str]) -> FloatArray:
    """The first rows of some columns in which all have a number."""
    part = _beginning(table, names)
    try:
        values = part.table(names)
    except RecordingError:  # a text in it, which reading the column refuses with the line
        return np.zeros((0, len(names)))
    return finite(values)


def has_gravity(table: DelimitedTable, names: Sequence[str]) -> bool:
    """Whether the mean of a vector over some rows is about as long as the vector: the shaking of a walk cancels."""
    values = _seen(table, names)
    if not len(values):
        return False
    num = max(len(values) // 50, 1)
    means = values[: len(values) // num * num].reshape(num, -1, 3).mean(axis=1)
    lengths = [float(np.median(np.sqrt((vectors**2).sum(axis=1)))) for vectors in (means, values)]
    return lengths[0] > 0.6 * lengths[1]


def _is_force(table: DelimitedTable, names: Sequence[str]) -> bool:
    """Whether a vector has gravity, and is usually as long as that in one of the units of acceleration."""
    if not has_gravity(table, names):
        return False
    usual = _length_of(table, names)
    return any(0.8 < usual * factor / UNITS["accel_unit"]["g"] < 1.25 for factor in UNITS["accel_unit"].values())


def _length_of(table: DelimitedTable, names: Sequence[str]) -> float:
    """The usual length of a vector, 0 where no row has it."""
    values = _seen(table, names)
    return float(np.median(np.sqrt((values**2).sum(axis=1)))) if len(values) else 0.0


def _is_pressure(table: DelimitedTable, name: str) -> bool:
    values = _seen(table, [name])
    middle = float(np.median(values)) if len(values) else 0.0
    return any(low < middle < high for low, high in _PRESSURE_RANGES)


def _time_column(table: DelimitedTable, bases: Mapping[str, str], *, shared: bool) -> str | None:
    """The column of the time; of several the one with most different values: dates may be to the second."""
    exact = sorted(
        (TIME_NAMES.index(base.removesuffix(unit_in(base)) or base), name)
        for name, base in bases.items()
        if (base.removesuffix(unit_in(base)) or base) in TIME_NAMES
    )
    found = [name for _, name in exact] or [name for name, base in bases.items() if "time" in base]
    different = {name: len({str(value) for value in table.columns[name][:_MAX_SEEN]}) for name in found}
    if shared:
        exact_enough = 0.9 * max(different.values(), default=0)
        found = [name for name in found if different[name] >= exact_enough and _is_epoch(table, name)] or found
    return max(found, key=lambda name: (different[name], _is_numeric(table, name)), default=None)


def _is_numeric(table: DelimitedTable, name: str) -> bool:
    """Whether a column holds numbers, and no dates."""
    if table.columns[name].dtype.kind in "iuf":
        return True
    try:
        _beginning(table, [name]).numbers(name)
    except RecordingError:
        return False
    return True


def _time_by_growth(table: DelimitedTable, names: Collection[str]) -> str | None:
    """The one column, whatever its name, that grows from row to row as a clock does."""
    found = _growing(table, [name for name in table.columns if name in names])
    return found[0] if len(found) == 1 else None


def _growing(table: DelimitedTable, names: Sequence[str]) -> list[str]:
    """Columns that grow from row to row as a clock does; one that counts rows is none."""
    found = []
    for name in names:
        part = _beginning(table, [name])
        try:
            t, _ = clock(part, name, "s" if table.columns[name].dtype.kind in "iuf" else "datetime")
        except RecordingError:
            continue
        steps = np.diff(t)
        grows = len(steps) >= MIN_ROWS and np.isfinite(steps).all() and (steps >= 0).all() and (steps > 0).mean() > 0.9
        if grows and not (steps == 1.0).all() and float(np.quantile(steps, 0.9)) < 3.0 * float(np.median(steps)):
            found.append(name)
    return found


def _is_epoch(table: DelimitedTable, name: str) -> bool:
    """Whether a time counts from 1970, in any unit."""
    try:
        first = _beginning(table, [name]).numbers(name)[:1]
    except RecordingError:  # a date
        return True
    return bool(len(first)) and any(6e8 < first[0] * s < 6e9 for s in SECONDS_IN.values())


def time_unit_of(table: DelimitedTable, name: str) -> str:
    """The unit of a time in which its rows come at the rate of a sensor, or it counts from 1970; or "datetime"."""
    if not _is_numeric(table, name):
        return "datetime"
    step, t = usual_step(table, name), table.numbers(name)
    fitting = [unit for unit, s in SECONDS_IN.items() if _STEPS_S[0] <= step * s <= _STEPS_S[1]]
    if step == 1.0 and not (np.diff(t) != 1.0).any():
        return "s"  # numbers of samples, which a finding says
    if fitting:
        return fitting[0]
    first = float(np.nanmin(t)) if np.isfinite(t).any() else 0.0
    return next((unit for unit, s in SECONDS_IN.items() if 6e8 < first * s < 6e9), "s")


def _unit_by_size(table: DelimitedTable, sensor: str, found: Mapping[str, Any], assumed: list[str]) -> str:
    assumed.append(f"{sensor}_unit")
    names = [found[sensor]] if sensor == "baro" else list(found[sensor])
    if sensor == "accel" and "gravity" in found:
        names = list(found["gravity"])
    values = finite(table.table(names))
    if not len(values):
        return next(iter(UNITS[f"{sensor}_unit"]))
    size = np.sqrt((values**2).sum(axis=1))
    usual = float(np.median(size))
    factors = UNITS[f"{sensor}_unit"]
    if sensor == "accel":
        is_g = has_gravity(table, names)  # without it, shaking alone may measure 1 m/s^2
        return "g" if is_g and 0.8 < usual < 1.25 else "mg" if is_g and 800 < usual < 1250 else "m/s^2"
    if sensor == "gyro":
        return "deg/s" if _in_degrees(table, found, size) else "rad/s"
    low, high = (500.0, 1100.0) if sensor == "baro" else (20.0, 75.0)
    # 200 to 750 is as likely an uncalibrated part in uT as one in mG
    fitting = [unit for unit, factor in factors.items() if low <= usual * factor <= high and unit != "mG"]
    return fitting[0] if fitting else next(iter(factors))


def _in_degrees(table: DelimitedTable, found: Mapping[str, Any], size: FloatArray) -> bool:
    """Whether rates are in degrees: faster than any gyroscope, or than gravity turns in the frame of the device."""
    return float(np.quantile(size, 0.99)) > MAX_RATE_RADPS or _turns(table, found, turns_in_degrees)


def _turns(
    table: DelimitedTable,
    found: Mapping[str, Any],
    judged: Callable[[FloatArray, FloatArray], bool] = turns_gravity,
) -> bool:
    """What a function of rates and accelerations says of the first rows of a table."""
    if not found.keys() >= {"accel", "time"}:
        return False
    part = _beginning(table, [found["time"], *found["accel"], *found["gyro"]])
    try:
        t_s, _ = clock(part, found["time"], found["time_unit"])
        rows = [np.column_stack([t_s, part.table(found[name])]) for name in ("gyro", "accel")]
    except RecordingError:  # which reading the column raises with the line
        return False
    whole = np.isfinite(np.column_stack(rows)).all(axis=1)
    return judged(rows[0][whole], rows[1][whole])
