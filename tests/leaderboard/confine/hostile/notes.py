"""Notes for a later walk or another localizer: files, numbers that the system counts up, what a process inherits."""

from __future__ import annotations

import builtins
import contextlib
import ctypes
import functools
import gc
import os
import resource
import signal
import stat
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from hostile.common import ALONE, ALWAYS, CALLS, FILES, Attempt, Probe, can_open, is_let_in, libc

PLACES = (".", "~", "/tmp", "/var/tmp", "/dev/shm")
MADV_PAGEOUT, FADV_DONTNEED, RWF_NOWAIT, MADV_MERGEABLE, MADV_COLLAPSE = 21, 4, 8, 12, 25
PR_SET_NAME, PR_GET_NAME = 15, 16
MANY = 64  # numbers that a first process, or a first file, is not given


class Remembers(Probe):
    """Leaves a note wherever it can, for a later walk or another localizer."""

    def attempts(self) -> dict[str, Attempt]:
        notes = {place: Path(place).expanduser() / f"note-{index}" for index, place in enumerate(PLACES)}
        protections = {place: FILES if place.startswith("/") else ALWAYS for place in PLACES}
        return {place: (functools.partial(self.note, note), protections[place]) for place, note in notes.items()}

    def note(self, path: Path) -> bool:
        found = path.exists()
        with contextlib.suppress(OSError):
            path.write_text("it was at (3, 4)")
        return found


class RemembersToo(Remembers):
    """Looks for the notes of the other."""


class Counts(Probe):
    """Reads and sets what the machine keeps when a process ends: what one walk counts up, the next can read."""

    def attempts(self) -> dict[str, Attempt]:
        words = ctypes.create_string_buffer(4096)
        library = ctypes.c_void_p(ctypes.cast(libc().malloc, ctypes.c_void_p).value & ~4095)  # type: ignore[operator]
        return {
            "process-number": (lambda: os.getpid() > MANY, ALONE),
            "thread-number": (lambda: threading.get_native_id() > MANY, ALONE),
            "file-number": (lambda: self.number_of_a_file() > MANY, ALONE),
            "pipe-number": (lambda: os.fstat(os.pipe()[0]).st_ino, CALLS),
            "own-pipe-number": (lambda: any(map(self.is_numbered, range(8))), ALONE),
            "proc-number": (lambda: any(map(self.is_numbered, self.pushed())), ALONE),
            "last-process": (lambda: can_open("/proc/sys/kernel/ns_last_pid"), FILES),
            "load": (lambda: can_open("/proc/loadavg"), FILES),
            "load-by-call": (lambda: is_let_in("sysinfo", words), CALLS),
            "forks": (lambda: can_open("/proc/stat"), FILES),
            "memory": (lambda: can_open("/proc/meminfo"), FILES),
            "pages": (lambda: can_open("/proc/vmstat"), FILES),
            "open-files": (lambda: can_open("/proc/sys/fs/file-nr"), FILES),
            "entries": (lambda: can_open("/proc/sys/fs/dentry-state"), FILES),
            "randomness": (lambda: can_open("/proc/sys/kernel/random/entropy_avail"), FILES),
            "control-group": (lambda: any(map(can_open, Path("/sys/fs/cgroup").glob("*stat*"))), FILES),
            "node": (lambda: can_open("/sys/devices/system/node/node0/vmstat"), FILES),
            "idle": (lambda: any(map(can_open, Path("/sys/devices/system/cpu/cpu0").rglob("usage"))), FILES),
            "pages-of-a-file": (lambda: is_let_in("mincore", library, 4096, words), CALLS),
            "cache-of-a-file": (lambda: self.with_library("cachestat", words, words, 0), CALLS),
            "fetches": (lambda: self.with_library("readahead", 0, 4096), CALLS),
            "evicts": (lambda: self.with_library("fadvise64", 0, 0, FADV_DONTNEED), CALLS),
            "evicts-mapped": (lambda: is_let_in("madvise", library, 4096, MADV_PAGEOUT), CALLS),
            "watches": (lambda: is_let_in("inotify_init1", 0), CALLS),
        }

    def pushed(self) -> list[str]:
        """Places below /proc, whose look-up makes the kernel count up."""
        own = ["/proc/self/task", "/proc/self/fd", "/proc/self/status", f"/proc/{os.getpid()}"]
        for number in range(100):
            with contextlib.suppress(OSError):
                Path(f"/proc/self/fdinfo/{number}").stat()
        return own

    def is_numbered(self, place: int | str) -> bool:
        with contextlib.suppress(OSError):
            found = os.stat(place)  # noqa: PTH116  of descriptors too
            return not stat.S_ISCHR(found.st_mode) and found.st_ino > MANY
        return False

    def number_of_a_file(self) -> int:
        Path("file").touch()
        return Path("file").stat().st_ino

    def with_library(self, call: str, *arguments: object) -> bool:
        with Path(np.__file__).open("rb") as file:
            return is_let_in(call, file.fileno(), *arguments)


class PagesInMemory(Probe):
    """Whether a page of an installed file was in memory before, said by the kernel and not by a clock."""

    def attempts(self) -> dict[str, Attempt]:
        return {
            "read-without-waiting": (self.reads_without_waiting, CALLS),
            "page-faults": (lambda: resource.getrusage(resource.RUSAGE_SELF).ru_minflt, CALLS),
            "page-faults-in-file": (lambda: can_open("/proc/self/stat"), FILES),
            "read-from-disk": (lambda: can_open("/proc/self/io"), FILES),
            "mapped-around": (lambda: can_open("/proc/self/smaps"), FILES),
            "resident-files": (lambda: can_open("/proc/self/status"), FILES),
            "table-of-pages": (lambda: can_open("/proc/self/pagemap"), FILES),
            "delays": (lambda: can_open("/proc/self/schedstat"), FILES),
            "merges": (lambda: is_let_in("madvise", self.page(), 4096, MADV_MERGEABLE), CALLS),
            "collapses": (lambda: is_let_in("madvise", self.page(), 4096, MADV_COLLAPSE), CALLS),
        }

    def reads_without_waiting(self) -> bool:
        with Path(np.__file__).open("rb") as file:
            return os.preadv(file.fileno(), [bytearray(8)], 0, RWF_NOWAIT) >= 0

    def page(self) -> ctypes.c_void_p:
        return ctypes.c_void_p(ctypes.cast(libc().malloc, ctypes.c_void_p).value & ~4095)  # type: ignore[operator]


class Inherits(Probe):
    """Changes everything that a process has of itself, and looks for what an earlier walk has changed."""

    def attempts(self) -> dict[str, Attempt]:
        checks = (
            *(self.umask, self.priority, self.scheduling, self.name, self.folder, self.variable, self.module),
            *(self.builtin, self.handler, self.alarm, self.blocked, self.random, self.errors, self.garbage),
            *(self.switch, self.descriptor, self.path, self.threads),
        )
        return {check.__name__: (check, ALWAYS) for check in checks}

    def swap(self, read: Callable[[], object], write: Callable[[], object], note: object) -> bool:
        found = read() == note
        with contextlib.suppress(OSError):
            write()
        return found

    def umask(self) -> bool:
        return os.umask(0o123) == 0o123

    def priority(self) -> bool:
        level = os.getpriority(os.PRIO_PROCESS, 0)
        return self.swap(lambda: level, lambda: os.setpriority(os.PRIO_PROCESS, 0, 3), 3)

    def scheduling(self) -> bool:
        usual = os.sched_param(0)  # an idle one would not get its time on a busy machine
        return self.swap(
            lambda: os.sched_getscheduler(0), lambda: os.sched_setscheduler(0, os.SCHED_BATCH, usual), os.SCHED_BATCH
        )

    def name(self) -> bool:
        text = ctypes.create_string_buffer(16)
        libc().prctl(PR_GET_NAME, text)
        return self.swap(lambda: text.value, lambda: libc().prctl(PR_SET_NAME, b"note"), b"note")

    def folder(self) -> bool:
        def write() -> None:
            Path("note").mkdir(exist_ok=True)
            os.chdir("note")

        return self.swap(lambda: Path.cwd().name, write, "note")

    def variable(self) -> bool:
        return self.swap(lambda: os.environ.get("NOTE"), lambda: os.environ.update(NOTE="1"), "1")

    def module(self) -> bool:
        return self.swap(lambda: hasattr(np, "note"), lambda: setattr(np, "note", 1), True)

    def builtin(self) -> bool:
        return self.swap(lambda: hasattr(builtins, "note"), lambda: setattr(builtins, "note", 1), True)

    def handler(self) -> bool:
        ignored = signal.SIG_IGN
        return self.swap(
            lambda: signal.getsignal(signal.SIGUSR2), lambda: signal.signal(signal.SIGUSR2, ignored), ignored
        )

    def alarm(self) -> bool:
        return signal.setitimer(signal.ITIMER_VIRTUAL, 1e6)[0] > 0

    def blocked(self) -> bool:
        return signal.SIGWINCH in signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGWINCH])

    def random(self) -> bool:
        state = np.random.get_state()[1]  # noqa: NPY002
        return self.swap(lambda: int(state[0]), lambda: np.random.seed(1234), 1234)  # noqa: NPY002

    def errors(self) -> bool:
        return np.seterr(all="raise")["over"] == "raise"

    def garbage(self) -> bool:
        return self.swap(gc.get_threshold, lambda: gc.set_threshold(123, 4, 5), (123, 4, 5))

    def switch(self) -> bool:
        return self.swap(sys.getswitchinterval, lambda: sys.setswitchinterval(0.125), 0.125)

    def descriptor(self) -> bool:
        try:
            os.fstat(77)
        except OSError:
            os.dup2(1, 77)
            return False
        return True

    def path(self) -> bool:
        return self.swap(lambda: "note" in sys.path, lambda: sys.path.append("note"), True)

    def threads(self) -> bool:
        def wait() -> None:
            threading.Thread(target=time.sleep, args=(3600,), daemon=True, name="note").start()

        return self.swap(lambda: any(one.name == "note" for one in threading.enumerate()), wait, True)
