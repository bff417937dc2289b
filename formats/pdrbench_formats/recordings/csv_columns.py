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

import re
from collections.abc import Sequence
from pathlib import Path, PurePosixPath
from typing import Any, Final

from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray
from pdrbench.io.container import Container, open_container
from pdrbench.io.log import Log
from pdrbench.io.reader import Head, Reader
from pdrbench.io.text import clean_text
from pdrbench.sensors.checks import SAMPLED
from pdrbench_formats.recordings.assemble import Origin, Tally, assemble, note_face_down
from pdrbench_formats.recordings.columnguess import guess, sensor_of
from pdrbench_formats.recordings.columnmap import (
    ColumnMap,
    clock,
    read_column_map,
    read_mapped,
    streams_of,
    unix_s,
)
from pdrbench_formats.recordings.delimited import DelimitedTable, Layout, find_layout, read_delimited

_MIN_NAMED = 4  # columns: a time and a vector
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
    if path.is_dir() or container.is_zip:
        if columns is not None:
            raise RecordingError(f"{path}: a column map is for one table; name one of the files in it")
        return _read_tables(path, container, tally, strict=strict)
    if columns is not None:
        known = read_column_map(columns)
        table = _table(path, known.separator, known.decimal, known.header_line)
        return read_mapped(path, table, known, strict=strict)
    table = _table(path)
    found, assumed = guess(table)
    if found is None:
        raise RecordingError(
            f"{path}: line 1: no time and sensor recognised among the columns {', '.join(table.columns)[:300]}; "
            f"name them in a TOML file and pass it as column map:\n    [columns]\n    {_EXAMPLE}"
        )
    if assumed:
        _note_guesses(tally, [f"{name} {getattr(found, name)!r}" for name in assumed])
    _note_sign(tally, table, found)
    return read_mapped(path, table, found, tally=tally, strict=strict)


def _read_tables(path: Path, container: Container, tally: Tally, *, strict: bool) -> Log:
    """A table for each sensor, in files that are named after it; all on one clock."""
    streams: dict[str, FloatArray] = {}
    firsts: dict[str, float] = {}
    sources: dict[str, str] = {}
    guesses: list[str] = []
    for name, sensor in _tables(container).items():
        table = read_delimited(container.read(name), container.label(name))
        found, assumed = guess(table, sensor)
        if found is None or not len(table):
            tally.skipped[name] += 1
            continue
        guesses += [f"{name}: {key} {getattr(found, key)!r}" for key in assumed]
        t_s, first_s = clock(table, found.time, found.time_unit)
        for kind, rows in streams_of(table, found, t_s, tally).items():
            if kind in streams:
                raise RecordingError(
                    f"{path}: {sources[kind]} and {name} both hold {kind}: two devices or two recordings; "
                    f"name the files of one of them"
                )
            streams[kind], firsts[kind], sources[kind] = rows, first_s, name
    if not streams:
        raise RecordingError(
            f"{path}: no time and sensor recognised in {', '.join(_tables(container))}; "
            f"name one of the files, with a column map"
        )
    for name in container.sizes.keys() - sources.values():
        tally.skipped[name] += 1
    begin_s = min(firsts.values())
    for kind, rows in streams.items():
        rows[:, 0] += firsts[kind] - begin_s
    if guesses:
        _note_guesses(tally, guesses)
    return assemble(path, streams, origin=Origin(start_unix_s=unix_s(begin_s)), tally=tally, strict=strict)


def _tables(container: Container) -> dict[str, str]:
    """Sensor by member, of text files whose names say one."""
    kinds = {
        name: sensor_of(re.sub(r"[^a-z]+|\b(csv|txt)$", "", PurePosixPath(name).stem.lower()))[0]
        for name in container.names()
        if name.lower().endswith((".csv", ".txt", ".tsv"))
    }
    return {name: kind for name, kind in kinds.items() if kind in SAMPLED}


def _note_guesses(tally: Tally, guesses: Sequence[str]) -> None:
    tally.note(
        "warning",
        "columns-guessed",
        "header",
        f"what the header does not state was concluded from the numbers: {', '.join(guesses)}",
        "check it with `pdrbench inspect`, which prints a column map to keep",
    )


def _note_sign(tally: Tally, table: DelimitedTable, found: ColumnMap) -> None:
    """A device on its face for most of the walk: apps of iPhones write acceleration with the other sign."""
    if found.accel is None or found.rotation is not None or found.gravity is not None:
        return
    turned = ", ".join(f'"-{name}"' for name in found.accel)
    note_face_down(tally, table.table(found.accel), f"keep the column map with accel = [{turned}]")


def column_map_of(path: Path | str) -> str:
    """The map that is guessed for a table, as TOML; "" where none is recognised."""
    path = Path(path)
    if path.is_dir() or open_container(path).is_zip:
        return ""
    found, assumed = guess(_table(path))
    if found is None:
        return ""
    lines = found.toml().splitlines()
    return "\n".join(
        f"{line}  # by the size of the numbers: check" if line.partition(" = ")[0] in assumed else line
        for line in lines
    )


def _table(
    path: Path, separator: str | None = None, decimal: str | None = None, header_line: int | None = None
) -> DelimitedTable:
    content = open_container(path).read(path.name)
    table = read_delimited(content, path, separator=separator, decimal=decimal, header_line=header_line)
    if not len(table):
        raise RecordingError(f"{path}: line {table.first_line}: no rows below the header; export the file again")
    return table


def sniff(head: Head) -> bool:
    """True for rows of numbers in at least four columns, and for a folder with a table of each inertial sensor."""
    if head.container is not None:
        tables = _tables(head.container)
        is_inertial = "accel" in tables.values() and "gyro" in tables.values()
        return is_inertial and all(_layout_of(head.peek(name), head.path) for name in tables)
    layout = _layout_of(head.content, head.path)
    return layout is not None and len(layout.names) >= _MIN_NAMED


def _layout_of(content: bytes, path: Path) -> Layout | None:
    try:
        return find_layout(clean_text(content, path, latin_1=True).content)
    except RecordingError:
        return None


READER: Final = Reader(read, sniff, options=("strict", "columns"), fallback=True, hint=column_map_of)
