"""What starts the process of a localizer: the plain one of this room, or one that a package adds by entry point."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, Literal, Protocol, cast

from pdrbench.errors import PdrbenchError
from pdrbench.process.child_process import Ended, Limits, warm_process
from pdrbench.registry import LAUNCHERS_GROUP, entries

Isolation = Literal["process", "confined", "none"]
PROCESS: Final = "process"
CONFINED: Final = "confined"


@dataclass(frozen=True, slots=True)
class LaunchOrder:
    """The localizer for which a process is wanted."""

    localizer: str  # as the user named it
    target: str  # where its class is: `module:Class` or `/absolute/file.py:Class`, or a folder
    walk_s: float  # wall time that it has for a walk
    limits: Limits = field(default_factory=Limits)
    is_rehearsal: bool = False  # whether what is compiled is kept for the walks to come


class Process(Protocol):
    """The process of a localizer, seen from the evaluating side.

    Attributes:
        facts: How it is isolated: `mode`, the protections `held`, and why others are `missing`, by name.
        last_read_s: When something was last read from it, on the monotonic clock.
    """

    @property
    def facts(self) -> Mapping[str, object]: ...

    @property
    def last_read_s(self) -> float: ...

    @property
    def output(self) -> str:
        """The end of what it wrote to standard output and error since it was handed out."""

    def ask(self, request: bytearray, ends_s: float, max_bytes: int) -> bytes:
        """Sends one frame and waits for one; returns its body.

        Args:
            request: The frame.
            ends_s: Until when, on the monotonic clock.
            max_bytes: Of the reply.

        Raises:
            LateError: No whole reply came in time.
            EndedError: The process ended, or exceeds a limit.
            ProtocolError: The reply is not a single frame of at most that size.
        """

    def check_silence(self) -> None:
        """Raises `ProtocolError` where an answer came without a request."""

    def request_traceback(self) -> None:
        """Has a process whose time is up write a traceback, where the system has a signal for that."""

    def release(self) -> Ended:
        """Gives it back after a walk that went well: it may serve the next one; what the walk used."""

    def end(self, grace_s: float = 0.0) -> Ended:
        """Ends it and what it has started, after waiting up to so many seconds; may be called again."""


class Launcher(Protocol):
    """Starts processes for localizers."""

    def check(self, localizer: str, target: str) -> None:
        """Raises `PdrbenchError` where it could start none for a localizer; called before anything is run."""

    def wants_rehearsal(self, order: LaunchOrder) -> bool:
        """Whether the localizer should play a walk that is not scored first, once, so that it compiles only then."""

    def launch(self, order: LaunchOrder, ends_s: float) -> Process:
        """A process in which no localizer has been made for this walk.

        Raises:
            LaunchError: None can be started until `ends_s`, on the monotonic clock.
        """


class PlainLauncher:
    """Processes by the standard means, the same on every system; each stays for the next walk of its package."""

    def check(self, localizer: str, target: str) -> None:
        """Everything can be run."""

    def wants_rehearsal(self, order: LaunchOrder) -> bool:
        """A process stays, and with it what it has compiled."""
        return False

    def launch(self, order: LaunchOrder, ends_s: float) -> Process:
        """A warm process, or a new one."""
        return warm_process(order.target, order.limits, ends_s)


def find_launcher(isolation: str) -> Launcher:
    """The launcher of a kind of isolation.

    Raises:
        PdrbenchError: No installed package has one of this kind.
    """
    if isolation == PROCESS:
        return PlainLauncher()
    found = entries(LAUNCHERS_GROUP).get(isolation)
    if found is None:
        raise PdrbenchError(
            f"no package that is installed runs localizers {isolation!r}; the one with the leaderboards does, "
            f"or leave that out"
        )
    return cast(Launcher, found.load()())
