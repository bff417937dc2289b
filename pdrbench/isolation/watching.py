"""A child seen from outside: its pipes, its deadline, what it uses, how it ended."""

from __future__ import annotations

import contextlib
import os
import select
import signal
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Protocol

from pdrbench.errors import PdrbenchError
from pdrbench.isolation.confine import Limits
from pdrbench.isolation.messages import LENGTH_BYTES, TRACE_SIGNAL, ProtocolError, frame_size
from pdrbench.isolation.neighbours import LONG_STEP_S, Neighbours
from pdrbench.isolation.usage import Usage

GONE: Final = "the process that starts localizers has ended; run the walk again"
DEAF: Final = "it closed the pipe of requests"
LOOK_S: Final = 0.1  # between looks at what a child uses
LOOK_MS: Final = round(1000 * LOOK_S)
LAST_WORDS_S: Final = 0.2  # for a traceback of a child whose time is up
GRACE_S: Final = 1.0  # for a child that has closed its end to be gone
QUIET_S: Final = 0.1  # without another write: it has said what it had to say
READ_BYTES: Final = 1 << 15
MOST_OUTPUT_BYTES: Final = 16_384


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


class Keeper(Protocol):
    """Who started a child, and ends it."""

    limits: Limits

    def reap(self, grace_s: float) -> Ended:
        """Ends the child, or waits so long for it to end."""


class Child:
    """One process of a localizer, seen from outside: its pipes, its deadline, what it uses.

    Attributes:
        heard_s: When it was last heard of, on the monotonic clock.
    """

    def __init__(self, keeper: Keeper, pid: int, handle: int, pipes: tuple[int, int, int]) -> None:
        self._keeper, self._handle = keeper, handle
        self._requests, self._replies, self._output = pipes
        for descriptor in pipes:
            os.set_blocking(descriptor, False)
        self._pid = _pid_here(handle, pid)
        self._neighbours, self._usage = Neighbours(self._pid), Usage(self._pid)
        self._buffer = bytearray()
        self._said = bytearray()
        self.heard_s = self._looked_s = time.monotonic()
        self._num_answers, self._waited_s = 0, 0.0  # for them, since the last look
        self._poll = select.poll()
        self._poll.register(self._replies, select.POLLIN)
        self._poll.register(self._output, select.POLLIN)
        self._ended: Ended | None = None
        self._is_closed = False

    @property
    def output(self) -> str:
        """The end of what it wrote to standard output and error."""
        return self._said.decode(errors="replace")

    def ask(self, request: bytearray, ends_s: float, most_bytes: int) -> bytes:
        """Sends one frame and waits for one; returns its body.

        Args:
            request: The frame.
            ends_s: Until when, on the monotonic clock.
            most_bytes: Of the reply.

        Raises:
            LateError: No whole reply came in time.
            EndedError: The process ended, or uses more than it may.
            ProtocolError: What came is no single frame of that size.
        """
        if self._is_closed:
            raise EndedError("it has ended")
        if self._buffer:
            raise ProtocolError("an answer came that nobody asked for")
        try:
            sent = os.write(self._requests, request)
        except BlockingIOError:
            sent = 0
        except BrokenPipeError:
            raise EndedError(DEAF) from None
        if sent < len(request):
            self._write(request[sent:], ends_s)
        return self.receive(ends_s, most_bytes)

    def receive(self, ends_s: float, most_bytes: int) -> bytes:
        """Waits for one frame; raises as `ask` does."""
        # What a short step meets stands here in one piece: between two steps all caches are lost to the localizer, and
        # every function that is called costs a microsecond or two.
        while True:
            began_s = time.monotonic()
            left_s = ends_s - began_s
            if left_s <= 0:
                raise LateError
            body = None
            for descriptor, _ in self._poll.poll(LOOK_MS if left_s > LOOK_S else 1000 * left_s + 1):
                if descriptor == self._output:
                    self._listen()
                    continue
                try:
                    part = os.read(self._replies, READ_BYTES)
                except BlockingIOError:  # a child can read its own pipe
                    continue
                if not part:
                    raise EndedError("it closed the pipe of replies")
                size = int.from_bytes(part[:LENGTH_BYTES], "little")
                if len(part) == LENGTH_BYTES + size and size <= most_bytes and not self._buffer:
                    body = part[LENGTH_BYTES:]
                else:
                    body = self._take(part, most_bytes)
            self.heard_s = now_s = time.monotonic()
            self._num_answers += body is not None
            self._waited_s += now_s - began_s
            if now_s - self._looked_s > LOOK_S:
                self._look(is_computing=body is None)
            if body is not None:
                if now_s > ends_s:
                    raise LateError
                return body

    def stay_near(self) -> None:
        """From now on many short questions come: both share a processor where that helps."""
        self._neighbours.join(time.monotonic())

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
        has_begun = False  # a traceback comes in many small writes
        while time.monotonic() < ends_s:
            if any(descriptor == self._output for descriptor, _ in self._poll.poll(QUIET_S * 1000)):
                self._listen()
                has_begun = True
            elif has_begun:
                return

    def end(self, grace_s: float = 0.0) -> Ended:
        """Ends it, and everything it started; may be called again."""
        if self._ended is None:
            if self._is_closed:
                raise IsolationError(GONE)
            try:
                self._ended = self._keeper.reap(grace_s)
            finally:
                self._neighbours.part()
                self._usage.close()
                self._listen()
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
            ready, _, _ = select.select([self._output], [self._requests], [], LOOK_S)
            if ready:
                self._listen()
            with contextlib.suppress(BlockingIOError):
                try:
                    del left[: os.write(self._requests, left)]
                except BrokenPipeError:
                    raise EndedError(DEAF) from None

    def _take(self, part: bytes, most_bytes: int) -> bytes | None:
        """Adds to a reply that comes in pieces; its body once it is whole."""
        self._buffer += part
        size = frame_size(self._buffer, most_bytes)
        if size is None or len(self._buffer) < size:
            return None
        if len(self._buffer) > size:
            raise ProtocolError("more than one answer came to one request")
        body = bytes(self._buffer[LENGTH_BYTES:])
        self._buffer.clear()
        return body

    def _listen(self) -> None:
        """Takes what it wrote and keeps the end."""
        with contextlib.suppress(BlockingIOError, ValueError, OSError):
            part = os.read(self._output, READ_BYTES)
            if not part and self._ended is None:
                with contextlib.suppress(KeyError):
                    self._poll.unregister(self._output)
            self._said += part
            del self._said[:-MOST_OUTPUT_BYTES]

    def _look(self, *, is_computing: bool) -> None:
        """Now and then: ends the wait where more memory or threads are used than there may be.

        Args:
            is_computing: True while an answer is awaited.
        """
        takes_long = self._waited_s > LONG_STEP_S * self._num_answers
        self._looked_s, self._num_answers, self._waited_s = self.heard_s, 0, 0.0
        if is_computing or takes_long:
            self._neighbours.part()  # it computes for long: wherever there is room
        else:
            self._neighbours.look(self.heard_s)
        limits, usage = self._keeper.limits, self._usage.look()
        if usage is None:
            return
        memory_mb, threads = usage
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
