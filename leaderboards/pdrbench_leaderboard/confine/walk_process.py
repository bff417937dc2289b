"""The process of one walk as its launcher sees it: forked, waited for, ended with everything it has started.

Where the system grants it, the process is alone in namespaces that exist for its walk only. Their first process forks
it, waits for it and says how it ended; the kernel ends all others in there with that one, while the launcher goes on.
"""

from __future__ import annotations

import contextlib
import errno
import os
import select
import signal
import socket
import sys
import time
from collections.abc import Callable, Sequence
from typing import Any, Final, Protocol

from pdrbench_leaderboard.confine import boot
from pdrbench_leaderboard.confine.boot import receive, send

KILL_S: Final = 2.0  # for the first process of a walk's namespaces to report how a killed child ended
WAIT_S: Final = 0.002


class WalkProcess(Protocol):
    """A child of the launcher, or of the first process of a walk's namespaces."""

    pid: int  # in the launcher's namespace
    handle: int  # descriptor that names it everywhere; -1 where there is none

    def wait(self, seconds: float) -> bool:
        """True once it has ended, False where it has not in that time."""

    def end(self, *, kill: bool) -> dict[str, Any]:
        """Waits for it, after killing it where asked to; ends what it has started.

        Returns:
            `status` as from wait(2), `peak_mb` of resident memory, `cpu_s` of processor time.
        """


class SharedWalk:
    """A child in the namespaces of the launcher."""

    def __init__(self, become: Callable[[], None]) -> None:
        self.handle = -1
        self.pid = _fork(become)
        with contextlib.suppress(OSError, AttributeError):
            self.handle = os.pidfd_open(self.pid)

    def wait(self, seconds: float) -> bool:
        """As `WalkProcess` says."""
        ends = time.monotonic() + seconds
        while not os.waitid(os.P_PID, self.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT):
            if time.monotonic() >= ends:
                return False
            time.sleep(WAIT_S)
        return True

    def end(self, *, kill: bool) -> dict[str, Any]:
        """As `WalkProcess` says."""
        if kill:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.pid, signal.SIGKILL)
        ended = _wait_for(self.pid)
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self.pid, signal.SIGKILL)
        _close(self.handle)
        return ended


class LoneWalk:
    """A child in namespaces of processes, files and communication that exist for it alone.

    Args:
        become: What the child runs; never returns.
        arrange: Arranges files in the new namespaces, before the child is forked.
        descriptors: Closed in the first process, so that their other ends close with the child.
        namespace: Descriptor of the launcher's own namespace of processes.

    Raises:
        OSError: The system does not grant it.
    """

    def __init__(
        self, become: Callable[[], None], arrange: Callable[[], None], descriptors: Sequence[int], namespace: int
    ) -> None:
        self._outcome, theirs = socket.socketpair()
        try:
            boot.check(boot.LIBC.unshare(boot.CLONE["namespace-pid"]))  # that of the next fork
            try:
                self._first = _fork(lambda: self._be_first(become, arrange, descriptors, theirs))
            finally:
                boot.check(boot.LIBC.setns(namespace, boot.CLONE["namespace-pid"]))
                theirs.close()
            _, handles = receive(self._outcome, 1)
        except (OSError, EOFError) as error:
            self._outcome.close()
            raise OSError(getattr(error, "errno", None) or errno.EPERM, "no namespaces for a walk") from error
        self.pid, self.handle = self._first, handles[0]

    def wait(self, seconds: float) -> bool:
        """As `WalkProcess` says."""
        return bool(select.select([self._outcome], [], [], seconds)[0])

    def end(self, *, kill: bool) -> dict[str, Any]:
        """As `WalkProcess` says; taking down the namespaces is left to the kernel, which takes its time."""
        if kill:
            with contextlib.suppress(ProcessLookupError):
                signal.pidfd_send_signal(self.handle, signal.SIGKILL)
        ended: dict[str, Any] = {}
        if self.wait(KILL_S):
            with contextlib.suppress(EOFError, ConnectionError):
                ended, _ = receive(self._outcome)
        if not ended:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self._first, signal.SIGKILL)
            ended = _wait_for(self._first)
        self._outcome.close()
        _close(self.handle)
        with contextlib.suppress(ChildProcessError):
            while os.waitpid(-1, os.WNOHANG)[0]:
                pass
        return ended

    def _be_first(
        self,
        become: Callable[[], None],
        arrange: Callable[[], None],
        descriptors: Sequence[int],
        control: socket.socket,
    ) -> None:
        self._outcome.close()
        boot.prctl(boot.PR_SET_PDEATHSIG, signal.SIGKILL)
        boot.check(boot.LIBC.unshare(boot.CLONE["namespace-mount"] | boot.CLONE["namespace-ipc"]))
        arrange()
        child = _fork(become)
        for descriptor in descriptors:
            os.close(descriptor)
        send(control, {}, [os.pidfd_open(child)])
        send(control, _wait_for(child))
        os._exit(0)


def _fork(act: Callable[[], None]) -> int:
    """A child that runs `act` and never returns from it."""
    pid = os.fork()
    if not pid:
        try:
            act()
        finally:
            os._exit(1)
    return pid


def _wait_for(pid: int) -> dict[str, Any]:
    _, status, usage = os.wait4(pid, 0)
    peak_kb = usage.ru_maxrss / (1024 if sys.platform == "darwin" else 1)
    cpu_s = usage.ru_utime + usage.ru_stime
    return {"status": status, "peak_mb": round(peak_kb / 1024, 1), "cpu_s": round(cpu_s, 3)}


def _close(descriptor: int) -> None:
    if descriptor >= 0:
        os.close(descriptor)
