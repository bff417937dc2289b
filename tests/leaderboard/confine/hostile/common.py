"""What hostile localizers share: a harmless one, and one that attempts forbidden operations and reports on them."""

from __future__ import annotations

import contextlib
import ctypes
import errno
import os
from collections.abc import Callable, MutableMapping
from pathlib import Path
from typing import Any

import numpy as np

from hostile.targets import TARGETS
from pdrbench.localizer import Briefing, Estimate, Observation

BAD_STEP = 3  # the observation at which a localizer shows what it is
MEBIBYTE = 1 << 20
# Protections each of which keeps an attempt from succeeding, as results name them.
FILES, CALLS, ALONE = {"landlock-files"}, {"seccomp"}, {"walk-alone"}
HIDDEN, READ_ONLY, NETWORK = {"data-hidden"}, {"files-read-only"}, {"namespace-net"}
OTHERS = {"namespace-pid", "seccomp", "landlock-scope"}
ALWAYS: set[str] = set()  # it fails on every system
NUMBERS = {  # of calls that Python has no function for
    "x86_64": {
        **{"bpf": 321, "keyctl": 250, "perf_event_open": 298, "io_uring_setup": 425, "ioprio_set": 251, "mincore": 27},
        **{"cachestat": 451, "inotify_init1": 294, "readahead": 187, "fadvise64": 221, "sysinfo": 99, "madvise": 28},
        **{"syslog": 103, "vmsplice": 278, "splice": 275, "pidfd_open": 434, "execveat": 322, "open_by_handle_at": 304},
    }
}


class Honest:
    """Adds up strides along x."""

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        self.x_m, self.count, self.rng, self.briefing = 0.0, 0, rng, briefing

    def step(self, observation: Observation) -> Estimate:
        self.x_m += float(observation["stride"][:, 1].sum())
        self.count += 1
        if self.count == BAD_STEP + 1:
            found = self.misbehave()
            if found is not None:
                return found  # type: ignore[return-value]
        return Estimate(np.array([self.x_m, 0.0]), 0)

    def misbehave(self) -> object:
        return None


Attempt = tuple[Callable[[], object], set[str]]  # true where it succeeds; protections each of which prevents that


class Probe(Honest):
    """Attempts forbidden operations; bit k of the x_m of its estimates is set where attempt k succeeded."""

    found = 0

    def attempts(self) -> dict[str, Attempt]:
        return {}

    def step(self, observation: Observation) -> Estimate:
        super().step(observation)
        return Estimate(np.array([float(self.found), 0.0]), 0)

    def misbehave(self) -> object:
        for bit, (attempt, _) in enumerate(self.attempts().values()):
            with contextlib.suppress(Exception, SystemExit):
                if attempt():
                    self.found |= 1 << bit
        return Estimate(np.array([float(self.found), 0.0]), 0)


def define(module: MutableMapping[str, Any], base: type, method: str, table: dict[str, Callable[..., object]]) -> None:
    """One class for each attack of a table, which overrides one method."""
    for name, attack in table.items():
        module[name] = type(name, (base,), {method: attack, "__module__": module["__name__"]})


def fail(error: Exception) -> object:
    raise error


def can_open(path: str | Path, flags: int = os.O_RDONLY) -> bool:
    os.close(os.open(path, flags))
    return True


def processes() -> list[int]:
    """Processes worth an attack: the parent, the test, and every other visible one."""
    seen = []
    with contextlib.suppress(OSError):
        seen = [int(entry.name) for entry in Path("/proc").iterdir() if entry.name.isdigit()]
    wanted = {os.getppid(), int(TARGETS["pid"]), *seen[:64], *seen[-64:]}
    return sorted(wanted - {0, os.getpid()})


def libc() -> ctypes.CDLL:
    return ctypes.CDLL(None, use_errno=True)


def call(name: str, *arguments: object) -> int:
    """What a system call returns; raises `OSError` where it fails, and where its number is not known here."""
    numbers = NUMBERS.get(os.uname().machine, {})
    if name not in numbers:
        raise OSError(errno.ENOSYS, name)
    ctypes.set_errno(0)
    found = int(libc().syscall(ctypes.c_long(numbers[name]), *arguments))
    if found < 0:
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
    return found


def is_let_in(name: str, *arguments: object) -> bool:
    """True where a system call was not refused, whatever its outcome."""
    try:
        call(name, *arguments)
    except OSError as error:
        return error.errno not in (errno.EPERM, errno.EACCES, errno.ENOSYS)
    return True
