"""Empties a folder in which an untrusted process could write: links, folders without rights, any depth."""

from __future__ import annotations

import contextlib
import itertools
import math
import os
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import Final

RIGHTS: Final = 0o700
BLOCK_BYTES: Final = 512  # in which stat(2) counts


def empty(folder: str) -> None:
    """Removes everything below a folder that no living process writes to; what cannot be removed stays.

    Folders within folders are moved up before they are removed: a tree may be deeper than a function can call itself
    and than a path can be long. Links are removed, never followed.
    """
    try:
        root = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    except OSError:
        return
    try:
        names = (f"{os.urandom(8).hex()}-{number}" for number in itertools.count())  # none of them existed before
        waiting = _clear(root, root, names)
        while waiting:
            waiting += _remove(waiting.pop(), root, names)
    finally:
        os.close(root)


def _remove(name: str, root: int, names: Iterator[str]) -> list[str]:
    """Removes a folder of `root`; the folders that were in it are in `root` now, under these names."""
    moved: list[str] = []
    with contextlib.suppress(OSError):
        folder = os.open(name, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW, dir_fd=root)
        try:
            moved = _clear(folder, root, names)
        finally:
            os.close(folder)
        os.rmdir(name, dir_fd=root)
    return moved


def _clear(folder: int, root: int, names: Iterator[str]) -> list[str]:
    """Removes the files of a folder and moves its folders into `root`; their names there."""
    moved = []
    with os.scandir(folder) as entries:
        found = [(entry.name, entry.is_dir(follow_symlinks=False)) for entry in entries]
    for name, is_folder in found:
        with contextlib.suppress(OSError):
            if not is_folder:
                os.unlink(name, dir_fd=folder)
                continue
            new_name = next(names)
            os.chmod(name, RIGHTS, dir_fd=folder)
            os.rename(name, new_name, src_dir_fd=folder, dst_dir_fd=root)
            moved.append(new_name)
    return moved


def measure(folder: str, pid: int, max_files: int) -> tuple[float, int]:
    """Size of all files below a folder, deleted ones that a process has open included, and their number.

    Args:
        folder: In which an untrusted process writes.
        pid: That process.
        max_files: Counting ends beyond this number.

    Returns:
        Bytes on the disk, infinite where a part cannot be looked at: a path too long, a folder without rights.
    """
    size, files = 0.0, 0
    waiting = [folder]
    while waiting and files <= max_files:
        try:
            with os.scandir(waiting.pop()) as entries:
                for entry in entries:
                    with contextlib.suppress(FileNotFoundError):
                        size += entry.stat(follow_symlinks=False).st_blocks * BLOCK_BYTES
                        if entry.is_dir(follow_symlinks=False):
                            waiting.append(entry.path)
                    files += 1
                    if files > max_files:
                        break
        except FileNotFoundError:
            continue
        except OSError:
            return math.inf, files
    with contextlib.suppress(OSError):
        for descriptor in Path(f"/proc/{pid}/fd").iterdir():
            with contextlib.suppress(OSError):
                found = descriptor.stat()
                size += found.st_blocks * BLOCK_BYTES if stat.S_ISREG(found.st_mode) and not found.st_nlink else 0
    return size, files
