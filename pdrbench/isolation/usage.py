"""Memory and threads of another process, read cheaply enough to be checked between two short steps."""

from __future__ import annotations

import os
from typing import Final

import psutil  # type: ignore[import-untyped]

READ_BYTES: Final = 4096
MEBIBYTE: Final = 2**20
# Fields of /proc/<pid>/stat behind the name, which may hold anything: proc(5) counts them from 1, the name is 2.
THREADS_FIELD: Final = 20 - 3
PAGES_FIELD: Final = 24 - 3


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
    """Memory and threads of a process."""

    def __init__(self, pid: int) -> None:
        self._pid = pid
        try:
            self._stat: LiveFile | None = LiveFile(f"/proc/{pid}/stat")
        except OSError:
            self._stat = None  # no Linux

    def read(self) -> tuple[float, int] | None:
        """Resident memory in MB, and number of threads; None where the process has ended."""
        try:
            if self._stat is None:
                process = psutil.Process(self._pid)
                return process.memory_info().rss / MEBIBYTE, process.num_threads()
            fields = self._stat.read().rpartition(b")")[2].split()
            return int(fields[PAGES_FIELD]) * _PAGE_MB, int(fields[THREADS_FIELD])
        except (OSError, psutil.Error):
            return None

    def close(self) -> None:
        """May be called again."""
        if self._stat is not None:
            self._stat.close()


_PAGE_MB: Final = os.sysconf("SC_PAGE_SIZE") / MEBIBYTE
