"""Files: digests of their bytes, and what systems do differently: locks between processes, waiting for the disk.

A lock ends with its process, however that ends, and children do not hold it. POSIX has record locks, which belong to
the process whichever way it opened the file; Windows has region locks, which another opening in it is refused.
"""

from __future__ import annotations

import functools
import hashlib
import os
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import IO, Any, Final

_windows: Any = None
try:
    import fcntl
except ImportError:
    import msvcrt

    _windows = msvcrt

# Windows keeps others from reading bytes that are locked, and takes 31 bits: they are behind every content.
FIRST_ON_WINDOWS: Final = 1 << 30
RETRY_S: Final = 0.05


def try_lock(file: IO[bytes], byte: int | None = None) -> bool:
    """Locks a byte, whether or not the file is so long; False where another process holds it.

    The whole file where there is no byte: then another opening in the same process is refused as well.
    """
    try:
        if _windows is not None:
            _on_windows(file, _windows.LK_NBLCK, byte or 0)
        elif byte is None:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        else:
            fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, byte)
    except (BlockingIOError, PermissionError):  # POSIX allows EAGAIN and EACCES for a lock that is held
        return False
    return True


def lock(file: IO[bytes]) -> None:
    """Locks the first byte, once no other process holds it."""
    while not try_lock(file, 0):
        time.sleep(RETRY_S)


def unlock(file: IO[bytes], byte: int) -> None:
    """Undoes `try_lock` of a byte."""
    if _windows is None:
        fcntl.lockf(file, fcntl.LOCK_UN, 1, byte)
    else:
        _on_windows(file, _windows.LK_UNLCK, byte)


def _on_windows(file: IO[bytes], mode: int, byte: int) -> None:
    """Bytes that share a remainder share a lock there: who meets one that is held comes back later."""
    place = os.lseek(file.fileno(), 0, os.SEEK_CUR)
    os.lseek(file.fileno(), FIRST_ON_WINDOWS + byte % FIRST_ON_WINDOWS, os.SEEK_SET)
    try:
        _windows.locking(file.fileno(), mode, 1)
    finally:
        os.lseek(file.fileno(), place, os.SEEK_SET)


def sync(place: Path) -> None:
    """Waits until a file, or the names in a folder, have reached the disk; Windows opens no folders for that."""
    if place.is_dir() and not hasattr(os, "O_DIRECTORY"):
        return
    handle = os.open(place, os.O_RDONLY if place.is_dir() else os.O_RDWR)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def bytes_sha256(places: Iterable[Path], root: Path | None = None) -> str:
    """Hex sha256 of the names and bytes of files, and of all files below folders.

    Hidden ones and compiled Python do not count. A file is read again where its size or its time of change is another.

    Args:
        places: Files and folders.
        root: What names are relative to; None: the folder that each place is in.

    Raises:
        OSError: One cannot be read.
    """
    lines = []
    for place in places:
        for path in [place] if place.is_file() else sorted(_files_below(place)):
            found = path.stat()
            digest = _file_sha256(path, found.st_size, found.st_mtime_ns)
            lines.append(f"{path.relative_to(root or place.parent).as_posix()} {digest}")
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()


def _files_below(folder: Path) -> Iterator[Path]:
    with os.scandir(folder) as entries:
        for entry in entries:
            if entry.name.startswith(".") or entry.name == "__pycache__":
                continue
            if entry.is_dir():
                yield from _files_below(Path(entry.path))
            else:
                yield Path(entry.path)


@functools.lru_cache(maxsize=10_000)
def _file_sha256(path: Path, size: int, mtime_ns: int) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
