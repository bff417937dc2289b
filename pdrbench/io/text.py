"""Text files from strangers, read whole within bounded memory."""

from __future__ import annotations

import lzma
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, Final

from pdrbench.errors import RecordingError

MAX_TEXT_BYTES: Final = 256 << 20  # an ILC20 log grows by 3 MB a minute: well over an hour
MAX_LINE_BYTES: Final = 64 << 10  # the longest honest line of any known log has some 200 bytes
_CHUNK_BYTES: Final = 4 << 20
_BLOCK_BYTES: Final = 8 << 10
_UTF8_BOM = b"\xef\xbb\xbf"
_WIDE_BOMS = (b"\xff\xfe", b"\xfe\xff")
_MAX_XZ_BYTES: Final = 128 << 20  # of memory while decompressing; the largest preset of xz needs half of it
# Name and decompressor by the bytes that a file begins with. 31: a gzip header and its checksum, RFC 1952.
_PACKED: Final[dict[bytes, tuple[str, Callable[[], Any]]]] = {
    b"\x1f\x8b": ("gzip", lambda: zlib.decompressobj(wbits=31)),
    b"\xfd7zXZ\0": ("xz", lambda: lzma.LZMADecompressor(lzma.FORMAT_XZ, _MAX_XZ_BYTES)),
}


@dataclass(frozen=True, slots=True)
class Text:
    """Content of a text file: UTF-8, lines end in a line feed, no NUL.

    Attributes:
        content: The bytes.
        mended: Count by reason of what was repaired without loss.
    """

    content: bytes
    mended: dict[str, int] = field(default_factory=dict)


def read_text(path: Path) -> Text:
    """Reads a text file that is plain or compressed with gzip or xz.

    A byte-order mark of UTF-8 and line ends of Windows are accepted and counted; everything else that is not plain
    UTF-8 is refused, as is a file or a line too long to be a log, before memory is spent on it.

    Raises:
        RecordingError: Names file, line and remedy.
    """
    try:
        with path.open("rb") as stream:
            content = _join_checked(_chunks(stream, path), path)
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise RecordingError(f"{path}: cannot be read: {reason}; check the path and its permissions") from error
    return _mend(content, path, latin_1=False)


def clean_text(content: bytes, path: Path, *, latin_1: bool = False) -> Text:
    """The same rules for content that has been read from an archive.

    Args:
        content: Of a whole file.
        path: Named in errors.
        latin_1: True to read UTF-16, and to take what else is not UTF-8 for Latin-1, as in headers with degree signs.
    """
    _check_line_lengths(content, path)
    return _mend(content, path, latin_1=latin_1)


def _mend(content: bytes, path: Path, *, latin_1: bool) -> Text:
    mended = {}
    if content.startswith(_WIDE_BOMS):
        if not latin_1:
            raise RecordingError(f"{path}: line 1: the file is UTF-16, expected UTF-8; convert it with iconv -t UTF-8")
        content = content.decode("utf-16", "replace").encode()
        mended["UTF-16"] = 1
    if content.startswith(_UTF8_BOM):
        content = content.removeprefix(_UTF8_BOM)
        mended["byte-order mark"] = 1
    try:
        _check_characters(content, path)
    except RecordingError:
        if not latin_1 or b"\0" in content:
            raise
        content = content.decode("latin-1").encode()
        mended["Latin-1 characters"] = 1
    if b"\r" in content:
        mended["carriage return at the end of a line"] = content.count(b"\r\n")
        content = content.replace(b"\r\n", b"\n")
    if not content or content.isspace():
        raise RecordingError(f"{path}: line 1: the file is empty; copy or download it again")
    return Text(content, mended)


def line_number(content: bytes, offset: int) -> int:
    """Number, from 1, of the line that holds a byte."""
    return content.count(b"\n", 0, offset) + 1


def _chunks(stream: BinaryIO, path: Path) -> Iterator[bytes]:
    """The content in pieces of bounded size, decompressed where it is gzip or xz."""
    first = stream.read(_CHUNK_BYTES)
    for magic, (kind, member) in _PACKED.items():
        if first.startswith(magic):
            yield from _decompressed(first, stream, path, kind, member)
            return
    while first:
        yield first
        first = stream.read(_CHUNK_BYTES)


def _decompressed(
    compressed: bytes, stream: BinaryIO, path: Path, kind: str, new_member: Callable[[], Any]
) -> Iterator[bytes]:
    """Decompresses one member (a stream, in xz) after the other, never more than a piece at a time."""
    member = new_member()
    while compressed or not member.eof:
        try:
            piece = member.decompress(compressed, _CHUNK_BYTES)
        except (zlib.error, lzma.LZMAError) as error:
            raise RecordingError(f"{path}: the {kind} data is damaged ({error}); download the file again") from error
        if piece:
            yield piece
        if member.eof:
            compressed = (member.unused_data or stream.read(_CHUNK_BYTES)).lstrip(b"\0")  # zero padding is legal
            if compressed:
                member = new_member()
            continue
        compressed = getattr(member, "unconsumed_tail", b"")  # xz keeps what it has not used
        if not compressed and getattr(member, "needs_input", True):
            compressed = stream.read(_CHUNK_BYTES)
            if not compressed and not piece:
                raise RecordingError(f"{path}: the {kind} data ends too early; download the file again")


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
