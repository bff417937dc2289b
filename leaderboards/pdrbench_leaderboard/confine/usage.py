"""Memory, threads and processor time of a confined process, read cheaply enough to be looked at between two steps.

It starts no other process and shares no memory, since its filter of system calls denies both.
"""

from __future__ import annotations

import os
from typing import Final

from pdrbench.process.child_process import MEBIBYTE

READ_BYTES: Final = 4096
# Fields of /proc/<pid>/stat behind the name, which may hold anything: proc(5) counts them from 1, the name is 2.
THREADS_FIELD, PAGES_FIELD = 20 - 3, 24 - 3
TIME_FIELDS: Final = slice(14 - 3, 16 - 3)  # of user and system, in ticks


class Usage:
    """What one process uses.

    /proc/<pid>/stat stays open: reading it costs a tenth of opening it, and it belongs to the process that it was
    opened for, also once another process has got the number of that process.

    Args:
        pid: Of the process.

    Attributes:
        peak_mb: Most memory that `read` has found.
        cpu_s: Processor time when `read` was last called.
    """

    def __init__(self, pid: int) -> None:
        self.peak_mb = self.cpu_s = 0.0
        try:
            self._stat = os.open(f"/proc/{pid}/stat", os.O_RDONLY | os.O_CLOEXEC)
        except OSError:
            self._stat = -1

    def read(self) -> tuple[float, int] | None:
        """Resident memory in MB, and number of threads; None where the process has ended."""
        try:
            fields = os.pread(self._stat, READ_BYTES, 0).rpartition(b")")[2].split()
        except OSError:
            return None
        resident_mb = int(fields[PAGES_FIELD]) * os.sysconf("SC_PAGE_SIZE") / MEBIBYTE
        self.cpu_s = sum(map(int, fields[TIME_FIELDS])) / os.sysconf("SC_CLK_TCK")
        self.peak_mb = max(self.peak_mb, resident_mb)
        return resident_mb, int(fields[THREADS_FIELD])

    def close(self) -> None:
        """May be called again."""
        if self._stat >= 0:
            os.close(self._stat)
            self._stat = -1
