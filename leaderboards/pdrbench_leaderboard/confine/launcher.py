"""The launcher: an interpreter that has imported the toolbox and nothing else, and forks one child for each walk.

A fork of it is a fresh interpreter in some milliseconds. It starts no threads, holds no recording, no reference and no
secret, runs no code of a localizer but pdrbench's own, and ends with the process that started it. The child is alone in
namespaces that exist for its walk only: with it end its processes and its files, and the numbers that the kernel counts
up for them.
"""

from __future__ import annotations

import contextlib
import gc
import importlib
import importlib.util
import os
import pkgutil
import socket
import sys
import sysconfig
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from pdrbench.process import child_main, messages
from pdrbench_leaderboard.confine import boot, numba_cache
from pdrbench_leaderboard.confine.boot import ProtectionRecord, receive, send
from pdrbench_leaderboard.confine.confine import FileLimits, close_others, confine, detach, prefer_for_oom
from pdrbench_leaderboard.confine.landlock import Ruleset
from pdrbench_leaderboard.confine.shared_modules import import_only
from pdrbench_leaderboard.confine.toolbox import LIBRARIES, TOOLBOX
from pdrbench_leaderboard.confine.walk_process import LoneWalk

NEEDED_ALONE: Final = ("namespace-pid", "namespace-mount", "scratch-limited", "proc-own")
# What numeric libraries ask /proc, as it was when the launcher began: what changes there would be a note
PROC_FILES: Final = ("/proc/cpuinfo", "/proc/sys/vm/overcommit_memory", "/proc/filesystems", "/proc/version")
OWN_MAP: Final = "/proc/self/maps"  # where a library finds the ends of the stack


def serve(descriptor: int, orders: dict[str, Any], record: ProtectionRecord) -> None:
    """Forks on request until the other side of the socket is closed; never returns.

    Args:
        descriptor: Of the socket.
        orders: As `boot.main` read them.
        record: Protections by the namespaces of this process.
    """
    os.environ.clear()
    home = {"HOME": orders["scratch"], "TMPDIR": orders["scratch"]}  # no variable of the user reaches a child
    os.environ.update({**orders["environment"], **home, "PYTHONDONTWRITEBYTECODE": "1", "LANG": "C.UTF-8"})
    numba_cache.read_only(orders["numba_cache"])
    for name in TOOLBOX:  # so that children need not import it
        package = importlib.import_module(name)
        for module in pkgutil.iter_modules(package.__path__):
            importlib.import_module(f"{package.__name__}.{module.name}")
    importlib.import_module("shapely")  # with which a child looks at the building that it is given
    if orders["modules"]:
        import_only(orders["modules"])
    gc.collect()
    gc.freeze()
    with socket.socket(fileno=descriptor) as control:
        control.settimeout(None)
        launcher = _Launcher(control, orders, record)
        with contextlib.suppress(EOFError, ConnectionError):
            launcher.run()
        launcher.end()
    for folder in (orders["scratch"], orders["compiled"]):
        boot.leave_scratch(folder)
        with contextlib.suppress(OSError):
            os.rmdir(folder)  # noqa: PTH106
    os._exit(0)


class _Launcher:
    def __init__(self, control: socket.socket, orders: dict[str, Any], record: ProtectionRecord) -> None:
        self._control, self._orders, self._record = control, orders, record
        self._child: LoneWalk | None = None
        self._namespace = -1
        if all(name in record.held for name in NEEDED_ALONE):
            self._namespace = os.open("/proc/self/ns/pid", os.O_RDONLY | os.O_CLOEXEC)
        self._proc = {path: _content(path) for path in PROC_FILES}
        self._num_modules = 0  # that were loaded when the map of its memory was read, which a fork has as well
        self._libraries: set[str] = set()

    def run(self) -> None:
        """One order after the other."""
        send(self._control, {"held": self._record.held, "missing": self._record.missing})
        while True:
            order, _ = receive(self._control)
            if "fork" in order:
                self._import(order["fork"]["libraries"])
                if order["fork"]["is_rehearsal"]:
                    os.makedirs(order["fork"]["compiled"], exist_ok=True)  # noqa: PTH103
                if order["fork"]["calls_compiled"]:
                    numba_cache.prepare()
                try:
                    self._child = child = self._fork(order["fork"])
                    send(self._control, {"pid": child.pid}, [child.handle, *child.pipes])
                    for descriptor in child.pipes:
                        os.close(descriptor)
                except OSError as error:
                    send(self._control, {"denied": str(error.strerror)})
            else:
                send(self._control, self._reap(order["reap"]["grace_s"]))

    def end(self) -> None:
        """Ends a child that is still running."""
        if self._child is not None:
            self._reap(0.0)

    def _import(self, libraries: Sequence[str]) -> None:
        """Imports installed libraries that the localizer's sources name; modules from other places are not trusted."""
        places = [Path(sysconfig.get_path(name)).resolve() for name in ("purelib", "platlib")]
        for name in sorted(set(libraries) & set(LIBRARIES) - self._libraries):
            self._libraries.add(name)
            spec = importlib.util.find_spec(name.partition(".")[0])
            origin = Path(spec.origin).resolve() if spec is not None and spec.origin is not None else None
            if origin is not None and any(origin.is_relative_to(place) for place in places):
                with contextlib.suppress(ImportError):
                    importlib.import_module(name)
                gc.freeze()

    def _fork(self, order: dict[str, Any]) -> LoneWalk:
        os.makedirs(self._orders["scratch"], exist_ok=True)  # noqa: PTH103
        record = ProtectionRecord([*self._record.held, "walk-alone"], self._record.missing)
        if self._num_modules != len(sys.modules):
            self._num_modules, self._proc[OWN_MAP] = len(sys.modules), _content(OWN_MAP)

        ruleset: list[Ruleset] = []  # made in the namespaces of the walk

        def arrange() -> None:
            record.attempt(["first-to-go"], prefer_for_oom)
            boot.mount_scratch(self._orders)
            boot.mount_facts(self._proc)
            try:
                ruleset.append(_make_ruleset(order, self._orders["scratch"]))
            except OSError as error:
                record.missing["landlock-files"] = str(error.strerror)

        return LoneWalk(
            lambda pipes: self._become_child(order, pipes, ruleset[0] if ruleset else None, record),
            arrange,
            self._orders["scratch"],
            self._namespace,
        )

    def _become_child(
        self, order: dict[str, Any], pipes: Sequence[int], ruleset: Ruleset | None, record: ProtectionRecord
    ) -> None:
        requests, replies, output = pipes
        null = os.open(os.devnull, os.O_RDONLY)
        os.dup2(null, 0)
        os.dup2(output, 1)
        os.dup2(output, 2)
        os.chdir(self._orders["scratch"])
        detach(record, FileLimits(**order["files"]), order["memory_mb"], order["cpu_s"])
        if order["is_rehearsal"]:
            numba_cache.enable_writing()
        if order["compiled"]:
            numba_cache.keep_all(order["compiled"])
        close_others([requests, replies, *([] if ruleset is None else [ruleset.descriptor])])
        confine(record, ruleset)
        if ruleset is not None:
            ruleset.close()
        child_main.serve(requests, replies, messages.Started(0, record.held, record.missing))

    def _reap(self, grace_s: float) -> dict[str, Any]:
        """Ends the child and its descendants, and with them their files; returns how it ended and what it used."""
        assert self._child is not None
        killed = not self._child.wait(grace_s)
        ended = self._child.end(kill=killed)
        self._child = None
        return {"code": os.waitstatus_to_exitcode(ended.pop("status")), "killed": killed, **ended}


def _content(path: str) -> bytes:
    """Of a file of the kernel; empty where it has none such."""
    with contextlib.suppress(OSError):
        return Path(path).read_bytes()
    return b""


def _make_ruleset(order: dict[str, Any], scratch: str) -> Ruleset:
    ruleset = Ruleset()
    for path in order["listed"]:
        ruleset.list_folder(path)
    for path in (*order["readable"], "/proc"):
        ruleset.read(path)
    for path in (*order["writable"], scratch, os.devnull):
        ruleset.write(path)
    return ruleset
