"""The process of one walk as its launcher sees it: forked, waited for, ended with everything it has started.

The process is alone in namespaces that exist for its walk only. Their first process forks it, waits for it and says how
it ended; the kernel ends all others in there with that one, while the launcher goes on.
"""

from __future__ import annotations

import contextlib
import errno
import os
import select
import signal
import socket
import sys
from collections.abc import Callable
from typing import Any, Final

from pdrbench_leaderboard.confine import boot
from pdrbench_leaderboard.confine.boot import receive, send

KILL_S: Final = 2.0  # for the first process of a walk's namespaces to report how a killed child ended
NUM_PIPES: Final = 3  # for requests, replies and output
PRIVATE_MODE: Final = 0o600


class LoneWalk:
    """A child in namespaces of processes, files and communication that exist for it alone.

    Its pipes are files of its own scratch folder: those that the kernel numbers would say how many others were made.

    Args:
        become: What the child runs, with its ends of the pipes; never returns.
        arrange: Arranges files in the new namespaces, before the child is forked.
        scratch: Folder of the walk, where its pipes are made.
        namespace: Descriptor of the launcher's own namespace of processes.

    Attributes:
        pid: Number of the first process in the launcher's namespace.
        handle: Descriptor that names the child everywhere.
        pipes: Our ends of those for requests, replies and output.

    Raises:
        OSError: The system does not grant it.
    """

    def __init__(
        self, become: Callable[[list[int]], None], arrange: Callable[[], None], scratch: str, namespace: int
    ) -> None:
        self._outcome, theirs = socket.socketpair()
        try:
            boot.check(boot.LIBC.unshare(boot.CLONE["namespace-pid"]))  # that of the next fork
            try:
                self._first = _fork(lambda: self._be_first(become, arrange, scratch, theirs))
            finally:
                boot.check(boot.LIBC.setns(namespace, boot.CLONE["namespace-pid"]))
                theirs.close()
            _, (self.handle, *self.pipes) = receive(self._outcome, 1 + NUM_PIPES)
        except (OSError, EOFError) as error:
            self._outcome.close()
            raise OSError(getattr(error, "errno", None) or errno.EPERM, "no namespaces for a walk") from error
        self.pid = self._first

    def wait(self, seconds: float) -> bool:
        """True once it has ended, False where it has not in that time."""
        return bool(select.select([self._outcome], [], [], seconds)[0])

    def end(self, *, kill: bool) -> dict[str, Any]:
        """Waits for it, after killing it where asked to; the kernel takes down the namespaces, and takes its time.

        Returns:
            `status` as from wait(2), `peak_mb` of resident memory, `cpu_s` of processor time.
        """
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
        os.close(self.handle)
        with contextlib.suppress(ChildProcessError):
            while os.waitpid(-1, os.WNOHANG)[0]:
                pass
        return ended

    def _be_first(
        self, become: Callable[[list[int]], None], arrange: Callable[[], None], scratch: str, control: socket.socket
    ) -> None:
        self._outcome.close()
        boot.prctl(boot.PR_SET_PDEATHSIG, signal.SIGKILL)
        boot.check(boot.LIBC.unshare(boot.CLONE["namespace-mount"] | boot.CLONE["namespace-ipc"]))
        arrange()
        ends = [_make_pipe(f"{scratch}/{number}") for number in range(NUM_PIPES)]
        theirs = [ends[0][0], ends[1][1], ends[2][1]]
        ours = [ends[0][1], ends[1][0], ends[2][0]]
        child = _fork(lambda: become(theirs))
        for descriptor in theirs:
            os.close(descriptor)
        send(control, {}, [os.pidfd_open(child), *ours])
        for descriptor in ours:
            os.close(descriptor)
        send(control, _wait_for(child))
        os._exit(0)


def _make_pipe(path: str) -> tuple[int, int]:
    """Ends for reading and writing of a pipe whose number is that of a file."""
    os.mkfifo(path, PRIVATE_MODE)
    reading = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    writing = os.open(path, os.O_WRONLY | os.O_CLOEXEC)
    os.set_blocking(reading, True)
    os.unlink(path)  # noqa: PTH108
    return reading, writing


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
