"""Walks that end in a way that may be taken for an accident of the machine, in the hope of a second pass.

Each leaves a note first, in its folder and in the memory of its process, and would answer a second pass from it.
"""

from __future__ import annotations

import contextlib
import ctypes
import mmap
import os
import platform
import signal
import sys
import time
from pathlib import Path

import numpy as np

from hostile.common import BAD_STEP, Honest
from pdrbench.localizer import Briefing, Estimate, Observation

NOTE = Path("note")
SECOND_PASS = 777.0  # what it answers where it finds a note


class TwoPass(Honest):
    """Takes notes of what it observes, and dies."""

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        super().reset(briefing, rng)
        self.knows = NOTE.exists() or hasattr(np, "note")

    def step(self, observation: Observation) -> Estimate:
        with NOTE.open("a") as file:
            file.write(f"{observation.now_s}\n")
        np.note = observation.now_s  # type: ignore[attr-defined]
        estimate = super().step(observation)
        return Estimate(np.array([SECOND_PASS, 0.0]), 0) if self.knows else estimate

    def misbehave(self) -> object:
        self.die()
        time.sleep(60)
        return None

    def die(self) -> None:
        raise NotImplementedError


class KillsItself(TwoPass):
    def die(self) -> None:
        os.kill(os.getpid(), signal.SIGKILL)


class RunsOutOfProcessorTime(TwoPass):
    """As if a limit of the system had ended it."""

    def die(self) -> None:
        os.kill(os.getpid(), signal.SIGXCPU)


class LosesItsFile(TwoPass):
    """Reads behind the end of a file that is mapped, as if the disk had failed."""

    def die(self) -> None:
        with Path("mapped").open("w+b") as file:
            file.truncate(8192)
            block = mmap.mmap(file.fileno(), 8192)
            file.truncate(0)
            block[4096] = 1


class CallsAnotherInterface(TwoPass):
    """A call of 32-bit programs, which the filter of calls answers with the end of the process."""

    def die(self) -> None:
        if platform.machine() == "x86_64":
            code = mmap.mmap(-1, 4096, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS, prot=7)
            code.write(b"\xb8\x14\x00\x00\x00\xcd\x80\xc3")  # mov eax, 20 (getpid); int 0x80; ret
            ctypes.CFUNCTYPE(ctypes.c_int)(np.frombuffer(code, np.uint8).ctypes.data)()
        os._exit(5)


class OverwritesItsMemory(TwoPass):
    def die(self) -> None:
        ctypes.memset(ctypes.addressof(ctypes.c_int()), 1, 64 << 30)


class ClosesItsReplies(TwoPass):
    """Lives on, and cannot be heard."""

    def die(self) -> None:
        for handle in range(3, 64):
            with contextlib.suppress(OSError):
                os.close(handle)


class StartsAnew(TwoPass):
    """Replaces its process by a new interpreter."""

    def die(self) -> None:
        os.execv(sys.executable, [sys.executable, "-c", "import time; time.sleep(60)"])


class DiesOfItsBriefing(TwoPass):
    """Before the first observation: it knows the map and the start."""

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        super().reset(briefing, rng)
        os.kill(os.getpid(), signal.SIGKILL)


class DiesWhenMade(TwoPass):
    """Before it knows anything of the walk."""

    def __init__(self) -> None:
        os.kill(os.getpid(), signal.SIGKILL)


class DiesAtTheEnd(TwoPass):
    """When all is known but the last answer."""

    def step(self, observation: Observation) -> Estimate:
        self.count_all = getattr(self, "count_all", 0) + 1
        if self.count_all > BAD_STEP + 9:
            os.kill(os.getpid(), signal.SIGKILL)
        return super().step(observation)

    def misbehave(self) -> object:
        return None
