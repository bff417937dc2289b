"""Seccomp: the calls into the kernel that a process may make; every other one is refused, for itself and for good.

What NumPy, Numba and PyTorch need is allowed: files by their names, memory, threads, waiting, time, facts on the
process itself. Not allowed are new processes and programs, sockets of every kind, other processes, mounts, keys, rights
and locks of files, limits, memory that no limit counts, administration of the machine, and what reads or sets a state
that outlives a process or that another one sees: pages in memory, numbers that the system counts up, its load, its
scarce objects. Some calls are allowed in part. Calls that a kernel of tomorrow knows are not on the list.
"""

from __future__ import annotations

import ctypes
import errno
import os
import platform
import struct
import tomllib
from pathlib import Path
from typing import Final

from pdrbench_leaderboard.confine.boot import prctl

PR_SET_SECCOMP, MODE_FILTER = 22, 2
ALLOW, KILL, ERRNO = 0x7FFF0000, 0x80000000, 0x00050000
LOAD, JUMP_EQUAL, JUMP_AT_LEAST, JUMP_ANY_BIT, RETURN = 0x20, 0x15, 0x35, 0x45, 0x06  # classic BPF
NUMBER_AT, ARCHITECTURE_AT, ARGUMENT_AT = 0, 4, 16  # offsets in `struct seccomp_data`
UPPER_HALF: Final = 4  # of an argument, in bytes behind its lower half
FIRST_X32: Final = 0x40000000  # the other interface of x86-64, whose numbers would slip through
FIRST_NEW: Final = 453  # calls that a library may try, and does without where the kernel has none such

ARCHITECTURES: Final = {"x86_64": 0xC000003E, "aarch64": 0xC00000B7}
# Numbers on x86-64 and on aarch64 by name, as `seccomp.toml` has them.
ALLOWED: Final[dict[str, list[int]]] = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
# Calls that are allowed in part.
FUTEX, MMAP, MADVISE, CLONE, CLONE3 = (202, 98), (9, 222), (28, 233), (56, 220), (435, 435)
CLOCKS: Final = ((228, 113), (230, 115))  # clock_gettime, clock_nanosleep
FCNTL, IOCTL, PRCTL, PRLIMIT = (72, 25), (16, 29), (157, 167), (302, 261)
PRIORITY: Final = ((140, 141), (141, 140))  # getpriority, setpriority
# Calls that name a process in their first argument: only this one, or 0.
ONLY_OWN: Final = {
    **{"sched_setaffinity": (203, 122), "sched_setscheduler": (144, 119), "sched_setparam": (142, 118)},
    **{"sched_setattr": (314, 274)},
}
SIGNALS: Final = {"kill": (62, 129), "tgkill": (234, 131)}  # 0 stands for the whole group there

CLONE_THREAD: Final = 0x00010000
PRIO_PROCESS: Final = 0  # not of a group, nor of all processes of a user
WAITS, PRIVATE = (0, 9, 256, 265), 128  # a wake-up at an address that processes share would say who waits there
MAP_SHARED, MAP_ANONYMOUS, MAP_HUGETLB = 1, 0x20, 0x40000  # shared memory without a file has numbers of the machine
# NORMAL, RANDOM, SEQUENTIAL, DONTNEED, FREE, DONTFORK, DOFORK, HUGEPAGE, NOHUGEPAGE, DONTDUMP, DODUMP, WIPEONFORK,
# KEEPONFORK, GUARD_INSTALL, GUARD_REMOVE: nothing about pages of files, nothing that merges pages of two processes.
ADVICE: Final = (0, 1, 2, 4, 8, 10, 11, 14, 15, 16, 17, 18, 19, 102, 103)
OTHERS_CLOCK: Final = 0x80000000  # the clock of a process or a thread
# F_DUPFD, F_GETFD, F_SETFD, F_GETFL, F_SETFL, F_DUPFD_CLOEXEC, F_GETPIPE_SZ: no locks, leases, watches, sizes of pipes
DESCRIPTORS: Final = (0, 1, 2, 3, 4, 1030, 1032)
DEVICES: Final = (0x5401, 0x5413, 0x541B, 0x5421, 0x5450, 0x5451)  # TCGETS, TIOCGWINSZ, FIONREAD, FIONBIO, FIO(N)CLEX
# PR_GET_DUMPABLE, PR_SET_NAME, PR_GET_NAME, PR_CAPBSET_READ, PR_GET_NO_NEW_PRIVS, PR_SET_VMA (a name for memory)
OF_ITSELF: Final = (3, 15, 16, 23, 39, 0x53564D41)

Instructions = list[tuple[int, int, int, int]]
DENY: Final = (RETURN, 0, 0, ERRNO | errno.EPERM)


class _Program(ctypes.Structure):
    _fields_ = (("length", ctypes.c_ushort), ("filter", ctypes.c_char_p))


def enforce() -> None:
    """Denies this process and its threads what is not listed, with EPERM; needs no_new_privs.

    Raises:
        OSError: The kernel or the surroundings do not grant it; the processor is another one.
    """
    machine = platform.machine()
    if machine not in ARCHITECTURES:
        raise OSError(errno.ENOSYS, f"no list of calls for {machine}")
    instructions = program(machine, os.getpid())
    code = b"".join(struct.pack("<HBBI", *instruction) for instruction in instructions)
    filters = _Program(len(instructions), code)
    prctl(PR_SET_SECCOMP, MODE_FILTER, ctypes.byref(filters))


def conditions(pid: int) -> list[tuple[tuple[int, int], Instructions]]:
    """Numbers of each call that is allowed in part, and instructions that deny the rest of it."""
    own = [(numbers, _only(0, 0, pid)) for numbers in ONLY_OWN.values()]
    signals = [(numbers, _only(0, pid)) for numbers in SIGNALS.values()]
    clocks = [(numbers, _no_bit(0, OTHERS_CLOCK)) for numbers in CLOCKS]
    priorities = [(numbers, _only(0, PRIO_PROCESS) + _only(1, 0, pid)) for numbers in PRIORITY]
    private = [(LOAD, 0, 0, ARGUMENT_AT + 8), (JUMP_ANY_BIT, len(WAITS) + 1, 0, PRIVATE), *_only(1, *WAITS)[1:]]
    shared = [
        (LOAD, 0, 0, ARGUMENT_AT + 24),
        (JUMP_ANY_BIT, 0, 2, MAP_ANONYMOUS),
        (JUMP_ANY_BIT, 0, 1, MAP_SHARED),
        DENY,
    ]
    return [
        (FUTEX, private),
        (MMAP, shared + _no_bit(3, MAP_HUGETLB)),
        (MADVISE, _only(2, *ADVICE)),
        *clocks,
        (CLONE, [(LOAD, 0, 0, ARGUMENT_AT), (JUMP_ANY_BIT, 1, 0, CLONE_THREAD), DENY]),
        (CLONE3, [(RETURN, 0, 0, ERRNO | errno.ENOSYS)]),  # its flags cannot be seen; glibc takes clone then
        (FCNTL, _only(1, *DESCRIPTORS)),
        (IOCTL, _only(1, *DEVICES)),
        (PRCTL, _only(0, *OF_ITSELF)),
        (PRLIMIT, _only(0, 0, pid) + _only(2, 0) + _only(2, 0, half=UPPER_HALF)),  # no new limit
        *priorities,
        *signals,
        *own,
    ]


def program(machine: str, pid: int) -> Instructions:
    """The filter: (code, jump if true, jump if false, operand) for each instruction."""
    column = list(ARCHITECTURES).index(machine)
    filters = [(LOAD, 0, 0, ARCHITECTURE_AT), (JUMP_EQUAL, 1, 0, ARCHITECTURES[machine]), (RETURN, 0, 0, KILL)]
    filters += [(LOAD, 0, 0, NUMBER_AT), (JUMP_AT_LEAST, 0, 1, FIRST_X32), DENY]
    allow = (RETURN, 0, 0, ALLOW)
    for numbers, block in conditions(pid):
        filters += [(JUMP_EQUAL, 0, len(block) + 1, numbers[column]), *block, allow]
    for name in ALLOWED:
        number = ALLOWED[name][column]
        if number >= 0:
            filters += [(JUMP_EQUAL, 0, 1, number), allow]
    return [*filters, (JUMP_AT_LEAST, 0, 1, FIRST_NEW), (RETURN, 0, 0, ERRNO | errno.ENOSYS), DENY]


def _only(argument: int, *values: int, half: int = 0) -> Instructions:
    """Denies every other value of the lower half, or the upper one, of an argument."""
    count = len(values)
    tests = [(JUMP_EQUAL, count - place, 0, value) for place, value in enumerate(values)]
    return [(LOAD, 0, 0, ARGUMENT_AT + 8 * argument + half), *tests, DENY]


def _no_bit(argument: int, bits: int) -> Instructions:
    """Denies values of the lower half of an argument that have any of the bits."""
    return [(LOAD, 0, 0, ARGUMENT_AT + 8 * argument), (JUMP_ANY_BIT, 0, 1, bits), DENY]
