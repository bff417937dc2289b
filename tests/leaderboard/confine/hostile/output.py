"""Words on every descriptor there is."""

from __future__ import annotations

import contextlib
import os

from hostile.common import Honest


class Floods(Honest):
    """Writes to standard output for ever, and never answers."""

    def misbehave(self) -> object:
        block = bytes(range(256)) * 4096
        while True:
            os.write(1, block)


class Garbage(Honest):
    """Ten megabytes on standard output and error."""

    def misbehave(self) -> object:
        block = bytes(range(256)) * 4096
        for _ in range(5):
            os.write(1, block)
            os.write(2, block)
        print("the end of the garbage", flush=True)
        return None


class GarbageEverywhere(Honest):
    """Ten bytes on every descriptor there is."""

    def misbehave(self) -> object:
        for handle in range(256):
            with contextlib.suppress(OSError):
                os.write(handle, b"\xff\xfe\xfd garbage"[:10])
        return None


class ReadsEverything(Honest):
    """Removes files that others read."""

    def misbehave(self) -> object:
        for handle in range(3, 64):
            with contextlib.suppress(OSError):
                os.set_blocking(handle, False)
                os.read(handle, 4096)
        return None
