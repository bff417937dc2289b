"""Apps and devices whose tables differ from others by their names only: one TOML file here for each, and no code.

A file `recordings/APP.toml` says how its tables are recognised and which column is which sensor. It is found because it
lies there; `apps.APP` is its reader. `header` lists parts of the header line in small letters, all of which must stand
in it; a bar parts alternatives. In `[columns]`, whose other keys are those of a `ColumnMap`, `{}` stands for the axes
x, y, z (w, x, y, z of an attitude), `*` for any end, a minus turns a column round, and `a + b` are vectors to be added,
as gravity and the acceleration without it. Of a list, the first counts whose columns are there and hold more than 0.
"""

from __future__ import annotations

import functools
import itertools
import re
from collections.abc import Iterable, Iterator
from pathlib import Path, PurePosixPath
from typing import Any, Final

import msgspec
import numpy as np

from pdrbench.errors import PdrbenchError, RecordingError
from pdrbench.io.container import open_container
from pdrbench.io.log import Log
from pdrbench.io.reader import Head, Reader
from pdrbench_formats.recordings.assemble import Tally
from pdrbench_formats.recordings.columnmap import ColumnMap, read_column_map, read_mapped
from pdrbench_formats.recordings.delimited import DelimitedTable, read_delimited

FOLDER: Final = Path(__file__).parent
_AXES: Final = {"accel": "xyz", "gyro": "xyz", "mag": "xyz", "rotation": "wxyz", "place": "xy"}
_HEADER_LINES: Final = 4  # `sep=;` and comments may stand above the header
_HEADER_BYTES: Final = 4096
_DEPTH: Final = 2  # folders above a table in an archive

Names = str | list[str]


class App(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A file `APP.toml`.

    Attributes:
        title: Name and maker.
        app: Versions and systems.
        header: Parts of the header line in small letters; `a|b` for one of two.
        columns: As in a `ColumnMap`, with patterns and alternatives; see above.
        files: Ends of the names of its tables in a folder or archive, in small letters.
        traps: What surprises a user.
        fallback: As in `Reader`.
    """

    title: str
    app: str
    header: list[str]
    columns: dict[str, Any]
    files: list[str] = []
    traps: str = ""
    fallback: bool = False

    def facts(self) -> dict[str, str]:
        """What the page of formats says of it."""
        units = [
            f"{key.removesuffix('_unit')} {' or '.join(dict.fromkeys(_listed(value)))}"
            for key, value in self.columns.items()
            if key.endswith("_unit")
        ]
        sensors = [name for name in (*_AXES, "baro") if name in self.columns]
        facts = {
            "App": f"{self.app}.",
            "Files": f"one table; in a folder or archive {' or '.join(self.files)}." if self.files else "one table.",
            "Sensors": ", ".join(sensors).replace("place", "places as the reference") + ".",
            "Clock": f"`{_listed(self.columns['time'])[0].rstrip('*')}`.",
            "Units": f"{', '.join(units)}; others in those of pdrbench.",
        }
        return facts | ({"Traps": f"{self.traps}."} if self.traps else {})


def app_names() -> list[str]:
    """Every app that has a file."""
    return sorted(path.stem for path in FOLDER.glob("*.toml"))


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
    if name.startswith("_") or name not in app_names():
        raise AttributeError(name)
    return reader_of(FOLDER / f"{name}.toml")


def _read(app: App, path: Path | str, *, strict: bool = True) -> Log:
    """Reads one recording.

    Raises:
        RecordingError: Names file, line and remedy.
    """
    path, tally = Path(path), Tally()
    container = open_container(path)
    names = [container.names()[0]] if container.is_file else [n for end in app.files for n in container.names(end)]
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
    return read_mapped(path, table, _column_map(app, table), tally=tally, strict=strict)


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
    times, units = _listed(app.columns["time"]), _listed(app.columns.get("time_unit", "s"))
    for pattern, unit in zip(times, itertools.cycle(units)):  # one unit may stand for all
        name = _named(lower, pattern)
        if name is not None and "time" not in found and (unit == "datetime" or _is_on(table, name)):
            found |= {"time": name, "time_unit": unit}
    if "time" not in found:
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
        names = [_named(lower, pattern.format(axis)) for axis in _AXES.get(key, "x")]
        if any(name is None or (key != "place" and key != "rotation" and not _is_on(table, name)) for name in names):
            return []
        terms.append(tuple(f"{sign}{name}" for name in names))
    return terms


def _named(lower: dict[str, str], pattern: str) -> str | None:
    """The column that a pattern names, capitals or not."""
    expression = re.compile(re.escape(pattern.lower()).replace(r"\*", ".*"))
    return next((name for text, name in lower.items() if expression.fullmatch(text)), None)


def _is_on(table: DelimitedTable, name: str) -> bool:
    """Whether a column holds more than zeros and `null`, which apps write for a sensor that is off."""
    return bool(np.nan_to_num(table.numbers(name)).any())


def _listed(value: Names) -> list[str]:
    return [value] if isinstance(value, str) else list(value)


def _combinations(columns: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Maps with made-up names, for the checks of `ColumnMap`: one for each unit of the time."""
    made_up: dict[str, Any] = {key: ["a"] * len(axes) for key, axes in _AXES.items() if key in columns}
    for unit in _listed(columns.get("time_unit", "s")):
        yield {**columns, **made_up, "time": "t", "time_unit": unit} | ({"baro": "p"} if "baro" in columns else {})


def _sniff(app: App, head: Head) -> bool:
    """True for a table whose header has what the app's have."""
    if head.container is not None:
        members: Iterable[str] = (name for end in app.files for name in head.members(end, depth=_DEPTH))
        return any(_has_header(app, head.peek(name)) for name in itertools.islice(members, 3))
    return _has_header(app, head.content[:_HEADER_BYTES])


def _has_header(app: App, content: bytes) -> bool:
    lines = content.decode("utf-8", "replace").lower().split("\n", _HEADER_LINES)[:_HEADER_LINES]
    wanted = [part.split("|") for part in app.header]
    return any(all(any(text in line for text in texts) for texts in wanted) for line in lines)
