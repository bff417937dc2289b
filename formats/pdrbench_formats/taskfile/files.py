"""The files that a task file names: which they are, whether they have changed, and what their readers make of them."""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import itertools
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import msgspec

from pdrbench.errors import MapError, RecordingError, unknown_name
from pdrbench.files import sha256_of
from pdrbench.geometry import FloatArray
from pdrbench.io import READERS
from pdrbench.io.compressed import plain_name
from pdrbench.io.geo import GeoFrame
from pdrbench.io.log import Log
from pdrbench.recording import Recording
from pdrbench.trajectory import Trajectory
from pdrbench_formats.detect import detect, read, read_plan
from pdrbench_formats.maps.plan import Plan
from pdrbench_formats.recordings.axes import moves_as_shoe
from pdrbench_formats.taskfile.index import Index
from pdrbench_formats.taskfile.places import check_not_exchanged, read_places
from pdrbench_formats.taskfile.schema import TaskFile, WalkTable

TRUTH_END: Final = "_truth.csv"  # of the name of a table of places beside a recording
COLUMNS_END: Final = "_columns.toml"  # of the name of a column map beside a table
TABLE: Final = "csv"  # the format that column maps explain
TABLE_ENDS: Final = (".csv", ".tsv", ".txt")
MAX_APART_S: Final = 60.0  # of places from the recording: further off they are on another clock
MAX_FILES: Final = 10_000  # of a recording that is a folder
BETWEEN: Final = "path_data_files"  # folder between those of floors and walks, in ILC20
Stamp = tuple[int, int]


class FileFacts(msgspec.Struct, frozen=True):
    """What there is to know of a recording before it is played.

    Attributes:
        geo: Frame of its places; None where they are in metres of a plan.
        first_s: Time of the first place; None where there is none.
        level: Of the first place; None where there is none.
        start_unix_s: Time 0 in seconds since 1970; None where the file does not say.
        end_s: Time of the last row of any sensor.
        findings: What the reader found that a user should know.
        mounting: Where the device was carried, as far as the file says.
        is_shoe: True where the file does not say so, and it moved as a shoe does.
    """

    geo: GeoFrame | None
    first_s: float | None
    level: int | None
    start_unix_s: float | None
    end_s: float
    findings: tuple[str, ...]
    mounting: str
    is_shoe: bool


def beside(path: Path, name: str) -> Path:
    """A file that a task file names."""
    return path.parent / Path(name).expanduser()


def place_of(path: Path, table: WalkTable) -> Path:
    """The file of a walk, by which two tables are known to name the same."""
    return beside(path, table.file).resolve()


def stamp(place: Path) -> Stamp:
    """Size and time of the last change of a file, or of all files of a folder; zeros where it is missing."""
    try:
        files = [*itertools.islice(place.rglob("*"), MAX_FILES)] if place.is_dir() else [place]
        states = [file.stat() for file in files]
    except OSError:
        return 0, 0
    return sum(state.st_size for state in states), max((state.st_mtime_ns for state in states), default=0)


def named_files(path: Path, content: TaskFile) -> list[Path]:
    """Every file whose change makes a task another one, as far as that is known before one is read."""
    tables = [with_companions(path, table) for table in (*content.walk, *survey_tables(content))]
    if not content.walk:
        return [path, *_visible(path), *_other_files(path, content, tables)]
    return [path, *_other_files(path, content, tables), *(beside(path, table.file) for table in tables)]


def walk_tables(path: Path, content: TaskFile, index: Index) -> dict[str, WalkTable]:
    """Table of each walk by id; without tables, of every file of the folder that a reader of walks recognises."""
    tables: dict[str, WalkTable] = {}
    for table in content.walk or _found_walks(path, content, index):
        file = Path(table.file)
        name = table.id or file.name.partition(".")[0] or file.resolve().name
        if name in tables:
            raise RecordingError(f"{path}: two walks are called {name!r}; give one of them an id")
        tables[name] = with_companions(path, msgspec.structs.replace(table, id=name))
    return tables


def survey_tables(content: TaskFile) -> tuple[WalkTable, ...]:
    """A table for each file of the survey, as if it were a walk."""
    return () if content.survey is None else tuple(WalkTable(file=name) for name in content.survey.files)


def walks_below(path: Path, content: TaskFile, table: WalkTable, index: Index) -> list[WalkTable]:
    """The table itself; of a folder that is no recording, one for every recording in it and in its folders."""
    place, told = beside(path, table.file), functools.partial(_told_format, path, content, index=index)
    if not place.is_dir() or told(table):
        return [with_companions(path, table)]
    nested = next((file for file in place.glob("*/*/*.txt*") if file.parent.name != BETWEEN), None)
    if nested is not None:
        raise RecordingError(
            f"{place}: the walks of a building lie in its folder or in those of its floors, not as deep as {nested}; "
            f"name one building: {place / nested.relative_to(place).parts[0]}"
        )
    named = (file.relative_to(place) for file in sorted(place.rglob("*"))[:MAX_FILES] if file.is_file())
    shown = (name for name in named if not any(part.startswith(".") for part in name.parts))
    every = (with_companions(path, WalkTable(file=str(Path(table.file) / name))) for name in shown)
    tables = (one for one in every if not one.file.endswith((TRUTH_END, COLUMNS_END)))
    return [msgspec.structs.replace(one, format=kind) for one in tables if (kind := told(one))]


def with_companions(path: Path, table: WalkTable) -> WalkTable:
    """The table of a walk with the truth and the column map that lie beside its file."""
    file = Path(table.file)
    stem = file.name.partition(".")[0]
    for name in dict.fromkeys(filter(None, (table.id, stem))):
        truth, columns = (str(file.with_name(f"{name}{end}")) for end in (TRUTH_END, COLUMNS_END))
        if not table.truth and beside(path, truth).is_file():
            table = msgspec.structs.replace(table, truth=truth)
        if table.columns is None and beside(path, columns).is_file():
            table = msgspec.structs.replace(table, columns=columns)
    return table


def unused_files(path: Path, content: TaskFile, tables: Mapping[str, WalkTable]) -> list[str]:
    """Names in the folder of a task that it does not use."""
    used = {place.name for place in _other_files(path, content, tables.values())}
    used |= {table.file for table in (*tables.values(), *survey_tables(content))}
    return [place.name for place in _visible(path) if place.name not in used and place != path]


def file_facts(path: Path, content: TaskFile, table: WalkTable, index: Index) -> FileFacts:
    """What there is to know of the file of a walk.

    Raises:
        RecordingError: It is missing, damaged or no walk.
    """

    def find() -> FileFacts:
        found = read_walk(path, content, table)
        reference, geo, left_out = places_of(path, table, found)
        unsaid = ["accel-sign"] if "foot" in (table.mounting, found.mounting) else []  # at any angle on a shoe
        reported = [one for one in getattr(found, "findings", ()) if one.severity != "note" and one.code not in unsaid]
        return FileFacts(
            geo=geo,
            first_s=float(reference.t_s[0]) if len(reference) else None,
            level=int(reference.level[0]) if len(reference) else None,
            start_unix_s=getattr(found, "start_unix_s", None),
            end_s=last_row_s(found),
            findings=(*map(str, reported), *[left_out] * bool(left_out)),
            mounting=found.mounting,
            is_shoe=not found.mounting and moves_as_shoe(rows_of(found)),
        )

    return index.facts(f"file {table.id or table.file}", FileFacts, causes_of(path, content, table), find)


def causes_of(path: Path, content: TaskFile, table: WalkTable) -> object:
    """What the content of a walk follows from: its files as they are now, and how they are read."""
    places = [beside(path, name) for name in (table.file, table.truth, _columns_file(content, table)) if name]
    stamps = [(str(place), stamp(place)) for place in places]
    return stamps, table.format, content.columns if table.columns is None else table.columns


def sha256_of_walk(path: Path, content: TaskFile, tables: Mapping[str, WalkTable], walk: str) -> str:
    """Digest of what a walk is made of: its files, the plan, the survey, and how they are read.

    Raises:
        UnknownNameError: There is no such walk.
    """
    if walk not in tables:
        raise unknown_name(f"walk of {path}", walk, tables)
    surveyed = [tables[name] for name in (() if content.survey is None else content.survey.walks) if name in tables]
    parts: list[object] = [content.task, content.plan]
    for table in (tables[walk], *surveyed, *(with_companions(path, table) for table in survey_tables(content))):
        columns = content.columns if table.columns is None else table.columns
        parts += [table, None if isinstance(columns, str) else columns]
        parts += [
            _content(beside(path, name)) for name in (table.file, table.truth, _columns_file(content, table)) if name
        ]
    parts.append(None if content.plan is None else _content(beside(path, content.plan.file)))
    return hashlib.sha256(msgspec.json.encode(parts)).hexdigest()


def _content(place: Path) -> object:
    """Digest of a file; of a folder, which may be large, its stamp."""
    return sha256_of(place) if place.is_file() else stamp(place)


def read_walk(path: Path, content: TaskFile, table: WalkTable) -> Log | Recording:
    """What a reader makes of the file of a walk.

    Args:
        path: Of the task file.
        content: Of the task file.
        table: What it says of the walk.
    """
    place = beside(path, table.file)
    kind = table.format or ("" if table.columns is None else TABLE)
    if not kind and content.columns is not None and place.is_file() and plain_name(place.name).endswith(TABLE_ENDS):
        kind = TABLE
    found = _read(path, place, kind or detect(place), content, table)
    if not isinstance(found, (Log, Recording)):
        raise RecordingError(f"{place}: holds {type(found).__name__}, no walk; name a recording")
    return found


def rows_of(found: Log | Recording) -> Mapping[str, FloatArray]:
    """(T, C) rows by sensor."""
    return found.rows if isinstance(found, Log) else {name: stream.rows for name, stream in found.streams.items()}


def last_row_s(found: Log | Recording) -> float:
    """Time of the last row of any sensor."""
    return max((float(rows[-1, 0]) for rows in rows_of(found).values() if len(rows)), default=0.0)


def places_of(path: Path, table: WalkTable, found: Log | Recording) -> tuple[Trajectory, GeoFrame | None, str]:
    """The places of a walk, from its table of truth where there is one, their frame, and what was left out of them."""
    if table.truth:
        places, geo, left_out = read_places(beside(path, table.truth), getattr(found, "start_unix_s", None))
        places = dataclasses.replace(places, t_s=places.t_s + table.truth_offset_s)
        if geo is not None and (of_phone := getattr(found, "geo", None)) is not None:
            check_not_exchanged(geo, of_phone, f"{beside(path, table.truth)}: its places")
        first_s, last_s, end_s = float(places.t_s[0]), float(places.t_s[-1]), last_row_s(found)
        if first_s > end_s + MAX_APART_S or last_s < -MAX_APART_S:
            raise RecordingError(
                f"{beside(path, table.truth)}: its places lie at {first_s:.1f} to {last_s:.1f} s, the recording at 0 "
                f"to {end_s:.1f} s: another clock; where both begin together, --truth-offset (truth_offset_s in a "
                f"task file) {table.truth_offset_s - first_s:.1f} puts them right"
            )
        return places, geo, left_out
    return found.reference, getattr(found, "geo", None), ""


@functools.lru_cache(maxsize=8)
def read_plan_once(place: Path, kind: str, doors: str, _stamped: Stamp) -> Plan:
    """A plan, read again where its stamp is another."""
    return read_plan(place, kind or None, doors)


def _read(path: Path, place: Path, kind: str, content: TaskFile, table: WalkTable) -> Any:
    columns = content.columns if table.columns is None else table.columns
    options: tuple[tuple[str, str], ...] = ()
    if columns is not None and (table.columns is not None or "columns" in READERS[kind].options):
        columns = str(beside(path, columns)) if isinstance(columns, str) else columns
        options = (("columns", msgspec.json.encode(columns).decode()),)
    changes = tuple(stamp(beside(path, name)) for name in (table.file, _columns_file(content, table)) if name)
    return _read_once(place, kind, options, changes)


# A folder may hold hundreds of recordings: few are kept.
@functools.lru_cache(maxsize=4)
def _read_once(place: Path, kind: str, options: tuple[tuple[str, str], ...], _stamped: tuple[Stamp, ...]) -> Any:
    return read(place, kind, **{name: msgspec.json.decode(value) for name, value in options})


def _columns_file(content: TaskFile, table: WalkTable) -> str:
    """The file with the column map of a walk; empty where there is none."""
    columns = content.columns if table.columns is None else table.columns
    return columns if isinstance(columns, str) else ""


def _visible(path: Path) -> list[Path]:
    """What lies in the folder of a task file."""
    return sorted(place for place in path.parent.iterdir() if place.name[0] != ".")


def _found_walks(path: Path, content: TaskFile, index: Index) -> Iterator[WalkTable]:
    surveys = survey_tables(content)
    named = {path, *_other_files(path, content, surveys), *(beside(path, table.file) for table in surveys)}
    for place in _visible(path):
        if place in named or place.name.endswith((TRUTH_END, COLUMNS_END)):
            continue
        table = with_companions(path, WalkTable(file=place.name))
        if kind := _told_format(path, content, table, index):
            yield WalkTable(file=place.name, format=kind)


def _told_format(path: Path, content: TaskFile, table: WalkTable, index: Index) -> str:
    find = functools.partial(_walk_format, path, content, table)
    return index.facts(f"format {table.file}", str, causes_of(path, content, table), find)


def _walk_format(path: Path, content: TaskFile, table: WalkTable) -> str:
    """The format of a recording; empty for a text, a picture, results of a run."""
    place = beside(path, table.file)
    try:
        kind = TABLE if table.columns is not None else detect(place)
    except RecordingError:
        return ""
    try:
        return kind if isinstance(_read(path, place, kind, content, table), (Log, Recording)) else ""
    except MapError:
        return ""  # a plan, whatever is wrong with it
    except RecordingError:
        return kind  # a walk that is refused


def _other_files(path: Path, content: TaskFile, tables: Iterable[WalkTable]) -> Iterator[Path]:
    """Files that belong to a task and are no walks: plan, column maps, tables of places."""
    if content.plan is not None:
        yield beside(path, content.plan.file)
    for table in tables:
        yield from (beside(path, name) for name in (table.truth, _columns_file(content, table)) if name)
    if isinstance(content.columns, str):
        yield beside(path, content.columns)
