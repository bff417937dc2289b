"""Deadlines for code that may never return: an alarm inside the interpreter, and behind it one that needs none."""

from __future__ import annotations

import contextlib
import ctypes
import faulthandler
import functools
import signal
import sys
import threading
import time
from collections.abc import Iterator
from types import FrameType, TracebackType
from typing import IO, Any, Final

from pdrbench.episode import STEP
from pdrbench.errors import PdrbenchError

REPEAT_S: Final = 0.2  # a localizer that swallows the alarm hears it again after this long
SHORTEST_S: Final = 1e-3  # a timer of 0 s would be none
GRACE_S: Final = 1.0  # between the alarm and the end of the process
KILL_SIGNAL: Final = signal.SIGVTALRM  # ends a process by default, leaves no core, hardly used by anybody


class Alarm(BaseException):
    """Raised inside a localizer when its time is up; not an `Exception`, so that few handlers catch it."""


class LocalizerTimeout(PdrbenchError):
    """A localizer did not answer in time."""


class LocalizerExit(PdrbenchError):
    """A localizer tried to end the process, or raised what is no `Exception`."""


class Deadlines:
    """The guard of `episode.play`: a context around every call into a localizer.

    Calls other than `step` (construction, `reset`, `revise`) may use up what is left of the budget of the walk.

    Args:
        step_s: Most wall time of one step.
        walk_s: Most wall time of all calls of one walk together.
        may_end_process: True where the process may be ended when the localizer sits in compiled code that never
            returns to the interpreter, or catches every alarm.
    """

    def __init__(self, step_s: float, walk_s: float, *, may_end_process: bool = False) -> None:
        if not (step_s > 0 and walk_s > 0):
            raise ValueError(f"deadlines are positive; got step {step_s} s, walk {walk_s} s")
        self._step_s, self._walk_s = step_s, walk_s
        self._executioner = executioner() if may_end_process else None
        self._ends_s = 0.0
        self._spent_s = 0.0
        self._began_s = 0.0
        self._most_s = walk_s
        self._budget_s = walk_s
        self._call = ""
        self._num_steps = 0
        self._armed = False
        # Alarms reach the main thread only; elsewhere (a notebook's thread pool) lateness is judged after the call.
        self._has_alarm = threading.current_thread() is threading.main_thread()

    def __call__(self, call: str) -> Deadlines:
        """The context of the next call, which is told by name: "step" or another one."""
        self._num_steps += call == STEP
        self._call = f"{call} {self._num_steps}" if call == STEP else call
        self._most_s = self._step_s if call == STEP else self._walk_s
        return self

    def start(self) -> None:
        """Installs the alarm; `stop` must follow."""
        if self._has_alarm:
            self._previous = signal.signal(signal.SIGALRM, self._ring)

    def stop(self) -> None:
        """Removes every alarm."""
        self._armed = False
        if self._has_alarm:
            signal.setitimer(signal.ITIMER_REAL, 0)
            signal.signal(signal.SIGALRM, self._previous)
        if self._executioner is not None:
            self._executioner.set(0.0)

    def __enter__(self) -> None:
        self._budget_s = max(min(self._most_s, self._walk_s - self._spent_s), SHORTEST_S)
        if self._executioner is not None:
            self._executioner.set(self._budget_s + GRACE_S)
        self._began_s = time.monotonic()
        self._armed = True
        if self._has_alarm:
            signal.setitimer(signal.ITIMER_REAL, self._budget_s, REPEAT_S)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._armed = False
        if self._has_alarm:
            signal.setitimer(signal.ITIMER_REAL, 0)
        elapsed_s = time.monotonic() - self._began_s
        self._spent_s += elapsed_s
        if isinstance(error, Alarm) or elapsed_s >= self._budget_s:
            raise LocalizerTimeout(
                f"{self._call} took longer than the {self._budget_s:.3g} s it had "
                f"(deadlines: {self._step_s:g} s a step, {self._walk_s:g} s a walk)"
            ) from error
        is_user_stop = self._executioner is None and isinstance(error, KeyboardInterrupt)
        if error is not None and not isinstance(error, Exception) and not is_user_stop:
            raise LocalizerExit(f"the localizer raised {type(error).__name__}: {error}") from error

    def _ring(self, signum: int, frame: FrameType | None) -> None:
        if self._armed:
            raise Alarm


class Executioner:
    """A timer of the kernel that ends this process without the interpreter's help: compiled code may hold its lock.

    Its signal makes faulthandler write a traceback, which also happens in C, and then ends the process. A POSIX timer
    costs a microsecond; `faulthandler.dump_traceback_later` starts and joins a thread each time, which cost 0.2 ms
    on an idle machine and 3 ms on a busy one.
    """

    def __init__(self) -> None:
        self._libc = ctypes.CDLL(None, use_errno=True)
        self._timer = ctypes.c_void_p()
        event = _SignalEvent(signo=KILL_SIGNAL, notify=0)  # SIGEV_SIGNAL
        if self._libc.timer_create(time.CLOCK_MONOTONIC, ctypes.byref(event), ctypes.byref(self._timer)):
            raise OSError(ctypes.get_errno(), "cannot create a timer")

    def set(self, after_s: float) -> None:
        """Ends the process in so many seconds; never where that is 0."""
        whole_s = int(after_s)
        setting = _TimerSetting(0, 0, whole_s, int((after_s - whole_s) * 1e9))
        self._libc.timer_settime(self._timer, 0, ctypes.byref(setting), None)


class _SignalEvent(ctypes.Structure):
    """`struct sigevent` of Linux: 64 bytes."""

    _fields_ = (
        ("value", ctypes.c_void_p),
        ("signo", ctypes.c_int),
        ("notify", ctypes.c_int),
        ("_padding", ctypes.c_char * 48),
    )


class _TimerSetting(ctypes.Structure):
    """`struct itimerspec`: interval, then first expiry."""

    _fields_ = (
        ("interval_s", ctypes.c_long),
        ("interval_ns", ctypes.c_long),
        ("value_s", ctypes.c_long),
        ("value_ns", ctypes.c_long),
    )


@functools.cache
def executioner() -> Executioner:
    """The one of this process."""
    return Executioner()


@contextlib.contextmanager
def last_words(report: IO[Any]) -> Iterator[None]:
    """Whatever ends the process inside leaves a traceback in `report`, also where compiled code is to blame."""
    faulthandler.enable(report)
    faulthandler.register(KILL_SIGNAL, report, all_threads=True, chain=True)
    try:
        yield
    finally:
        faulthandler.unregister(KILL_SIGNAL)
        faulthandler.enable(sys.__stderr__ or 2)


def was_ended(report: str) -> bool:
    """True where the last words are those of a process that was ended for its lateness, not of one that crashed."""
    return bool(report) and not report.startswith("Fatal Python error")
