"""The launcher that the core finds under the isolation "confined": what is asked for here is held, or refused."""

from __future__ import annotations

import functools
import os
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from pdrbench.errors import PdrbenchError
from pdrbench.evaluation.origin import localizer_target
from pdrbench.process.child_process import EndedError, LateError, LaunchError
from pdrbench.process.launch import LaunchOrder
from pdrbench.process.messages import MAX_REPLY_BYTES, ProtocolError, Started, read_reply
from pdrbench_leaderboard.confine.boot import CAN_CONFINE, ProtectionRecord
from pdrbench_leaderboard.confine.confine import FileLimits
from pdrbench_leaderboard.confine.confined_process import ConfinedProcess
from pdrbench_leaderboard.confine.launcher_client import DeniedError, warm_launcher
from pdrbench_leaderboard.confine.read_permissions import ReadPermissions, permissions_of

TRIED: Final = "stay"  # in whose name a process is started to see what the system denies
TRIED_S: Final = 60.0
CPU_PER_WALL: Final = 4.0  # processor time that a walk may take, in its wall time: threads count
# Without any of these a localizer reads files, connects, sees other processes or leaves notes
NAMESPACES: Final = tuple(f"namespace-{kind}" for kind in ("mount", "pid", "net", "ipc"))
NEEDED: Final = (*NAMESPACES, "files-read-only", "scratch-limited", "proc-own")  # of a launcher
NEEDED_OF_WALK: Final = ("landlock-files", "seccomp", "no-new-privileges", "no-capabilities")


class ConfinedLauncher:
    """See `pdrbench.process.launch.Launcher`: a process of its own for every walk.

    Args:
        files: Limits of the files of each.
    """

    def __init__(self, files: FileLimits | None = None) -> None:
        self._files = files or FileLimits()

    def check(self, localizer: str, target: str) -> None:
        """Raises `PdrbenchError` where nothing can be confined, or a localizer may not be read; tries it once."""
        permissions_of(localizer, target)
        _try(os.getpid(), self._files)

    def wants_rehearsal(self, order: LaunchOrder) -> bool:
        """For a localizer that compiles."""
        permissions = permissions_of(order.localizer, order.target)
        if "numba" not in {name.partition(".")[0] for name in permissions.imports}:
            return False
        launcher = warm_launcher(order.limits, self._files, permissions.packages)
        return _version(order.target, permissions) not in launcher.rehearsed

    def launch(self, order: LaunchOrder, ends_s: float) -> ConfinedProcess:
        """A process that has given up what it may not do.

        Raises:
            LaunchError: None could be started until `ends_s`.
            PdrbenchError: The system denies what confinement needs.
        """
        if not CAN_CONFINE:
            raise PdrbenchError("localizers are confined on Linux only: run it there, or without --confined")
        permissions = permissions_of(order.localizer, order.target)
        launcher = warm_launcher(order.limits, self._files, permissions.packages)
        _check(NEEDED, launcher.held, launcher.missing)
        _compile_toolbox(permissions)
        name = _version(order.target, permissions)
        if order.is_rehearsal:
            launcher.rehearsed.add(name)
        compiled = launcher.compiled_folder(name) if name in launcher.rehearsed else ""
        cpu_s = CPU_PER_WALL * order.walk_s  # nothing of the walk may be in it
        process = launcher.fork(permissions, cpu_s, compiled, is_rehearsal=order.is_rehearsal)
        try:
            started = read_reply(process.receive(max(ends_s, time.monotonic() + 1.0), MAX_REPLY_BYTES), 0, Started)
        except (LateError, EndedError, ProtocolError) as error:
            # no code of the localizer has run yet: whatever happened to its process is not its fault
            process.release()
            raise LaunchError(f"a process for the localizer did not begin: {error}; {process.output}") from error
        assert isinstance(started, Started)
        process.look_at(ProtectionRecord(started.held, started.missing))
        try:
            _check(NEEDED_OF_WALK, started.held, started.missing)
        except DeniedError:
            process.release()
            raise
        return process


@functools.cache
def _try(pid: int, files: FileLimits) -> None:
    """Raises `PdrbenchError` where this process cannot confine a localizer; one that comes with pdrbench is not run."""
    order = LaunchOrder(TRIED, localizer_target(TRIED), TRIED_S)
    ConfinedLauncher(files).launch(order, time.monotonic() + TRIED_S).release()


def _check(needed: Sequence[str], held: Sequence[str], missing: Mapping[str, str]) -> None:
    """Raises `DeniedError` where a protection is not in force."""
    lacking = [f"{name} ({missing.get(name, 'it was not tried')})" for name in needed if name not in held]
    if lacking:
        raise DeniedError(" and ".join(lacking))


def _version(target: str, permissions: ReadPermissions) -> str:
    """A localizer as its sources are now."""
    changed_ns = [Path(place).stat().st_mtime_ns for place in permissions.own if Path(place).is_file()]
    return f"{target} {changed_ns}"


def _compile_toolbox(permissions: ReadPermissions) -> None:
    """Compiles what a localizer is likely to call, since its own process may not write the cache."""
    toolbox = permissions.toolbox
    if toolbox:
        from pdrbench_leaderboard.confine.numba_cache import compile_package  # takes half a second to import

        for package in toolbox:
            compile_package(package)
