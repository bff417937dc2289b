"""Processes, threads, memory, files and descriptors without end, capped where nothing protects the machine."""

from __future__ import annotations

import contextlib
import os
import tempfile
import threading
import time
from pathlib import Path

import numpy as np

from hostile.common import MEBIBYTE, Honest
from pdrbench.localizer import Estimate

MAX_FORKS, MAX_THREADS, MAX_FILES = 300, 3_000, 20_000
MAX_BYTES = 6 << 30


class ForkBomb(Honest):
    def misbehave(self) -> object:
        started = 0
        for _ in range(MAX_FORKS):
            with contextlib.suppress(OSError):
                if os.fork() == 0:
                    time.sleep(30)
                    os._exit(0)
                started += 1
        return Estimate(np.array([float(started), 0.0]), 0)


class ThreadBomb(Honest):
    def misbehave(self) -> object:
        done = threading.Event()
        started = 0
        with contextlib.suppress(RuntimeError):
            for _ in range(MAX_THREADS):
                threading.Thread(target=done.wait, daemon=True).start()
                started += 1
        done.set()
        return Estimate(np.array([float(started), 0.0]), 0)


class DiskFillerOfManyFiles(Honest):
    def misbehave(self) -> object:
        written = 0
        for number in range(MAX_FILES):
            more = fill(Path(tempfile.gettempdir()) / f"small-{number}", MEBIBYTE)
            written += more
            if not more:
                break
        return Estimate(np.array([float(written), 0.0]), 0)


def fill(path: Path, most: int) -> int:
    written, block = 0, b"\1" * MEBIBYTE
    with contextlib.suppress(OSError), path.open("wb", buffering=0) as file:
        while written < most:
            written += file.write(block)
    return written


class DeepFolders(Honest):
    """Nested folders, deeper than a recursive cleanup can descend."""

    def misbehave(self) -> object:
        os.chdir(tempfile.gettempdir())
        for _ in range(1_200):
            with contextlib.suppress(OSError):
                os.mkdir("a-long-name")  # noqa: PTH102
                os.chdir("a-long-name")
        return None


class OpensFiles(Honest):
    """As many descriptors as there are."""

    def misbehave(self) -> object:
        opened = []
        with contextlib.suppress(OSError):
            for _ in range(1 << 20):
                opened.append(os.open("/dev/null", os.O_RDONLY))
        for handle in opened:
            os.close(handle)
        return Estimate(np.array([float(len(opened)), 0.0]), 0)


class LeavesDaemons(Honest):
    """Children of children in sessions of their own, which outlive the walk, and a thread that does not end."""

    def misbehave(self) -> object:
        threading.Thread(target=time.sleep, args=(3600,), daemon=False).start()
        with contextlib.suppress(OSError):
            if os.fork() == 0:
                os.setsid()
                if os.fork() == 0:
                    time.sleep(120)
                os._exit(0)
        return None
