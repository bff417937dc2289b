"""What other programs keep: recognised, and refused with what to export instead.

App: Excel, SQLite, MATLAB and MATLAB Mobile, Parquet, archives, saved states of apps.
Files: workbooks, databases, MAT-files, `.mvnx`, `.mtb`, `.phyphox`, `.gpx`, `.kml` and the like.
Sensors: none; the export as CSV gives them.
Units: those of the export.
Clock: that of the export.
Traps: a workbook or a database may hold several recordings; export one at a time.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import msgspec

from pdrbench.errors import RecordingError
from pdrbench.io.reader import Head, Reader, head_of


class _Kind(msgspec.Struct, forbid_unknown_fields=True):
    """A text by which files of a kind are known, where it stands, what they are, and what to do."""

    text: str
    what: str
    remedy: str
    at: int = 0

    @property
    def content(self) -> bytes:
        """The text as bytes."""
        return self.text.encode("latin-1")


class _Kinds(msgspec.Struct, forbid_unknown_fields=True):
    """Files known by how they begin, by an element of XML, and by a member of an archive."""

    begins: list[_Kind]
    element: list[_Kind]
    member: list[_Kind]


_KNOWN: Final = msgspec.toml.decode((Path(__file__).parents[1] / "other_programs.toml").read_bytes(), type=_Kinds)


def read(path: Path | str) -> None:
    """Raises `RecordingError` with what to export instead."""
    kind = _kind(head_of(Path(path)))
    if kind is None:
        raise RecordingError(f"{path}: of no program that is known; name another format")
    raise RecordingError(f"{path}: {kind.what}, which is not read; {kind.remedy}")


def sniff(head: Head) -> bool:
    """True for a file of such a program."""
    return _kind(head) is not None


def _kind(head: Head) -> _Kind | None:
    if head.container is not None:
        names = {head.container.prefix + name for name in head.container.sizes} if head.container.is_zip else set()
        return next((kind for kind in _KNOWN.member if kind.text in names), None)
    begin = head.content[:4096].lstrip()
    if begin.startswith(b"<"):
        return next((kind for kind in _KNOWN.element if kind.content in begin), None)
    return next((kind for kind in _KNOWN.begins if head.content.startswith(kind.content, kind.at)), None)


READER: Final = Reader(read, sniff, fallback=True)
