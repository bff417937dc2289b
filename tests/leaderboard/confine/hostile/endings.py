"""Walks that end before their time."""

from __future__ import annotations

import contextlib
import os
import signal

from hostile.common import MEBIBYTE, Honest, define, fail
from pdrbench.errors import UnsuitableError

define(
    globals(),
    Honest,
    "misbehave",
    {
        "ExitsAsIfNothing": lambda self: os._exit(0),
        "RaisesWithoutEnd": lambda self: fail(ValueError("x" * (16 * MEBIBYTE))),
        "Declines": lambda self: fail(UnsuitableError("this walk is too hard")),
        "Colours": lambda self: fail(ValueError("\x1b[2J\x1b]0;owned\x07 \x9b31m gone")),  # would clear the terminal
    },
)


class KillsItsParent(Honest):
    """In earnest, where there is one to be seen."""

    def misbehave(self) -> object:
        with contextlib.suppress(OSError):
            return os.kill(os.getppid(), signal.SIGKILL) if os.getppid() else None


class CannotBeTold(Honest):
    """An error that raises again when it is printed."""

    def misbehave(self) -> object:
        class Rude(Exception):
            def __str__(self) -> str:
                raise self

        raise Rude
