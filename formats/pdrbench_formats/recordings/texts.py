"""Texts as loggers and scripts leave them, as one kind of table: in UTF-8, with line feeds, names in a header."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import msgspec

from pdrbench.io.text import Text, clean_text

WORDS: Final = tomllib.loads((Path(__file__).parents[1] / "words.toml").read_text(encoding="utf-8"))
ENCODINGS: Final = ("latin-1", "gb18030", "shift_jis", "cp1251")  # the first in which most words are known
_FOREIGN: Final = [
    word
    for words in (*WORDS["sensors"]["ending"].values(), WORDS["columns"]["time"])
    for word in words
    if not word.isascii()
]
_BEGIN_BYTES: Final = 4096
_FEW_LINES: Final = 60  # by which rows are known
_MIN_FIELDS: Final = 3  # of a row: a time and a place
_MAX_NAMES: Final = 200
_BETWEEN_OBJECTS: Final = re.compile(rb"\}\s*,\s*\{")
_BETWEEN_FIELDS: Final = re.compile(rb"[,;\t|]\s*|\s+(?=[A-Za-z_\x80-\xff][^\s:=]*[:=])")
_FIELD: Final = re.compile(rb"([A-Za-z_\x80-\xff][^:=]*?)\s*[:=]\s*(.*)")


def text_of(content: bytes, path: Path) -> Text:
    """A table in any encoding and with any line ends; with a header where each row names its own fields.

    Args:
        content: Of a file, or its beginning.
        path: Named in errors.

    Raises:
        RecordingError: As `clean_text`.
    """
    if b"\n" not in content:
        content = content.replace(b"\r", b"\n")
    begin = content[:_BEGIN_BYTES]
    encoding = max(ENCODINGS, key=lambda one: sum(word in begin.decode(one, "ignore").lower() for word in _FOREIGN))
    return clean_text(_with_header(content), path, encoding=encoding)


def _with_header(content: bytes) -> bytes:
    """Rows of JSON objects, or of fields as `ax:0.1` or `ax=0.1`, as a table with tabs; anything else as it is."""
    mark = content[:_BEGIN_BYTES].lstrip()[:1]
    text = content if mark != b"[" else _BETWEEN_OBJECTS.sub(b"}\n{", content.replace(b"\n", b" "))
    fields_of = _members if mark in (b"{", b"[") else _named_fields
    first = [line for line in text[: 16 * _BEGIN_BYTES].split(b"\n")[:_FEW_LINES] if line.strip()]
    if 2 * sum(len(fields_of(line)) >= _MIN_FIELDS for line in first) <= len(first):
        return content
    lines = text.split(b"\n")
    rows = [fields_of(line) for line in lines]
    names = dict.fromkeys(name for row in rows[: 10 * _FEW_LINES] for name in row)
    if len(names) > _MAX_NAMES:
        return content
    table = [b"\t".join([row.get(name, b"") for name in names]) if row else lines[k] for k, row in enumerate(rows)]
    return b"\n".join([b"\t".join(names), *table])


def _named_fields(line: bytes) -> dict[bytes, bytes]:
    """Fields by name of a line in which each has one, else none."""
    found = [_FIELD.fullmatch(field) for field in _BETWEEN_FIELDS.split(line.strip()) if field]
    return {match[1]: match[2] for match in found if match} if all(found) else {}


def _members(line: bytes) -> dict[bytes, bytes]:
    """Fields by name, as `acc.x`, of a line with a JSON object, else none."""
    try:
        return dict(_leaves("", msgspec.json.decode(line.strip(b" \t\r,[]"))))
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return {}


def _leaves(name: str, value: Any) -> Iterator[tuple[bytes, bytes]]:
    """Names and texts of what an object of JSON holds."""
    if isinstance(value, (dict, list)):
        for key, inner in value.items() if isinstance(value, dict) else enumerate(value):
            yield from _leaves(f"{name}.{key}".lstrip("."), inner)
    elif name:
        texts = (name, "" if value is None else str(value))
        key, text = (b" ".join(one.encode(errors="replace").split()) for one in texts)
        yield key, text
