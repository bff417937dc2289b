"""A table of numbers with a header, from any logger, device or script; or one for each sensor.

App: any that writes tables, among them HyperIMU, Physics Toolbox, Sensor Kinetics.
Files: one text file with a header; commas, semicolons, tabs or blanks; decimal points or commas; UTF-8, UTF-16 or
Latin-1; also gzip-compressed. Lines above the header, and a line of units below it, are found. Or a folder or zip with
a table for each sensor, named after it, as in `Gyroscope.csv`.
Sensors: accel, gyro, mag, rotation, baro; places as the reference.
Units: as the column map states (TOML, `[columns]`); without a map, from names such as `acc_x (g)`, else by their size,
which a warning says.
Frame: x right, y to the top edge, z out of the screen; a minus before a name in the map turns a column round.
Clock: one column; seconds, milliseconds, microseconds, nanoseconds or dates.
Traps: units that are stated nowhere; acceleration without gravity; sensors that share a table at different rates leave
fields empty; latitude and longitude, which are what the phone took for its place and no truth, unless a map says so.
"""

from __future__ import annotations

import itertools
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Any, Final

import msgspec
import numpy as np

from pdrbench.errors import RecordingError
from pdrbench.inertial.quaternions import to_world
from pdrbench.io.container import Container, open_container
from pdrbench.io.log import Log
from pdrbench.io.reader import Head, Reader
from pdrbench.sensors.checks import MIN_ROWS, SAMPLED
from pdrbench_formats.recordings.assemble import Tally, note_face_down, note_guesses
from pdrbench_formats.recordings.columnguess import doubted_unit, guess, guess_by_place, named_by_place
from pdrbench_formats.recordings.columnmap import ColumnMap, clock, read_column_map, read_mapped, times_of
from pdrbench_formats.recordings.columnnames import TIME_NAMES, sensor_in, split_names, unit_of
from pdrbench_formats.recordings.delimited import DelimitedTable, Layout, NoHeaderError, find_layout, read_delimited
from pdrbench_formats.recordings.joined import COLUMNS_OF, SensorTable, by_kind, join_tables
from pdrbench_formats.recordings.texts import text_of
from pdrbench_formats.toml import toml_value

_WIDTH: Final = range(4, 1000)  # columns: a time and a vector, and not the numbers of a document in one line
_BOTH: Final = {"accel", "gyro"}
_MAX_DEVICES: Final = 8
_MAX_SEEN: Final = 1000  # rows that show that a column names no devices
_SAME_CLOCK_S: Final = 0.002
_SAME_TIMES: Final = 0.9  # of rows: more than sensors that share a table, each with rows of its own
_TURNS: Final = 0.2  # of all rows, after which those of another device come: labels of what was done change less often
_PEEK_BYTES: Final = 32_768  # of a table that may hold both inertial sensors
_COLUMNS: Final = re.compile(rb'\s*\{\s*"[^"]*"\s*:\s*(?:\[\s*[-\d]|\{)')  # of JSON, known as a whole only
_RATE: Final = re.compile(r"(?<![\d.])(\d+(?:\.\d+)?)[ _-]?hz(?![a-z])|(?:rate|frequency)\W{1,3}(\d+(?:\.\d+)?)", re.I)
_RATE_ALONE: Final = re.compile(r"\s*([1-9]\d+(?:\.\d+)?)\s*$")  # a number that no row has beside it
_UNKNOWN: Final = ColumnMap()  # whose separator, decimals and header are found
_EXAMPLE: Final = 'time = "t"\n    time_unit = "ms"\n    accel = ["ax", "ay", "az"]\n    accel_unit = "m/s^2"'


def read(path: Path | str, *, columns: Any = None, strict: bool = True) -> Log:
    """Reads one table.

    Args:
        path: Of the file.
        columns: Column map: a TOML file, its `[columns]` table as a mapping, or a `ColumnMap`; None to guess.
        strict: As in `pdrbench_formats.recordings.assemble.assemble`.

    Raises:
        RecordingError: Names file, line and remedy.
    """
    path, tally = Path(path), Tally()
    container = open_container(path)
    if not container.is_file:
        if columns is not None:
            raise RecordingError(f"{path}: a column map is for one table; name one of the files in it")
        return _read_tables(path, container, tally, strict=strict)
    content = container.read(path.name)
    known = _UNKNOWN if columns is None else read_column_map(columns)
    if known != _UNKNOWN and not known.is_rate:
        return read_mapped(path, _table(content, path, known), known, tally=tally, strict=strict)
    table, sensor = _headed_table(content, path, known)
    found, assumed = guess(table, sensor, rate_hz=known.rate_hz)
    if found is not None:
        found = msgspec.structs.replace(found, **msgspec.to_builtins(known))  # the rate, and how the file is laid out
    parts = by_kind(table) if found is None else _side_by_side(table)
    if parts:
        return join_tables(path, parts, tally, strict=strict)
    if found is None:
        likely = guess_by_place(table, known.rate_hz)
        rate = "" if known.rate_hz else _stated_rate(path, content, table)
        lines = _indented(likely, rate) if likely is not None else f"    [columns]\n    {_EXAMPLE}"
        raise RecordingError(
            f"{path}: line 1: no time and sensor recognised among the columns {', '.join(table.columns)[:300]}; "
            f"name them in a TOML file and pass it as column map, {'by the numbers' if likely else 'such as'}:\n{lines}"
        )
    _check_time(path, table, found, assumed, _stated_rate(path, content, table))
    _check_devices(path, table, found, assumed)
    if isinstance(found.gyro_unit, float) and "gyro_unit" in assumed:
        raise RecordingError(
            f"{path}: the rates are counts of a converter, whose range nothing states, or finer than degrees/s; pass "
            f"this column map once gyro_unit is right, one count in rad/s (0.000133 of 16 bits and 250 degrees/s, "
            f"0.00107 of 2000):\n{_indented(found)}"
        )
    note_guesses(tally, [f"{name} {getattr(found, name)!r}" for name in assumed])
    _note_sign(tally, table, found)
    return read_mapped(path, table, found, tally=tally, strict=strict)


def _headed_table(content: bytes, path: Path, known: ColumnMap) -> tuple[DelimitedTable, str]:
    """A table, and the sensor that its name says where it has no header."""
    try:
        return _table(content, path, known), ""
    except NoHeaderError as error:
        table, sensor = _table(content, path, ColumnMap(header_line=0)), sensor_in(path.stem)
        if sensor in SAMPLED:
            return named_by_place(table, sensor), sensor
        if by_kind(table):
            return table, ""
        found = guess_by_place(table, known.rate_hz, header_line=0)
        if found is None:
            raise
        rate = "" if known.rate_hz else _stated_rate(path, content, table)
        raise NoHeaderError(f"{error}; this may be its map, to be checked:\n{_indented(found, rate)}") from error


def _stated_rate(path: Path, content: bytes, table: DelimitedTable) -> str:
    """Rows a second as a line above the rows, the file or its folder states them, and which; or a guess."""
    num = max(table.first_line - 1, 1)  # a number alone is no row, even where rows begin at once
    lines = text_of(content, path).content.decode().split("\n", num)[:num]
    places = {f"line {number}": line for number, line in enumerate(lines, 1)}
    for where, text in (places | {"the file's name": path.stem, "the folder's name": path.parent.name}).items():
        if match := _RATE.search(text) or (_RATE_ALONE.match(text) if where in places else None):
            return f"{float(next(filter(None, match.groups())))}  # as {where} says"
    return "100.0  # a guess, which nothing here states: write the rows a second of the device"


def _check_time(path: Path, table: DelimitedTable, found: ColumnMap, assumed: Sequence[str], rate: str) -> None:
    """Refuses a table without a time, and one whose header states a unit of time that its steps contradict."""
    if found.rate_hz is not None:
        return
    few = _few_times(table, found)
    if few:
        rated = msgspec.structs.replace(found, time="", time_unit="s", rate_hz=few[1]) if few[1] else None
        remedy = f", or state the rate in place of the time:\n{_indented(rated)}" if rated else ""
        raise RecordingError(
            f"{path}: line {table.first_line}: {found.time!r} has the same time in {few[0]:.0f} of 100 rows, as where "
            f"a spreadsheet cut it; export the file again{remedy}"
        )
    if not found.time:
        choice = [name for name in ("accel", "gyro", "mag", "rotation") if name in assumed]
        several = f", and several that may be {' and '.join(choice)}: two devices?" if choice else ""
        raise RecordingError(
            f"{path}: line {table.first_line - 1}: no column of the time among "
            f"{', '.join(table.columns)[:300]}{several}; state the rate by --rate, or with the columns of one "
            f"device in a column map:\n{_indented(found, rate)}"
        )
    unit = doubted_unit(table, found)
    if unit:
        raise RecordingError(
            f"{path}: the header states the unit {found.time_unit!r} for {found.time!r}, and the steps between its "
            f"rows are those of a sensor in {unit!r} only; if they are right, pass this column map:\n"
            f"{_indented(msgspec.structs.replace(found, time_unit=unit))}"
        )


def _few_times(table: DelimitedTable, found: ColumnMap) -> tuple[float, float] | None:
    """Percent of rows with the time of the row before, and rows a second (0: unknown); None where most times differ."""
    if not found.time:
        return None
    beginning = replace(table, columns={found.time: table.columns[found.time][: 10 * _MAX_SEEN]})
    t_s, _ = clock(beginning, found.time, found.time_unit)
    changes = np.flatnonzero(np.diff(t_s))
    if len(changes) > (1.0 - _SAME_TIMES) * len(t_s) or len(t_s) < MIN_ROWS:
        return None
    span_s = float(t_s[changes[-1] + 1] - t_s[changes[0] + 1]) if len(changes) > 1 else 0.0
    rate_hz = (changes[-1] - changes[0]) / span_s if span_s > 0.0 else 0.0
    return 100.0 * (1.0 - (1 + len(changes)) / len(t_s)), float(f"{rate_hz:.4g}")


def _side_by_side(table: DelimitedTable) -> list[SensorTable]:
    """Sensors that stand beside one another in a table, each behind a time of its own; [] where all share one."""
    names, bounds = list(table.columns), []
    for place, (base, unit) in enumerate(split_names(names, table.units).values()):
        is_time = "time" in base or base in TIME_NAMES or (base[:1] == "t" and sensor_in(base[1:]) in COLUMNS_OF)
        if (is_time or unit_of("time_unit", unit)) and len(set(table.columns[names[place]][:_MAX_SEEN].tolist())) > 1:
            bounds.append(place)
    spans = [span for span in itertools.pairwise([*bounds, len(names)]) if span[1] - span[0] in _WIDTH]
    parts, clocks = [], []
    for first, end in spans if len(spans) > 1 else ():
        given = np.array([text not in ("", "nan") for text in table.texts(names[first])])
        columns = {name: table.columns[name][given] for name in names[first:end]}
        part = DelimitedTable(table.path, columns, table.first_line, Counter(), Counter(), table.units)
        if (found := guess(part)[0]) is not None and found.time:
            parts.append(SensorTable(names[first], "", part))
            clocks.append(clock(part, found.time, found.time_unit)[0])
    same = [len(t_s) == len(clocks[0]) and np.abs(t_s - clocks[0]).max() < _SAME_CLOCK_S for t_s in clocks[1:]]
    return [] if all(same) else parts


def _check_devices(path: Path, table: DelimitedTable, found: ColumnMap, assumed: Sequence[str]) -> None:
    """Refuses two devices in one table: in columns, with the map of the first; in rows, with the column of devices."""
    if set(assumed) >= _BOTH:
        raise RecordingError(
            f"{path}: line {table.first_line - 1}: several accelerometers and gyroscopes among the columns "
            f"{', '.join(table.columns)[:300]}: two devices; name those of one of them in a column map, as the first:\n"
            f"{_indented(found)}"
        )
    t_s, _ = times_of(table, found)
    for name, values in table.columns.items():
        if values.dtype.kind == "f" or name == found.time or len(set(values[:_MAX_SEEN].tolist())) > _MAX_DEVICES:
            continue
        texts = np.array(table.texts(name))
        devices, num_rows = np.unique(texts[texts != ""], return_counts=True)
        if not (1 < len(devices) <= _MAX_DEVICES and num_rows.min() >= MIN_ROWS):
            continue
        changes, goes_back = texts[1:] != texts[:-1], np.diff(t_s) < 0
        in_turn = changes.mean() > _TURNS and values.dtype.kind not in "iu"
        if in_turn or (goes_back.any() and changes[goes_back].all()):
            raise RecordingError(
                f"{path}: rows of {len(devices)} devices or recordings: column {name!r} has {', '.join(devices)}; "
                f"write the rows of one of them into a file of its own"
            )


def _indented(columns: ColumnMap, rate: str = "") -> str:
    header, *lines = columns.toml().splitlines()
    rated = [f"rate_hz = {rate}"] if rate and not columns.time else []
    return "".join(f"    {line}\n" for line in (header, *rated, *lines))


def _read_tables(path: Path, container: Container, tally: Tally, *, strict: bool) -> Log:
    """A table for each sensor, in files that are named after it; all on one clock."""
    tables: list[SensorTable] = []
    for name, sensor in _tables(container).items():
        content, label = container.read(name), container.label(name)
        try:
            try:
                table = read_delimited(content, label)
            except NoHeaderError:
                table = named_by_place(read_delimited(content, label, header_line=0), sensor)
        except RecordingError as error:
            tally.note("warning", "left-out", name, str(error), "the file was left out")
            continue
        tables.append(SensorTable(name, sensor, table))
    if not tables:
        raise RecordingError(f"{path}: none of its tables can be read: {'; '.join(map(str, tally.findings))}")
    named = {table.name for table in tables}
    tally.skipped.update({name: 1 for name in container.sizes if name not in named})
    return join_tables(path, tables, tally, strict=strict)


def _tables(container: Container) -> dict[str, str]:
    """Sensor by member, of texts whose names or folders say one."""
    texts = [name for name in container.names() if name.lower().endswith((".csv", ".txt", ".tsv"))]
    words = {name: reversed(PurePosixPath(name).with_suffix("").parts) for name in texts}
    kinds = {name: next(filter(None, map(sensor_in, words[name])), "") for name in texts}
    return {name: kind for name, kind in kinds.items() if kind in COLUMNS_OF}


def is_inertial(content: bytes, path: Path) -> bool:
    """Whether the columns of a table, by its first rows, are a time and both inertial sensors."""
    try:
        found, _ = guess(read_delimited(content[: content.rfind(b"\n", 0, _PEEK_BYTES) + 1], path))
    except RecordingError:
        return False
    return found is not None and bool(found.time and found.accel and found.gyro)


def _note_sign(tally: Tally, table: DelimitedTable, found: ColumnMap) -> None:
    """A device on its face for most of the walk: apps of iPhones write acceleration with the other sign."""
    if found.accel is None:
        return
    axes = {name: names for name in ("accel", "gravity") if (names := getattr(found, name)) is not None}
    turned = (f"{name} = {toml_value([f'-{axis}' for axis in names])}" for name, names in axes.items())
    force = np.asarray(sum(table.table(names) for names in axes.values()))
    if found.rotation is None:
        note_face_down(tally, force, f"keep the column map with {' and '.join(turned)}")
    elif np.nanmean(to_world(table.table(found.rotation), force)[:, 2]) < -0.9 * np.nanmean(
        np.linalg.norm(force, axis=1)
    ):
        other = {name: tuple(f"-{axis}" for axis in names) for name, names in axes.items()}
        remedy = f"if an iPhone wrote it, pass this column map:\n{_indented(msgspec.structs.replace(found, **other))}"
        tally.note("error", "accel-sign", "accel", "the attitude turns gravity down: the sign is the other one", remedy)


def column_map_of(path: Path | str) -> str:
    """The map that is guessed for a table, as TOML; "" where none is recognised."""
    path, container = Path(path), open_container(Path(path))
    try:
        found, assumed = guess(_table(container.read(path.name), path)) if container.is_file else (None, [])
    except NoHeaderError:
        return ""
    if found is None:
        return ""
    lines = found.toml().splitlines()
    return "\n".join(
        f"{line}  # by the size of the numbers: check" if line.partition(" = ")[0] in assumed else line
        for line in lines
    )


def _table(content: bytes, path: Path, known: ColumnMap = _UNKNOWN) -> DelimitedTable:
    separator, decimal, line = known.separator, known.decimal, known.header_line
    table = read_delimited(content, path, separator=separator, decimal=decimal, header_line=line)
    if not len(table):
        raise RecordingError(f"{path}: line {table.first_line}: no rows below the header; export the file again")
    return table


def sniff(head: Head) -> bool:
    """True for rows of numbers in as many columns as sensors have, or a folder with a table of each inertial sensor."""
    if head.container is not None:
        tables = _tables(head.container)
        if not {COLUMNS_OF[kind] for kind in tables.values()} >= _BOTH:
            return False
        return {COLUMNS_OF[kind] for name, kind in tables.items() if _layout_of(head.peek(name), head.path)} >= _BOTH
    is_whole = not _COLUMNS.match(head.content)
    content = head.content if is_whole else open_container(head.path).read(head.path.name)
    layout = _layout_of(content, head.path)
    return layout is not None and len(layout.names) in _WIDTH


def _layout_of(content: bytes, path: Path) -> Layout | None:
    try:
        return find_layout(text_of(content, path).content)
    except RecordingError:
        return None


READER: Final = Reader(read, sniff, options=("strict", "columns"), fallback=True, hint=column_map_of)
