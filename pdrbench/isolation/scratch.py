"""Empties a folder in which a stranger's process could write: links, rights taken off, any depth."""

from __future__ import annotations

import contextlib
import os
from typing import Final

RIGHTS: Final = 0o700
MOVED: Final = ".moved-"


def empty(folder: str) -> None:
    """Removes everything below a folder that no living process writes to; what cannot be removed stays.

    Folders within folders are moved up before they are removed: a tree may be deeper than a function can call itself and
    than a path can be long. Links are removed, never followed.
    """
    try:
        root = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    except OSError:
        return
    try:
        _remove_all(root)
    finally:
        os.close(root)


def _remove_all(root: int) -> None:
    waiting, moved = _clear(root, root, 0)
    while waiting:
        name = waiting.pop()
        with contextlib.suppress(OSError):
            inside = os.open(name, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW, dir_fd=root)
            try:
                more, moved = _clear(inside, root, moved)
            finally:
                os.close(inside)
            waiting += more
            os.rmdir(name, dir_fd=root)


def _clear(folder: int, root: int, moved: int) -> tuple[list[str], int]:
    """Removes the files of a folder and moves its folders into `root`; their names there, and how many were moved."""
    found = []
    with os.scandir(folder) as entries:
        names = [(entry.name, entry.is_dir(follow_symlinks=False)) for entry in entries]
    for name, is_folder in names:
        with contextlib.suppress(OSError):
            if not is_folder:
                os.unlink(name, dir_fd=folder)
                continue
            os.chmod(name, RIGHTS, dir_fd=folder)
            moved += 1
            os.rename(name, f"{MOVED}{moved}", src_dir_fd=folder, dst_dir_fd=root)
            found.append(f"{MOVED}{moved}")
    return found, moved
