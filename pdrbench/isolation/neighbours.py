"""Two processes of which one always waits for the other share a processor, where nobody else wants it.

A message and its answer take 7 us within one processor and 35 us between two, since an idle one has to be woken [M].
"""

from __future__ import annotations

import contextlib
import ctypes
import os
from pathlib import Path
from typing import Final

LEAST_SHARE: Final = 0.7  # of their processor that the two have together: another busy process leaves them a half; ours
APART_S: Final = 2.0  # how long they then go where the system puts them; ours
LONG_STEP_S: Final = 5e-3  # of an answer: what is gained is then less than a percent


class Neighbours:
    """Puts this thread and a child on one processor while that helps, and apart again.

    Args:
        child: Process id.
    """

    def __init__(self, child: int) -> None:
        self._child = child
        self._apart_until_s = 0.0
        self._looked_s = 0.0
        self._ran_s = 0.0
        self._everywhere: set[int] = set()  # processors that we may use; empty while we are apart

    def join(self, now_s: float) -> None:
        """Both on the processor that this thread runs on, unless that was no good idea a moment ago."""
        if self._everywhere or now_s < self._apart_until_s:
            return
        with contextlib.suppress(AttributeError, OSError, ValueError):
            processor = ctypes.CDLL(None).sched_getcpu()
            everywhere = os.sched_getaffinity(0)
            self._looked_s, self._ran_s = now_s, self._running_s()
            if processor in everywhere:
                os.sched_setaffinity(self._child, {processor})
                os.sched_setaffinity(0, {processor})
                self._everywhere = everywhere

    def look(self, now_s: float) -> None:
        """Now and then, while answers come quickly: parts the two where somebody else wants their processor."""
        if not self._everywhere:
            self.join(now_s)
            return
        elapsed_s, self._looked_s = now_s - self._looked_s, now_s
        before_s = self._ran_s
        with contextlib.suppress(OSError, ValueError):
            self._ran_s = self._running_s()
        if self._ran_s - before_s < LEAST_SHARE * elapsed_s:
            self._apart_until_s = now_s + APART_S
            self.part()

    def part(self) -> None:
        """Both may run anywhere again."""
        if self._everywhere:
            for process in (0, self._child):
                with contextlib.suppress(OSError):
                    os.sched_setaffinity(process, self._everywhere)
            self._everywhere = set()

    def _running_s(self) -> float:
        """Processor time that the two have had; raises `OSError`."""
        places = ("/proc/thread-self/schedstat", f"/proc/{self._child}/schedstat")
        return sum(int(Path(place).read_text().split()[0]) for place in places) / 1e9
