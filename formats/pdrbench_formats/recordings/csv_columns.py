"""A table of numbers with a header, from any logger, device or script.

App: any that writes one table.
Files: one text file with a header; commas, semicolons, tabs or blanks; decimal points or commas; UTF-8, UTF-16 or
Latin-1; also gzip-compressed. Lines above the header, and a line of units below it, are found.
Sensors: accel, gyro, mag, rotation, baro; places as the reference.
Units: as the column map states (TOML, `[columns]`); without a map, from names such as `acc_x (g)`, else by their size,
which a warning says.
Frame: x right, y to the top edge, z out of the screen; a minus before a name in the map turns a column round.
Clock: one column; seconds, milliseconds, microseconds, nanoseconds or dates.
Traps: units that are stated nowhere; acceleration without gravity; sensors that share a table at different rates leave
fields empty.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from pdrbench.errors import RecordingError
from pdrbench.io.container import open_container
from pdrbench.io.log import Log
from pdrbench.io.reader import Head, Reader
from pdrbench.io.text import clean_text, read_text
from pdrbench_formats.recordings.assemble import Tally
from pdrbench_formats.recordings.columnmap import ColumnMap, guess, read_column_map, read_mapped
from pdrbench_formats.recordings.delimited import DelimitedTable, find_layout, read_delimited

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
        _note_guesses(tally, found, assumed)
    _note_sign(tally, table, found)
    return read_mapped(path, table, found, tally=tally, strict=strict)


def _note_guesses(tally: Tally, found: ColumnMap, assumed: Sequence[str]) -> None:
    guesses = ", ".join(f"{name} {getattr(found, name)!r}" for name in assumed)
    tally.note(
        "warning",
        "columns-guessed",
        "header",
        f"what the header does not state was concluded from the numbers: {guesses}",
        "check it with `pdrbench inspect`, which prints a column map to keep",
    )


def _note_sign(tally: Tally, table: DelimitedTable, found: ColumnMap) -> None:
    """A device on its face for most of the walk: apps of iPhones write acceleration with the other sign."""
    if found.accel is None or found.rotation is not None or found.gravity is not None:
        return
    force = table.table(found.accel)
    z, length = float(np.nanmedian(force[:, 2])), float(np.nanmedian(np.linalg.norm(force, axis=1)))
    if z < -0.5 * length:
        turned = ", ".join(f'"-{name}"' for name in found.accel)
        tally.note(
            "warning",
            "accel-sign",
            "accel",
            f"z is {z / length:.2f} of gravity: the device lay on its face, or the sign is that of an iPhone",
            f"in the second case the walk turns the wrong way: keep the column map with accel = [{turned}]",
        )


def column_map_of(path: Path | str) -> str:
    """The map that is guessed for a table, as TOML; "" where none is recognised."""
    found, assumed = guess(_table(Path(path)))
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
    content = _content(path)
    table = read_delimited(content, path, separator=separator, decimal=decimal, header_line=header_line)
    if not len(table):
        raise RecordingError(f"{path}: line {table.first_line}: no rows below the header; export the file again")
    return table


def _content(path: Path) -> bytes:
    container = open_container(path)
    if container.read(path.name, 2) == b"\x1f\x8b":
        return read_text(path).content
    return container.read(path.name)


def sniff(head: Head) -> bool:
    """True for rows of numbers in at least four columns; what stands above them may name the columns."""
    if head.container is not None or not head.content:
        return False
    try:
        layout = find_layout(clean_text(head.content, head.path, latin_1=True).content)
    except RecordingError:
        return False
    return layout is not None and len(layout.names) >= _MIN_NAMED


READER: Final = Reader(read, sniff, options=("strict", "columns"), fallback=True, hint=column_map_of)
