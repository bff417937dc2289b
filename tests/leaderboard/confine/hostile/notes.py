"""Notes for a later walk or another localizer: files, numbers that the system counts up, objects that all share."""

from __future__ import annotations

import builtins
import contextlib
import ctypes
import fcntl
import functools
import gc
import mmap
import os
import resource
import signal
import struct
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from hostile.common import ALONE, ALWAYS, CALLS, FILES, READ_ONLY, Attempt, Probe, can_open, is_let_in, libc

PLACES = (".", "~", "/tmp", "/var/tmp", "/dev/shm")
MADV_PAGEOUT, FADV_DONTNEED, RWF_NOWAIT, MADV_MERGEABLE, MADV_COLLAPSE = 21, 4, 8, 12, 25
FUTEX_WAKE, FUTEX_WAIT_SHARED = 1, 0
FS_IOC_GETFLAGS, FS_IOC_SETFLAGS = 0x80086601, 0x40086602
F_OFD_SETLK, F_ADD_SEALS, F_SETPIPE_SZ = 37, 1033, 1031
PR_SET_NAME, PR_GET_NAME = 15, 16
MANY = 64  # numbers that a first process, or a first file, is not given
DAY_S = 86_400.0


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

    def number_of_a_file(self) -> int:
        Path("file").touch()
        return Path("file").stat().st_ino

    def with_library(self, call: str, *arguments: object) -> bool:
        with Path(np.__file__).open("rb") as file:
            return is_let_in(call, file.fileno(), *arguments)


class MemoryNumbers(Probe):
    """Shared memory without a file has a number that the machine counts up, and that a map of the process shows."""

    def attempts(self) -> dict[str, Attempt]:
        return {"shared": (self.number, CALLS), "of-zeros": (lambda: can_open("/dev/zero", os.O_RDWR), FILES)}

    def number(self) -> int:
        with mmap.mmap(-1, mmap.PAGESIZE) as block:
            block[0] = 1
            lines = Path("/proc/self/maps").read_text().splitlines()
            return max(int(line.split()[4]) for line in lines if "/dev/zero" in line)


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


class Locks(Probe):
    """What one process does to a file that it may only read, and another one finds."""

    def attempts(self) -> dict[str, Attempt]:
        lock = struct.pack("hhqqi", fcntl.F_RDLCK, os.SEEK_SET, 0, 1, 0)
        return {
            "lock": (lambda: self.with_file(fcntl.F_SETLK, lock), CALLS),
            "who-locks": (lambda: self.with_file(fcntl.F_GETLK, lock), CALLS),
            "lock-of-description": (lambda: self.with_file(F_OFD_SETLK, lock), CALLS),
            "flock": (lambda: fcntl.flock(os.open(np.__file__, os.O_RDONLY), fcntl.LOCK_SH) is None, CALLS),
            "lease": (lambda: self.with_file(fcntl.F_SETLEASE, fcntl.F_RDLCK) == 0, CALLS),
            "watch": (lambda: self.with_folder(fcntl.F_NOTIFY, fcntl.DN_ACCESS) == 0, CALLS),
            "wake-up": (self.wakes, CALLS),
            "flags": (lambda: self.flags(FS_IOC_GETFLAGS), CALLS),
            "sets-flags": (lambda: self.flags(FS_IOC_SETFLAGS), CALLS | READ_ONLY),
            "link": (lambda: os.link(np.__file__, "linked") is None, CALLS | FILES | READ_ONLY),
            "attribute": (lambda: os.setxattr(np.__file__, "user.note", b"(3, 4)") is None, CALLS | READ_ONLY),
            "last-access": (self.sets_last_access, READ_ONLY),
            "free-blocks": (lambda: os.statvfs("/").f_bfree, CALLS),
            "size-of-pipe": (lambda: fcntl.fcntl(1, F_SETPIPE_SZ, 1 << 16) > 0, CALLS),
        }

    def with_file(self, what: int, argument: int | bytes) -> object:
        with Path(np.__file__).open("rb") as file:
            return fcntl.fcntl(file.fileno(), what, argument)

    def with_folder(self, what: int, argument: int) -> object:
        folder = os.open(Path(np.__file__).parent, os.O_RDONLY)
        try:
            return fcntl.fcntl(folder, what, argument)
        finally:
            os.close(folder)

    def wakes(self) -> bool:
        """Wakes who waits at an address of a file that all have mapped; the call says how many there were."""
        with Path(np.__file__).open("rb") as file, mmap.mmap(file.fileno(), 4096, prot=mmap.PROT_READ) as block:
            address = np.frombuffer(block, np.uint8).ctypes.data
            return is_let_in("futex", ctypes.c_void_p(address), FUTEX_WAKE, 1, None, None, 0)

    def flags(self, what: int) -> bool:
        with Path(np.__file__).open("rb") as file:
            fcntl.ioctl(file.fileno(), what, bytearray(8))
        return True

    def sets_last_access(self) -> bool:
        """Reads files that nobody has read for a day, and looks for a new time."""
        for path in sorted(Path(np.__file__).parent.rglob("*.pyi"))[:200]:
            before = path.stat()
            if time.time() - before.st_atime > DAY_S or before.st_atime <= before.st_mtime:
                path.read_bytes()
                if path.stat().st_atime != before.st_atime:
                    return True
        return False


class SharedObjects(Probe):
    """Objects of which the machine or the user has a limited number, and queues that outlive a process."""

    def attempts(self) -> dict[str, Attempt]:
        room = ctypes.create_string_buffer(4096)
        calls = {
            "io_setup": (60_000, ctypes.byref(ctypes.c_ulong(0))),
            "timer_create": (1, None, room),
            "mq_open": (b"/note", os.O_RDWR | os.O_CREAT, 0o600, None),
            "semget": (1234, 1, 0o1600),
            "shmget": (1234, 4096, 0o1600),
            "msgget": (1234, 0o1600),
            "add_key": (b"user", b"note", b"(3, 4)", 6, -3),
            "userfaultfd": (0,),
            "memfd_create": (b"note", 3),
            "fanotify_init": (0, 0),
            "eventfd2": (0, 0),
            "epoll_create1": (0,),
            "timerfd_create": (1, 0),
            "signalfd4": (-1, room, 8, 0),
            "mlock": (room, 4096),
            "rt_sigqueueinfo": (os.getpid(), 0, room),
            "get_mempolicy": (None, None, 0, None, 0),
            "remap_file_pages": (None, 0, 0, 0, 0),
            "personality": (0xFFFFFFFF,),
        }
        made: dict[str, Attempt] = {
            name: (functools.partial(is_let_in, name, *arguments), CALLS) for name, arguments in calls.items()
        }
        lowered = (16, resource.getrlimit(resource.RLIMIT_NPROC)[1])
        made["processes-of-the-user"] = (lambda: resource.setrlimit(resource.RLIMIT_NPROC, lowered) is None, CALLS)
        made["huge-pages"] = (self.takes_huge_page, CALLS)
        made["clock-of-another"] = (lambda: time.clock_gettime(~os.getppid() << 3 | 2) >= 0, CALLS)
        return made

    def takes_huge_page(self) -> bool:
        """Of a number that the machine sets apart: refused for want of them is an answer, too."""
        try:
            mmap.mmap(-1, 2 << 20, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS | 0x40000).close()
        except PermissionError:
            return False
        except OSError:
            return True
        return True


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
        return self.swap(lambda: level, lambda: os.setpriority(os.PRIO_PROCESS, 0, 17), 17)

    def scheduling(self) -> bool:
        idle = os.sched_param(0)
        return self.swap(
            lambda: os.sched_getscheduler(0), lambda: os.sched_setscheduler(0, os.SCHED_IDLE, idle), os.SCHED_IDLE
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
