"""Empties a folder in which an untrusted process could write: links, folders without rights, any depth."""

from __future__ import annotations

import contextlib
import itertools
import os
from collections.abc import Iterator
from typing import Final

RIGHTS: Final = 0o700


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
