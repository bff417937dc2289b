"""A control group of version 2 for each walk: the kernel counts and limits the memory of all that runs in it.

It counts what no look at a process finds: files in memory, shared memory that is not mapped any more, tables of pages.
Only a part of the tree that the system has left to this user can hold such groups; where there is none, `Usage` counts.
"""

from __future__ import annotations

import contextlib
import errno
import itertools
import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from pdrbench.process.child_process import MEBIBYTE

MOUNTS, OWN_GROUP = Path("/proc/self/mountinfo"), Path("/proc/self/cgroup")
MEMORY_GROUP: Final = "memory-group"  # name of the protection
KIND: Final = "cgroup2"
HIERARCHY: Final = "0::"  # begins the line of version 2
REMOVE_S: Final = 1.0  # for the last process of a group to be gone
WAIT_S: Final = 0.002
_NUMBERS: Final = itertools.count()


class MemoryGroup:
    """One group, for one walk.

    Args:
        limit_mb: Of the memory of all its processes together; there is no swap.
        place: Folder in the tree of groups, from `find_place`.

    Raises:
        OSError: The system does not grant it.
    """

    def __init__(self, limit_mb: int, place: Path) -> None:
        self._folder = place / f"pdrbench-{os.getpid()}-{next(_NUMBERS)}"
        self._folder.mkdir()
        try:
            (self._folder / "memory.max").write_text(str(limit_mb * MEBIBYTE))
            with contextlib.suppress(OSError):  # a kernel without swap has no such file
                (self._folder / "memory.swap.max").write_text("0")
            (self._folder / "memory.oom.group").write_text("1")  # all of its processes are ended together
            # What may be moved into it depends on the rights of who has opened this, not of who writes to it.
            self.entrance = os.open(self._folder / "cgroup.procs", os.O_WRONLY | os.O_CLOEXEC)
        except OSError:
            self._folder.rmdir()
            raise

    @property
    def has_exceeded(self) -> bool:
        """True once the kernel has ended what ran in it, since it needed more memory."""
        with contextlib.suppress(OSError):
            for line in (self._folder / "memory.events").read_text().splitlines():
                name, _, count = line.partition(" ")
                if name == "oom_kill":
                    return int(count) > 0
        return False

    def close(self) -> None:
        """Removes the group once its processes are gone; may be called again."""
        if self.entrance < 0:
            return
        os.close(self.entrance)
        self.entrance = -1
        ends_s = time.monotonic() + REMOVE_S
        while True:
            try:
                self._folder.rmdir()
            except OSError as error:
                if error.errno == errno.EBUSY and time.monotonic() < ends_s:
                    time.sleep(WAIT_S)
                    continue
            return


def enter(entrance: int) -> None:
    """Moves this process into a group; raises `OSError`."""
    os.write(entrance, b"0")


def find_place(mounts: Path = MOUNTS, own_group: Path = OWN_GROUP) -> Path:
    """The nearest folder above this process in the tree of groups where groups with a limit of memory can be made.

    Args:
        mounts: Mounts of this process, as the kernel lists them.
        own_group: Groups of this process, likewise.

    Raises:
        OSError: There is none; says why.
    """
    found = [fields for fields in _mounts(mounts) if fields[0] == KIND]
    lines = [line for line in own_group.read_text().splitlines() if line.startswith(HIERARCHY)]
    if not found or not lines:
        raise OSError(errno.ENOENT, "no control groups of version 2")
    _, root, mounted = found[0]
    own = lines[0].removeprefix(HIERARCHY)
    inside = os.path.relpath(own, root) if own.startswith(root) else "."
    here = Path(mounted, inside)
    if "memory" not in _words(here / "cgroup.controllers"):
        raise OSError(errno.ENOTSUP, "control groups of version 2 do not count memory here")
    for place in (here, *here.parents):
        is_ours = os.access(place, os.W_OK) and os.access(place / "cgroup.procs", os.W_OK)
        if is_ours and "memory" in _words(place / "cgroup.subtree_control"):
            return place
        if place == Path(mounted):
            break
    raise OSError(errno.EACCES, "no part of the tree of control groups is left to this user")


def _mounts(path: Path) -> Iterator[tuple[str, str, str]]:
    """Kind, root and place of every mount."""
    for line in path.read_text().splitlines():
        before, _, after = line.partition(" - ")
        yield after.split()[0], before.split()[3], before.split()[4]


def _words(path: Path) -> list[str]:
    try:
        return path.read_text().split()
    except OSError:
        return []
