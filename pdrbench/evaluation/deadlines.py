"""Deadlines for code in this process that may never return: an alarm inside the interpreter."""

from __future__ import annotations

import ctypes
import math
import signal
import threading
import time
from types import FrameType, TracebackType
from typing import Final

from pdrbench.episode import STEP
from pdrbench.process.budget import Budget, LocalizerExit, LocalizerTimeout, TimeAccount

REPEAT_S: Final = 0.2  # a localizer that swallows the alarm gets it again after this long
MIN_TIMER_S: Final = 1e-3  # a timer of 0 s would be none
LOOK_S: Final = 0.05  # between looks at the clock where there is no signal


class Alarm(BaseException):
    """Raised inside a localizer when its time is up; not an `Exception`, so that few handlers catch it."""


class Deadlines:
    """The guard of `episode.play`: a context around every call into the localizer of one walk.

    Compiled code that never returns to the interpreter is not interrupted: that takes a process of its own.
    """

    def __init__(self, budget: Budget, period_s: float) -> None:
        self._account = TimeAccount(budget, period_s)
        self._began_s = 0.0
        self._allowed_s = 0.0
        self._call = ""
        self._num_steps = 0
        # Signals reach the main thread only, and a notebook may use others; Windows has no such signal.
        has_signal = hasattr(signal, "setitimer") and threading.current_thread() is threading.main_thread()
        self._clock: _Signal | _Watch = _Signal() if has_signal else _Watch()

    def __call__(self, call: str) -> Deadlines:
        """The context of the next call, by its name: "step" or another one."""
        self._num_steps += call == STEP
        self._call = call
        return self

    def start(self) -> None:
        """Installs the alarm; `stop` must follow."""
        self._clock.start()

    def stop(self) -> None:
        """Removes the alarm."""
        self._clock.stop()

    def __enter__(self) -> None:
        self._allowed_s = max(self._account.allowed_s(self._call), MIN_TIMER_S)
        self._began_s = time.monotonic()
        self._clock.set(self._allowed_s)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._clock.set(0.0)
        elapsed_s = time.monotonic() - self._began_s
        if isinstance(error, Alarm) or elapsed_s >= self._allowed_s:
            name = f"{self._call} {self._num_steps}" if self._call == STEP else self._call
            rule = self._account.rule(self._call)
            raise LocalizerTimeout(
                f"timeout: {name} took longer than the {self._allowed_s:.3g} s it had ({rule})"
            ) from error
        self._account.spend(self._call, elapsed_s)
        if error is not None and not isinstance(error, (Exception, KeyboardInterrupt)):
            raise LocalizerExit(f"the localizer raised {type(error).__name__}: {error}") from error


class _Signal:
    """An alarm by the timer of the process, which interrupts system calls as well."""

    def __init__(self) -> None:
        self._is_set = False

    def start(self) -> None:
        self._previous = signal.signal(signal.SIGALRM, self._ring)

    def stop(self) -> None:
        self.set(0.0)
        signal.signal(signal.SIGALRM, self._previous)

    def set(self, seconds: float) -> None:
        """Rings after that time; never for 0 s."""
        self._is_set = seconds > 0.0
        signal.setitimer(signal.ITIMER_REAL, seconds, REPEAT_S if seconds else 0.0)

    def _ring(self, signum: int, frame: FrameType | None) -> None:
        if self._is_set:
            raise Alarm


class _Watch:
    """An alarm by another thread; it rings between two instructions of the interpreter, up to `LOOK_S` late."""

    def __init__(self) -> None:
        self._thread = ctypes.c_ulong(threading.get_ident())
        self._lock = threading.Lock()
        self._has_stopped = threading.Event()
        self._due_s = math.inf

    def start(self) -> None:
        threading.Thread(target=self._look, daemon=True).start()

    def stop(self) -> None:
        self._has_stopped.set()

    def set(self, seconds: float) -> None:
        """Rings after that time; never for 0 s."""
        with self._lock:
            self._due_s = time.monotonic() + seconds if seconds else math.inf
            ctypes.pythonapi.PyThreadState_SetAsyncExc(self._thread, None)  # takes back what has not rung yet

    def _look(self) -> None:
        while not self._has_stopped.wait(LOOK_S):
            with self._lock:
                if (now_s := time.monotonic()) >= self._due_s:
                    self._due_s = now_s + REPEAT_S
                    ctypes.pythonapi.PyThreadState_SetAsyncExc(self._thread, ctypes.py_object(Alarm))
