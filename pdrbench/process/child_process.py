"""A process by the standard means, the same on Linux, macOS and Windows, which stays for the walks to come.

Whoever runs own code pays once for what that imports, compiles and loads: the process and the localizer in it play one
walk after the other. Localizers of one package share a process; a file or a folder has its own. A process ends where
anything goes wrong in it, where a source that it has loaded changes, and with the one that started it.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import json
import math
import os
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import psutil  # type: ignore[import-untyped]

from pdrbench.arithmetic import THREADS
from pdrbench.errors import PdrbenchError
from pdrbench.process.messages import LENGTH_BYTES, TRACE_SIGNAL, ProtocolError, Started, frame_size, read_reply

BEGUN: Final = "the walk had begun and is not played again"  # of whatever has been shown anything of it
REQUESTS_CLOSED: Final = "it closed the pipe of requests"
REPLIES_CLOSED: Final = "it closed the pipe of replies"
UNREQUESTED: Final = "an answer came without a request"
CHECK_S: Final = 0.1  # between looks at the clock and at what a child uses
TRACEBACK_S: Final = 0.2  # for a traceback of a child whose time is up
GRACE_S: Final = 1.0  # for a child that has closed its end to exit
MAX_OUTPUT_BYTES: Final = 16_384
MAX_GREETING_BYTES: Final = 65_536
MEBIBYTE: Final = 2**20
MAX_IDLE: Final = 4  # warm processes that are kept; those that have waited longest end
BEGIN: Final = (
    "import json, sys; sys.path[:], owner = json.loads(sys.argv[1]); "
    "import pdrbench.process.child_main as it; it.main(owner)"
)
PLAIN: Final[Mapping[str, object]] = {"mode": "process", "held": [], "missing": {}}


class LaunchError(PdrbenchError):
    """No process can be started, or what starts them is gone."""


class LateError(PdrbenchError):
    """A child did not answer in time."""


class EndedError(PdrbenchError):
    """A child has closed its end, or exceeds a limit and is to be ended."""

    def __init__(self, reason: str, *, is_running: bool = False) -> None:
        super().__init__(reason)
        self.is_running = is_running


@dataclass(frozen=True, slots=True)
class Limits:
    """Upper limits for the process of a localizer. Ours: several times what the registered localizers use."""

    memory_mb: int = 4096  # resident memory
    threads: int = 128  # number of threads


@dataclass(frozen=True, slots=True)
class Ended:
    """What became of a child, and what it used."""

    code: int  # exit code, or minus the signal; 0 where it goes on
    killed: bool  # true where it had to be ended
    peak_mb: float  # most resident memory, interpreter and toolbox included
    cpu_s: float  # processor time
    is_measured: bool = True  # False where these are what was last seen, lower bounds
    lost: str = ""  # why nothing is known of its end; empty where it is known


class ChildProcess:
    """One process; see `launch.Process`. A thread ends it where its time is up or it exceeds a limit.

    Args:
        limits: Of its memory and threads.
        ends_s: Until when it has to be there, on the monotonic clock.
        key: Of what it may serve.

    Raises:
        LaunchError: It cannot be started, or does not begin.
    """

    facts = PLAIN

    def __init__(self, limits: Limits, ends_s: float, key: tuple[object, ...] = ()) -> None:
        self._limits, self.key = limits, key
        self._folder = Path(tempfile.mkdtemp(prefix="pdrbench-process-"))
        self._written = self._folder / "output"
        path = [str(Path(place or os.curdir).absolute()) for place in sys.path]
        try:
            with self._written.open("ab") as output:
                self._process = subprocess.Popen(
                    [sys.executable, "-s", "-P", "-c", BEGIN, json.dumps([path, os.getpid()])],
                    env={**os.environ, **THREADS, "PYTHONHASHSEED": "0"},
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=output,
                    start_new_session=True,  # an interrupt is not for it
                    creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),  # the same on Windows
                )
        except OSError as error:
            shutil.rmtree(self._folder, ignore_errors=True)
            raise LaunchError(f"no process for localizers can be started: {error.strerror}") from error
        assert self._process.stdin is not None and self._process.stdout is not None
        self._requests, self._replies = self._process.stdin, self._process.stdout
        self._usage = Usage(self._process.pid)
        self._ends_s, self.last_read_s = math.inf, time.monotonic()
        self._why: LateError | EndedError | None = None  # why it was ended
        self._ended: Ended | None = None
        self._output = ""
        self._is_asked = threading.Event()
        threading.Thread(target=self._watch, daemon=True).start()
        try:
            read_reply(self._receive(ends_s, MAX_GREETING_BYTES), 0, Started)
        except (LateError, EndedError, ProtocolError) as error:
            self.end()
            raise LaunchError(f"a process for the localizer did not begin: {error}; {self.output}") from error

    @property
    def output(self) -> str:
        """As `launch.Process` has it."""
        if self._ended is None:
            with contextlib.suppress(OSError), self._written.open("rb") as file:
                file.seek(max(0, file.seek(0, os.SEEK_END) - MAX_OUTPUT_BYTES))
                self._output = file.read().decode(errors="replace")
        return self._output

    def begin(self) -> None:
        """Begins to count what a walk uses, and forgets the output of those before."""
        self._usage.begin()
        with contextlib.suppress(OSError):
            os.truncate(self._written, 0)

    def ask(self, request: bytearray, ends_s: float, max_bytes: int) -> bytes:
        """As `launch.Process` has it."""
        self._ends_s = ends_s
        self._is_asked.set()
        try:
            self._requests.write(request)
            self._requests.flush()
        except (OSError, ValueError):
            raise self._why or EndedError(REQUESTS_CLOSED) from None
        return self._receive(ends_s, max_bytes)

    def _receive(self, ends_s: float, max_bytes: int) -> bytes:
        """One frame; where none comes, `_watch` ends the process and so the pipe."""
        self._ends_s = ends_s
        self._is_asked.set()
        try:
            size = frame_size(self._replies.read(LENGTH_BYTES), max_bytes)
            body = b"" if size is None else self._replies.read(size - LENGTH_BYTES)
        finally:
            self._is_asked.clear()
            self._ends_s, self.last_read_s = math.inf, time.monotonic()
        if size is None or len(body) < size - LENGTH_BYTES:
            raise self._why or EndedError(REPLIES_CLOSED)
        if self.last_read_s > ends_s:
            raise LateError
        return body

    def check_silence(self) -> None:
        """An answer without a request is found with the next one."""

    def request_traceback(self) -> None:
        """It has been written before the process was ended."""

    def release(self) -> Ended:
        """As `launch.Process` has it."""
        if self._process.poll() is not None:
            return self.end()
        self._usage.read()
        _idle().put(self)
        return Ended(0, False, *self._usage.used, is_measured=False)

    def end(self, grace_s: float = 0.0) -> Ended:
        """As `launch.Process` has it; what it used is what was last seen."""
        if self._ended is None:
            self._usage.read()
            self._is_asked.set()  # so that `_watch` ends
            with contextlib.suppress(OSError):
                self._requests.close()
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(grace_s)
            killed = self._why is not None or self._process.poll() is None
            self._kill()
            code = self._process.wait()
            self._replies.close()
            self.output  # noqa: B018  the end of it is kept
            self._ended = Ended(code, killed, *self._usage.used, is_measured=False)
            shutil.rmtree(self._folder, ignore_errors=True)
        return self._ended

    @property
    def is_alive(self) -> bool:
        return self._ended is None and self._process.poll() is None

    def _kill(self) -> None:
        """Ends the process and what it has started."""
        with contextlib.suppress(psutil.Error):
            for started in psutil.Process(self._process.pid).children(recursive=True):
                started.kill()
        self._process.kill()

    def _watch(self) -> None:
        while self._process.poll() is None:
            self._is_asked.wait()
            try:
                self._usage.read()
                self._usage.check(self._limits)
                if time.monotonic() > self._ends_s:
                    raise LateError
            except (LateError, EndedError) as error:
                self._why = error
                if TRACE_SIGNAL is not None:
                    self._process.send_signal(TRACE_SIGNAL)
                    time.sleep(TRACEBACK_S)
                self._kill()
            time.sleep(CHECK_S)


class Usage:
    """Memory, threads and processor time of a process, since a walk began."""

    def __init__(self, pid: int) -> None:
        self._pid = pid
        self._memory_mb = self._peak_mb = self._cpu_s = self._before_s = 0.0
        self._threads = 0

    @property
    def used(self) -> tuple[float, float]:
        """Peak memory in MB and processor time in seconds."""
        return round(self._peak_mb, 1), round(self._cpu_s - self._before_s, 3)

    def begin(self) -> None:
        self.read()
        self._peak_mb, self._before_s = self._memory_mb, self._cpu_s

    def read(self) -> None:
        """Looks; what has ended keeps its last figures."""
        with contextlib.suppress(psutil.Error):
            process = psutil.Process(self._pid)
            with process.oneshot():
                self._memory_mb = process.memory_info().rss / MEBIBYTE
                self._threads = process.num_threads()
                self._cpu_s = sum(process.cpu_times()[:2])
            self._peak_mb = max(self._peak_mb, self._memory_mb)

    def check(self, limits: Limits) -> None:
        """Raises `EndedError` where a limit is exceeded."""
        used_mb, threads = self._memory_mb, self._threads
        if used_mb > limits.memory_mb:
            raise EndedError(f"memory: it uses {used_mb:.0f} MB; the limit is {limits.memory_mb} MB", is_running=True)
        if threads > limits.threads:
            raise EndedError(f"threads: it runs {threads}; the limit is {limits.threads}", is_running=True)


class _Idle:
    """Processes that wait for their next walk."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._waiting: list[ChildProcess] = []

    def take(self, key: tuple[object, ...]) -> ChildProcess | None:
        with self._lock:
            found = next((process for process in self._waiting if process.key == key), None)
            if found is not None:
                self._waiting.remove(found)
        return found

    def put(self, process: ChildProcess) -> None:
        with self._lock:
            self._waiting.append(process)
            surplus = self._waiting[:-MAX_IDLE]
            del self._waiting[:-MAX_IDLE]
        for old in surplus:
            old.end()

    def end(self) -> None:
        with self._lock:
            waiting, self._waiting = self._waiting, []
        for process in waiting:
            process.end()


@functools.cache
def _idle_of(pid: int) -> _Idle:
    """Those of one process: a fork has none of its parent's."""
    found = _Idle()
    atexit.register(found.end)
    return found


def _idle() -> _Idle:
    return _idle_of(os.getpid())


def discard() -> None:
    """Ends the processes that wait; the next walk starts a new one."""
    _idle().end()


def warm_process(target: str, limits: Limits, ends_s: float) -> ChildProcess:
    """A process that waits for a localizer of the same package, or a new one.

    Args:
        target: Where the class of the localizer is.
        limits: Of its memory and threads.
        ends_s: Until when it has to be there, on the monotonic clock.

    Raises:
        LaunchError: None can be started.
    """
    place = target.partition(":")[0]
    owner = place if place.endswith((".py", "/")) else place.partition(".")[0]
    variables = tuple(sorted(os.environ.items()))
    key = (owner, limits, tuple(sys.path), str(Path.cwd()), variables)
    while (process := _idle().take(key)) is not None:
        if process.is_alive:
            break
        process.end()
    else:
        process = ChildProcess(limits, ends_s, key)
    process.begin()
    return process
