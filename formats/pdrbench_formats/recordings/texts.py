"""Texts as loggers and scripts leave them, as one kind of table: in UTF-8, with line feeds, names in a header."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import msgspec

from pdrbench.io.text import Text, clean_text

WORDS: Final = tomllib.loads((Path(__file__).parents[1] / "words.toml").read_text(encoding="utf-8"))
ENCODINGS: Final = ("latin-1", "gb18030", "shift_jis", "cp1251")  # the first in which most words are known
_FOREIGN: Final = [
    word
    for words in (*WORDS["sensors"]["ending"].values(), WORDS["columns"]["time"], WORDS["columns"]["level"])
    for word in words
    if not word.isascii()
]
_BEGIN_BYTES: Final = 4096
_FEW_LINES: Final = 60  # by which rows are known
_MIN_FIELDS: Final = 3  # of a row: a time and a place
_MAX_NAMES: Final = 200
_MAX_DEPTH: Final = 4  # of a list of rows in a document
_ROWS_BEGIN: Final = re.compile(rb"\[\s*\{")
_STAMP: Final = re.compile(rb"^(\d\d:\d\d:\d\d[.,]\d+) -> (?=(.*))", re.M)  # of the serial monitor of Arduino
_MINUS: Final = "\N{MINUS SIGN}".encode()  # of typeset numbers, where others write a hyphen
_CHECKSUM: Final = re.compile(rb"\*[0-9A-F]{2}(?=\r?$)", re.M)  # of NMEA 0183
_VECTOR: Final = re.compile(rb'"?[\[(]\s*(-?[\d.][-+\d.e]*(?:[,;\s]+-?[\d.][-+\d.e]*){2,3})\s*[\])]"?', re.I)
_PARTS: Final = re.compile(rb"[^,;\s]+")
_LAST_MARK: Final = re.compile(rb";(?=\r?\n)")
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
    num_zero = len(content) - len(content.rstrip(b"\0")) if content.endswith(b"\0\0") else 0
    content = content[: len(content) - num_zero]  # of a logger whose power was cut
    if b"\n" not in content:
        content = content.replace(b"\r", b"\n")
    content = _without_brackets(content.replace(_MINUS, b"-"))
    if content.startswith(b"$"):
        content = _CHECKSUM.sub(b"", content)
    begin = content[:_BEGIN_BYTES]
    encoding = ENCODINGS[0] if begin.isascii() else max(ENCODINGS, key=lambda one: _num_known(begin, one))
    num_lines = begin.count(b"\n")
    if 2 * len(_STAMP.findall(begin)) > num_lines:
        content = _STAMP.sub(_after_stamp, content)
    if begin.count(b";") == len(_LAST_MARK.findall(begin)) > num_lines / 2:
        content = _LAST_MARK.sub(b"", content)
    table = _with_header(content)
    text = clean_text(table, path, encoding=encoding)
    mended = {**text.mended, **({"zero bytes at the end": num_zero} if num_zero else {})}
    return replace(text, added_lines=int(table is not content), mended=mended)


def _without_brackets(content: bytes) -> bytes:
    """Rows with whole vectors in their fields, as `[0.1, 0.2, 9.8]` or `(0.1 0.2 9.8)`, with a field for each axis."""
    header, _, rows = content.partition(b"\n")
    if content[:1] in (b"{", b"[") or not _VECTOR.search(first := rows.partition(b"\n")[0]):
        return content
    mark = next((one for one in (b"\t", b";", b",") if one in header), b",")
    fields = _VECTOR.sub(lambda match: b"\0" * len(_PARTS.findall(match[1])), first).split(mark)
    of_fields = zip(header.strip().split(mark), fields, strict=False)
    names = [
        name + axis
        for name, field in of_fields
        for axis in (b".x", b".y", b".z", b".w")[: field.count(b"\0")] or (b"",)
    ]
    return mark.join(names) + b"\n" + _VECTOR.sub(lambda match: mark.join(_PARTS.findall(match[1])), rows)


def _num_known(begin: bytes, encoding: str) -> int:
    """Words of `words.toml` in the beginning of a text, if that is its encoding."""
    text = begin.decode(encoding, "ignore").lower()
    return sum(word in text for word in _FOREIGN)


def _after_stamp(match: re.Match[bytes]) -> bytes:
    """The time of a line as one of its fields."""
    rest = match[2]
    mark = next((one for one in (b",", b"\t", b";") if one in rest), b" ")
    return (b"time=" if _named_fields(rest) else b"") + match[1].replace(b",", b".") + mark


def _objects(content: bytes) -> bytes:
    """A document of JSON with rows somewhere in it, as an object on each line; lists beside one another are kinds."""
    try:
        first, _, rest = content.partition(b"\n")
        is_by_line = rest.strip() and b"[{" in first and _members(first)
        document = msgspec.json.Decoder().decode_lines(content) if is_by_line else msgspec.json.decode(content)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        begin = None if _members(content.split(b"\n", 1)[0]) else _ROWS_BEGIN.search(content, 0, _BEGIN_BYTES)
        part = content if begin is None else content[begin.end() - 1 :].replace(b"\n", b" ")
        return content if begin is None else _BETWEEN_OBJECTS.sub(b"}\n{", part)
    every = dict(_lists("", document))
    lists = {key: found for key, found in every.items() if len(found) > _MIN_FIELDS}
    kinds = {key: found for key, found in (lists or every).items() if _are_objects(found)}
    rows = [row if len(kinds) == 1 else {"sensor": key, **row} for key, found in kinds.items() for row in found]
    if not rows and len(set(map(len, lists.values()))) == 1:
        rows = [dict(zip(lists, row, strict=True)) for row in zip(*lists.values(), strict=True)]
    inner = {key for row in rows for key, value in row.items() if isinstance(value, list) and _are_objects(value)}
    if len(inner) == 1:  # readings of a scan, or sensors of a time
        key = inner.pop()
        nested = ((k, row, row.get(key)) for k, row in enumerate(rows))
        rows = [
            {**row, key: k, **one} for k, row, of in nested if isinstance(of, list) and _are_objects(of) for one in of
        ]
    return b"\n".join([msgspec.json.encode(row) for row in rows]) or content


def _are_objects(value: list[Any]) -> bool:
    return bool(value) and all(isinstance(one, dict) for one in value)


def _lists(name: str, value: Any, depth: int = 0) -> Iterator[tuple[str, list[Any]]]:
    """Lists in a document, by the names that they have."""
    if isinstance(value, list):
        yield name, value
    elif isinstance(value, dict) and len(value) > _MAX_NAMES and all(isinstance(one, dict) for one in value.values()):
        yield name, list(value.values())  # each row has a key of its own
    elif isinstance(value, dict) and depth < _MAX_DEPTH:
        for key, inner in value.items():
            yield from _lists(key, inner, depth + 1)


def _with_header(content: bytes) -> bytes:
    """Rows of JSON objects, or of fields as `ax:0.1` or `ax=0.1`, as a table with tabs; anything else as it is."""
    mark = content[:_BEGIN_BYTES].lstrip()[:1]
    text = _objects(content) if mark in (b"{", b"[") else content
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
