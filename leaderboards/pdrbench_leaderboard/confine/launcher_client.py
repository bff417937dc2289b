"""The evaluating side of a launcher: starts it, makes it fork children, ends them."""

from __future__ import annotations

import atexit
import contextlib
import functools
import hashlib
import math
import os
import socket
import subprocess
import sys
import tempfile
import threading
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

from pdrbench.arithmetic import THREADS
from pdrbench.errors import PdrbenchError
from pdrbench.process.child_process import GRACE_S, MEBIBYTE, Ended, LaunchError, Limits
from pdrbench_leaderboard.confine.boot import receive, send
from pdrbench_leaderboard.confine.confine import FileLimits
from pdrbench_leaderboard.confine.confined_process import LAUNCHER_ENDED, ConfinedProcess
from pdrbench_leaderboard.confine.read_permissions import ReadPermissions, hidden_places, numba_cache
from pdrbench_leaderboard.confine.shared_modules import shared_modules
from pdrbench_leaderboard.confine.toolbox import LIBRARIES
from pdrbench_leaderboard.confine.walk_process import NUM_PIPES

START_S: Final = 120.0  # for an interpreter and the toolbox, on a busy machine with cold files
# One numeric thread in each process: walks are the unit of parallelism, and sums stay the same on every machine.
BOOT: Final = Path(__file__).with_name("boot.py")


class DeniedError(PdrbenchError):
    """The system denies what confinement needs."""

    def __init__(self, what: str) -> None:
        super().__init__(f"confinement was asked for, and the system denies {what}")


class Launcher:
    """One launcher process; its children come one after the other.

    Those of a folder of packages import from there, and of what is
    installed here no more than pdrbench and what that needs.
    """

    def __init__(self, limits: Limits, files: FileLimits, packages: str = "") -> None:
        self.limits, self.files = limits, files
        self._owner = os.getpid()
        self._scratch = tempfile.mkdtemp(prefix="pdrbench-scratch-")
        self._compiled = tempfile.mkdtemp(prefix="pdrbench-compiled-")  # by localizer: see `rehearsed`
        self.rehearsed: set[str] = set()  # targets, with when they were changed, that have played a walk before
        self._has_ended = False
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
        self._start(
            {
                "path": [str(Path(place or os.curdir).absolute()) for place in sys.path],
                "scratch": self._scratch,
                "compiled": self._compiled,
                "scratch_bytes": files.scratch_mb * MEBIBYTE,
                "scratch_files": files.scratch_files,
                "hidden": sorted(hidden_places()),
                "numba_cache": numba_cache(),
                "environment": {**THREADS, "PATH": os.defpath},
                "modules": sorted(shared_modules()) if packages else [],
            }
        )

    @property
    def alive(self) -> bool:
        """False once it has ended, or no longer answers."""
        return not self._has_ended and self._process.poll() is None

    def compiled_folder(self, name: str) -> str:
        """Where the compiled functions of a localizer lie that has been rehearsed under this name."""
        return f"{self._compiled}/{hashlib.sha256(name.encode()).hexdigest()[:16]}"

    def fork(
        self, permissions: ReadPermissions, cpu_s: float, compiled: str = "", *, is_rehearsal: bool = False
    ) -> ConfinedProcess:
        """A new child, whose processor time is limited.

        Args:
            permissions: What it may open.
            cpu_s: Its processor time.
            compiled: Folder of its compiled functions; empty where there is none.
            is_rehearsal: Whether it may write there; else it may read.

        Raises:
            LaunchError: The launcher has ended.
            DeniedError: The system does not grant it.
        """
        order = {
            "readable": [*permissions.readable, *([compiled] if compiled else [])],
            "listed": permissions.listed,
            "writable": [compiled] if is_rehearsal else [],
            "compiled": compiled,
            "is_rehearsal": is_rehearsal,
            "files": asdict(self.files),
            "memory_mb": self.limits.memory_mb,
            "cpu_s": cpu_s if math.isfinite(cpu_s) else 1e9,
            "libraries": [name for name in LIBRARIES if name in permissions.imports],
            "calls_compiled": permissions.calls_compiled,
        }
        answer, descriptors = self._ask({"fork": order})
        if "denied" in answer:
            raise DeniedError(f"namespaces for a walk ({answer['denied']})")
        handle, *pipes = descriptors
        return ConfinedProcess(self.limits, self.reap, answer["pid"], handle, pipes)

    def reap(self, grace_s: float) -> Ended:
        """Ends the child after waiting up to `grace_s` for it to end by itself."""
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
        for folder in (self._scratch, self._compiled):  # empty: what was written there lay in namespaces that are gone
            with contextlib.suppress(OSError):  # the launcher has removed it where it ended by itself
                os.rmdir(folder)  # noqa: PTH106

    def _ask(self, order: dict[str, Any]) -> tuple[dict[str, Any], list[int]]:
        try:
            send(self._control, order)
            return receive(self._control, 1 + NUM_PIPES)
        except (OSError, EOFError) as error:
            self._has_ended = True  # its first process may take a moment to follow
            raise LaunchError(LAUNCHER_ENDED) from error

    def _start(self, orders: dict[str, Any]) -> None:
        self._control.settimeout(START_S)
        try:
            answer, _ = self._ask(orders)
            self.held: list[str] = answer["held"]  # protections by its namespaces
            self.missing: dict[str, str] = answer["missing"]
        except LaunchError as error:
            raise LaunchError(f"no process for localizers can be started: {self._last_error_line()}") from error

    def _last_error_line(self) -> str:
        self._process.kill()
        self._process.wait()
        self._errors.seek(0)
        lines = self._errors.read().decode(errors="replace").strip().splitlines()
        return lines[-1] if lines else f"it ended with code {self._process.returncode} and wrote nothing"


@functools.cache
def _launchers() -> dict[tuple[object, ...], Launcher]:
    """The launchers of this process."""
    atexit.register(discard)
    return {}


def warm_launcher(limits: Limits, files: FileLimits, packages: str = "") -> Launcher:
    """The launcher of this thread; a new one where there is none yet or the last one has ended.

    Args:
        limits: Of the memory and threads of its children.
        files: Of their files.
        packages: Folder of the packages that they import; empty where these are the installed ones.
    """
    world = (os.getpid(), tuple(sys.path), str(Path.cwd()), os.environ.get("NUMBA_CACHE_DIR", ""))
    key = (limits, files, threading.get_ident(), world, packages)
    launchers = _launchers()
    found = launchers.get(key)
    if found is None or not found.alive:
        for old in [old for old in launchers if old[2] == key[2] and (old == key or old[3] != world)]:
            launchers.pop(old).close()
        found = launchers[key] = Launcher(limits, files, packages)
    return found


def discard() -> None:
    """Ends the launchers of this process; the next walk starts a new one."""
    launchers = _launchers()
    while launchers:
        launchers.popitem()[1].close()
