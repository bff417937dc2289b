"""Tables of TOML that people write: read with errors that name the key, and written."""

from __future__ import annotations

import difflib
import re
import types
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, TypeVar

import msgspec

from pdrbench.errors import RecordingError

MAX_FILE_BYTES: Final = 1 << 20
Table = TypeVar("Table")
_UNKNOWN: Final = re.compile(r"unknown field `(?P<key>.*?)`(?: - at `(?P<where>.*)`)?")
_ROW: Final = re.compile(r"\[(\d+)\]")
_NUMBER: Final = re.compile(r" \(number \d+\)")


def read_toml(path: Path, kind: type[Table], page: str) -> Table:
    """Reads a file.

    Args:
        path: Of the file.
        kind: What it holds: a struct, or a mapping of anything.
        page: Of the documentation, that says more.

    Raises:
        RecordingError: Names the file, the key that is unknown or wrong, and the nearest known key.
    """
    try:
        with path.open("rb") as stream:
            content = stream.read(MAX_FILE_BYTES + 1)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror}; check the path") from error
    if len(content) > MAX_FILE_BYTES:
        raise RecordingError(f"{path}: larger than {MAX_FILE_BYTES} bytes; recordings belong into files of their own")
    try:
        return msgspec.toml.decode(content.removeprefix(b"\xef\xbb\xbf"), type=kind)
    except msgspec.ValidationError as error:
        raise RecordingError(f"{path}: {explained(error, kind, page)}") from error
    except RecursionError as error:
        raise RecordingError(f"{path}: nested too deeply; write it again") from error
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise RecordingError(f"{path}: not TOML: {error}; put texts into quotes") from error


def explained(error: msgspec.ValidationError, kind: Any, page: str) -> str:
    """What is wrong with a table; where a key is unknown, with the nearest one that is known."""
    message = _ROW.sub(lambda row: f" (number {int(row[1]) + 1})", str(error).replace("$.", ""))
    found = _UNKNOWN.search(message)
    if found is None:
        return f'{message}; see the page "{page}" of the documentation'
    where = found["where"] or ""
    known = _keys(kind, _NUMBER.sub("", where))
    near = difflib.get_close_matches(found["key"], known, n=1, cutoff=0.5)
    remedy = f"did you mean {near[0]!r}?" if near else f"known: {', '.join(known)}"
    return f"no key {found['key']!r} in {f'[{where}]' if where else 'the table'}; {remedy}"


def _keys(table: Any, where: str) -> tuple[str, ...]:
    """Keys of a table in another one, from the path to it: `walk.start`."""
    for name in filter(None, where.split(".")):
        table = _struct_in(typing.get_type_hints(table)[name])
    keys: tuple[str, ...] = table.__struct_fields__
    return keys


def _struct_in(hint: Any) -> Any:
    """The table behind a type such as `StartTable | None` or `tuple[WalkTable, ...]`."""
    if isinstance(hint, type) and not isinstance(hint, types.GenericAlias) and issubclass(hint, msgspec.Struct):
        return hint
    return next(filter(None, map(_struct_in, typing.get_args(hint))), None)


def as_toml(content: msgspec.Struct) -> str:
    """A table as text; what has its default is left out."""
    lines: list[str] = []
    _add_table(lines, "", msgspec.to_builtins(content))
    return "\n".join(lines).strip() + "\n"


def _add_table(lines: list[str], name: str, table: Mapping[str, Any]) -> None:
    """Adds `[name]`, its values, then the tables and lists of tables in it; tables in walks stand in one line."""
    inner = {k: v for k, v in table.items() if isinstance(v, Mapping) and not name.startswith("[")}
    lists = {k: v for k, v in table.items() if isinstance(v, (list, tuple)) and v and isinstance(v[0], Mapping)}
    values = {k: v for k, v in table.items() if k not in inner and k not in lists}
    if name and (values or not inner):
        lines += ["", f"[{name}]"]
    lines += [f"{key} = {toml_value(value)}" for key, value in values.items()]
    for key, value in inner.items():
        _add_table(lines, f"{name}.{key}" if name else key, value)
    for key, rows in lists.items():
        for row in rows:
            _add_table(lines, f"[{key}]", row)


def toml_value(value: object) -> str:
    """A value of TOML."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {toml_value(item)}" for key, item in value.items()) + " }"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(toml_value, value)) + "]"
    return repr(value) if isinstance(value, float) else msgspec.json.encode(value).decode()
