"""Files: names from outside, digests of bytes, and what systems do differently: locks, waiting for the disk.

A lock ends with its process, however that ends, and children do not hold it. POSIX has record locks, which belong to
the process whichever way it opened the file; Windows has region locks, which another opening in it is refused.
"""

from __future__ import annotations

import functools
import hashlib
import os
import re
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
DEVICES: Final = r"(?i:con|prn|aux|nul|com[0-9]|lpt[0-9])"  # names that Windows keeps for itself
# A name that is harmless on every system: no folder above, no hidden file, no option, no device of Windows
SAFE_NAME: Final = rf"(?!{DEVICES}(?:[./]|\Z))[A-Za-z0-9_][A-Za-z0-9_.-]{{0,99}}(?<!\.)"
MAX_DEPTH: Final = 8  # of a path of such names
SAFE_PATH: Final = rf"{SAFE_NAME}(?:/{SAFE_NAME}){{0,{MAX_DEPTH - 1}}}"
MAX_NAME: Final = 100  # characters


def is_safe_name(name: str) -> bool:
    """Whether a name from outside may become that of a file or folder.

    >>> [is_safe_name(name) for name in ("walk-1.csv", "..", ".ssh", "a/b", "C:evil", "nul.txt", "")]
    [True, False, False, False, False, False, False]
    """
    return re.fullmatch(SAFE_NAME, name) is not None


def is_safe_path(path: str) -> bool:
    """Whether a relative path from outside, with forward slashes, may become one below a folder."""
    return re.fullmatch(SAFE_PATH, path) is not None


def safe_name(text: str, max_characters: int = MAX_NAME) -> str:
    """A name of a file that a person recognises a text by; two texts may have the same.

    >>> safe_name("li2012?map=false"), safe_name("../.."), safe_name("con")
    ('li2012-map-false', '_', '_con')
    """
    slug = re.sub(r"[^A-Za-z0-9_-]+", "-", text)[-max_characters:].strip("-")
    return slug if is_safe_name(slug) else f"_{slug}"


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
            lines.append(f"{path.relative_to(root or place.parent).as_posix()} {known_sha256(path)}")
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


def known_sha256(path: Path) -> str:
    """As `sha256_of`; read again only where size or time of change is another."""
    found = path.stat()
    return _file_sha256(path, found.st_size, found.st_mtime_ns)


@functools.lru_cache(maxsize=10_000)
def _file_sha256(path: Path, size: int, mtime_ns: int) -> str:
    return sha256_of(path)


def sha256_of(path: Path) -> str:
    """Hex sha256 of the bytes of a file; raises `OSError`."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
