"""Memory and threads of another process, read cheaply enough to be checked between two short steps."""

from __future__ import annotations

import contextlib
import math
import os
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

import psutil  # type: ignore[import-untyped]

from pdrbench_leaderboard.confine.boot import CAN_CONFINE

READ_BYTES: Final = 4096
MEBIBYTE: Final = 2**20
# Fields of /proc/<pid>/stat behind the name, which may hold anything: proc(5) counts them from 1, the name is 2.
PARENT_FIELD, THREADS_FIELD, MAPPED_FIELD, PAGES_FIELD = 4 - 3, 20 - 3, 23 - 3, 24 - 3
TIME_FIELDS: Final = slice(14 - 3, 16 - 3)  # of user and system, in ticks
COUNT_S: Final = 1.0  # between counts of memory, each of which takes a millisecond
MAX_PROCESSES: Final = 1000  # of a walk that are looked for
DELETED: Final = " (deleted)"  # ends the name of shared memory without a file: "/dev/zero (deleted)" and the like


class LiveFile:
    """A file under /proc that stays open: reading it costs a tenth of opening it.

    It belongs to the process that it was opened for, also once another process has got the number of that process.

    Raises:
        OSError: There is no such file.
    """

    def __init__(self, path: str) -> None:
        self._descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)

    def read(self) -> bytes:
        """The present content; raises `OSError` once the process has ended."""
        return os.pread(self._descriptor, READ_BYTES, 0)

    def close(self) -> None:
        """May be called again."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1


class Usage:
    """Memory, threads and processor time of a process and of all that it has started.

    Processes are looked for below its parent, to which those come whose own parent has ended.

    Args:
        pid: Of the process.

    Attributes:
        peak_mb: Most memory that `read` has found.
        cpu_s: Processor time when `read` was last called.
    """

    def __init__(self, pid: int) -> None:
        self._pid = pid
        self.peak_mb = self.cpu_s = 0.0
        self._parent = 0
        self._counted_s = -math.inf
        self._count_mb = 0.0
        self.may_fork = False  # True where nothing keeps it from starting processes
        self.is_counted = False  # True where the kernel counts its memory
        self._stat: LiveFile | None = None  # no Linux
        with contextlib.suppress(OSError, IndexError):
            if CAN_CONFINE:
                self._stat = LiveFile(f"/proc/{pid}/stat")
                self._parent = int(_fields(self._stat.read())[PARENT_FIELD])

    def read(self, limit_mb: float = math.inf) -> tuple[float, int] | None:
        """Memory in MB, and number of threads; None where the process has ended.

        The memory is what is resident. Where more than the limit could be held, it is counted, at most once a second:
        pages that several processes share once, shared memory by its size whether it is mapped at the moment or not,
        what was swapped out and tables of pages.
        """
        found = self._read(limit_mb)
        if found is not None:
            self.peak_mb = max(self.peak_mb, found[0])
        return found

    def _read(self, limit_mb: float) -> tuple[float, int] | None:
        try:
            if self._stat is None:
                main = psutil.Process(self._pid)
                every = [main, *main.children(recursive=True)]
                self.cpu_s = sum(sum(process.cpu_times()[:2]) for process in every)
                used_mb = sum(process.memory_info().rss for process in every) / MEBIBYTE
                return used_mb, sum(process.num_threads() for process in every)
            main = _fields(self._stat.read())
        except (OSError, psutil.Error):
            return None
        every = [main]
        others = self._others() if self.may_fork else []
        for other in others:
            with contextlib.suppress(OSError):
                every.append(_fields(Path(f"/proc/{other}/stat").read_bytes()))
        resident_mb = sum(int(fields[PAGES_FIELD]) for fields in every) * _PAGE_MB
        threads = sum(int(fields[THREADS_FIELD]) for fields in every)
        self.cpu_s = sum(int(ticks) for fields in every for ticks in fields[TIME_FIELDS]) / _TICKS_PER_S
        mapped_mb = sum(int(fields[MAPPED_FIELD]) for fields in every) / MEBIBYTE
        if mapped_mb <= limit_mb or self.is_counted:
            return resident_mb, threads
        now_s = time.monotonic()
        if resident_mb > limit_mb or now_s - self._counted_s > COUNT_S:
            self._counted_s, self._count_mb = now_s, count_mb([self._pid, *others])
        return self._count_mb or resident_mb, threads

    def close(self) -> None:
        """May be called again."""
        if self._stat is not None:
            self._stat.close()

    def _others(self) -> list[int]:
        """Processes of the walk beside the first one."""
        found: list[int] = []
        waiting = _children(self._parent) if self._parent else []
        while waiting and len(found) < MAX_PROCESSES:
            found.append(waiting.pop())
            waiting += _children(found[-1])
        return [pid for pid in found if pid != self._pid]


def count_mb(pids: Sequence[int]) -> float:
    """Memory that processes hold together, in MB; 0 where the system does not say."""
    total_kb = 0.0
    shared_kb: dict[str, float] = {}
    for pid in pids:
        with contextlib.suppress(OSError, ValueError, LookupError):  # it has ended
            status = dict(line.split(":", 1) for line in Path(f"/proc/{pid}/status").read_text().splitlines())
            own_kb, shmem_kb, swap_kb, table_kb = (
                float(status[name].split()[0]) for name in ("VmRSS", "RssShmem", "VmSwap", "VmPTE")
            )
            if len(pids) > 1:
                rollup = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
                kb = {name: float(rest.split()[0]) for name, _, rest in (line.partition(":") for line in rollup[1:])}
                own_kb, shmem_kb = kb["Pss"], kb.get("Pss_Shmem", 0.0)
            for name, size_kb in _shared_memory_kb(pid):
                shared_kb[name] = max(shared_kb.get(name, 0.0), size_kb)
            total_kb += own_kb - shmem_kb + swap_kb + table_kb
    return (total_kb + sum(shared_kb.values())) / 1024


def _shared_memory_kb(pid: int) -> Iterator[tuple[str, float]]:
    """Name and size of each block of memory that can be shared with other processes and that no folder shows."""
    sizes: dict[str, float] = {}
    for line in Path(f"/proc/{pid}/maps").read_text().splitlines():
        place, rights, _, device, inode, *name = line.split(maxsplit=5)
        if rights[3] == "s" and name and name[0].endswith(DELETED):
            begin, end = (int(address, 16) for address in place.split("-"))
            sizes[f"{device} {inode}"] = sizes.get(f"{device} {inode}", 0.0) + (end - begin) / 1024
    yield from sizes.items()


def _children(pid: int) -> list[int]:
    found = []
    with contextlib.suppress(OSError):
        for thread in Path(f"/proc/{pid}/task").iterdir():
            with contextlib.suppress(OSError):
                found += [int(child) for child in (thread / "children").read_text().split()]
    return found


def _fields(stat: bytes) -> list[bytes]:
    """Fields of /proc/<pid>/stat behind the name."""
    return stat.rpartition(b")")[2].split()


_TICKS_PER_S: Final = os.sysconf("SC_CLK_TCK") if CAN_CONFINE else 1
_PAGE_MB: Final = os.sysconf("SC_PAGE_SIZE") / MEBIBYTE if CAN_CONFINE else 1.0
