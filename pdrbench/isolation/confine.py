"""What a process gives up before it runs a stranger's code: tried one by one, and noted what held and what did not."""

from __future__ import annotations

import ctypes
import os
import resource
import signal
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

from pdrbench.isolation import seccomp
from pdrbench.isolation.landlock import Ruleset, parts

PR_SET_PDEATHSIG, PR_SET_DUMPABLE, PR_SET_NO_NEW_PRIVS = 1, 4, 38
CAPABILITY_VERSION: Final = 0x20080522  # _LINUX_CAPABILITY_VERSION_3
FIRST_DESCRIPTOR: Final = 3
MEBIBYTE: Final = 1 << 20


@dataclass(frozen=True, slots=True)
class Limits:
    """Most that the process of a localizer may use. All ours: several times what the registered ones use.

    Attributes:
        memory_mb: Memory, counted by what is resident (looked at while an answer is awaited) and as private data.
        file_mb: Largest file.
        scratch_mb: All files of the scratch folder together.
        scratch_files: How many of them.
        open_files: Descriptors.
        threads: Looked at while an answer is awaited.
    """

    memory_mb: int = 4096
    file_mb: int = 128
    scratch_mb: int = 256
    scratch_files: int = 10_000
    open_files: int = 256
    threads: int = 128


class Record:
    """What held and what did not, by name."""

    def __init__(self) -> None:
        self.held: list[str] = []
        self.missing: dict[str, str] = {}

    def attempt(self, names: Sequence[str], act: Callable[[], object]) -> None:
        """Does one thing and notes what came of it."""
        try:
            act()
        except (OSError, ValueError, AttributeError) as error:
            reason = (error.strerror or str(error)) if isinstance(error, OSError) else "not on this system"
            self.missing.update(dict.fromkeys(names, reason))
        else:
            self.held += names


def detach(record: Record, limits: Limits, cpu_s: float) -> None:
    """What every child gives up, confined or not: its group, its descriptors' number, memory without end."""
    record.attempt(["process-group"], lambda: os.setpgid(0, 0))
    if sys.platform == "linux":
        record.attempt(["dies-with-launcher"], lambda: _prctl(PR_SET_PDEATHSIG, signal.SIGKILL))
    data = limits.memory_mb * MEBIBYTE
    for name, which, most in (
        ("limit-memory", resource.RLIMIT_DATA, data),
        ("limit-cpu", resource.RLIMIT_CPU, int(cpu_s) + 1),
        ("limit-file-size", resource.RLIMIT_FSIZE, limits.file_mb * MEBIBYTE),
        ("limit-open-files", resource.RLIMIT_NOFILE, limits.open_files),
        ("limit-core", resource.RLIMIT_CORE, 0),
    ):
        record.attempt([name], lambda which=which, most=most: _lower(which, most))  # type: ignore[misc]
    if sys.platform == "linux":
        record.attempt(["first-to-go"], _go_first)


def confine(record: Record, ruleset: Ruleset | None, why_none: str) -> None:
    """What a confined child gives up in addition: rights, files, calls; each forbids what was needed before.

    Args:
        record: Where it is noted.
        ruleset: What it may open; None where the kernel has no Landlock.
        why_none: Why there is no ruleset.
    """
    record.attempt(["no-new-privileges"], lambda: _prctl(PR_SET_NO_NEW_PRIVS, 1))
    if ruleset is None:
        record.missing["landlock-files"] = why_none
    else:
        record.attempt(parts(ruleset.abi), ruleset.enforce)
    record.attempt(["no-capabilities"], _drop_capabilities)
    record.attempt(["seccomp"], seccomp.enforce)


def close_others(keep: Sequence[int]) -> None:
    """Closes every descriptor but the standard ones and `keep`."""
    ends = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
    first = FIRST_DESCRIPTOR
    for descriptor in sorted(keep):
        os.closerange(first, descriptor)
        first = descriptor + 1
    os.closerange(first, min(ends, 65_536))


def mode(record: Record) -> str:
    """In a word what protects: "landlock+namespaces+seccomp", or what of it held; "process" where nothing did."""
    found = {
        "landlock": any(name.startswith("landlock") for name in record.held),
        "namespaces": any(name.startswith("namespace") for name in record.held),
        "seccomp": "seccomp" in record.held,
    }
    return "+".join(name for name, held in found.items() if held) or "process"


def _lower(which: int, most: int) -> None:
    hard = resource.getrlimit(which)[1]
    wanted = most if hard == resource.RLIM_INFINITY else min(most, hard)
    resource.setrlimit(which, (wanted, wanted))


def _go_first() -> None:
    """Where the system's memory runs out, this process is the one to end."""
    _prctl(PR_SET_DUMPABLE, 1)  # the file belongs to root otherwise
    with open("/proc/self/oom_score_adj", "w") as file:  # noqa: PTH123  a file of the kernel
        file.write("1000")


def _prctl(option: int, value: int) -> None:
    libc: Any = ctypes.CDLL(None, use_errno=True)
    if libc.prctl(option, value, 0, 0, 0):
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))


def _drop_capabilities() -> None:
    """Root without its rights: what it may open is what anybody of that user may."""
    libc: Any = ctypes.CDLL(None, use_errno=True)
    header = (ctypes.c_uint32 * 2)(CAPABILITY_VERSION, 0)
    nothing = (ctypes.c_uint32 * 6)()
    if libc.capset(header, nothing):
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
