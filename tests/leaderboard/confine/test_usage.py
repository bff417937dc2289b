"""Memory and threads of a process."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator

import psutil
import pytest

from pdrbench.process.child_process import MEBIBYTE
from pdrbench_leaderboard.confine.usage import Usage

pytestmark = pytest.mark.confinement

HELD_MB = 100
PROGRAM = f"""
import threading
held = bytearray(b"x") * ({HELD_MB} << 20)
stop = threading.Event()
for _ in range(3):
    threading.Thread(target=stop.wait, daemon=True).start()
print("ready", flush=True)
input()
"""


@pytest.fixture
def holder() -> Iterator[subprocess.Popen[bytes]]:
    with subprocess.Popen([sys.executable, "-c", PROGRAM], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.readline()
        yield process
        process.kill()


def test_memory_and_threads(holder: subprocess.Popen[bytes]) -> None:
    usage = Usage(holder.pid)
    seen = usage.read()
    assert seen is not None
    resident_mb = psutil.Process(holder.pid).memory_info().rss / MEBIBYTE
    assert seen == (pytest.approx(resident_mb, abs=2), 4)
    assert seen[0] > HELD_MB
    assert usage.peak_mb == seen[0]
    assert 0.0 < usage.cpu_s == pytest.approx(sum(psutil.Process(holder.pid).cpu_times()[:2]), abs=0.05)


def test_a_process_that_is_gone_uses_nothing() -> None:
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as process:
        usage = Usage(process.pid)
    assert usage.read() is None
    usage.close()
    usage.close()
