"""What names of columns, files and records say: sensors, axes and units, by the words of `words.toml`."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Final

from pdrbench_formats.recordings.texts import WORDS

_UNIT_TEXT: Final = re.compile(r"\(([^()]*)\)|\[([^\[\]]*)\]")
_INDEX: Final = re.compile(r"[(\[]\s*(\d+|[wxyzWXYZ])\s*[)\]]")  # the axis, as of `accel[0]` and `Accelerometers[X]`
_CAMEL: Final = re.compile(r"(?<=[a-z])(?=[A-Z])|(?<=[XYZ])(?=[A-Z][a-z])")
_SECONDS: Final = ("s", "sec", "secs", "second", "seconds", "sekunden")
_UNIT_NAMES: Final[Mapping[str, Mapping[str, Sequence[str]]]] = {
    **WORDS["units"],
    "time_unit": {
        unit: [f"{short}{word}" for short in shorts for word in _SECONDS]
        for unit, shorts in WORDS["units"]["time_unit"].items()
    }
    | WORDS["units"]["long_time_unit"],
}
_AFTER_AXIS: Final = re.compile(r"(.*)[\W_]?([wxyz])[\W_]+(.+)")  # a name, its axis, and what can only be a unit
_UNIT_TEXTS: Final = sorted(
    {text for units in _UNIT_NAMES.values() for texts in units.values() for text in texts}, key=len, reverse=True
)
_W3C: Final = {"alpha": "z", "beta": "x", "gamma": "y"}  # rates in the DeviceMotion of browsers
_LETTERS: Final = ("g", "t", "s", "m", "in", "min", "day")  # of a name as often as of a unit
_SENSOR_NAMES: Final[Mapping[str, Sequence[str]]] = WORDS["sensors"]["alone"]
_SENSOR_WORDS: Final[Mapping[str, Sequence[str]]] = WORDS["sensors"]["ending"]
_OTHER, FILLERS = WORDS["columns"]["other"], WORDS["columns"]["fillers"]
_LINEAR: Final = re.compile("|".join(WORDS["columns"]["linear"]))
TIME_NAMES: Final[Sequence[str]] = [
    *WORDS["columns"]["time"],
    *(text for unit in WORDS["units"]["time_unit"] for text in _UNIT_NAMES["time_unit"][unit] if len(text) > 1),
]
BETWEEN_ROWS: Final[Sequence[str]] = WORDS["columns"]["between_rows"]
BARO_NAMES: Final[Sequence[str]] = WORDS["columns"]["baro"]
LEVEL_NAMES: Final[Sequence[str]] = WORDS["columns"]["level"]
PLACE_NAMES: Final = {unit: WORDS["columns"][f"place_{unit}"] for unit in ("m", "deg")}


def split_names(names: Iterable[str], units: Mapping[str, str]) -> dict[str, tuple[str, str]]:
    """As `split_unit`, by name; axes that are numbers as x, y, z, and units as far as another line states them."""
    named = {name: split_unit(name) for name in names}
    named |= _by_number(named)
    return named | {name: (named[name][0], unit.strip("()[] ").lower()) for name, unit in units.items() if unit}


def vectors_of(
    named: Mapping[str, tuple[str, str]], sensor: str
) -> tuple[dict[tuple[int, str, str], tuple[str, ...]], list[tuple[str, ...]]]:
    """Columns that together are a vector, by their names.

    Args:
        named: As from `split_names`.
        sensor: Of columns that are named by their axis only; "" where their unit has to say it.

    Returns:
        Columns by axis, x, y, z or w, x, y, z, by how far they are from sure, sensor, and what else tells them from
        others; and those whose word is not known.
    """
    groups: dict[tuple[int, str, str], dict[str, str]] = {}
    unknown: dict[str, dict[str, str]] = {}
    for name, (base, unit) in named.items():
        for axis, stem in _axes_of(base):
            is_bare, is_other = stem in ("", *FILLERS), any(word in stem for word in _OTHER)
            kind, rank = (sensor or sensor_by(unit), 0) if is_bare else sensor_of(stem)
            if not kind and not is_other:
                # a word of another language, or before another, or a letter after what all names begin with
                kind, rank = sensor_by(unit) or sensor_in(name) or sensor_of(_letter_before(axis, name))[0], 2
            # what no unit is called names a device
            owner = f"{stem} {unit}" if unit and unit not in _UNIT_TEXTS else stem
            if kind:
                groups.setdefault((rank, kind, owner), {}).setdefault(axis, name)
            elif not (is_bare or is_other):
                unknown.setdefault(stem, {}).setdefault(axis, name)
    whole = {}
    for key, axes in groups.items():
        wanted = "wxyz" if key[1] == "rotation" else "xyz"
        if axes.keys() >= set(wanted):
            whole[key] = tuple(axes[axis] for axis in wanted)
    return whole, [tuple(axes[axis] for axis in "xyz") for axes in unknown.values() if axes.keys() >= set("xyz")]


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
        ends = (end for end in _UNIT_TEXTS if text.endswith(end) and text[: -len(end)][-1:] in tuple(" _-.,/"))
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


def unit_of(kind: str, text: str) -> str:
    return next((unit for unit, texts in _UNIT_NAMES[kind].items() if text in texts), "") if text else ""


def unit_in(base: str) -> str:
    """The unit of a time whose name has no separator before it: `timens`, `tms`."""
    if unit_of("time_unit", base):
        return base
    texts = sorted((text for texts in _UNIT_NAMES["time_unit"].values() for text in texts), key=len, reverse=True)
    ends = (text for text in texts if len(text) > 1 and base.endswith(text))
    return next((text for text in ends if base.removesuffix(text) in TIME_NAMES or "time" in base), "")


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


def sensor_by(unit: str) -> str:
    """The sensor with axes that alone is measured in a unit; g is of accelerations."""
    return next((kind for kind in ("accel", "gyro", "mag") if unit_of(f"{kind}_unit", unit)), "")


def _axes_of(base: str) -> list[tuple[str, str]]:
    """Each way to read a name as an axis and the rest."""
    base = _without_fillers(base)
    return [(base[-1:], base[:-1])] * (base[-1:] in tuple("wxyz")) + [(base[:1], base[1:])] * (
        base[:1] in tuple("wxyz")
    )


def _by_number(named: Mapping[str, tuple[str, str]]) -> dict[str, tuple[str, str]]:
    """The names and units whose names end in 0, 1, 2 or in 1, 2, 3, with the axes x, y, z in their place."""
    every = {base for base, _ in named.values()}
    bases = [base for base, _ in named.values() if len(base) > 1]
    ends = {base[:-1]: "".join(sorted(one[-1] for one in bases if one[:-1] == base[:-1])) for base in bases}
    # digits behind axes number devices
    numbered = [
        (stem, digits)
        for stem, digits in ends.items()
        if digits in ("012", "123") and not {f"{stem[:-1]}{axis}" for axis in "xyz"} <= ends.keys()
    ]
    axes = {f"{stem}{digits[k]}": f"{stem}{'xyz'[k]}" for stem, digits in numbered for k in range(3)}
    for rates in WORDS["columns"]["rates"]:
        axes |= {base: f"gyro{axis}" for base, axis in zip(rates, "xyz", strict=True) if {*rates} <= every}
    for base in bases:
        for word, axis in _W3C.items():
            stem = base.removesuffix(word)
            axes |= {base: f"{stem}{axis}"} if stem != base and sensor_of(stem)[0] == "gyro" else {}
    return {name: (axes[base], unit) for name, (base, unit) in named.items() if base in axes}


def _letter_before(axis: str, name: str) -> str:
    """The letter before an axis that ends a name of several words: a of `imu_ax`."""
    match = re.search(rf"[\W_]([a-z])[\W_]?{axis}[\W_]*$", _UNIT_TEXT.sub("", _CAMEL.sub("_", name)).lower())
    return "" if match is None else match[1]


def _without_fillers(name: str) -> str:
    while filler := next((filler for filler in FILLERS if name.endswith(filler) and name != filler), ""):
        name = name.removesuffix(filler)
    return name
