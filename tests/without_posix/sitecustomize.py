"""With the folder of this file on PYTHONPATH, the code of pdrbench finds what Python has on Windows and no more.

Modules and functions that only POSIX has are gone for its six packages, here and in every interpreter that this one
starts. `msvcrt` is there, with locks on bytes that behave as those of Windows do: they belong to one opening of a file.
Other libraries choose by the name of the system and keep what they need.
"""

from __future__ import annotations

import builtins
import faulthandler
import fcntl
import os
import signal
import struct
import subprocess
import types
from pathlib import Path

MODULES = ("fcntl", "resource", "pwd", "grp", "termios", "tty", "pty", "syslog", "readline", "posix")
GONE = {
    os: (
        *("fork", "forkpty", "setsid", "getsid", "setpgid", "getpgid", "setpgrp", "getpgrp", "killpg", "wait", "wait3"),
        *(
            "wait4",
            "waitid",
            "pidfd_open",
            "nice",
            "uname",
            "sysconf",
            "statvfs",
            "chown",
            "lchown",
            "fchown",
            "fchmod",
        ),
        *("getuid", "geteuid", "getgid", "getegid", "getresuid", "setuid", "setgid", "getgroups", "getloadavg"),
        *("pread", "pwrite", "memfd_create", "mkfifo", "openpty", "ttyname", "set_blocking", "WNOHANG", "P_PID"),
        *("sched_getaffinity", "sched_setaffinity", "O_DIRECTORY", "O_NOFOLLOW", "O_CLOEXEC", "O_NONBLOCK"),
    ),
    signal: (
        *("SIGALRM", "SIGVTALRM", "SIGKILL", "SIGHUP", "SIGUSR1", "SIGUSR2", "setitimer", "getitimer", "alarm"),
        *("ITIMER_REAL", "pidfd_send_signal", "pthread_sigmask"),
    ),
    faulthandler: ("register",),
}
OWN_LOCK = 37  # F_OFD_SETLK of Linux: of an opening, not of a process


class _Reduced(types.ModuleType):
    """A module that lacks some names; others are looked up each time, since tests replace them."""

    def __init__(self, whole: types.ModuleType, gone: tuple[str, ...]) -> None:
        super().__init__(whole.__name__)
        self.__dict__.update(_whole=whole, _gone=gone)

    def __getattr__(self, name: str) -> object:
        if name in self._gone:
            raise AttributeError(f"module {self.__name__!r} has no attribute {name!r} on Windows")
        return getattr(self._whole, name)


def _locking(descriptor: int, mode: int, count: int) -> None:
    kind = fcntl.F_WRLCK if mode == msvcrt.LK_NBLCK else fcntl.F_UNLCK
    place = os.lseek(descriptor, 0, os.SEEK_CUR)
    fcntl.fcntl(descriptor, OWN_LOCK, struct.pack("hhqqi4x", kind, os.SEEK_SET, place, count, 0))


def _import(name, globals=None, locals=None, fromlist=(), level=0):  # type: ignore[no-untyped-def]
    if level or not str((globals or {}).get("__name__", "")).startswith("pdrbench"):
        return _real_import(name, globals, locals, fromlist, level)
    if name in MODULES:
        raise ImportError(f"no module named {name!r} on Windows")
    return _reduced.get(name) or _real_import(name, globals, locals, fromlist, level)


msvcrt = types.ModuleType("msvcrt")
msvcrt.__dict__.update(LK_NBLCK=2, LK_UNLCK=0, locking=_locking)
_reduced: dict[str, types.ModuleType] = {"msvcrt": msvcrt}
_reduced |= {whole.__name__: _Reduced(whole, gone) for whole, gone in GONE.items()}


def _pass_on(self, *args, env=None, **options):  # type: ignore[no-untyped-def]
    if env is not None:
        env = {**env, "PYTHONPATH": os.pathsep.join([HERE, env.get("PYTHONPATH", "")]).rstrip(os.pathsep)}
    _real_popen(self, *args, env=env, **options)


HERE = str(Path(__file__).parent.absolute())
_real_popen, subprocess.Popen.__init__ = subprocess.Popen.__init__, _pass_on  # type: ignore[method-assign]
_real_import, builtins.__import__ = builtins.__import__, _import
