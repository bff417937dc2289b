"""Replies that no request asked for, or that are none."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator

import msgspec

from hostile.common import MEBIBYTE, Honest, define
from pdrbench.episode import EstimateRow
from pdrbench.process import messages


class Forger(Honest):
    """Writes to the descriptor of the replies itself."""

    rests_s = 0.0  # after that, so that what it wrote is read before its own reply comes

    def misbehave(self) -> object:
        handle, number = self.pipe()
        for part in self.bytes(number):
            left = memoryview(part)
            while left:
                left = left[os.write(handle, left) :]
        time.sleep(self.rests_s)
        return None

    def pipe(self) -> tuple[int, int]:
        """Descriptor of the replies and number of the request, from the frames that wait for this one."""
        handle, number = -1, -1
        frame = sys._getframe()
        while frame is not None:
            here = frame.f_locals
            handle = here["replies"] if isinstance(here.get("replies"), int) else handle
            number = getattr(here.get("request"), "number", number)
            frame = frame.f_back  # type: ignore[assignment]
        return handle, number

    def bytes(self, number: int) -> Iterator[bytes]:
        raise NotImplementedError


def reply_to(number: int) -> bytes:
    return bytes(messages.frame(messages.Answer(number, EstimateRow(0.0, 0.0, 0.0, 0.0, 0.0, 0.0))))


def framed(body: bytes) -> bytes:
    return len(body).to_bytes(4, "little") + body


class ForgerThatRests(Forger):
    rests_s = 5.0


class GigabyteReply(Forger):
    def bytes(self, number: int) -> Iterator[bytes]:
        yield (1 << 30).to_bytes(4, "little")
        for _ in range(1024):
            yield bytes(MEBIBYTE)


class Drips(Forger):
    """One byte at a time, for ever: something always comes."""

    def bytes(self, number: int) -> Iterator[bytes]:
        yield (50_000).to_bytes(4, "little")
        while True:
            yield b"\x00"
            time.sleep(0.02)


define(globals(), Forger, "bytes", {"Twice": lambda self, number: [reply_to(number)]})
define(
    globals(),
    ForgerThatRests,
    "bytes",
    {
        "WrongStep": lambda self, number: [reply_to(number + 1)],
        "NotSixNumbers": lambda self, number: [framed(msgspec.msgpack.encode(["answer", number, [0.0, 0.0, 0.0]]))],
        "NoMessage": lambda self, number: [framed(bytes(range(100, 200)))],
    },
)
