"""Two processes of which one always waits for the other share a processor, where nobody else wants it.

A message and its answer take 7 us within one processor and 35 us between two, since an idle one has to be woken [M].
"""

from __future__ import annotations

import contextlib
import ctypes
import os
from typing import Final, NamedTuple

from pdrbench.isolation.usage import LiveFile

# Another busy process leaves the two a half of their processor and has them wait for it the other half. Less than this
# much processor and more than this much waiting tell it from a pause of ours, and from handing over all the time; ours.
LEAST_SHARE: Final = 0.7
MOST_DELAY: Final = 0.3
APART_S: Final = 2.0  # how long they then go where the system puts them; ours
LONG_STEP_S: Final = 5e-3  # of an answer: what is gained is then less than a percent


class Had(NamedTuple):
    """Time on a processor, and time in which one could have run and had none."""

    ran_s: float
    delayed_s: float


class Neighbours:
    """Puts this thread and a child on one processor while that helps, and apart again.

    Args:
        child: Process id.
    """

    def __init__(self, child: int) -> None:
        self._child = child
        self._apart_until_s = 0.0
        self._looked_s = 0.0
        self._had = Had(0.0, 0.0)
        self._everywhere: set[int] = set()  # processors that we may use; empty while we are apart
        self._clocks: list[LiveFile] = []  # of this thread and of the child, while they are together

    def join(self, now_s: float) -> None:
        """Both on the processor that this thread runs on, unless that was no good idea a moment ago."""
        if self._everywhere or now_s < self._apart_until_s:
            return
        with contextlib.suppress(AttributeError, OSError, ValueError):
            processor = ctypes.CDLL(None).sched_getcpu()
            everywhere = os.sched_getaffinity(0)
            if processor in everywhere:
                self._looked_s, self._had = now_s, self._have_had()
                os.sched_setaffinity(self._child, {processor})
                os.sched_setaffinity(0, {processor})
                self._everywhere = everywhere

    def look(self, now_s: float) -> None:
        """Now and then, while answers come quickly: parts the two where somebody else wants their processor."""
        if not self._everywhere:
            self.join(now_s)
            return
        elapsed_s, self._looked_s = now_s - self._looked_s, now_s
        before = self._had
        with contextlib.suppress(OSError, ValueError):
            self._had = self._have_had()
        ran_s, delayed_s = self._had.ran_s - before.ran_s, self._had.delayed_s - before.delayed_s
        if ran_s < LEAST_SHARE * elapsed_s and delayed_s > MOST_DELAY * elapsed_s:
            self._apart_until_s = now_s + APART_S
            self.part()

    def part(self) -> None:
        """Both may run anywhere again."""
        if self._everywhere:
            for process in (0, self._child):
                with contextlib.suppress(OSError):
                    os.sched_setaffinity(process, self._everywhere)
            self._everywhere = set()
        while self._clocks:
            self._clocks.pop().close()

    def _have_had(self) -> Had:
        """Of both together; raises `OSError` or `ValueError` where the system does not tell."""
        if not self._clocks:
            for process in ("thread-self", str(self._child)):
                self._clocks.append(LiveFile(f"/proc/{process}/schedstat"))
        ran_ns = delayed_ns = 0
        for clock in self._clocks:
            ran, delayed, _ = map(int, clock.read().split())
            ran_ns, delayed_ns = ran_ns + ran, delayed_ns + delayed
        if not ran_ns:
            raise ValueError("this system keeps no such statistics")
        return Had(ran_ns / 1e9, delayed_ns / 1e9)
