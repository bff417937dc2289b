"""A localizer's process where nothing can be confined, as on macOS and Windows: a fresh interpreter for each walk."""

from __future__ import annotations

import contextlib
import functools
import json
import math
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import psutil  # type: ignore[import-untyped]

from pdrbench.arithmetic import THREADS
from pdrbench.isolation import numba_cache
from pdrbench.isolation.boot import CAN_CONFINE, LENGTH_BYTES
from pdrbench.isolation.child_process import (
    CHECK_S,
    MAX_OUTPUT_BYTES,
    REQUESTS_CLOSED,
    TRACEBACK_S,
    Ended,
    EndedError,
    IsolationError,
    LateError,
    check_usage,
)
from pdrbench.isolation.confine import Limits
from pdrbench.isolation.messages import TRACE_SIGNAL, Confined, frame_size
from pdrbench.isolation.read_permissions import ReadPermissions
from pdrbench.isolation.read_permissions import numba_cache as cache_place
from pdrbench.isolation.shared_modules import import_only, shared_modules
from pdrbench.isolation.usage import Usage

# One line for people, and what provenance says is missing; empty where localizers are confined.
NOT_CONFINED: Final = (
    ""
    if CAN_CONFINE
    else f"{platform.system()} does not confine localizers as Linux does: each runs in a process of its own, which may "
    f"read, write and connect as you may"
)
# Variables without which no interpreter starts on Windows; no other of the user reaches the process.
KEPT: Final = ("PATH", "SYSTEMROOT", "SYSTEMDRIVE", "WINDIR", "COMSPEC", "PATHEXT", "PROCESSOR_ARCHITECTURE")
SCRATCH: Final = ("HOME", "USERPROFILE", "APPDATA", "LOCALAPPDATA", "TMPDIR", "TEMP", "TMP")  # that name a folder
BEGIN: Final = (
    "import json, sys; sys.path[:], *rest = json.loads(sys.argv[1]); "
    "import pdrbench.isolation.spawned as it; it.main(*rest)"
)


def main(cache: str, own_cache: bool, modules: Sequence[str]) -> None:
    """What the process runs."""
    from pdrbench.isolation import child_main

    numba_cache.read_only(cache)
    if own_cache:
        numba_cache.enable_writing()
    if modules:
        import_only(modules)
    replies = os.dup(1)
    os.dup2(2, 1)  # what a localizer prints
    child_main.serve(0, replies, Confined(0, [], {"confinement": NOT_CONFINED}))


@functools.cache
def announce() -> None:
    """Says once what is missing, where something is."""
    if NOT_CONFINED:
        print(f"note: {NOT_CONFINED}", file=sys.stderr, flush=True)  # noqa: T201


class SpawnedProcess:
    """One process of a localizer, with the methods of `ChildProcess`; a thread ends it where it exceeds a limit.

    Args:
        limits: Of its memory and threads; the others are not kept.
        permissions: Whether it may write compiled code, and whose packages it imports.

    Raises:
        IsolationError: It cannot be started.
    """

    has_exceeded_memory = False

    def __init__(self, limits: Limits, permissions: ReadPermissions) -> None:
        self._limits = limits
        self._folder = tempfile.mkdtemp(prefix="pdrbench-scratch-")
        self._output = tempfile.TemporaryFile()  # noqa: SIM115  closed with the process
        kept = {name: os.environ[name] for name in KEPT if name in os.environ}
        path = [str(Path(place or os.curdir).absolute()) for place in sys.path]
        modules = sorted(shared_modules()) if permissions.packages else []
        orders = json.dumps([path, cache_place(), permissions.is_builtin, modules])
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-s", "-P", "-B", "-c", BEGIN, orders],
                env={**kept, **THREADS, **dict.fromkeys(SCRATCH, self._folder), "PYTHONHASHSEED": "0"},
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._output,
                cwd=self._folder,
                start_new_session=True,  # an interrupt is not for it
                creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),  # the same on Windows
            )
        except OSError as error:
            raise IsolationError(f"no process for localizers can be started: {error.strerror}") from error
        assert self._process.stdin is not None and self._process.stdout is not None
        self._requests, self._replies = self._process.stdin, self._process.stdout
        self._usage = Usage(self._process.pid)
        self._usage.may_fork = True
        self._ends_s, self.last_read_s = math.inf, time.monotonic()
        self._why: LateError | EndedError | None = None  # why it was ended
        self._ended: Ended | None = None
        threading.Thread(target=self._watch, daemon=True).start()

    @property
    def output(self) -> str:
        """As `ChildProcess.output`."""
        if not self._output.closed:
            self._output.seek(max(0, self._output.seek(0, os.SEEK_END) - MAX_OUTPUT_BYTES))
            self._read = self._output.read().decode(errors="replace")
        return self._read

    @property
    def last_seen(self) -> tuple[float, float]:
        """As `ChildProcess.last_seen`."""
        return round(self._usage.peak_mb, 1), round(self._usage.cpu_s, 3)

    def ask(self, request: bytearray, ends_s: float, max_bytes: int) -> bytes:
        """As `ChildProcess.ask`."""
        self._ends_s = ends_s
        try:
            self._requests.write(request)
            self._requests.flush()
        except (OSError, ValueError):
            raise self._why or EndedError(REQUESTS_CLOSED) from None
        return self.receive(ends_s, max_bytes)

    def receive(self, ends_s: float, max_bytes: int) -> bytes:
        """As `ChildProcess.receive`; where no answer comes, `_watch` ends the process and so the pipe."""
        self._ends_s = ends_s
        size = frame_size(self._replies.read(LENGTH_BYTES), max_bytes)
        body = b"" if size is None else self._replies.read(size - LENGTH_BYTES)
        self._ends_s, self.last_read_s = math.inf, time.monotonic()
        if size is None or len(body) < size - LENGTH_BYTES:
            raise self._why or EndedError("it closed the pipe of replies")
        if self.last_read_s > ends_s:
            raise LateError
        return body

    def look_at(self, held: Sequence[str]) -> None:
        """As `ChildProcess.look_at`."""
        self._usage.read()

    def share_processor(self) -> None:
        """The system places both processes."""

    def check_silence(self) -> None:
        """An answer without a request is found with the next one."""

    def request_traceback(self) -> None:
        """It has been written before the process was ended, where the system has a signal for that."""

    def end(self, grace_s: float = 0.0) -> Ended:
        """As `ChildProcess.end`; what it used is what was last seen."""
        if self._ended is None:
            self._usage.read()
            self._requests.close()
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(grace_s)
            killed = self._why is not None or self._process.poll() is None
            self._kill()
            self._ended = Ended(self._process.wait(), killed, *self.last_seen)
            self._usage.close()
            self._replies.close()
            self.output  # noqa: B018  the end of it is kept
            self._output.close()
            shutil.rmtree(self._folder, ignore_errors=True)
        return self._ended

    def _kill(self) -> None:
        """Ends the process and what it has started."""
        with contextlib.suppress(psutil.Error):
            for started in psutil.Process(self._process.pid).children(recursive=True):
                started.kill()
        self._process.kill()

    def _watch(self) -> None:
        while self._process.poll() is None:
            try:
                check_usage(self._usage, self._limits)
                if time.monotonic() > self._ends_s:
                    raise LateError
            except (LateError, EndedError) as error:
                self._why = error
                if TRACE_SIGNAL is not None:
                    self._process.send_signal(TRACE_SIGNAL)
                    time.sleep(TRACEBACK_S)
                self._kill()
            time.sleep(CHECK_S)
