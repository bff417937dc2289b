"""Seccomp: calls into the kernel that a process may not make, for itself and for good.

The list names what is denied, since NumPy, Numba and PyTorch need too many calls to list: new processes and programs,
sockets of every kind and what could be sent over one, memory and limits of other processes, mounts, keys, rights of
files, memory that no limit counts, administration of the machine, and what reads or sets a state that outlives a
process: which pages are in memory, numbers that the system counts up, its load.
"""

from __future__ import annotations

import ctypes
import errno
import os
import platform
import struct
from typing import Final

from pdrbench.isolation.boot import PR_SET_DUMPABLE, PR_SET_PDEATHSIG, prctl

PR_SET_SECCOMP, MODE_FILTER = 22, 2
ALLOW, KILL, ERRNO = 0x7FFF0000, 0x80000000, 0x00050000
LOAD, JUMP_EQUAL, JUMP_AT_LEAST, JUMP_ANY_BIT, RETURN = 0x20, 0x15, 0x35, 0x45, 0x06  # classic BPF
NUMBER_AT, ARCHITECTURE_AT, ARGUMENT_AT = 0, 4, 16  # offsets in `struct seccomp_data`
CLONE_THREAD: Final = 0x00010000
FIRST_X32: Final = 0x40000000  # the other interface of x86-64, whose numbers would slip through

ARCHITECTURES: Final = {"x86_64": 0xC000003E, "aarch64": 0xC00000B7}
# Numbers on x86-64 and on aarch64 (None: it has no such call); from 424 on they are the same everywhere.
DENIED: Final[dict[str, tuple[int | None, int | None]]] = {
    **{"socketpair": (53, 199), "sendto": (44, 206), "sendmsg": (46, 211), "sendmmsg": (307, 269)},
    **{"recvfrom": (45, 207), "recvmsg": (47, 212), "recvmmsg": (299, 243)},
    **{"pipe": (22, None), "pipe2": (293, 59), "sysinfo": (99, 179), "ioprio_set": (251, 30)},
    **{"mincore": (27, 232), "cachestat": (451, 451), "readahead": (187, 213), "fadvise64": (221, 223)},
    **{"sync": (162, 81), "syncfs": (306, 267), "inotify_init": (253, None), "inotify_init1": (294, 26)},
    **{"inotify_add_watch": (254, 27), "flock": (73, 32)},
    **{"socket": (41, 198), "connect": (42, 203), "bind": (49, 200), "listen": (50, 201), "accept": (43, 202)},
    **{"accept4": (288, 242), "fork": (57, None), "vfork": (58, None), "execve": (59, 221), "execveat": (322, 281)},
    **{"setsid": (112, 157), "setpgid": (109, 154), "ptrace": (101, 117), "process_vm_readv": (310, 270)},
    **{"process_vm_writev": (311, 271), "kcmp": (312, 272), "pidfd_send_signal": (424, 424), "pidfd_open": (434, 434)},
    **{"pidfd_getfd": (438, 438), "process_madvise": (440, 440), "process_mrelease": (448, 448), "tkill": (200, 130)},
    **{"mount": (165, 40), "umount2": (166, 39), "pivot_root": (155, 41), "chroot": (161, 51), "unshare": (272, 97)},
    **{"setns": (308, 268), "open_tree": (428, 428), "move_mount": (429, 429), "fsopen": (430, 430)},
    **{"fsconfig": (431, 431), "fsmount": (432, 432), "fspick": (433, 433), "mount_setattr": (442, 442)},
    **{"keyctl": (250, 219), "add_key": (248, 217), "request_key": (249, 218), "bpf": (321, 280)},
    **{"perf_event_open": (298, 241), "userfaultfd": (323, 282), "io_uring_setup": (425, 425)},
    **{"io_uring_enter": (426, 426), "io_uring_register": (427, 427), "kexec_load": (246, 104)},
    **{"kexec_file_load": (320, 294), "init_module": (175, 105), "finit_module": (313, 273)},
    **{"delete_module": (176, 106), "reboot": (169, 142), "swapon": (167, 224), "swapoff": (168, 225)},
    **{"settimeofday": (164, 170), "clock_settime": (227, 112), "clock_adjtime": (305, 266), "adjtimex": (159, 171)},
    **{"sethostname": (170, 161), "setdomainname": (171, 162), "acct": (163, 89), "quotactl": (179, 60)},
    **{"quotactl_fd": (443, 443), "open_by_handle_at": (304, 265), "name_to_handle_at": (303, 264)},
    **{"iopl": (172, None), "ioperm": (173, None), "modify_ldt": (154, None), "personality": (135, 92)},
    **{"syslog": (103, 116), "vhangup": (153, 58), "fanotify_init": (300, 262), "migrate_pages": (256, 238)},
    **{"move_pages": (279, 239), "memfd_create": (319, 279), "memfd_secret": (447, 447), "shmget": (29, 194)},
    **{"shmat": (30, 196), "msgget": (68, 186), "semget": (64, 190), "mq_open": (240, 180)},
    **{"chmod": (90, None), "fchmod": (91, 52), "fchmodat": (268, 53), "fchmodat2": (452, 452)},
    **{"chown": (92, None), "lchown": (94, None), "fchown": (93, 55), "fchownat": (260, 54), "utime": (132, None)},
    **{"utimes": (235, None), "futimesat": (261, None), "utimensat": (280, 88), "setxattr": (188, 5)},
    **{"lsetxattr": (189, 6), "fsetxattr": (190, 7), "removexattr": (197, 14), "lremovexattr": (198, 15)},
    **{"fremovexattr": (199, 16), "setxattrat": (463, 463), "removexattrat": (466, 466), "mknod": (133, None)},
    **{"mknodat": (259, 33)},
}
# Calls that name a process in their first argument (setpriority: in its second): only this one, 0 or its own id.
ONLY_OWN: Final[dict[str, tuple[int, int, int]]] = {
    **{"kill": (62, 129, 0), "tgkill": (234, 131, 0), "rt_sigqueueinfo": (129, 138, 0)},
    **{"rt_tgsigqueueinfo": (297, 240, 0), "prlimit64": (302, 261, 0), "sched_setaffinity": (203, 122, 0)},
    **{"sched_setscheduler": (144, 119, 0), "sched_setparam": (142, 118, 0), "sched_setattr": (314, 274, 0)},
    **{"setpriority": (141, 140, 1)},
}
PRIORITY, PRIO_PROCESS = (141, 140), 0  # not of a group, nor of all processes of a user
# Advice on pages of files that others map too: to write them out, to fetch them.
MADVISE, SHARED_ADVICE = (28, 233), (3, 20, 21, 22)  # WILLNEED, COLD, PAGEOUT, POPULATE_READ
ZERO_IS_OTHERS: Final = frozenset({"kill"})  # there 0 stands for the whole group
CLONE, CLONE3, PRCTL = (56, 220), (435, 435), (157, 167)


class _Program(ctypes.Structure):
    _fields_ = (("length", ctypes.c_ushort), ("filter", ctypes.c_char_p))


def enforce() -> None:
    """Denies this process and its threads what is listed, with EPERM; needs no_new_privs.

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


def program(machine: str, pid: int) -> list[tuple[int, int, int, int]]:
    """The filter: (code, jump if true, jump if false, operand) for each instruction."""
    column = list(ARCHITECTURES).index(machine)
    deny = ERRNO | errno.EPERM
    filters = [(LOAD, 0, 0, ARCHITECTURE_AT), (JUMP_EQUAL, 1, 0, ARCHITECTURES[machine]), (RETURN, 0, 0, KILL)]
    filters += [(LOAD, 0, 0, NUMBER_AT), (JUMP_AT_LEAST, 0, 1, FIRST_X32), (RETURN, 0, 0, deny)]
    for numbers in DENIED.values():
        number = numbers[column]
        if number is not None:
            filters += [(JUMP_EQUAL, 0, 1, number), (RETURN, 0, 0, deny)]
    filters += [(JUMP_EQUAL, 0, 1, CLONE3[column]), (RETURN, 0, 0, ERRNO | errno.ENOSYS)]  # its flags cannot be seen
    filters += _where(CLONE[column], 0, [(JUMP_ANY_BIT, 1, 0, CLONE_THREAD), (RETURN, 0, 0, deny)])
    for option in (PR_SET_PDEATHSIG, PR_SET_DUMPABLE):  # it ends with us; its memory can be counted
        filters += _where(PRCTL[column], 0, [(JUMP_EQUAL, 0, 1, option), (RETURN, 0, 0, deny)])
    filters += _where(PRIORITY[column], 0, [(JUMP_EQUAL, 1, 0, PRIO_PROCESS), (RETURN, 0, 0, deny)])
    for advice in SHARED_ADVICE:
        filters += _where(MADVISE[column], 2, [(JUMP_EQUAL, 0, 1, advice), (RETURN, 0, 0, deny)])
    for name, (*both, argument) in ONLY_OWN.items():
        own = [(JUMP_EQUAL, 1, 0, pid), (RETURN, 0, 0, deny)]
        if name not in ZERO_IS_OTHERS:
            own = [(JUMP_EQUAL, 2, 0, 0), *own]
        filters += _where(both[column], argument, own)
    return [*filters, (RETURN, 0, 0, ALLOW)]


def _where(number: int, argument: int, then: list[tuple[int, int, int, int]]) -> list[tuple[int, int, int, int]]:
    """Instructions that test the lower half of an argument of one call; the number is loaded again after them."""
    block = [(LOAD, 0, 0, ARGUMENT_AT + 8 * argument), *then, (LOAD, 0, 0, NUMBER_AT)]
    return [(JUMP_EQUAL, 0, len(block), number), *block]
