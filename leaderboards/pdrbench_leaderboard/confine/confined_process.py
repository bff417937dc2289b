"""The confined process of one walk, seen from the evaluating side: pipes, deadlines, resource use, exit status."""

from __future__ import annotations

import contextlib
import os
import select
import signal
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Final

from pdrbench.process.child_process import (
    CHECK_S,
    MAX_OUTPUT_BYTES,
    REPLIES_CLOSED,
    REQUESTS_CLOSED,
    UNREQUESTED,
    Ended,
    EndedError,
    LateError,
    LaunchError,
    Limits,
    Usage,
)
from pdrbench.process.messages import TRACE_SIGNAL, ProtocolError, frame_size
from pdrbench_leaderboard.confine.boot import LENGTH_BYTES, ProtectionRecord
from pdrbench_leaderboard.confine.confine import mode

LAUNCHER_ENDED: Final = "the process that starts localizers has ended; run the walk again"
CHECK_MS: Final = round(1000 * CHECK_S)
TRACEBACK_S: Final = 0.2  # for a traceback of a child whose time is up
QUIET_S: Final = 0.1  # without another write: the traceback is complete
READ_BYTES: Final = 1 << 15
MAX_PIPE_BYTES: Final = 1 << 20  # Linux: what a process without privileges may enlarge a pipe to


class ConfinedProcess:
    """One process; see `pdrbench.process.launch.Process`.

    Args:
        limits: Of its memory and threads.
        reap: Ends it, after waiting up to so many seconds for it to end by itself.
        pid: Its number in the namespace of the launcher.
        handle: Descriptor that names it everywhere.
        pipes: Our ends of those for requests, replies and output.

    Attributes:
        last_read_s: When something was last read from it, on the monotonic clock.
    """

    def __init__(
        self, limits: Limits, reap: Callable[[float], Ended], pid: int, handle: int, pipes: Sequence[int]
    ) -> None:
        self._limits, self._reap, self._handle = limits, reap, handle
        self._record = ProtectionRecord()
        self._requests, self._replies, self._output = pipes
        for descriptor in pipes:
            os.set_blocking(descriptor, False)
        self._usage = Usage(_own_pid(handle, pid))
        self._buffer = bytearray()
        self._output_bytes = bytearray()
        self.last_read_s = self._checked_s = time.monotonic()
        self._poll = select.poll()
        self._poll.register(self._replies, select.POLLIN)
        self._poll.register(self._output, select.POLLIN)
        self._ended: Ended | None = None
        self._is_closed = False

    @property
    def facts(self) -> Mapping[str, object]:
        """As `launch.Process` has it."""
        return {"mode": mode(self._record), "held": self._record.held, "missing": self._record.missing}

    @property
    def output(self) -> str:
        """The end of what the process wrote to standard output and error."""
        return self._output_bytes.decode(errors="replace")

    def ask(self, request: bytearray, ends_s: float, max_bytes: int) -> bytes:
        """As `launch.Process` has it."""
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
                    raise EndedError(REPLIES_CLOSED)
                size = int.from_bytes(part[:LENGTH_BYTES], "little")
                if len(part) == LENGTH_BYTES + size and size <= max_bytes and not self._buffer:
                    body = part[LENGTH_BYTES:]
                else:
                    body = self._take(part, max_bytes)
            self.last_read_s = now_s = time.monotonic()
            if now_s - self._checked_s > CHECK_S:
                self._check()
            if body is not None:
                if now_s > ends_s:
                    raise LateError
                return body

    def look_at(self, record: ProtectionRecord) -> None:
        """Notes its protections, and looks at its memory."""
        self._record = record
        self._usage.read()

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
            signal.pidfd_send_signal(self._handle, TRACE_SIGNAL)
        ends_s = time.monotonic() + TRACEBACK_S
        has_begun = False  # a traceback comes in many small writes
        while time.monotonic() < ends_s:
            if any(descriptor == self._output for descriptor, _ in self._poll.poll(QUIET_S * 1000)):
                self._read_output()
                has_begun = True
            elif has_begun:
                return

    def release(self) -> Ended:
        """As `launch.Process` has it: it serves no other walk."""
        return self.end()

    def end(self, grace_s: float = 0.0) -> Ended:
        """As `launch.Process` has it."""
        if self._ended is None:
            try:
                self._ended = self._reap(grace_s)
            except LaunchError as error:  # the launcher, which measures it, has ended
                self._ended = Ended(0, True, *self._usage.used, is_measured=False, lost=str(error))
            finally:
                for _ in range(MAX_PIPE_BYTES // READ_BYTES):
                    if not self._read_output():
                        break
                self._is_closed = True
                for descriptor in (self._requests, self._replies, self._output, self._handle):
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

    def _check(self) -> None:
        """Raises `EndedError` where memory or threads exceed their limits; called every `CHECK_S`."""
        self._checked_s = self.last_read_s
        self._usage.read()
        self._usage.check(self._limits)


def _own_pid(handle: int, pid: int) -> int:
    """The number that a child has in the namespace of this process; the launcher knows another one."""
    try:
        lines = Path(f"/proc/self/fdinfo/{handle}").read_text().splitlines()
    except OSError:
        return pid
    return next((int(line.partition(":")[2]) for line in lines if line.startswith("Pid:")), pid)
