"""Landlock: the kernel's list of what a process may open, for itself and for good (Linux 5.13 and later)."""

from __future__ import annotations

import ctypes
import os
from typing import Any, Final

from pdrbench_leaderboard.confine.boot import LIBC, check

SYS_CREATE_RULESET, SYS_ADD_RULE, SYS_RESTRICT_SELF = 444, 445, 446  # the same on every architecture
CREATE_VERSION: Final = 1
RULE_PATH_BENEATH: Final = 1
READ_FILE, READ_DIR, WRITE_FILE, TRUNCATE = 1 << 2, 1 << 3, 1 << 1, 1 << 14
# By the first version of the interface (ABI) that knows them: rights on files, the network, and scopes of signals and
# abstract sockets. What a ruleset handles and no rule allows is denied.
FILE_RIGHTS: Final = {1: 13, 2: 14, 3: 15, 5: 16}  # how many bits, from 0
FILE_ONLY: Final = READ_FILE | WRITE_FILE | TRUNCATE | 1 | 1 << 15  # EXECUTE, IOCTL_DEV: what a rule on a file can name
NETWORK_SINCE, NETWORK_RIGHTS = 4, 0b11  # bind and connect TCP
SCOPED_SINCE, SCOPES = 6, 0b11  # abstract unix sockets, signals


class _RulesetAttributes(ctypes.Structure):
    _fields_ = tuple((name, ctypes.c_uint64) for name in ("files", "network", "scoped"))


class _PathBeneath(ctypes.Structure):
    _pack_ = 1
    _layout_ = "ms"
    _fields_ = (("allowed", ctypes.c_uint64), ("parent", ctypes.c_int32))


def version() -> int:
    """The version of the interface; raises `OSError` where the kernel has none or has it switched off."""
    return _call(SYS_CREATE_RULESET, None, 0, CREATE_VERSION)


def protections(abi: int) -> list[str]:
    """Names of the protections that a ruleset of this version of the interface gives."""
    return [
        "landlock-files",
        *(["landlock-net"] if abi >= NETWORK_SINCE else []),
        *(["landlock-scope"] if abi >= SCOPED_SINCE else []),
    ]


class Ruleset:
    """What a process may open: everything that no rule names is denied.

    Raises:
        OSError: The kernel has no Landlock.
    """

    def __init__(self) -> None:
        self.abi = version()
        bits = max(count for since, count in FILE_RIGHTS.items() if since <= self.abi)
        self._all = (1 << bits) - 1
        attributes = _RulesetAttributes(
            self._all, NETWORK_RIGHTS if self.abi >= NETWORK_SINCE else 0, SCOPES if self.abi >= SCOPED_SINCE else 0
        )
        size = 8 if self.abi < NETWORK_SINCE else 16 if self.abi < SCOPED_SINCE else 24
        self.descriptor = _call(SYS_CREATE_RULESET, ctypes.byref(attributes), size, 0)

    def list_folder(self, path: str) -> None:
        """Allows the names in a folder to be listed, and those below it."""
        self._allow(path, READ_DIR)

    def read(self, path: str) -> None:
        """Allows a file, or everything below a folder, to be read."""
        self._allow(path, READ_FILE | READ_DIR)

    def write(self, path: str) -> None:
        """Allows everything below a folder but running programs; a device or file may be read and written."""
        self._allow(path, self._all & ~1)

    def enforce(self) -> None:
        """Binds this process, its threads to come and its children; needs no_new_privs."""
        _call(SYS_RESTRICT_SELF, self.descriptor, 0)

    def close(self) -> None:
        """Gives the descriptor back."""
        os.close(self.descriptor)

    def _allow(self, path: str, rights: int) -> None:
        """Adds a rule; what does not exist needs none."""
        try:
            parent = os.open(path, os.O_PATH | os.O_CLOEXEC)
        except OSError:
            return
        try:
            if not os.path.isdir(path):  # noqa: PTH112  hundreds of them
                rights &= FILE_ONLY & self._all
            rule = _PathBeneath(rights, parent)
            _call(SYS_ADD_RULE, self.descriptor, RULE_PATH_BENEATH, ctypes.byref(rule), 0)
        finally:
            os.close(parent)


def _call(number: int, *arguments: Any) -> int:
    return check(LIBC.syscall(ctypes.c_long(number), *arguments))
