"""Ways out for what was observed, beside sockets of the network and of the machine."""

from __future__ import annotations

import fcntl
import functools
import os
import resource
import struct
import subprocess
import sys
import termios
from pathlib import Path

from hostile.common import ALWAYS, CALLS, FILES, READ_ONLY, Attempt, Probe, can_open, is_let_in
from hostile.targets import TARGETS

TERMINALS = ("/dev/ptmx", "/dev/tty", "/dev/console", "/dev/tty0", "/dev/ttyS0", "/dev/pts/ptmx", "/dev/pts/0")
DEVICES = ("/dev/kmsg", "/dev/log", "/dev/fuse", "/dev/net/tun", "/dev/vsock", "/dev/vhost-vsock", "/dev/snd/seq")


class Terminals(Probe):
    """Keys typed into a terminal, lines in the logs of the machine."""

    def attempts(self) -> dict[str, Attempt]:
        found: dict[str, Attempt] = {
            path: (functools.partial(can_open, path, os.O_RDWR | os.O_NOCTTY), FILES) for path in TERMINALS + DEVICES
        }
        for handle in range(3):
            found[f"types-{handle}"] = (functools.partial(self.types, handle), ALWAYS)
        found["log-of-the-kernel"] = (lambda: is_let_in("syslog", 10, None, 0), CALLS)
        return found

    def types(self, handle: int) -> bool:
        return fcntl.ioctl(handle, termios.TIOCSTI, b"x") is not None


class Programs(Probe):
    """A program that sends, or a crash that hands memory to one."""

    def attempts(self) -> dict[str, Attempt]:
        return {
            "runs": (lambda: subprocess.run([sys.executable, "--version"], timeout=5).returncode == 0, CALLS),
            "spawns": (lambda: os.posix_spawn("/bin/true", ["true"], {}) > 0, CALLS),
            "shell": (lambda: os.system("true") == 0, CALLS),
            "execveat": (lambda: is_let_in("execveat", -1, b"/nowhere", None, None, 0), CALLS),
            "core": (self.leaves_cores, {"limit-core"}),
            "core-without-limit": (lambda: self.limits_cores(1 << 30), {"limit-core"}),
        }

    def leaves_cores(self) -> bool:
        """A limit of a page or more; below, 1 keeps programs that collect crashes out, too, which 0 does not."""
        return resource.getrlimit(resource.RLIMIT_CORE)[0] not in (0, 1)

    def limits_cores(self, size: int) -> bool:
        resource.setrlimit(resource.RLIMIT_CORE, (size, resource.RLIM_INFINITY))
        return True


class HandsOver(Probe):
    """Files by other names, queues with names, and descriptors of others."""

    def attempts(self) -> dict[str, Attempt]:
        home, file = Path(TARGETS.get("home", "")), TARGETS.get("removable", "")
        return {
            "renames-out": (lambda: self.made("mine").rename(home / "mine"), FILES | READ_ONLY),
            "links-out": (lambda: os.link(self.made("other"), home / "other") is None, CALLS | FILES | READ_ONLY),
            "symlink-out": (lambda: (home / "symlink").symlink_to("(3, 4)") is None, FILES | READ_ONLY),
            "folder-out": (lambda: (home / "3-4").mkdir() is None, FILES | READ_ONLY),
            "removes": (lambda: Path(file).unlink() is None, FILES | READ_ONLY),
            "truncates": (lambda: os.truncate(file, 0) is None, FILES | READ_ONLY),
            "touches": (lambda: os.utime(file) is None, CALLS | READ_ONLY),
            "rights": (lambda: Path(file).chmod(0o777) is None, CALLS | READ_ONLY),
            "queue": (lambda: os.mkfifo("queue") is None, CALLS | FILES),
            "parents-descriptors": (lambda: self.of_parent(), FILES | {"namespace-pid"}),
            "descriptor-of-another": (lambda: is_let_in("pidfd_open", os.getppid(), 0), CALLS),
            "by-handle": (lambda: is_let_in("open_by_handle_at", -100, struct.pack("QQ", 8, 1), 0), CALLS),
            "splices": (lambda: is_let_in("splice", 0, None, 1, None, 1, 0), CALLS),
            "gives-pages": (lambda: is_let_in("vmsplice", 1, None, 0, 0), CALLS),
        }

    def made(self, name: str) -> Path:
        path = Path(name).absolute()
        path.write_text("(3, 4)")
        return path

    def of_parent(self) -> bool:
        """A descriptor of the parent that can be opened once more for writing."""
        folder = Path(f"/proc/{os.getppid() or 1}/fd")
        return any(can_open(entry, os.O_WRONLY | os.O_NONBLOCK) for entry in folder.iterdir())
