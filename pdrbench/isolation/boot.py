"""The first thing that a launcher runs: standard library only, one thread, namespaces before anything is imported.

Run as a script with the number of its socket. What it is to do comes over that socket as one JSON object. Where
namespaces are granted, the launcher is the first process of its own: when it ends, the kernel ends all the others.
"""

from __future__ import annotations

import contextlib
import ctypes
import importlib.metadata
import json
import os
import signal
import socket
import sys
from typing import Any, Final

CLONE: Final = {  # flags of unshare(2)
    "namespace-user": 0x10000000,
    "namespace-mount": 0x00020000,
    "namespace-pid": 0x20000000,
    "namespace-net": 0x40000000,
    "namespace-ipc": 0x08000000,
    "namespace-uts": 0x04000000,
}
MS_RDONLY, MS_NOSUID, MS_NODEV, MS_NOEXEC, MS_BIND = 1, 2, 4, 8, 4096
MS_PRIVATE_TREE: Final = 0x4000 | 0x40000  # MS_REC | MS_PRIVATE
MNT_DETACH: Final = 2
SYS_MOUNT_SETATTR: Final = 442  # on every architecture; Linux 5.12
AT_FDCWD, AT_RECURSIVE = -100, 0x8000
PR_SET_PDEATHSIG, PR_SET_DUMPABLE, PR_SET_CHILD_SUBREAPER = 1, 4, 36
LENGTH_BYTES: Final = 4


class _MountAttributes(ctypes.Structure):
    """`struct mount_attr` of Linux."""

    _fields_ = tuple((name, ctypes.c_uint64) for name in ("set", "clear", "propagation", "user_namespace"))


def main(descriptor: int) -> None:
    """Reads the orders, enters namespaces, and becomes the launcher; the process that was started waits for it."""
    orders = json.loads(_read(descriptor))
    sys.path[:] = orders["path"]
    held: list[str] = []
    missing: dict[str, str] = {}
    if orders["confines"]:
        enter_namespaces(held, missing)
    if "namespace-pid" in held:
        launcher = os.fork()  # the first of the new namespace
        if launcher:
            os.close(descriptor)
            _, status = os.waitpid(launcher, 0)
            os._exit(os.waitstatus_to_exitcode(status) & 0xFF)
        with contextlib.suppress(OSError):
            _check(_libc().prctl(PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0))
    if "namespace-mount" in held:
        arrange_files(orders, held, missing)
    with contextlib.suppress(OSError, AttributeError):
        _check(_libc().prctl(PR_SET_DUMPABLE, 0, 0, 0, 0))  # nobody looks into the launcher
        _check(_libc().prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0))  # who leaves a child behind leaves it to us
    with _nothing_registered():
        from pdrbench.isolation.launcher import serve
    serve(descriptor, orders, held, missing)


def enter_namespaces(held: list[str], missing: dict[str, str]) -> None:
    """Leaves as many namespaces of the system as it lets us; notes which, and why not the others."""
    uid, gid = os.getuid(), os.getgid()
    for name, flag in CLONE.items():
        try:
            _check(_libc().unshare(flag))
            if name == "namespace-user":
                _write("/proc/self/setgroups", "deny")
                _write("/proc/self/uid_map", f"{uid} {uid} 1")
                _write("/proc/self/gid_map", f"{gid} {gid} 1")
            held.append(name)
        except (OSError, AttributeError) as error:
            missing[name] = _why(error)


def arrange_files(orders: dict[str, Any], held: list[str], missing: dict[str, str]) -> None:
    """A tree that cannot be written but for the scratch folder, a /proc of our own, and nothing where data lies."""
    libc, scratch = _libc(), orders["scratch"].encode()
    try:
        _check(libc.mount(b"none", b"/", None, MS_PRIVATE_TREE, None))
        _check(_set_attributes("/", MS_RDONLY, 0, AT_RECURSIVE))
        size = f"size={orders['scratch_bytes']},nr_inodes={orders['scratch_files']},mode=700".encode()
        _check(libc.mount(b"tmpfs", scratch, b"tmpfs", MS_NOSUID | MS_NODEV | MS_NOEXEC, size))
        held += ["files-read-only", "scratch-limited"]
    except (OSError, AttributeError) as error:
        missing["files-read-only"] = _why(error)
        return
    if "namespace-pid" in held:
        _try("proc-own", held, missing, lambda: libc.mount(b"proc", b"/proc", b"proc", 14, None))
    for folder in orders["writable"]:  # Landlock decides which child may
        with contextlib.suppress(OSError):
            _check(libc.mount(folder.encode(), folder.encode(), None, MS_BIND, None))
            _check(_set_attributes(folder, 0, MS_RDONLY, 0))
    hidden = [path for path in orders["hidden"] if os.path.isdir(path)]  # noqa: PTH112  pathlib is not loaded yet
    for path in hidden:
        _try(
            "data-hidden",
            held,
            missing,
            lambda path=path: libc.mount(b"tmpfs", path.encode(), b"tmpfs", MS_RDONLY | MS_NODEV, b"size=4k"),
        )


def leave_scratch(scratch: str) -> None:
    """Takes the file system off the scratch folder and lets us write again, so that the folder can be removed."""
    with contextlib.suppress(AttributeError):
        _libc().umount2(scratch.encode(), MNT_DETACH)
        place = os.path.dirname(scratch)  # noqa: PTH120
        while not os.path.ismount(place):
            place = os.path.dirname(place)  # noqa: PTH120
        _set_attributes(place, 0, MS_RDONLY, 0)


def _try(name: str, held: list[str], missing: dict[str, str], act: Any) -> None:
    try:
        _check(act())
    except (OSError, AttributeError) as error:
        missing[name] = _why(error)
        if name in held:
            held.remove(name)
    else:
        if name not in held and name not in missing:
            held.append(name)


def _set_attributes(path: str, to_set: int, to_clear: int, flags: int) -> int:
    """mount_setattr(2); its MOUNT_ATTR_RDONLY is the same bit as MS_RDONLY."""
    wanted = _MountAttributes(to_set, to_clear, 0, 0)
    done: int = _libc().syscall(
        SYS_MOUNT_SETATTR, AT_FDCWD, path.encode(), flags, ctypes.byref(wanted), ctypes.sizeof(wanted)
    )
    return done


@contextlib.contextmanager
def _nothing_registered() -> Any:
    """Plug-ins stay unknown to a launcher: reading their tables would import strangers' packages into it."""
    real = importlib.metadata.entry_points
    importlib.metadata.entry_points = lambda **_: ()  # type: ignore[assignment]
    try:
        yield
    finally:
        importlib.metadata.entry_points = real


def _libc() -> Any:
    return ctypes.CDLL(None, use_errno=True)


def _check(result: int) -> int:
    if result < 0:
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
    return result


def _why(error: OSError | AttributeError) -> str:
    return error.strerror or str(error) if isinstance(error, OSError) else "not on this system"


def _write(path: str, text: str) -> None:
    handle = os.open(path, os.O_WRONLY)
    try:
        os.write(handle, text.encode())
    finally:
        os.close(handle)


def _read(descriptor: int) -> bytes:
    """One frame: four bytes of length, then the rest."""
    with socket.socket(fileno=os.dup(descriptor)) as control, control.makefile("rb", buffering=0) as stream:
        size = int.from_bytes(_exactly(stream, LENGTH_BYTES), "little")
        return _exactly(stream, size)


def _exactly(stream: Any, size: int) -> bytes:
    content = b""
    while len(content) < size:
        part = stream.read(size - len(content))
        if not part:
            raise SystemExit(0)  # whoever started us has left
        content += part
    return content


if __name__ == "__main__":
    main(int(sys.argv[1]))
