"""Two processes of which one always waits for the other share a processor, where nobody else wants it.

A message and its answer take 7 us within one processor and 35 us between two, since an idle one has to be woken [M].
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

LOOK_S: Final = 0.1  # between looks whether it is still a good idea; ours
MOST_WAITING: Final = 0.25  # share of time that the two may wait: another busy process makes it a half; ours
APART_S: Final = 2.0  # how long they then go where the system puts them; ours
LONG_STEP_S: Final = 5e-3  # of an answer: what is gained is then less than a percent


class Neighbours:
    """Puts this thread and a child on one processor while that helps, and apart again.

    Args:
        child: Process id.
    """

    def __init__(self, child: int) -> None:
        self._child = child
        self._looked_s = time.monotonic()
        self._apart_until_s = 0.0
        self._waited_s: float | None = None
        self._num_answers = 0
        self._everywhere: set[int] = set()  # processors that we may use; empty while we are apart
        self._here: Callable[[], int] | None = None
        with contextlib.suppress(AttributeError, OSError):
            self._here = ctypes.CDLL(None).sched_getcpu
            self._waited_s = self._waiting_s()

    def answered(self, now_s: float) -> None:
        """Is told of every answer, and looks now and then."""
        self._num_answers += 1
        if now_s - self._looked_s < LOOK_S or self._here is None or self._waited_s is None:
            return
        elapsed_s, self._looked_s = now_s - self._looked_s, now_s
        with contextlib.suppress(OSError, ValueError):
            waited_s = self._waiting_s()
            is_crowded = waited_s - self._waited_s > MOST_WAITING * elapsed_s
            self._waited_s = waited_s
            is_long = elapsed_s > LONG_STEP_S * self._num_answers
            self._num_answers = 0
            if is_crowded:
                self._apart_until_s = now_s + APART_S
            if is_crowded or is_long:
                self.part()
            elif not self._everywhere and now_s > self._apart_until_s:
                self._join(self._here())

    def part(self) -> None:
        """Both may run anywhere again."""
        if self._everywhere:
            for process in (0, self._child):
                with contextlib.suppress(OSError):
                    os.sched_setaffinity(process, self._everywhere)
            self._everywhere = set()

    def _join(self, processor: int) -> None:
        everywhere = os.sched_getaffinity(0)
        if processor in everywhere:
            os.sched_setaffinity(self._child, {processor})
            os.sched_setaffinity(0, {processor})
            self._everywhere = everywhere

    def _waiting_s(self) -> float:
        """Time that the two have been ready to run and had to wait for a processor; raises `OSError`."""
        places = ("/proc/thread-self/schedstat", f"/proc/{self._child}/schedstat")
        return sum(int(Path(place).read_text().split()[1]) for place in places) / 1e9
