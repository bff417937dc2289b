"""Apps and devices whose tables differ from others by their names only: one TOML file here for each, and no code.

A file `recordings/APP.toml` says how its tables are recognised and which column is which sensor. It is found because it
lies there; `apps.APP` is its reader. `header` lists parts of the header line in small letters, all of which must stand
in it; a bar parts alternatives. A table without a header is known by the number of its `fields` and the name of its
file. In `[columns]`, whose other keys are those of a `ColumnMap`, `{}` stands for the axes x, y, z (w, x, y, z of an
attitude), `8:10` for columns without names, `*` for any text, a minus turns a column round, and `a + b` are vectors to
be added, as gravity and the acceleration without it. Of a list, the first counts whose columns are there and hold more
than 0. A time without a unit has that in which its rows come at the rate of a sensor. `[truth]` names the files with
places that lie beside the table, the best first, and their columns.
"""

from __future__ import annotations

import functools
import itertools
import re
from collections.abc import Iterable, Iterator, Sequence
from fnmatch import fnmatch
from pathlib import Path, PurePosixPath
from typing import Any, Final

import msgspec
import numpy as np

from pdrbench.errors import PdrbenchError, RecordingError
from pdrbench.geometry import FloatArray
from pdrbench.io.compressed import found_file, plain_name
from pdrbench.io.container import Container, open_container
from pdrbench.io.log import Log
from pdrbench.io.reader import Head, Reader
from pdrbench.trajectory import Trajectory
from pdrbench_formats.recordings.assemble import Tally, places
from pdrbench_formats.recordings.columnguess import time_unit_of
from pdrbench_formats.recordings.columnmap import ColumnMap, clock, read_column_map, read_mapped, times_of
from pdrbench_formats.recordings.delimited import DelimitedTable, read_delimited

FOLDER: Final = Path(__file__).parent
_AXES: Final = {"accel": "xyz", "gyro": "xyz", "mag": "xyz", "rotation": "wxyz", "place": "xy"}
_HEADER_LINES: Final = 4  # `sep=;` and comments may stand above the header
_HEADER_BYTES: Final = 4096
_DEPTH: Final = 3  # folders above a table in an archive

_NUMBERS: Final = re.compile(r"(\d+):(\d+)")
_DECIMAL: Final = re.compile(r"\s*[+-]?\d+(?:\.\d*)?(?:e[+-]?\d+)?\s*")
_MIN_CHANGES: Final = 0.1  # of the rows of a time; fewer where it was cut when it was written
_MAX_APART_S: Final = 1.0  # of a reference from the recording that it belongs to

Names = str | list[str]


class Truth(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """`[truth]`: where the reference of a recording lies.

    Attributes:
        files: Names with `*`, the best first; where the name of the recording has a `*`, both stand for the same.
        time, time_unit: Column of the time, by its name or number.
        place: Columns x, y and z in metres.
        by_row: Whether rows belong to those of the recording one by one, where there are as many.
        header_line: 0 where there is none.
    """

    files: list[str]
    time: str
    place: str
    time_unit: str = ""
    by_row: bool = False
    header_line: int | None = None


class App(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A file `APP.toml`.

    Attributes:
        title: Name and maker.
        app: Versions and systems.
        header: Parts of the header line in small letters; `a|b` for one of two.
        columns: As in a `ColumnMap`, with patterns and alternatives; see above.
        files: Ends of the names of its tables in a folder or archive, in small letters, with `*`; of two the first.
        fields: Numbers in a row of a table without a header.
        truth: Where its reference lies.
        traps: What surprises a user.
        fallback: As in `Reader`.
    """

    title: str
    app: str
    columns: dict[str, Any]
    header: list[str] = []
    files: list[str] = []
    fields: int = 0
    truth: Truth | None = None
    traps: str = ""
    fallback: bool = False


@functools.cache
def app_of(path: Path) -> App:
    """The app that a TOML file describes.

    Raises:
        PdrbenchError: It is wrong; names the key.
    """
    try:
        app = msgspec.toml.decode(path.read_bytes(), type=App)
        for columns in _combinations(app.columns):
            read_column_map(columns)
    except (msgspec.DecodeError, RecordingError) as error:
        raise PdrbenchError(f"{path}: {error}; see the other files in its folder") from error
    return app


def reader_of(path: Path) -> Reader:
    """The reader of the tables of an app, by its TOML file."""
    app = app_of(path)
    return Reader(
        functools.partial(_read, app),
        functools.partial(_sniff, app),
        options=("strict",),
        fallback=app.fallback,
        summary=f"{app.title}.",
    )


def __getattr__(name: str) -> Reader:
    path = FOLDER / f"{name}.toml"
    if name.startswith("_") or not path.is_file():
        raise AttributeError(name)
    return reader_of(path)


def _read(app: App, path: Path | str, *, strict: bool = True) -> Log:
    """Reads one recording.

    Raises:
        RecordingError: Names file, line and remedy.
    """
    path, tally = Path(path), Tally()
    container = open_container(path)
    names = container.names() if container.is_file else _named_so(container.sizes, app.files)
    if len(names) != 1:
        raise RecordingError(
            f"{path}: {len(names)} files named {' or '.join(app.files)} ({', '.join(names[:3])}); "
            f"read the folder of one recording"
        )
    for name in container.names(".csv"):
        if name != names[0]:
            tally.skipped[PurePosixPath(name).stem] += 1
    layout = {key: app.columns[key] for key in ("separator", "decimal", "header_line") if key in app.columns}
    table = read_delimited(container.read(names[0]), container.label(names[0]), **layout)
    columns = _column_map(app, table)
    if not columns.time:
        seen = f"the times stand still: rows follow one another at the {columns.rate_hz:g} Hz that the set states"
        tally.note("warning", "clock", "time", seen, "copy the files again if others have times")
    reference = None
    if app.truth is not None:
        t_s, first_s = times_of(table, columns)
        reference = _truth(app, app.truth, container, names[0], (t_s, first_s), tally)
    return read_mapped(path, table, columns, tally=tally, strict=strict, reference=reference)


def _named_so(names: Iterable[str], patterns: Sequence[str]) -> list[str]:
    """Names that end as the first pattern does that any of them ends as."""
    listed = list(names)
    ends = (f"*/{end}" if "*" in end else f"*{end}" for end in patterns)
    found = ([name for name in listed if fnmatch(f"/{name.lower()}", end)] for end in ends)
    return next(filter(None, found), [])


def _truth(
    app: App, truth: Truth, container: Container, name: str, clock_s: tuple[FloatArray, float], tally: Tally
) -> Trajectory | None:
    """The reference that lies beside a table, on its clock; None, with a note, where there is none."""
    matches = (_filled(end).fullmatch(PurePosixPath(name).name) for end in app.files if "*" in end)
    same = next((match[1] for match in matches if match), "")
    ends = [end.replace("*", same) for end in truth.files]
    if container.is_file:
        beside = (found_file(container.path.with_name(end)) for end in ends if "/" not in end)
        place = next((one for one in beside if one.is_file() and one != container.path), None)
        container = container if place is None else open_container(place)
        own = [] if place is None else container.names()
    else:
        own = _named_so(container.sizes, ends)
    if not own:
        tally.note("note", "reference", truth.files[0], "not beside the table", "copy it there to have a reference")
        return None
    table = read_delimited(container.read(own[0]), container.label(own[0]), header_line=truth.header_line)
    columns = {name.lower(): name for name in table.columns}
    time, names = _named(columns, truth.time), _vector(columns, truth.place, "xyz")
    if time is None or None in names:
        raise RecordingError(f"{table.path}: line 1: no columns {truth.time} and {truth.place}; copy the file again")
    xyz = table.table([str(name) for name in names])
    t_s, first_s = clock(table, time, truth.time_unit or time_unit_of(table, time))
    if truth.by_row and len(xyz) == len(clock_s[0]):
        t_s = clock_s[0]
    else:
        t_s = t_s + (first_s - clock_s[1])
        if not ((t_s > -_MAX_APART_S) & (t_s < np.nanmax(clock_s[0]) + _MAX_APART_S)).any():
            tally.note("warning", "reference", own[0], "is on another clock", "copy the file that belongs to the table")
            return None
    return places(t_s, xyz[:, :2], z_m=xyz[:, 2], tally=tally)


def _column_map(app: App, table: DelimitedTable) -> ColumnMap:
    """The map with the names of this table.

    Raises:
        RecordingError: No time, or no sensor.
    """
    found: dict[str, Any] = {}
    lower = {name.lower(): name for name in table.columns}
    for key, value in app.columns.items():
        if key in _AXES or key == "baro":
            chosen = (terms for option in _listed(value) if (terms := _terms(table, lower, key, option)))
            first, *added = next(chosen, [None])
            if first is not None:
                found[key] = first[0] if key == "baro" else first
                found |= {"gravity": added[0]} if added else {}
        elif key not in ("time", "time_unit"):
            found[key] = value
    times, units = _listed(app.columns["time"]), _listed(app.columns.get("time_unit", ""))
    for pattern, unit in zip(times, itertools.cycle(units)):  # one unit may stand for all
        name = _named(lower, pattern)
        may_stop = "rate_hz" in found and name is not None and not _runs(table, name)
        if name is not None and "time" not in found and not may_stop and (unit == "datetime" or _is_on(table, name)):
            found |= {"time": name, "time_unit": unit or time_unit_of(table, name)}
    if not found.keys() & {"time", "rate_hz"}:
        raise RecordingError(f"{table.path}: line 1: no column {times[0].rstrip('*')!r}; export with it")
    if not found.keys() & {"accel", "gyro", "baro"}:
        raise RecordingError(
            f"{table.path}: line 1: no accelerometer, gyroscope or barometer; switch them on in the app"
        )
    return read_column_map(found)


def _terms(table: DelimitedTable, lower: dict[str, str], key: str, option: str) -> list[tuple[str, ...]]:
    """Columns of each vector of a sum, "-" before those that are turned round; [] where one is missing or off."""
    terms = []
    for term in option.split(" + "):
        sign, pattern = ("-", term[1:]) if term.startswith("-") else ("", term)
        names = _vector(lower, pattern, _AXES.get(key, "x"))
        if any(name is None or (key != "place" and key != "rotation" and not _is_on(table, name)) for name in names):
            return []
        terms.append(tuple(f"{sign}{name}" for name in names))
    return terms


def _vector(lower: dict[str, str], pattern: str, axes: str) -> list[str | None]:
    """The columns that a pattern names, one for each axis: `a_{}`, or `8:10` of a table without a header."""
    if numbers := _NUMBERS.fullmatch(pattern):
        return [_named(lower, str(number)) for number in range(int(numbers[1]), int(numbers[2]) + 1)]
    return [_named(lower, pattern.format(axis)) for axis in axes]


def _filled(pattern: str) -> re.Pattern[str]:
    """What a name with `*` stands for, in a group."""
    return re.compile(re.escape(pattern).replace(r"\*", "(.*)"), re.I)


def _named(lower: dict[str, str], pattern: str) -> str | None:
    """The column that a pattern names, capitals or not."""
    return next((name for text, name in lower.items() if _filled(pattern).fullmatch(text)), None)


def _is_on(table: DelimitedTable, name: str) -> bool:
    """Whether a column holds more than zeros and `null`, which apps write for a sensor that is off."""
    return bool(np.nan_to_num(table.numbers(name)).any())


def _runs(table: DelimitedTable, name: str) -> bool:
    """Whether a column has another number in more than a tenth of the rows than in the row before."""
    return bool((np.diff(table.numbers(name)) != 0.0).mean() > _MIN_CHANGES)


def _listed(value: Names) -> list[str]:
    return [value] if isinstance(value, str) else list(value)


def _combinations(columns: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Maps with made-up names, for the checks of `ColumnMap`: one for each unit of the time."""
    made_up: dict[str, Any] = {key: ["a"] * len(axes) for key, axes in _AXES.items() if key in columns}
    for unit in _listed(columns.get("time_unit", "s")) or ["s"]:
        yield {**columns, **made_up, "time": "t", "time_unit": unit} | ({"baro": "p"} if "baro" in columns else {})


def _sniff(app: App, head: Head) -> bool:
    """True for a table whose header has what the app's have."""
    if head.container is not None:
        members = _named_so((name for name in head.members(depth=_DEPTH)), app.files)
        return any(_is_table(app, head.peek(name)) for name in members[:3])
    is_named = bool(_named_so([plain_name(head.path.name)], app.files))
    return (is_named or not app.fields) and _is_table(app, head.content[:_HEADER_BYTES])


def _is_table(app: App, content: bytes) -> bool:
    """Whether the first lines are a header as the app's, or numbers as many as its rows have."""
    lines = content.decode("utf-8", "replace").lower().split("\n", _HEADER_LINES)[:_HEADER_LINES]
    if app.fields:
        fields = lines[0].split(",")
        return len(fields) == app.fields and all(map(_DECIMAL.fullmatch, fields))
    wanted = [part.split("|") for part in app.header]
    return any(all(any(text in line for text in texts) for texts in wanted) for line in lines)
