"""Other processes, the memory of this one, and ways out of limits and namespaces."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import os
import resource
import struct
import sys
from pathlib import Path

import numpy as np

from hostile.common import ALWAYS, CALLS, FILES, OTHERS, Attempt, Probe, can_open, is_let_in, libc, processes
from hostile.targets import TARGETS

PTRACE_SEIZE, PTRACE_DETACH = 0x4206, 17
CLONE_NEWUSER, CLONE_NEWNS = 0x10000000, 0x00020000
KEYCTL_GET_KEYRING_ID = 0
PRIO_PGRP, PRIO_USER, IOPRIO_WHO_USER = 1, 2, 3


class ReadsMemory(Probe):
    def attempts(self) -> dict[str, Attempt]:
        return {
            "mem-file": (lambda: any(self.memory_file(pid) for pid in processes()), FILES | {"namespace-pid"}),
            "process_vm_readv": (lambda: any(self.process_vm_readv(pid) for pid in processes()), OTHERS),
            "ptrace": (lambda: any(self.ptrace(pid) for pid in processes()), OTHERS),
            "dev-mem": (lambda: can_open("/dev/mem") or can_open("/proc/kcore"), FILES),
        }

    def memory_file(self, pid: int) -> bool:
        with contextlib.suppress(OSError):
            return can_open(f"/proc/{pid}/mem")
        return False

    def process_vm_readv(self, pid: int) -> bool:
        """One byte of the other's program: its address is ours, as both run the same interpreter, or else a fault."""
        buffer = ctypes.create_string_buffer(8)
        here = struct.pack("PN", ctypes.addressof(buffer), 8)
        address = ctypes.cast(libc().getpid, ctypes.c_void_p).value
        there = struct.pack("PN", address, 8)
        ctypes.set_errno(0)
        got = libc().process_vm_readv(pid, here, 1, there, 1, 0)
        return bool(got >= 0 or ctypes.get_errno() == 14)  # EFAULT: allowed, with nothing at that address

    def ptrace(self, pid: int) -> bool:
        if libc().ptrace(PTRACE_SEIZE, pid, 0, 0) != 0:
            return False
        libc().ptrace(PTRACE_DETACH, pid, 0, 0)
        return True


class WalksMemory(Probe):
    """Every object that the interpreter and its frames refer to."""

    def attempts(self) -> dict[str, Attempt]:
        return {"types": (self.by_type, ALWAYS), "frames": (self.by_frames, ALWAYS), "rows": (self.rows_ahead, ALWAYS)}

    def by_type(self) -> bool:
        names = {"Recording", "Episode", "Task", "Job", "JobContext", "Item", "Setting", "Result"}
        return any(type(thing).__name__ in names and "pdrbench" in type(thing).__module__ for thing in gc.get_objects())

    def by_frames(self) -> bool:
        words = {"recording", "episode", "task", "reference", "truth", "secret", "setting", "item"}
        frames = list(sys._current_frames().values())
        while frames:
            frame = frames.pop()
            if words & set(frame.f_locals):
                return True
            if frame.f_back is not None:
                frames.append(frame.f_back)
        return False

    def rows_ahead(self) -> bool:
        """An array with the times of every stride of the walk: 1, 2, ..., 12 s."""
        arrays = [thing for thing in gc.get_objects() if isinstance(thing, np.ndarray) and thing.ndim == 2]
        return any(len(rows) >= 12 and rows[-1, 0] == 12.0 for rows in arrays)


class ReadsSecrets(Probe):
    def attempts(self) -> dict[str, Attempt]:
        return {
            "own-variables": (
                lambda: TARGETS["secret"] in str(dict(os.environ)) or "PDRBENCH_DATA" in os.environ,
                ALWAYS,
            ),
            "environ": (lambda: self.stands_in("environ"), FILES | {"namespace-pid"}),
            "cmdline": (lambda: self.stands_in("cmdline"), FILES | {"namespace-pid"}),
            "own-environ": (lambda: TARGETS["secret"].encode() in Path("/proc/self/environ").read_bytes(), ALWAYS),
        }

    def stands_in(self, file: str) -> bool:
        for pid in processes():
            with contextlib.suppress(OSError):
                if TARGETS["secret"].encode() in Path(f"/proc/{pid}/{file}").read_bytes():
                    return True
        return False


class SignalsOthers(Probe):
    def attempts(self) -> dict[str, Attempt]:
        nice = os.getpriority(os.PRIO_PROCESS, 0)
        return {
            "kill": (lambda: any(self.reaches(pid) for pid in processes()), OTHERS),
            "nice-user": (lambda: libc().setpriority(PRIO_USER, os.getuid(), nice) == 0, CALLS),
            "nice-group": (lambda: libc().setpriority(PRIO_PGRP, 0, nice) == 0, CALLS),
            "nice-parent": (lambda: libc().setpriority(os.PRIO_PROCESS, os.getppid(), nice) == 0, CALLS),
            "io-priority": (lambda: is_let_in("ioprio_set", IOPRIO_WHO_USER, os.getuid(), 0), CALLS),
        }

    def reaches(self, pid: int) -> bool:
        with contextlib.suppress(OSError):
            os.kill(pid, 0)  # nothing is sent
            return True
        return False


class Escapes(Probe):
    """Ways out of limits and namespaces."""

    def attempts(self) -> dict[str, Attempt]:
        unlimited = (resource.RLIM_INFINITY, resource.RLIM_INFINITY)
        return {
            "file-size": (lambda: resource.setrlimit(resource.RLIMIT_FSIZE, unlimited) is None, {"limit-file-size"}),
            "memory": (lambda: resource.setrlimit(resource.RLIMIT_DATA, unlimited) is None, {"limit-memory"}),
            "unshare": (lambda: libc().unshare(CLONE_NEWUSER | CLONE_NEWNS) == 0, CALLS),
            "mount": (lambda: libc().mount(b"none", b"/tmp", b"tmpfs", 0, None) == 0, CALLS | {"no-capabilities"}),
            "chroot": (lambda: libc().chroot(b".") == 0, CALLS | {"no-capabilities"}),
            "setns": (
                lambda: libc().setns(os.open("/proc/1/ns/mnt", os.O_RDONLY), 0) == 0,
                CALLS | {"no-capabilities"},
            ),
            "bpf": (lambda: is_let_in("bpf", 0, ctypes.create_string_buffer(64), 64), CALLS),
            "keyctl": (lambda: is_let_in("keyctl", KEYCTL_GET_KEYRING_ID, -3, 1), CALLS),
            "io_uring": (lambda: is_let_in("io_uring_setup", 4, ctypes.create_string_buffer(256)), CALLS),
            "perf": (lambda: is_let_in("perf_event_open", ctypes.create_string_buffer(128), 0, -1, -1, 0), CALLS),
        }
