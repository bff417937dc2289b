"""Two processes of which one always waits for the other share a processor while no other process needs it.

A message and its answer take 7 us within one processor and 35 us between two, since an idle one has to be woken [M].
"""

from __future__ import annotations

import contextlib
import ctypes
import os
from typing import Final, NamedTuple

from pdrbench.isolation.usage import LiveFile

# Another busy process takes half of the processor, for which the two then wait half of the time. Both thresholds
# together distinguish that from a pause of the evaluating side, and from frequent switches between the two; ours.
MIN_RUN_FRACTION: Final = 0.7
MAX_DELAY_FRACTION: Final = 0.3
SEPARATE_S: Final = 2.0  # how long the system then places them; ours
LONG_STEP_S: Final = 5e-3  # of an answer: sharing then gains less than a percent


class SchedulerStats(NamedTuple):
    """Time on a processor, and time spent ready to run without one."""

    ran_s: float
    delayed_s: float


class SharedProcessor:
    """Puts this thread and a child process on one processor while that helps, and separates them again."""

    def __init__(self, child: int) -> None:
        self._child = child
        self._separate_until_s = 0.0
        self._checked_s = 0.0
        self._stats = SchedulerStats(0.0, 0.0)
        self._allowed: set[int] = set()  # processors of this process; empty while the two are separate
        self._clocks: list[LiveFile] = []  # of this thread and of the child, while they are together

    def share(self, now_s: float) -> None:
        """Puts both on the processor of this thread, unless they were separated a moment ago."""
        if self._allowed or now_s < self._separate_until_s:
            return
        with contextlib.suppress(AttributeError, OSError, ValueError):
            processor = ctypes.CDLL(None).sched_getcpu()
            allowed = os.sched_getaffinity(0)
            if processor in allowed:
                self._checked_s, self._stats = now_s, self._read_stats()
                os.sched_setaffinity(self._child, {processor})
                os.sched_setaffinity(0, {processor})
                self._allowed = allowed

    def check(self, now_s: float) -> None:
        """Separates the two where another process needs their processor; called while answers come quickly."""
        if not self._allowed:
            self.share(now_s)
            return
        elapsed_s, self._checked_s = now_s - self._checked_s, now_s
        before = self._stats
        with contextlib.suppress(OSError, ValueError):
            self._stats = self._read_stats()
        ran_s, delayed_s = self._stats.ran_s - before.ran_s, self._stats.delayed_s - before.delayed_s
        if ran_s < MIN_RUN_FRACTION * elapsed_s and delayed_s > MAX_DELAY_FRACTION * elapsed_s:
            self._separate_until_s = now_s + SEPARATE_S
            self.separate()

    def separate(self) -> None:
        """Both may run anywhere again."""
        if self._allowed:
            for process in (0, self._child):
                with contextlib.suppress(OSError):
                    os.sched_setaffinity(process, self._allowed)
            self._allowed = set()
        while self._clocks:
            self._clocks.pop().close()

    def _read_stats(self) -> SchedulerStats:
        """Of both together; raises `OSError` or `ValueError` where the system keeps no such statistics."""
        if not self._clocks:
            for process in ("thread-self", str(self._child)):
                self._clocks.append(LiveFile(f"/proc/{process}/schedstat"))
        ran_ns = delayed_ns = 0
        for clock in self._clocks:
            ran, delayed, _ = map(int, clock.read().split())
            ran_ns, delayed_ns = ran_ns + ran, delayed_ns + delayed
        if not ran_ns:
            raise ValueError("this system keeps no such statistics")
        return SchedulerStats(ran_ns / 1e9, delayed_ns / 1e9)
