"""A format: how its files are recognised and read."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from pdrbench.errors import RecordingError
from pdrbench.io.compressed import content_of
from pdrbench.io.container import ZIP_MAGIC, Container, open_container
from pdrbench.io.text import from_utf16

HEAD_BYTES: Final = 65_536  # every header of every known text log lies within
_PEEK_BYTES: Final = 4096


@dataclass(frozen=True, slots=True)
class Head:
    """What a format is recognised by.

    Attributes:
        path: Of the file or folder.
        content: The first `HEAD_BYTES` of a file, unpacked where it is compressed, UTF-16 as UTF-8 and without a
            byte-order mark; empty for a folder.
        container: Members of a folder or zip archive; None of a plain file.
    """

    path: Path
    content: bytes
    container: Container | None = None

    def members(self, suffix: str = "", depth: int = 1) -> list[str]:
        """Names of members that end so, in small letters, below at most `depth` folders; none of a plain file."""
        names = [] if self.container is None else self.container.names(suffix)
        return [name for name in names if name.count("/") <= depth]

    def peek(self, name: str) -> bytes:
        """The beginning of a member, as `content` is that of a file."""
        assert self.container is not None
        return from_utf16(self.container.read(name, _PEEK_BYTES))


@dataclass(frozen=True, slots=True)
class Reader:
    """One format of files or folders.

    Attributes:
        read: Takes the path; returns a `Log`, a `Recording` or a `Building`, or a record of its own, whose method
            `describe()` gives what `pdrbench inspect` prints as numbers, texts, mappings and lists of rows. Raises
            `RecordingError` or `MapError` with file, line and remedy.
        sniff: Returns True where a file or folder is in this format, by its content and not by its name alone.
        options: Keyword arguments that `read` takes beside the path. With "strict", `read(path, strict=False)` returns
            a log with errors among its findings instead of raising them.
        fallback: True for a format that many files seem to be in: asked after all others.
        hint: Text on a file for `pdrbench inspect` to print last, such as a column map to correct; None for no hint.
        summary: What lists say of it; empty for the docstring of the module of `read`.
    """

    read: Callable[..., Any]
    sniff: Callable[[Head], bool]
    options: tuple[str, ...] = ()
    fallback: bool = False
    hint: Callable[[Path], str] | None = None
    summary: str = ""


def head_of(path: Path) -> Head:
    """The head of a file or folder.

    Raises:
        RecordingError: It is missing, cannot be read, or is compressed or a zip archive and damaged.
    """
    if path.is_dir():
        container = None
        with contextlib.suppress(RecordingError):  # too many files for one recording: the folder may be something else
            container = open_container(path)
        return Head(path, b"", container)
    content = read_bytes(path, HEAD_BYTES)
    container = open_container(path) if content.startswith(ZIP_MAGIC) else None
    return Head(path, from_utf16(content), container)


def read_bytes(path: Path, num_bytes: int) -> bytes:
    """The first bytes of a file, unpacked where it is compressed; raises `RecordingError` where it cannot be read."""
    try:
        with path.open("rb") as stream:
            return content_of(stream, path, num_bytes)
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise RecordingError(f"{path}: cannot be read: {reason}; check the path and its permissions") from error
