"""The process of a localizer, seen from the evaluating side: pipes, deadlines, resource use, exit status."""

from __future__ import annotations

import contextlib
import os
import select
import signal
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from pdrbench.errors import PdrbenchError
from pdrbench.isolation import scratch
from pdrbench.isolation.boot import LENGTH_BYTES
from pdrbench.isolation.confine import Limits
from pdrbench.isolation.memory_group import MEMORY_GROUP, MemoryGroup
from pdrbench.isolation.messages import TRACE_SIGNAL, ProtocolError, frame_size
from pdrbench.isolation.shared_processor import LONG_STEP_S, SharedProcessor
from pdrbench.isolation.usage import MEBIBYTE, Usage

LAUNCHER_ENDED: Final = "the process that starts localizers has ended; run the walk again"
BEGUN: Final = "the walk had begun and is not played again"  # of whatever has been shown anything of it
REQUESTS_CLOSED: Final = "it closed the pipe of requests"
UNREQUESTED: Final = "an answer came without a request"
CHECK_S: Final = 0.1  # between checks of what a child uses
CHECK_MS: Final = round(1000 * CHECK_S)
TRACEBACK_S: Final = 0.2  # for a traceback of a child whose time is up
MEASURE_S: Final = 1.0  # between looks at the files of a scratch folder that no protection limits
GRACE_S: Final = 1.0  # for a child that has closed its end to exit
QUIET_S: Final = 0.1  # without another write: the traceback is complete
READ_BYTES: Final = 1 << 15
MAX_OUTPUT_BYTES: Final = 16_384
MAX_PIPE_BYTES: Final = 1 << 20  # Linux: what a process without privileges may enlarge a pipe to


class IsolationError(PdrbenchError):
    """A child cannot be started, or the launcher is gone."""


class LateError(PdrbenchError):
    """A child did not answer in time."""


class EndedError(PdrbenchError):
    """A child has closed its end, or exceeds a limit and is to be ended."""

    def __init__(self, reason: str, *, is_running: bool = False) -> None:
        super().__init__(reason)
        self.is_running = is_running


@dataclass(frozen=True, slots=True)
class Ended:
    """How a child ended."""

    code: int  # exit code, or minus the signal
    killed: bool  # true where it had to be ended
    peak_mb: float  # most resident memory, interpreter and toolbox included
    cpu_s: float  # processor time


class ChildProcess:
    """One process of a localizer.

    Args:
        limits: Of its memory, threads and files.
        reap: Ends it, after waiting up to so many seconds for it to end by itself.
        pid: Its number in the namespace of the launcher.
        handle: Descriptor that names it everywhere; -1 where there is none.
        pipes: Our ends of those for requests, replies and output.
        folder: Its scratch folder.
        group: In which the kernel counts its memory; None where there is none.

    Attributes:
        last_read_s: When something was last read from it, on the monotonic clock.
    """

    def __init__(
        self,
        limits: Limits,
        reap: Callable[[float], Ended],
        pid: int,
        handle: int,
        pipes: tuple[int, int, int],
        folder: str,
        group: MemoryGroup | None = None,
    ) -> None:
        self._folder, self._group = folder, group
        self._has_exceeded = self._measures_scratch = False
        self._measured_s = 0.0
        self._limits, self._reap, self._handle = limits, reap, handle
        self._requests, self._replies, self._output = pipes
        for descriptor in pipes:
            os.set_blocking(descriptor, False)
        self._pid = _own_pid(handle, pid)
        self._processor, self._usage = SharedProcessor(self._pid), Usage(self._pid)
        self._buffer = bytearray()
        self._output_bytes = bytearray()
        self.last_read_s = self._checked_s = time.monotonic()
        self._num_answers, self._waited_s = 0, 0.0  # for them, since the last check
        self._poll = select.poll()
        self._poll.register(self._replies, select.POLLIN)
        self._poll.register(self._output, select.POLLIN)
        self._ended: Ended | None = None
        self._is_closed = False

    @property
    def output(self) -> str:
        """The end of what the process wrote to standard output and error."""
        return self._output_bytes.decode(errors="replace")

    def ask(self, request: bytearray, ends_s: float, max_bytes: int) -> bytes:
        """Sends one frame and waits for one; returns its body.

        Args:
            request: The frame.
            ends_s: Until when, on the monotonic clock.
            max_bytes: Of the reply.

        Raises:
            LateError: No whole reply came in time.
            EndedError: The process ended, or exceeds a limit.
            ProtocolError: The reply is not a single frame of at most that size.
        """
        if self._is_closed:
            raise EndedError("it has ended")
        if self._buffer:
            raise ProtocolError(UNREQUESTED)
        try:
            sent = os.write(self._requests, request)
        except BlockingIOError:
            sent = 0
        except BrokenPipeError:
            raise EndedError(REQUESTS_CLOSED) from None
        if sent < len(request):
            self._write(request[sent:], ends_s)
        return self.receive(ends_s, max_bytes)

    def receive(self, ends_s: float, max_bytes: int) -> bytes:
        """Waits for one frame; raises as `ask` does."""
        # The path of a short step is one function on purpose: between two steps the localizer evicts all caches, so
        # that each further function call costs a microsecond or two.
        while True:
            began_s = time.monotonic()
            left_s = ends_s - began_s
            if left_s <= 0:
                raise LateError
            body = None
            for descriptor, _ in self._poll.poll(CHECK_MS if left_s > CHECK_S else 1000 * left_s + 1):
                if descriptor == self._output:
                    self._read_output()
                    continue
                try:
                    part = os.read(self._replies, READ_BYTES)
                except BlockingIOError:  # a child can read its own pipe
                    continue
                if not part:
                    raise EndedError("it closed the pipe of replies")
                size = int.from_bytes(part[:LENGTH_BYTES], "little")
                if len(part) == LENGTH_BYTES + size and size <= max_bytes and not self._buffer:
                    body = part[LENGTH_BYTES:]
                else:
                    body = self._take(part, max_bytes)
            self.last_read_s = now_s = time.monotonic()
            self._num_answers += body is not None
            self._waited_s += now_s - began_s
            if now_s - self._checked_s > CHECK_S:
                self._check(is_computing=body is None)
            if body is not None:
                if now_s > ends_s:
                    raise LateError
                return body

    @property
    def has_exceeded_memory(self) -> bool:
        """True where the kernel has ended it for that."""
        return self._has_exceeded or (self._group is not None and self._group.has_exceeded)

    def look_at(self, held: Sequence[str]) -> None:
        """Looks at what no protection limits: its memory, processes that it may start, files of its scratch folder."""
        self._usage.is_counted = MEMORY_GROUP in held
        self._usage.may_fork = "seccomp" not in held
        self._measures_scratch = "scratch-limited" not in held
        self._usage.read()

    @property
    def last_seen(self) -> tuple[float, float]:
        """Peak memory in MB and processor time in seconds that were last seen from outside; lower bounds."""
        return round(self._usage.peak_mb, 1), round(self._usage.cpu_s, 3)

    def share_processor(self) -> None:
        """Has both processes share a processor where that helps, since many short requests follow."""
        self._processor.share(time.monotonic())

    def check_silence(self) -> None:
        """Raises `ProtocolError` where an answer came without a request."""
        if self._is_closed:
            return
        with contextlib.suppress(BlockingIOError):
            if self._buffer or os.read(self._replies, 1):
                raise ProtocolError(UNREQUESTED)

    def request_traceback(self) -> None:
        """Makes a child whose time is up write a traceback, also where compiled code holds the interpreter."""
        with contextlib.suppress(OSError):
            if self._handle >= 0:
                signal.pidfd_send_signal(self._handle, TRACE_SIGNAL)
            else:
                os.kill(self._pid, TRACE_SIGNAL)
        ends_s = time.monotonic() + TRACEBACK_S
        has_begun = False  # a traceback comes in many small writes
        while time.monotonic() < ends_s:
            if any(descriptor == self._output for descriptor, _ in self._poll.poll(QUIET_S * 1000)):
                self._read_output()
                has_begun = True
            elif has_begun:
                return

    def end(self, grace_s: float = 0.0) -> Ended:
        """Ends the process and everything that it started; may be called again."""
        if self._ended is None:
            if self._is_closed:
                raise IsolationError(LAUNCHER_ENDED)
            try:
                self._ended = self._reap(grace_s)
            finally:
                self._processor.separate()
                self._usage.close()
                if self._group is not None:
                    self._has_exceeded = self._group.has_exceeded
                    self._group.close()
                for _ in range(MAX_PIPE_BYTES // READ_BYTES):
                    if not self._read_output():
                        break
                self._is_closed = True
                for descriptor in (self._requests, self._replies, self._output, self._handle):
                    if descriptor >= 0:
                        os.close(descriptor)
        return self._ended

    def _write(self, left: bytearray, ends_s: float) -> None:
        """Sends the rest of a request that is too large for the pipe."""
        while left:
            if time.monotonic() > ends_s:
                raise LateError
            ready, _, _ = select.select([self._output], [self._requests], [], CHECK_S)
            if ready:
                self._read_output()
            with contextlib.suppress(BlockingIOError):
                try:
                    del left[: os.write(self._requests, left)]
                except BrokenPipeError:
                    raise EndedError(REQUESTS_CLOSED) from None

    def _take(self, part: bytes, max_bytes: int) -> bytes | None:
        """Adds to a reply that comes in parts; returns its body once it is complete."""
        self._buffer += part
        size = frame_size(self._buffer, max_bytes)
        if size is None or len(self._buffer) < size:
            return None
        if len(self._buffer) > size:
            raise ProtocolError("more than one answer came to one request")
        body = bytes(self._buffer[LENGTH_BYTES:])
        self._buffer.clear()
        return body

    def _read_output(self) -> bool:
        """Reads what the process has written to standard output and error, keeps the end; False where nothing came."""
        with contextlib.suppress(BlockingIOError, ValueError, OSError):
            part = os.read(self._output, READ_BYTES)
            if not part and self._ended is None:
                with contextlib.suppress(KeyError):
                    self._poll.unregister(self._output)
            self._output_bytes += part
            del self._output_bytes[:-MAX_OUTPUT_BYTES]
            return bool(part)
        return False

    def _check(self, *, is_computing: bool) -> None:
        """Raises `EndedError` where memory or threads exceed their limits; called every `CHECK_S`.

        Args:
            is_computing: True while an answer is awaited.
        """
        takes_long = self._waited_s > LONG_STEP_S * self._num_answers
        self._checked_s, self._num_answers, self._waited_s = self.last_read_s, 0, 0.0
        if is_computing or takes_long:
            self._processor.separate()  # it computes for long: on any processor
        else:
            self._processor.check(self.last_read_s)
        limits = self._limits
        is_running = check_usage(self._usage, limits)
        if is_running and self._measures_scratch and self.last_read_s - self._measured_s > MEASURE_S:
            self._measured_s = self.last_read_s
            size, files = scratch.measure(self._folder, self._pid, limits.scratch_files)
            if size > limits.scratch_mb * MEBIBYTE or files > limits.scratch_files:
                what = f"{files} files of {size / MEBIBYTE:.0f} MB"
                allowed = f"{limits.scratch_files} files of {limits.scratch_mb} MB"
                raise EndedError(f"scratch: it has {what}; the limit is {allowed} together", is_running=True)


def check_usage(usage: Usage, limits: Limits) -> bool:
    """Raises `EndedError` where a process exceeds its limits of memory or threads; False where it has ended."""
    used = usage.read(limits.memory_mb)
    if used is None:
        return False
    memory_mb, threads = used
    if memory_mb > limits.memory_mb:
        raise EndedError(f"memory: it uses {memory_mb:.0f} MB; the limit is {limits.memory_mb} MB", is_running=True)
    if threads > limits.threads:
        raise EndedError(f"threads: it runs {threads}; the limit is {limits.threads}", is_running=True)
    return True


def _own_pid(handle: int, pid: int) -> int:
    """The number that a child has in the namespace of this process; the launcher knows another one."""
    if handle < 0:
        return pid
    try:
        lines = Path(f"/proc/self/fdinfo/{handle}").read_text().splitlines()
    except OSError:
        return pid
    return next((int(line.partition(":")[2]) for line in lines if line.startswith("Pid:")), pid)
