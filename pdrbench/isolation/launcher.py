"""The launcher: an interpreter that has imported the toolbox and nothing else, and forks one child for each walk.

A fork of it is a fresh interpreter in some milliseconds. It starts no threads, holds no recording, no reference and no
secret, and ends with the process that started it.
"""

from __future__ import annotations

import contextlib
import gc
import importlib
import importlib.util
import json
import os
import pkgutil
import shutil
import signal
import socket
import sys
import sysconfig
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from pdrbench.isolation import boot, child_main, messages, numba_cache, scratch
from pdrbench.isolation.boot import ProtectionRecord, receive, send
from pdrbench.isolation.confine import Limits, close_others, confine, detach
from pdrbench.isolation.landlock import Ruleset

TOOLBOX: Final = ("filters", "inertial", "radio")  # packages whose modules every child finds imported
MAX_RULESETS: Final = 16
NUM_PIPES: Final = 3  # handed over with an order: requests, replies, output
WAIT_S: Final = 0.002


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
        package = importlib.import_module(f"pdrbench.{name}")
        for module in pkgutil.iter_modules(package.__path__):
            importlib.import_module(f"{package.__name__}.{module.name}")
    gc.collect()
    gc.freeze()
    with socket.socket(fileno=descriptor) as control:
        control.settimeout(None)
        launcher = _Launcher(control, orders, record)
        with contextlib.suppress(EOFError, ConnectionError):
            launcher.run()
        launcher.end()
    boot.leave_scratch(orders["scratch"])
    shutil.rmtree(orders["scratch"], ignore_errors=True)
    os._exit(0)


class _Launcher:
    def __init__(self, control: socket.socket, orders: dict[str, Any], record: ProtectionRecord) -> None:
        self._control, self._orders, self._record = control, orders, record
        self._child = 0
        self._rulesets: dict[str, tuple[Ruleset | None, str]] = {}
        self._libraries: set[str] = set()

    def run(self) -> None:
        """One order after the other."""
        send(self._control, {"ready": True})
        while True:
            order, descriptors = receive(self._control, NUM_PIPES)
            if "fork" in order:
                self._import(order["fork"]["libraries"])
                self._import_builtins(order["fork"]["builtins"])
                self._fork(order["fork"], descriptors)
                for descriptor in descriptors:
                    os.close(descriptor)
                self._answer_with_handle()
            else:
                send(self._control, self._reap(order["reap"]["grace_s"]))

    def end(self) -> None:
        """Ends a child that is still running."""
        if self._child:
            self._reap(0.0)

    def _answer_with_handle(self) -> None:
        """Sends the child's number, and a descriptor that names it outside of this namespace too."""
        handle = -1
        with contextlib.suppress(OSError, AttributeError):
            handle = os.pidfd_open(self._child)
        send(self._control, {"pid": self._child}, [handle] if handle >= 0 else [])
        if handle >= 0:
            os.close(handle)

    def _import(self, libraries: Sequence[str]) -> None:
        """Imports installed libraries that an earlier child has used; modules from other places are not trusted."""
        places = [Path(sysconfig.get_path(name)).resolve() for name in ("purelib", "platlib")]
        for name in sorted(set(libraries) & set(messages.LIBRARIES) - self._libraries):
            self._libraries.add(name)
            spec = importlib.util.find_spec(name.partition(".")[0])
            origin = Path(spec.origin).resolve() if spec is not None and spec.origin is not None else None
            if origin is not None and any(origin.is_relative_to(place) for place in places):
                with contextlib.suppress(ImportError):
                    importlib.import_module(name)
                gc.freeze()

    def _import_builtins(self, modules: Sequence[str]) -> None:
        """Imports modules of localizers that come with pdrbench, as the evaluating process names them."""
        for name in modules:
            if name not in sys.modules:
                with contextlib.suppress(ImportError):
                    importlib.import_module(name)
                gc.freeze()

    def _ruleset(self, order: dict[str, Any]) -> tuple[Ruleset | None, str]:
        """What this kind of child may open; built once for each kind."""
        key = json.dumps([order["readable"], order["listed"], order["writable"]])
        if key not in self._rulesets:
            if len(self._rulesets) >= MAX_RULESETS:
                for ruleset, _ in self._rulesets.values():
                    if ruleset is not None:
                        ruleset.close()
                self._rulesets.clear()
            try:
                self._rulesets[key] = (_make_ruleset(order, self._orders["scratch"]), "")
            except OSError as error:
                self._rulesets[key] = (None, str(error.strerror))
        return self._rulesets[key]

    def _fork(self, order: dict[str, Any], descriptors: Sequence[int]) -> None:
        ruleset, why_none = self._ruleset(order) if self._orders["confines"] else (None, "")
        os.makedirs(self._orders["scratch"], exist_ok=True)  # noqa: PTH103
        self._child = os.fork()
        if self._child:
            return
        try:
            self._become_child(order, descriptors, ruleset, why_none)
        finally:
            os._exit(1)

    def _become_child(
        self, order: dict[str, Any], descriptors: Sequence[int], ruleset: Ruleset | None, why_none: str
    ) -> None:
        requests, replies, output = descriptors
        null = os.open(os.devnull, os.O_RDONLY)
        os.dup2(null, 0)
        os.dup2(output, 1)
        os.dup2(output, 2)
        os.chdir(self._orders["scratch"])
        record = ProtectionRecord(self._record.held, self._record.missing)
        detach(record, Limits(**order["limits"]), order["cpu_s"])
        if order["own_cache"]:
            numba_cache.enable_writing()
        close_others([requests, replies, *([] if ruleset is None else [ruleset.descriptor])])
        if ruleset is not None:
            ruleset.read(f"/proc/{os.getpid()}")
        if self._orders["confines"]:
            confine(record, ruleset, why_none)
        if ruleset is not None:
            ruleset.close()
        child_main.serve(requests, replies, messages.Confined(0, record.held, record.missing))

    def _reap(self, grace_s: float) -> dict[str, Any]:
        """Ends the child and its descendants and removes its files; returns how it ended and what it used."""
        killed = False
        ends = time.monotonic() + grace_s
        while True:
            pid, status, usage = os.wait4(self._child, os.WNOHANG)
            if pid:
                break
            if time.monotonic() >= ends:
                killed = True
                with contextlib.suppress(ProcessLookupError):
                    os.kill(self._child, signal.SIGKILL)
                pid, status, usage = os.wait4(self._child, 0)
                break
            time.sleep(WAIT_S)
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self._child, signal.SIGKILL)
        self._child = 0
        _end_others()
        scratch.empty(self._orders["scratch"])
        peak_kb = usage.ru_maxrss / (1024 if sys.platform == "darwin" else 1)
        return {
            "code": os.waitstatus_to_exitcode(status),
            "killed": killed,
            "peak_mb": round(peak_kb / 1024, 1),
            "cpu_s": round(usage.ru_utime + usage.ru_stime, 3),
        }


def _end_others() -> None:
    """Ends processes that a child left behind, which are children of this process by now."""
    if os.getpid() == 1:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.kill(-1, signal.SIGKILL)
    while True:
        orphans = _children()
        for orphan in orphans:
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.kill(orphan, signal.SIGKILL)
        try:
            while os.waitpid(-1, 0 if orphans else os.WNOHANG)[0]:
                pass
        except ChildProcessError:
            return
        if not orphans:
            return


def _children() -> list[int]:
    try:
        return [int(pid) for pid in Path("/proc/thread-self/children").read_text().split()]
    except OSError:
        return []


def _make_ruleset(order: dict[str, Any], scratch: str) -> Ruleset:
    ruleset = Ruleset()
    for path in order["listed"]:
        ruleset.list_folder(path)
    for path in order["readable"]:
        ruleset.read(path)
    for path in (*order["writable"], scratch, os.devnull):
        ruleset.write(path)
    return ruleset
