"""Which column of a table is which sensor, concluded from the names in its header and the size of its numbers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import numpy as np

from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray
from pdrbench.sensors.checks import MAX_RATE_RADPS, MIN_ROWS, lengths
from pdrbench_formats.recordings import columnnames as words
from pdrbench_formats.recordings.axes import turns_by_revolutions, turns_gravity, turns_in_degrees
from pdrbench_formats.recordings.columnmap import SECONDS_IN, TIME_UNITS, UNITS, ColumnMap, clock, is_compact, scale_of
from pdrbench_formats.recordings.delimited import DelimitedTable

_PRESSURE_RANGES: Final = ((500.0, 1100.0), (5e4, 1.1e5), (50.0, 110.0))  # hPa, Pa, kPa
_MOST: Final = 1e12  # of any value: nothing of a walk comes near
_MAX_SEEN: Final = 5000  # rows that names in doubt are judged by
_MAX_TIMES: Final = 100  # columns among which a time without a name is looked for
_STEPS_S: Final = (1e-3, 0.5)  # between rows: 1000 to 2 Hz, less than the thousand between two units
_SAMPLED_S: Final = (1e-3, 0.05)  # of inertial sensors: 1000 to 20 Hz
_FORCE_UNITS: Final = ("m/s^2", "g", "mg")  # that need no word
_MIN_FIELD_UT: Final = 5.0  # less is no field of the Earth, in whatever is taken for the unit
_COUNTS_IN_G: Final = (64.0, 16_384.0)  # of converters of 8 to 16 bits
_SIGN_BIT: Final = 32_768.0
_DPS_FOR_G: Final = 125.0  # of ranges as they are paired: 2 g and 250 degrees/s, 16 g and 2000
_TICKS_S: Final = (1e-7, 1e-4, 1e-2, 1 / 32_768)  # of clocks that count neither of the usual units
_PACE_S: Final = (0.35, 1.5)  # from step to step or stride to stride
_ANY_PACE_S: Final = (0.2, 3.0)  # beyond, it is no walk
_MIN_ALIKE: Final = 0.3  # correlation of one step and the next
_RARE_S: Final = (1e-4, 2.0)  # no less and no more, whatever a header states


def guess(
    table: DelimitedTable, sensor: str = "", *, shared: bool = False, rate_hz: float | None = None
) -> tuple[ColumnMap | None, list[str]]:
    """What the columns of a table are, by their names; the units by names, else by the numbers.

    Args:
        table: Any.
        sensor: Of columns that are named by their axis only, as the name of the file says: a key of `SENSORS`.
        shared: Whether other tables are on the clock: a time since 1970 is taken where there is one.

    Returns:
        The map, None where no sensor is recognised, and without `time` where no time is; and what was concluded from
        the numbers alone, or chosen among several that it might be.
    """
    named = words.split_names(table.columns, table.units)
    found: dict[str, Any] = {}
    assumed: list[str] = []
    whole, unknown = words.vectors_of(named, sensor)
    bases = {base: name for name, (base, _) in reversed(named.items())}
    plain = [bases.get(axis, "") for axis in "xyz"]
    kinds = {key[1] for key in whole}
    is_taken = tuple(plain) in whole.values()  # by the gyroscope itself, 1 rad/s being as much as 1 g
    if all(plain) and not is_taken and "gyro" in kinds and not kinds & {"accel", "linear"} and _is_force(table, plain):
        whole[2, "accel", ""] = tuple(plain)
        bases = {base: name for base, name in bases.items() if name not in plain}
        assumed.append("accel")
    if not kinds & {"accel", "linear"} and len(forces := [names for names in unknown if _is_force(table, names)]) == 1:
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
    baro = next((bases[base] for base in words.BARO_NAMES if base in bases), None)
    if baro is None and sensor == "baro":
        baro = next((bases[base] for base in ("x", *words.FILLERS) if base in bases), None)
    in_pressure = (name for name, (_, unit) in named.items() if words.unit_of("baro_unit", unit))
    baro = baro or next((name for name in in_pressure if _is_pressure(table, name)), None)
    if baro is not None and (named[baro][0] != "p" or _is_pressure(table, baro)):
        found["baro"] = baro
    level = next((bases[base] for base in words.LEVEL_NAMES if base in bases), None)
    # latitude and longitude in a log are what the phone itself took for its place, unless a person was there
    units = [unit for unit in words.PLACE_NAMES if not sensor and (unit == "m" or level is not None)]
    places = ((unit, pair) for unit in units for pair in words.PLACE_NAMES[unit] if {*pair} <= bases.keys())
    if (place := next(places, None)) is not None:
        found |= {"place": tuple(bases[base] for base in place[1]), "place_unit": place[0]}
        found |= {} if level is None else {"level": level}
    if not found.keys() & {"accel", "gyro", "mag", "rotation", "baro"}:
        return None, assumed
    bases_of = {name: base for name, (base, _) in named.items()}
    taken = {name for value in found.values() if not isinstance(value, str) for name in value} | {baro or ""}
    time = _time_column(table, bases_of, shared=shared) if rate_hz is None else None
    if rate_hz is not None:
        found["rate_hz"] = rate_hz
    elif time is None and len(growing := _growing(table, [name for name in table.columns if name not in taken])) == 1:
        time = growing[0]
    if time is not None:
        found["time"] = time
        stated = words.unit_of("time_unit", named[time][1]) or words.unit_of("time_unit", words.unit_in(named[time][0]))
        is_stated = stated and _is_numeric(table, time)
        found["time_unit"] = stated if is_stated else _paced(table, found, time_unit_of(table, time))
        assumed += [] if stated else ["time_unit"]
    if "gyro" not in found and len(turning := [one for one in unknown if _turns(table, {**found, "gyro": one})]) == 1:
        found["gyro"] = turning[0]
    for kind in ("accel", "gyro", "mag", "baro"):
        if kind in found:
            name = found[kind] if kind == "baro" else found[kind][0]
            unit = words.unit_of(f"{kind}_unit", named[name][1])
            if named[name][1] == "rps" and _turns(table, found, turns_by_revolutions):
                unit = "rev/s"
            found[f"{kind}_unit"] = unit or _unit_by_size(table, kind, found, assumed)
    if (
        "mag_unit" in assumed
        and _length_of(table, found["mag"]) * scale_of("mag_unit", found["mag_unit"]) < _MIN_FIELD_UT
    ):
        assumed.remove("mag_unit")
        del found["mag"], found["mag_unit"]  # of no unit: listed among the columns that are not read
    return ColumnMap(**found), assumed


def named_by_place(table: DelimitedTable, sensor: str) -> DelimitedTable:
    """Columns without names, in the order of Android: the first that is a time, then x, y, z, and w of an attitude."""
    names, listed = ("time", *("xyzw" if sensor == "rotation" else "xyz")), list(table.columns)
    first = listed.index(next(iter(_growing(table, listed)), listed[0]))
    columns = dict(zip(names, list(table.columns.values())[first:], strict=False))
    return DelimitedTable(table.path, columns, table.first_line, table.mended, table.dropped)


def doubted_unit(table: DelimitedTable, columns: ColumnMap) -> str:
    """The unit that the step of a time fits, where it does not fit the one that is stated; "" where it does."""
    if columns.time_unit == "datetime" or not columns.time:
        return ""
    step = usual_step(table, columns.time)
    is_likely = _RARE_S[0] <= step * scale_of("time_unit", columns.time_unit) < _RARE_S[1]
    fitting = [unit for unit, s in SECONDS_IN.items() if _SAMPLED_S[0] <= step * s <= _SAMPLED_S[1]]
    return fitting[0] if fitting and not is_likely else ""


def usual_step(table: DelimitedTable, name: str) -> float:
    """The median step of a column of times, 0 where none is positive."""
    t = table.numbers(name)
    steps = np.diff(t[np.isfinite(t)])
    steps = steps[steps > 0]
    return float(np.median(steps)) if len(steps) else 0.0


def guess_by_place(table: DelimitedTable, rate_hz: float | None = None, **layout: Any) -> ColumnMap | None:
    """What columns of no known name may be: a time that grows, then vectors, the first with gravity being the force."""
    names = list(table.columns)
    times = _growing(table, names)[:1]
    names = names[names.index(times[0]) + 1 if times else 0 :]
    changing = [name for name in names if len(values := _seen(table, [name])) > 1 and np.ptp(np.diff(values[:, 0]))]
    vectors = [tuple(changing[k : k + 3]) for k in range(0, len(changing) - 2, 3)]
    force = next((vector for vector in vectors if _is_force(table, vector)), None)
    if force is None:
        return None
    found: dict[str, Any] = {"accel": force, **layout}
    found |= {"time": times[0], "time_unit": time_unit_of(table, times[0])} if times else {"rate_hz": rate_hz}
    assumed: list[str] = []
    found["accel_unit"] = _unit_by_size(table, "accel", found, assumed)
    if others := [vector for vector in vectors if vector != force]:
        least = min(others, key=lambda vector: _steadiness(table, vector))  # a walk turns as often back
        found["gyro"] = next((vector for vector in others if _turns(table, {**found, "gyro": vector})), least)
        found["gyro_unit"] = _unit_by_size(table, "gyro", found, assumed)
    return ColumnMap(**found)


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


def _steadiness(table: DelimitedTable, names: Sequence[str]) -> float:
    """The length of the mean of a vector in its root mean square."""
    values = _seen(table, names)
    return float(lengths(values.mean(axis=0, keepdims=True))[0] / max(np.sqrt((values**2).sum(axis=1).mean()), 1e-12))


def has_gravity(table: DelimitedTable, names: Sequence[str]) -> bool:
    """Whether the mean of a vector over some rows is about as long as the vector: the shaking of a walk cancels."""
    values = _seen(table, names)
    if not len(values):
        return False
    num = max(len(values) // 50, 1)
    means = values[: len(values) // num * num].reshape(num, -1, 3).mean(axis=1)
    of_means, of_rows = (float(np.median(lengths(vectors))) for vectors in (means, values))
    return of_means > 0.6 * of_rows


def _is_force(table: DelimitedTable, names: Sequence[str]) -> bool:
    """Whether a vector has gravity, and is usually as long as that in one of the units of acceleration."""
    if not has_gravity(table, names):
        return False
    usual = _length_of(table, names)
    return any(0.8 < usual * UNITS["accel_unit"][unit] / UNITS["accel_unit"]["g"] < 1.25 for unit in _FORCE_UNITS)


def _length_of(table: DelimitedTable, names: Sequence[str]) -> float:
    """The usual length of a vector, 0 where no row has it."""
    values = _seen(table, names)
    return float(np.median(lengths(values))) if len(values) else 0.0


def _is_pressure(table: DelimitedTable, name: str) -> bool:
    values = _seen(table, [name])
    middle = float(np.median(values)) if len(values) else 0.0
    return any(low < middle < high for low, high in _PRESSURE_RANGES)


def _time_column(table: DelimitedTable, bases: Mapping[str, str], *, shared: bool) -> str | None:
    """The column of the time; of several the one with most different values: dates may be to the second."""
    exact = sorted(
        (words.TIME_NAMES.index(base.removesuffix(words.unit_in(base)) or base), name)
        for name, base in bases.items()
        if (base.removesuffix(words.unit_in(base)) or base) in words.TIME_NAMES
    )
    found = [name for _, name in exact] or [name for name, base in bases.items() if "time" in base]
    found = [name for name in found if not any(word in bases[name] for word in words.BETWEEN_ROWS)]
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


def _growing(table: DelimitedTable, names: Sequence[str]) -> list[str]:
    """Columns that grow from row to row as a clock does; one that counts rows is none."""
    found = []
    for name in names[:_MAX_TIMES] if len(table) > MIN_ROWS else ():
        part = _beginning(table, [name])
        try:
            t, _ = clock(part, name, "s" if table.columns[name].dtype.kind in "iuf" else "datetime")
        except RecordingError:
            continue
        steps = np.diff(t)
        grows = np.isfinite(steps).all() and (steps >= 0).all() and (steps > 0).mean() > 0.9
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
    if is_compact(table, name):
        return "datetime"
    step, t = usual_step(table, name), table.numbers(name)
    fitting = [unit for unit, s in TIME_UNITS.items() if _STEPS_S[0] <= step * s <= _STEPS_S[1]]
    if step == 1.0 and not (np.diff(t) != 1.0).any():
        return "s"  # numbers of samples, which a finding says
    if fitting:
        return fitting[0]
    first = float(np.nanmin(t)) if np.isfinite(t).any() else 0.0
    return next((unit for unit, s in SECONDS_IN.items() if 6e8 < first * s < 6e9), "s")


def _paced(table: DelimitedTable, found: Mapping[str, Any], unit: str) -> Any:
    """A unit of time; another where the steps of a walk would be too fast or too slow in it."""
    step = usual_step(table, found["time"]) if unit != "datetime" and "accel" in found else 0.0
    size = lengths(_seen(table, found["accel"])) if step else np.zeros(0)
    if len(size) < MIN_ROWS:
        return unit
    alike = np.fft.irfft(np.abs(np.fft.rfft(size - size.mean(), 2 * len(size))) ** 2)[: len(size) // 2]
    first = int((alike < 0.0).argmax())
    rows = first + int(alike[first:].argmax())  # to the most similar row, a step or a stride later
    if (
        not first
        or alike[rows] < _MIN_ALIKE * alike[0]
        or _ANY_PACE_S[0] < rows * step * TIME_UNITS[unit] < _ANY_PACE_S[1]
    ):
        return unit
    steps_s: dict[Any, float] = {one: step * s for one, s in (*SECONDS_IN.items(), *((s, s) for s in _TICKS_S))}
    of_pace = [one for one, s in steps_s.items() if _PACE_S[0] < rows * s < _PACE_S[1]]
    fitting = [one for one in of_pace if _SAMPLED_S[0] <= steps_s[one] <= _SAMPLED_S[1]]
    return fitting[0] if len(fitting) == 1 else unit


def _unit_by_size(table: DelimitedTable, sensor: str, found: Mapping[str, Any], assumed: list[str]) -> str | float:
    assumed.append(f"{sensor}_unit")
    names = [found[sensor]] if sensor == "baro" else list(found[sensor])
    if sensor == "accel" and "gravity" in found:
        names = list(found["gravity"])
    values = finite(table.table(names))
    if not len(values):
        return next(iter(UNITS[f"{sensor}_unit"]))
    size = lengths(values)
    usual = float(np.median(size))
    factors = UNITS[f"{sensor}_unit"]
    if sensor == "accel":
        if not has_gravity(table, names):  # shaking alone may measure 1 m/s^2
            return "m/s^2"
        in_g = (unit for unit in _FORCE_UNITS[1:] if 0.8 < usual * factors[unit] / factors["g"] < 1.25)
        return next(in_g, "") or _of_converter(values, usual) or "m/s^2"
    if sensor == "gyro":
        fast, force_unit = float(np.quantile(size, 0.99)), found.get("accel_unit")
        is_counts = is_whole(values)
        if isinstance(force_unit, float) and is_counts:  # of the range that is usual beside it, to be checked
            return float(f"{force_unit / UNITS['accel_unit']['g'] * _DPS_FOR_G * factors['deg/s']:.6g}")
        if fast * factors["deg/s"] > MAX_RATE_RADPS and not is_counts:
            return factors["mdeg/s"]
        is_fast = fast > MAX_RATE_RADPS  # than any gyroscope, or than gravity turns
        return "deg/s" if is_fast or _turns(table, found, turns_in_degrees) else "rad/s"
    low, high = (500.0, 1100.0) if sensor == "baro" else (20.0, 75.0)
    # 200 to 750 is as likely an uncalibrated part in uT as one in mG
    fitting = [unit for unit, factor in factors.items() if low <= usual * factor <= high and unit != "mG"]
    return fitting[0] if fitting else next(iter(factors))


def is_whole(values: FloatArray) -> bool:
    """Whether all are whole numbers, as counts of a converter are."""
    return bool((values == np.round(values)).all())


def _of_converter(values: FloatArray, usual: float) -> str | float:
    """What one count of a converter is in m/s^2, if 1 g is a power of two of them; "" where it is not."""
    in_g = 2.0 ** np.round(np.log2(max(usual, 1.0)))
    is_signed = values.min() < 0.0 or values.max() < _SIGN_BIT
    if 0.9 < usual / in_g < 1.1 and _COUNTS_IN_G[0] <= in_g <= _COUNTS_IN_G[1] and is_signed and is_whole(values):
        return float(f"{UNITS['accel_unit']['g'] / in_g:.6g}")
    return "mm/s^2" if 0.9 < usual * 1e-3 / UNITS["accel_unit"]["g"] < 1.1 else ""


def _turns(
    table: DelimitedTable, found: Mapping[str, Any], judged: Callable[[FloatArray, FloatArray], bool] = turns_gravity
) -> bool:
    """What a function of rates and accelerations says of the first rows of a table."""
    times = [found["time"]] if "time" in found else []
    if "accel" not in found or not (times or found.get("rate_hz")):
        return False
    part = _beginning(table, [*times, *found["accel"], *found["gyro"]])
    try:
        t_s = clock(part, times[0], found["time_unit"])[0] if times else np.arange(len(part)) / found["rate_hz"]
        rows = [np.column_stack([t_s, part.table(found[name])]) for name in ("gyro", "accel")]
    except RecordingError:  # which reading the column raises with the line
        return False
    whole = np.isfinite(np.column_stack(rows)).all(axis=1)
    return judged(rows[0][whole], rows[1][whole])
