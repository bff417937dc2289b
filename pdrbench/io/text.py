"""Text files from strangers, read whole within bounded memory."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from pdrbench.errors import RecordingError
from pdrbench.io.compressed import pieces

MAX_TEXT_BYTES: Final = 256 << 20  # an ILC20 log grows by 3 MB a minute: well over an hour
MAX_LINE_BYTES: Final = 64 << 10  # the longest honest line of any known log has some 200 bytes
_BLOCK_BYTES: Final = 8 << 10
_UTF8_BOM = b"\xef\xbb\xbf"
_WIDE_BOMS = (b"\xff\xfe", b"\xfe\xff")


@dataclass(frozen=True, slots=True)
class Text:
    """Content of a text file: UTF-8, lines end in a line feed, no NUL.

    Attributes:
        content: The bytes.
        mended: Count by reason of what was repaired without loss.
        added_lines: That stand above those of the file.
    """

    content: bytes
    mended: dict[str, int] = field(default_factory=dict)
    added_lines: int = 0


def read_text(path: Path) -> Text:
    """Reads a text file that is plain or compressed with gzip, xz or bzip2.

    A byte-order mark of UTF-8 and line ends of Windows are accepted and counted; everything else that is not plain
    UTF-8 is refused, as is a file or a line too long to be a log, before memory is spent on it.

    Raises:
        RecordingError: Names file, line and remedy.
    """
    try:
        with path.open("rb") as stream:
            content = _join_checked(pieces(stream, path), path)
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise RecordingError(f"{path}: cannot be read: {reason}; check the path and its permissions") from error
    return _mend(content, path)


def clean_text(content: bytes, path: Path, *, encoding: str = "") -> Text:
    """The same rules for content that has been read from an archive.

    Args:
        content: Of a whole file.
        path: Named in errors.
        encoding: Of what is neither UTF-8 nor UTF-16, as of headers with degree signs; "" to refuse both.
    """
    _check_line_lengths(content, path)
    return _mend(content, path, encoding)


def _mend(content: bytes, path: Path, encoding: str = "") -> Text:
    mended = {}
    if content.startswith(_WIDE_BOMS):
        if not encoding:
            raise RecordingError(f"{path}: line 1: the file is UTF-16, expected UTF-8; convert it with iconv -t UTF-8")
        content = from_utf16(content)
        mended["UTF-16"] = 1
    if content.startswith(_UTF8_BOM):
        content = content.removeprefix(_UTF8_BOM)
        mended["byte-order mark"] = 1
    try:
        _check_characters(content, path)
    except RecordingError:
        if not encoding or b"\0" in content:
            raise
        content = content.decode(encoding, "replace").encode()
        mended[f"{encoding} characters"] = 1
    if b"\r" in content:
        mended["carriage return at the end of a line"] = content.count(b"\r\n")
        content = content.replace(b"\r\n", b"\n")
    if not content or content.isspace():
        raise RecordingError(f"{path}: line 1: the file is empty; copy or download it again")
    return Text(content, mended)


def from_utf16(content: bytes) -> bytes:
    """A text, or its beginning, as UTF-8, without a byte-order mark, where it begins with one of UTF-16."""
    if not content.startswith(_WIDE_BOMS):
        return content.removeprefix(_UTF8_BOM)
    return content[: len(content) & ~1].decode("utf-16", "replace").encode()


def line_number(content: bytes, offset: int) -> int:
    """Number, from 1, of the line that holds a byte."""
    return content.count(b"\n", 0, offset) + 1


def _join_checked(chunks: Iterator[bytes], path: Path) -> bytes:
    """Joins the pieces unless the whole or one of its lines is too long."""
    pieces: list[bytes] = []
    total_bytes = 0
    for chunk in chunks:
        total_bytes += len(chunk)
        if total_bytes > MAX_TEXT_BYTES:
            raise RecordingError(f"{path}: more than {MAX_TEXT_BYTES >> 20} MiB of text; split the log into walks")
        if len(chunk) > MAX_LINE_BYTES and b"\n" not in chunk:  # before the rest of a gigabyte is read
            _refuse_line(path, sum(piece.count(b"\n") for piece in pieces) + 1)
        pieces.append(chunk)
    content = b"".join(pieces)
    _check_line_lengths(content, path)
    return content


def _check_line_lengths(content: bytes, path: Path) -> None:
    """Refuses a line that is too long; hops from line to line at most `MAX_LINE_BYTES` apart."""
    place = 0
    while place + MAX_LINE_BYTES < len(content):
        end = content.rfind(b"\n", place, place + MAX_LINE_BYTES + 1)
        if end < 0:
            _refuse_line(path, line_number(content, place))
        place = end + 1


def _refuse_line(path: Path, line: int) -> None:
    raise RecordingError(
        f"{path}: line {line}: longer than {MAX_LINE_BYTES >> 10} KiB; check whether the file is a log"
    )


def _check_characters(content: bytes, path: Path) -> None:
    """Refuses NUL and what is not UTF-8."""
    nul = content.find(b"\0")
    if nul >= 0:
        raise RecordingError(
            f"{path}: line {line_number(content, nul)}: a NUL byte; the file is damaged, download or export it again"
        )
    place = 0
    while place < len(content):  # whole lines at a time, since most of them are plain ASCII and need no decoder
        end = content.find(b"\n", place + _BLOCK_BYTES) + 1 or len(content)
        block = content[place:end]
        try:
            block.isascii() or block.decode()
        except UnicodeDecodeError as error:
            line = line_number(content, place + error.start)
            raise RecordingError(f"{path}: line {line}: not UTF-8; convert the file with iconv -t UTF-8") from None
        place = end
