"""The first thing that a launcher runs: standard library only, one thread, namespaces before anything is imported.

Run as a script with the number of its socket, over which its orders come. Where the system grants namespaces, the
launcher is the first process of its own: when it ends, the kernel ends all the others. Its orders and answers are JSON
behind four bytes of length, with descriptors where there are any.
"""

from __future__ import annotations

import contextlib
import ctypes
import importlib
import importlib.metadata
import json
import os
import signal
import socket
import sys
from collections.abc import Callable, Sequence
from typing import Any, Final

CLONE: Final = {  # flags of unshare(2)
    "namespace-user": 0x10000000,
    "namespace-mount": 0x00020000,
    "namespace-pid": 0x20000000,
    "namespace-net": 0x40000000,
    "namespace-ipc": 0x08000000,
    "namespace-uts": 0x04000000,
}
MS_RDONLY, MS_NOSUID, MS_NODEV, MS_NOEXEC = 1, 2, 4, 8
MS_PRIVATE_TREE: Final = 0x4000 | 0x40000  # MS_REC | MS_PRIVATE
MNT_DETACH: Final = 2
SYS_MOUNT_SETATTR: Final = 442  # on every architecture; Linux 5.12
AT_FDCWD, AT_RECURSIVE = -100, 0x8000
PR_SET_PDEATHSIG, PR_SET_DUMPABLE = 1, 4
LENGTH_BYTES: Final = 4
LAUNCHER: Final = "pdrbench_leaderboard.confine.launcher"  # which needs this module, and is what it becomes
CAN_CONFINE: Final = sys.platform == "linux" and hasattr(os, "fork")
LIBC: Final[Any] = ctypes.CDLL(None, use_errno=True) if CAN_CONFINE else None


class ProtectionRecord:
    """Protections of a process by name: those in force, and why the others are missing."""

    def __init__(self, held: Sequence[str] = (), missing: dict[str, str] | None = None) -> None:
        self.held: list[str] = [*held]
        self.missing: dict[str, str] = {**(missing or {})}

    def attempt(self, names: Sequence[str], act: Callable[[], object]) -> None:
        """Puts protections into force and notes the outcome."""
        try:
            act()
        except (OSError, ValueError, AttributeError) as error:
            reason = (error.strerror or str(error)) if isinstance(error, OSError) else "not on this system"
            self.missing.update(dict.fromkeys(names, reason))
        else:
            self.held += names


class _MountAttributes(ctypes.Structure):
    """`struct mount_attr` of Linux."""

    _fields_ = tuple((name, ctypes.c_uint64) for name in ("set", "clear", "propagation", "user_namespace"))


def main(descriptor: int) -> None:
    """Reads the orders, enters namespaces, and becomes the launcher; the process that was started waits for it."""
    with socket.socket(fileno=os.dup(descriptor)) as control:
        try:
            orders, _ = receive(control)
        except EOFError:  # the evaluating process has ended
            raise SystemExit(0) from None
    sys.path[:] = orders["path"]
    record = ProtectionRecord()
    for name in CLONE:
        record.attempt([name], lambda name=name: _enter_namespace(name))  # type: ignore[misc]
    if "namespace-pid" in record.held:
        launcher = os.fork()  # the first of the new namespace
        if launcher:
            os.close(descriptor)
            _, status = os.waitpid(launcher, 0)
            os._exit(os.waitstatus_to_exitcode(status) & 0xFF)
        with contextlib.suppress(OSError):
            prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    if "namespace-mount" in record.held:
        _arrange_files(orders, record)
    with contextlib.suppress(OSError, AttributeError):
        prctl(PR_SET_DUMPABLE, 0)  # no other process can read the launcher's memory
    with _no_plug_ins():
        launcher_module: Any = importlib.import_module(LAUNCHER)
    _hide_data(orders, record)
    launcher_module.serve(descriptor, orders, record)


def _enter_namespace(name: str) -> None:
    uid, gid = os.getuid(), os.getgid()
    check(LIBC.unshare(CLONE[name]))
    if name == "namespace-user":
        for file, text in (("setgroups", "deny"), ("uid_map", f"{uid} {uid} 1"), ("gid_map", f"{gid} {gid} 1")):
            with open(f"/proc/self/{file}", "w") as stream:  # noqa: PTH123  pathlib is not loaded yet
                stream.write(text)


def _arrange_files(orders: dict[str, Any], record: ProtectionRecord) -> None:
    """A read-only tree but for the scratch folder, and a /proc of its own."""
    record.attempt(["files-read-only", "scratch-limited"], lambda: _mount_tree(orders))
    if "files-read-only" in record.missing:
        return
    if "namespace-pid" in record.held:
        record.attempt(["proc-own"], mount_proc)


def _hide_data(orders: dict[str, Any], record: ProtectionRecord) -> None:
    """Empty folders where data lies, and this package: called once nothing more is imported from there."""
    if "files-read-only" not in record.held:
        return
    hidden = [path for path in orders["hidden"] if os.path.isdir(path)]  # noqa: PTH112
    if hidden:
        record.attempt(["data-hidden"], lambda: _hide(hidden))


def mount_proc() -> None:
    """A /proc that shows the processes of this namespace; raises `OSError`."""
    check(LIBC.mount(b"proc", b"/proc", b"proc", MS_NOSUID | MS_NODEV | MS_NOEXEC, None))


def mount_facts(files: dict[str, bytes]) -> None:
    """A /proc of plain files: nothing in it changes, and their numbers are the same in every walk; raises `OSError`."""
    check(LIBC.mount(b"tmpfs", b"/proc", b"tmpfs", MS_NOSUID | MS_NODEV | MS_NOEXEC, b"size=4m,mode=755"))
    for path, content in files.items():
        os.makedirs(os.path.dirname(path), exist_ok=True)  # noqa: PTH103, PTH120
        with open(path, "wb") as file:  # noqa: PTH123
            file.write(content)
    check(_set_attributes("/proc", MS_RDONLY, 0, 0))


def _mount_tree(orders: dict[str, Any]) -> None:
    check(LIBC.mount(b"none", b"/", None, MS_PRIVATE_TREE, None))
    check(_set_attributes("/", MS_RDONLY, 0, AT_RECURSIVE))
    mount_scratch(orders)
    _mount_limited(orders, orders["compiled"])


def mount_scratch(orders: dict[str, Any]) -> None:
    """An empty file system of limited size over the scratch folder; raises `OSError`."""
    _mount_limited(orders, orders["scratch"])


def _mount_limited(orders: dict[str, Any], folder: str) -> None:
    size = f"size={orders['scratch_bytes']},nr_inodes={orders['scratch_files']},mode=700".encode()
    check(LIBC.mount(b"tmpfs", folder.encode(), b"tmpfs", MS_NOSUID | MS_NODEV | MS_NOEXEC, size))


def _hide(folders: Sequence[str]) -> None:
    """Covers every folder that can be covered; raises the error of one that cannot."""
    errors = []
    for folder in folders:
        try:
            check(LIBC.mount(b"tmpfs", folder.encode(), b"tmpfs", MS_RDONLY | MS_NODEV, b"size=4k"))
        except OSError as error:
            errors.append(error)
    if errors:
        raise errors[-1]


def leave_scratch(scratch: str) -> None:
    """Unmounts the scratch folder and makes its parent writable again, so that the folder can be removed."""
    with contextlib.suppress(AttributeError):
        LIBC.umount2(scratch.encode(), MNT_DETACH)
        place = os.path.dirname(scratch)  # noqa: PTH120
        while not os.path.ismount(place):
            place = os.path.dirname(place)  # noqa: PTH120
        _set_attributes(place, 0, MS_RDONLY, 0)


def _set_attributes(path: str, to_set: int, to_clear: int, flags: int) -> int:
    """mount_setattr(2); its MOUNT_ATTR_RDONLY is the same bit as MS_RDONLY."""
    wanted = _MountAttributes(to_set, to_clear, 0, 0)
    done: int = LIBC.syscall(
        SYS_MOUNT_SETATTR, AT_FDCWD, path.encode(), flags, ctypes.byref(wanted), ctypes.sizeof(wanted)
    )
    return done


@contextlib.contextmanager
def _no_plug_ins() -> Any:
    """Hides entry points from a launcher: reading the tables of plug-ins would import their packages into it."""
    real = importlib.metadata.entry_points
    importlib.metadata.entry_points = lambda **_: ()  # type: ignore[assignment]
    try:
        yield
    finally:
        importlib.metadata.entry_points = real


def check(result: int) -> int:
    """The result of a call of the C library; raises `OSError` where it failed."""
    if result < 0:
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
    return result


def prctl(option: int, value: int, pointer: Any = 0) -> None:
    """prctl(2); raises `OSError` where it fails."""
    check(LIBC.prctl(option, value, pointer, 0, 0))


def send(control: socket.socket, content: dict[str, Any], descriptors: Sequence[int] = ()) -> None:
    """Sends one object; the descriptors go with its first bytes."""
    body = json.dumps(content).encode()
    message = len(body).to_bytes(LENGTH_BYTES, "little") + body
    sent = socket.send_fds(control, [message[:LENGTH_BYTES]], descriptors) if descriptors else 0
    control.sendall(message[sent:])


def receive(control: socket.socket, max_descriptors: int = 0) -> tuple[dict[str, Any], list[int]]:
    """The next object and its descriptors; raises `EOFError` where the other side has closed the socket."""
    head, descriptors, _, _ = socket.recv_fds(control, LENGTH_BYTES, max_descriptors)
    if not head:
        raise EOFError
    head += _read_exactly(control, LENGTH_BYTES - len(head))
    content: dict[str, Any] = json.loads(_read_exactly(control, int.from_bytes(head, "little")))
    return content, list(descriptors)


def _read_exactly(control: socket.socket, size: int) -> bytes:
    content = bytearray()
    while len(content) < size:
        part = control.recv(size - len(content))
        if not part:
            raise EOFError
        content += part
    return bytes(content)


if __name__ == "__main__":
    main(int(sys.argv[1]))
