"""The evaluating side of a launcher: starts it, has it fork children, watches them, ends them."""

from __future__ import annotations

import atexit
import contextlib
import functools
import math
import os
import select
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import psutil  # type: ignore[import-untyped]

from pdrbench.errors import PdrbenchError
from pdrbench.isolation import scratch
from pdrbench.isolation.confine import MEBIBYTE, Limits
from pdrbench.isolation.control import receive, send
from pdrbench.isolation.messages import LENGTH_BYTES, LIBRARIES, TRACE_SIGNAL, ProtocolError, frame_size
from pdrbench.isolation.neighbours import Neighbours
from pdrbench.isolation.reach import Reach, compiled_folders, hidden_places, numba_cache

START_S: Final = 120.0  # for an interpreter and the toolbox, on a busy machine with cold files
GONE: Final = "the process that starts localizers has ended; run the walk again"
LOOK_S: Final = 0.1  # between looks at what a child uses
LAST_WORDS_S: Final = 0.2  # for a traceback of a child whose time is up
GRACE_S: Final = 1.0  # for a child that has closed its end to be gone
READ_BYTES: Final = 1 << 15
MOST_OUTPUT_BYTES: Final = 16_384
# One numeric thread in each process: walks are the unit of parallelism, and sums stay the same on every machine.
THREADS: Final = dict.fromkeys(
    (
        "OMP_NUM_THREADS",
        "OPENBLAS_NUM_THREADS",
        "MKL_NUM_THREADS",
        "BLIS_NUM_THREADS",
        "VECLIB_MAXIMUM_THREADS",
        "NUMBA_NUM_THREADS",
        "NUMEXPR_NUM_THREADS",
    ),
    "1",
)
BOOT: Final = Path(__file__).with_name("boot.py")


class IsolationError(PdrbenchError):
    """A child cannot be started, or the launcher is gone."""


class LateError(PdrbenchError):
    """A child did not answer in time."""


class EndedError(PdrbenchError):
    """A child has closed its end, or uses more than it may and is to be ended."""

    def __init__(self, what: str, *, lives: bool = False) -> None:
        super().__init__(what)
        self.lives = lives


@dataclass(frozen=True, slots=True)
class Ended:
    """How a child ended.

    Attributes:
        code: Exit code, or minus the signal.
        killed: True where it had to be ended.
        peak_mb: Most resident memory, interpreter and toolbox included.
        cpu_s: Processor time.
    """

    code: int
    killed: bool
    peak_mb: float
    cpu_s: float


class Launcher:
    """One launcher process; its children come one after the other.

    Args:
        confines: True where children are to be confined as far as the system lets us.
        limits: Of every child.
    """

    def __init__(self, confines: bool, limits: Limits) -> None:
        self.limits, self.confines = limits, confines
        self._owner = os.getpid()
        self._scratch = tempfile.mkdtemp(prefix="pdrbench-scratch-")
        self._libraries: set[str] = set()
        self._is_gone = False
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115  closed with the launcher
        ours, theirs = socket.socketpair()
        self._control = ours
        # The paths of the interpreter are handed over; its own start must not see the user's variables.
        self._process = subprocess.Popen(
            [sys.executable, "-s", "-P", "-B", str(BOOT), str(theirs.fileno())],
            env={**THREADS, "PYTHONHASHSEED": "0", "LANG": "C.UTF-8", "PATH": os.defpath},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=self._errors,
            pass_fds=(theirs.fileno(),),
            start_new_session=True,
        )
        theirs.close()
        compiled = compiled_folders()
        self._start(
            {
                "path": [str(Path(place or os.curdir).absolute()) for place in sys.path],
                "confines": confines,
                "scratch": self._scratch,
                "scratch_bytes": limits.scratch_mb * MEBIBYTE,
                "scratch_files": limits.scratch_files,
                "hidden": sorted(hidden_places()),
                "writable": compiled,
                "numba_cache": numba_cache(),
                "environment": {**THREADS, "PATH": os.defpath},
            }
        )

    @property
    def alive(self) -> bool:
        """False once it has ended, or no longer answers."""
        return not self._is_gone and self._process.poll() is None

    def fork(self, reach: Reach, cpu_s: float) -> Child:
        """A new child.

        Args:
            reach: What it may open.
            cpu_s: Most processor time.
        """
        requests_in, requests = os.pipe()
        replies, replies_out = os.pipe()
        output, output_out = os.pipe()
        theirs = (requests_in, replies_out, output_out)
        order = {
            "readable": reach.readable,
            "listed": reach.listed,
            "writable": reach.writable,
            "own_cache": reach.ships_with_us,
            "limits": asdict(self.limits),
            "cpu_s": cpu_s if math.isfinite(cpu_s) else 1e9,
            "libraries": sorted(self._libraries),
        }
        try:
            answer, handles = self._ask({"fork": order}, theirs)
        except IsolationError:
            for descriptor in (requests, replies, output):
                os.close(descriptor)
            raise
        finally:
            for descriptor in theirs:
                os.close(descriptor)
        return Child(self, answer["pid"], handles[0] if handles else -1, (requests, replies, output))

    def preload(self, libraries: Sequence[str]) -> None:
        """Libraries that the next children are to find imported."""
        self._libraries |= set(libraries) & set(LIBRARIES)

    def reap(self, grace_s: float) -> Ended:
        """Ends the child, or waits so long for it to end."""
        answer, _ = self._ask({"reap": {"grace_s": grace_s}})
        return Ended(**answer)

    def close(self) -> None:
        """Ends the launcher and what it has forked; does nothing in a fork of the process that started it."""
        self._control.close()
        if os.getpid() != self._owner:
            return
        try:
            self._process.wait(GRACE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._errors.close()
        with contextlib.suppress(OSError):  # the launcher has removed it where it ended by itself
            scratch.empty(self._scratch)
            os.rmdir(self._scratch)  # noqa: PTH106

    def _ask(self, order: dict[str, Any], descriptors: Sequence[int] = ()) -> tuple[dict[str, Any], list[int]]:
        try:
            send(self._control, order, descriptors)
            return receive(self._control, 1)
        except (OSError, EOFError) as error:
            self._is_gone = True  # its first process may take a moment to follow
            raise IsolationError(GONE) from error

    def _start(self, orders: dict[str, Any]) -> None:
        self._control.settimeout(START_S)
        try:
            self._ask(orders)
        except IsolationError as error:
            raise IsolationError(f"no process for localizers can be started: {self._last_words()}") from error

    def _last_words(self) -> str:
        self._process.kill()
        self._process.wait()
        self._errors.seek(0)
        lines = self._errors.read().decode(errors="replace").strip().splitlines()
        return lines[-1] if lines else f"it ended with code {self._process.returncode} and said nothing"


class Child:
    """One process of a localizer, seen from outside: its pipes, its deadline, what it uses."""

    def __init__(self, launcher: Launcher, pid: int, handle: int, pipes: tuple[int, int, int]) -> None:
        self._launcher, self._handle = launcher, handle
        self._requests, self._replies, self._output = pipes
        for descriptor in pipes:
            os.set_blocking(descriptor, False)
        self._pid = _pid_here(handle, pid)
        self._neighbours = Neighbours(self._pid)
        self._buffer = bytearray()
        self._said = bytearray()
        self._looked_s = time.monotonic()
        self._poll = select.poll()
        self._poll.register(self._replies, select.POLLIN)
        self._poll.register(self._output, select.POLLIN)
        self._ended: Ended | None = None
        self._is_closed = False

    @property
    def output(self) -> str:
        """The end of what it wrote to standard output and error."""
        return self._said.decode(errors="replace")

    def ask(self, request: bytes, allowed_s: float, most_bytes: int) -> bytes:
        """Sends one frame and waits for one.

        Args:
            request: The frame.
            allowed_s: Most wall time from now on.
            most_bytes: Of the reply.

        Raises:
            LateError: No whole reply came in time.
            EndedError: The process ended, or uses more than it may.
            ProtocolError: What came is no single frame of that size.
        """
        if self._is_closed:
            raise EndedError("it has ended")
        ends_s = time.monotonic() + allowed_s
        if self._buffer:
            raise ProtocolError("an answer came that nobody asked for")
        self._write(request, ends_s)
        return self.receive(ends_s, most_bytes)

    def receive(self, ends_s: float, most_bytes: int) -> bytes:
        """Waits for one frame until a time of the monotonic clock; raises as `ask` does."""
        while True:
            left_s = ends_s - time.monotonic()
            if left_s <= 0:
                raise LateError
            size: int | None = None
            events = self._poll.poll(min(left_s, LOOK_S) * 1000 + 1)
            for descriptor, _ in events:
                if descriptor == self._output:
                    self._listen()
                else:
                    size = self._read(most_bytes)
            now_s = time.monotonic()
            if now_s - self._looked_s > LOOK_S:
                self._looked_s = now_s
                self._look()
                if size is None:
                    self._neighbours.part()  # it computes for long: wherever there is room
            if size is not None and len(self._buffer) >= size:
                if len(self._buffer) > size:
                    raise ProtocolError("more than one answer came to one request")
                if now_s > ends_s:
                    raise LateError
                body = bytes(self._buffer[LENGTH_BYTES:])
                self._buffer.clear()
                self._neighbours.answered(now_s)
                return body

    def check_silence(self) -> None:
        """Raises `ProtocolError` where something came that nobody asked for."""
        if self._is_closed:
            return
        with contextlib.suppress(BlockingIOError):
            if self._buffer or os.read(self._replies, 1):
                raise ProtocolError("an answer came that nobody asked for")

    def ask_where(self) -> None:
        """Has a child whose time is up write where it is, also where compiled code holds the interpreter."""
        with contextlib.suppress(OSError):
            if self._handle >= 0:
                signal.pidfd_send_signal(self._handle, TRACE_SIGNAL)
            else:
                os.kill(self._pid, TRACE_SIGNAL)
        ends_s = time.monotonic() + LAST_WORDS_S
        before = len(self._said)
        while time.monotonic() < ends_s and len(self._said) == before:
            if any(descriptor == self._output for descriptor, _ in self._poll.poll(20)):
                self._listen()

    def end(self, grace_s: float = 0.0) -> Ended:
        """Ends it, and everything it started; may be called again."""
        if self._ended is None:
            if self._is_closed:
                raise IsolationError(GONE)
            try:
                self._ended = self._launcher.reap(grace_s)
            finally:
                self._neighbours.part()
                self._listen()
                self._is_closed = True
                for descriptor in (self._requests, self._replies, self._output, self._handle):
                    if descriptor >= 0:
                        os.close(descriptor)
        return self._ended

    def _write(self, request: bytes, ends_s: float) -> None:
        left = memoryview(request)
        while True:
            with contextlib.suppress(BlockingIOError):
                try:
                    left = left[os.write(self._requests, left) :]
                except BrokenPipeError:
                    raise EndedError("it closed the pipe of requests") from None
            if not left:
                return
            if time.monotonic() > ends_s:
                raise LateError
            ready, _, _ = select.select([self._output], [self._requests], [], LOOK_S)
            if ready:
                self._listen()

    def _read(self, most_bytes: int) -> int | None:
        """Takes what has come of a reply; the size of the whole frame once that is known."""
        try:
            part = os.read(self._replies, READ_BYTES)
        except BlockingIOError:
            part = None
        if part == b"":
            raise EndedError("it closed the pipe of replies")
        self._buffer += part or b""
        return frame_size(self._buffer, most_bytes)

    def _listen(self) -> None:
        """Takes what it wrote and keeps the end."""
        with contextlib.suppress(BlockingIOError, ValueError, OSError):
            part = os.read(self._output, READ_BYTES)
            if not part and self._ended is None:
                with contextlib.suppress(KeyError):
                    self._poll.unregister(self._output)
            self._said += part
            del self._said[:-MOST_OUTPUT_BYTES]

    def _look(self) -> None:
        """Ends the wait where more memory or threads are used than there may be."""
        limits = self._launcher.limits
        try:
            process = psutil.Process(self._pid)
            memory_mb, threads = process.memory_info().rss / MEBIBYTE, process.num_threads()
        except psutil.Error:
            return
        if memory_mb > limits.memory_mb:
            raise EndedError(f"memory: it uses {memory_mb:.0f} MB; {limits.memory_mb} MB are the most", lives=True)
        if threads > limits.threads:
            raise EndedError(f"threads: it runs {threads}; {limits.threads} are the most", lives=True)


def _pid_here(handle: int, pid: int) -> int:
    """The number that a child has in our namespace; it is told its own one."""
    if handle < 0:
        return pid
    try:
        lines = Path(f"/proc/self/fdinfo/{handle}").read_text().splitlines()
    except OSError:
        return pid
    return next((int(line.partition(":")[2]) for line in lines if line.startswith("Pid:")), pid)


@functools.cache
def _launchers() -> dict[tuple[object, ...], Launcher]:
    """Those of this process."""
    atexit.register(discard)
    return {}


def warm_launcher(confines: bool, limits: Limits) -> Launcher:
    """The launcher of this thread, started where there is none yet or the one there was has ended."""
    world = (os.getpid(), tuple(sys.path), str(Path.cwd()), os.environ.get("NUMBA_CACHE_DIR", ""))
    key = (confines, limits, threading.get_ident(), world)
    launchers = _launchers()
    found = launchers.get(key)
    if found is None or not found.alive:
        for old in [old for old in launchers if old[2] == key[2] and (old == key or old[3] != world)]:
            launchers.pop(old).close()
        found = launchers[key] = Launcher(confines, limits)
    return found


def discard() -> None:
    """Ends the launchers of this process; the next walk starts a new one."""
    launchers = _launchers()
    while launchers:
        launchers.popitem()[1].close()
