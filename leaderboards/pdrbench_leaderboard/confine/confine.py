"""What a process gives up before it runs untrusted code: protections are tried one by one, and the outcome noted."""

from __future__ import annotations

import ctypes
import importlib
import os
import signal
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

from pdrbench.process.child_process import MEBIBYTE
from pdrbench_leaderboard.confine import seccomp
from pdrbench_leaderboard.confine.boot import (
    CAN_CONFINE,
    LIBC,
    PR_SET_DUMPABLE,
    PR_SET_PDEATHSIG,
    ProtectionRecord,
    check,
    prctl,
)
from pdrbench_leaderboard.confine.landlock import Ruleset, protections

resource: Any = importlib.import_module("resource") if CAN_CONFINE else None
PR_SET_NO_NEW_PRIVS: Final = 38
CAPABILITY_VERSION: Final = 0x20080522  # _LINUX_CAPABILITY_VERSION_3
FIRST_DESCRIPTOR: Final = 3
MAX_ADDRESSES: Final = 64 << 30  # bytes: tables of pages, which no limit counts, then take 128 MB at most


@dataclass(frozen=True, slots=True)
class FileLimits:
    """Upper limits for the files of a process. Ours: several times what the registered localizers use."""

    file_mb: int = 128  # size of a file
    scratch_mb: int = 256  # size of all files of the scratch folder together
    scratch_files: int = 10_000  # number of those files
    open_files: int = 256  # number of descriptors


def detach(record: ProtectionRecord, limits: FileLimits, memory_mb: int, cpu_s: float) -> None:
    """What a child gives up first: its process group, and resources beyond the limits."""
    record.attempt(["process-group"], lambda: os.setpgid(0, 0))
    if sys.platform == "linux":
        record.attempt(["dies-with-launcher"], lambda: prctl(PR_SET_PDEATHSIG, signal.SIGKILL))
    data = memory_mb * MEBIBYTE
    for name, which, limit in (
        ("limit-memory", "RLIMIT_DATA", data),
        ("limit-addresses", "RLIMIT_AS", MAX_ADDRESSES),
        ("limit-cpu", "RLIMIT_CPU", int(cpu_s) + 1),
        ("limit-file-size", "RLIMIT_FSIZE", limits.file_mb * MEBIBYTE),
        ("limit-open-files", "RLIMIT_NOFILE", limits.open_files),
        ("limit-core", "RLIMIT_CORE", 1),  # 0 would still hand the memory to a program that collects crashes
    ):
        record.attempt([name], lambda which=which, limit=limit: _lower(which, limit))  # type: ignore[misc]


def confine(record: ProtectionRecord, ruleset: Ruleset | None) -> None:
    """What a confined child gives up in addition: rights, files, system calls. The order matters.

    Args:
        record: Where the outcome is noted.
        ruleset: What it may open; None where the kernel has no Landlock, as the record says.
    """
    record.attempt(["no-new-privileges"], lambda: prctl(PR_SET_NO_NEW_PRIVS, 1))
    if ruleset is not None:
        record.attempt(protections(ruleset.abi), ruleset.enforce)
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


def mode(record: ProtectionRecord) -> str:
    """The protections in force: "landlock+namespaces+seccomp" or a part of it; "process" where there are none."""
    found = {
        "landlock": any(name.startswith("landlock") for name in record.held),
        "namespaces": any(name.startswith("namespace") for name in record.held),
        "seccomp": "seccomp" in record.held,
    }
    return "+".join(name for name, held in found.items() if held) or "process"


def _lower(name: str, limit: int) -> None:
    which = getattr(resource, name)
    hard = resource.getrlimit(which)[1]
    wanted = limit if hard == resource.RLIM_INFINITY else min(limit, hard)
    resource.setrlimit(which, (wanted, wanted))


def prefer_for_oom() -> None:
    """Where the system's memory runs out, the kernel ends this process and its children first; raises `OSError`."""
    prctl(PR_SET_DUMPABLE, 1)  # the file belongs to root otherwise
    with open("/proc/self/oom_score_adj", "w") as file:  # noqa: PTH123  a file of the kernel
        file.write("1000")


def _drop_capabilities() -> None:
    """Gives up the rights of root: files are then opened as that user without privileges."""
    header = (ctypes.c_uint32 * 2)(CAPABILITY_VERSION, 0)
    no_capabilities = (ctypes.c_uint32 * 6)()
    check(LIBC.capset(header, no_capabilities))
