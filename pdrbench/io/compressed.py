"""Files that are compressed by gzip, xz or bzip2, read as what is in them and within bounds."""

from __future__ import annotations

import bz2
import contextlib
import lzma
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, Any, Final

from pdrbench.errors import RecordingError

ENDINGS: Final = (".gz", ".xz", ".bz2")  # of names
CHUNK_BYTES: Final = 4 << 20
MAX_CONTENT_BYTES: Final = 2 << 30  # a day of a phone at 100 Hz
MAX_RATIO: Final = 100  # text of sensors is packed to a third or fifth
MIN_BOMB_BYTES: Final = 64 << 20
MAX_XZ_BYTES: Final = 128 << 20  # of memory while decompressing; the largest preset of xz needs half of it
# Name and decompressor by the bytes that a file begins with. 31: a gzip header and its checksum, RFC 1952.
_KINDS: Final[dict[bytes, tuple[str, Callable[[], Any]]]] = {
    b"\x1f\x8b": ("gzip", lambda: zlib.decompressobj(wbits=31)),
    b"\xfd7zXZ\0": ("xz", lambda: lzma.LZMADecompressor(lzma.FORMAT_XZ, MAX_XZ_BYTES)),
    b"BZh": ("bzip2", bz2.BZ2Decompressor),
}
MAGIC_BYTES: Final = 6


def plain_name(name: str) -> str:
    """The name of a file without what compressing it added.

    >>> plain_name("walk.csv.gz"), plain_name("walk.csv")
    ('walk.csv', 'walk.csv')
    """
    ending = next((ending for ending in ENDINGS if name.lower().endswith(ending)), "")
    return name[: len(name) - len(ending)]


def found_file(path: Path) -> Path:
    """The file at a path, or what it was compressed to; the path where there is neither."""
    places = (path, *(path.with_name(path.name + ending) for ending in ENDINGS))
    return next((place for place in places if place.is_file()), path)


def is_compressed(begin: bytes) -> bool:
    """Whether a file whose first `MAGIC_BYTES` are these is compressed."""
    return begin.startswith(tuple(_KINDS))


def content_of(stream: IO[bytes], where: object, limit: int | None = None) -> bytes:
    """A file, or its first `limit` bytes, decompressed where it is compressed.

    Raises:
        RecordingError: As `pieces` does, or more than `MAX_CONTENT_BYTES` unpacked.
    """
    begin = stream.read(MAGIC_BYTES)
    stream.seek(0)
    if not is_compressed(begin):
        return stream.read() if limit is None else stream.read(limit)
    most = MAX_CONTENT_BYTES if limit is None else limit
    found: list[bytes] = []
    for piece in pieces(stream, where, max(min(most, CHUNK_BYTES), MAGIC_BYTES)):
        if limit is None and len(piece) > most:
            raise RecordingError(f"{where}: more than {MAX_CONTENT_BYTES >> 30} GiB unpacked; split it into walks")
        found.append(piece[:most])
        most -= len(found[-1])
        if limit is not None and not most:
            break
    return b"".join(found)


def refuse_compressed(path: Path) -> None:
    """Raises `RecordingError` for a compressed file, where a library has to read it itself."""
    with contextlib.suppress(OSError), path.open("rb") as stream:  # what else is wrong, the library says
        if is_compressed(stream.read(MAGIC_BYTES)):
            raise RecordingError(f"{path}: is compressed as a whole; unpack it and name what was in it")


def pieces(stream: IO[bytes], where: object, size: int = CHUNK_BYTES) -> Iterator[bytes]:
    """The content of a file, at most `size` bytes at a time, decompressed where it is compressed.

    Args:
        stream: At the beginning of the file.
        where: Named in errors.
        size: Of a piece.

    Raises:
        RecordingError: The file is damaged, cut off or a bomb.
    """
    first = stream.read(size)
    for magic, (kind, new_member) in _KINDS.items():
        if first.startswith(magic):
            yield from _decompressed(first, stream, where, size, kind, new_member)
            return
    while first:
        yield first
        first = stream.read(size)


def _decompressed(
    packed: bytes, stream: IO[bytes], where: object, size: int, kind: str, new_member: Callable[[], Any]
) -> Iterator[bytes]:
    """Decompresses one member (a stream, in xz and bzip2) after the other, never more than a piece at a time."""
    member = new_member()
    num_packed, num_bytes = len(packed), 0
    while packed or not member.eof:
        try:
            piece = member.decompress(packed, size)
        except (zlib.error, lzma.LZMAError, OSError) as error:
            raise RecordingError(f"{where}: the {kind} data is damaged ({error}); download the file again") from error
        num_bytes += len(piece)
        if num_bytes > max(MIN_BOMB_BYTES, MAX_RATIO * num_packed):
            raise RecordingError(
                f"{where}: {num_packed} bytes unpack to more than {num_bytes}; that is no recording but a bomb: "
                f"do not open it"
            )
        if piece:
            yield piece
        # zlib keeps apart what it has not used; xz and bzip2 keep it within, and need input or not
        packed = member.unused_data if member.eof else getattr(member, "unconsumed_tail", b"")
        if not packed and (member.eof or getattr(member, "needs_input", True)):
            packed = stream.read(size)
            num_packed += len(packed)
            if not packed and not piece and not member.eof:
                raise RecordingError(f"{where}: the {kind} data ends too early; download the file again")
        if member.eof:
            packed = packed.lstrip(b"\0")  # padding is legal
            member = new_member() if packed else member
