"""Readers take a few times the size of a file."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from recording_samples import SAMPLES, make_walk

MOST = 5.0  # times the size of the file
WALK_S = 300.0
PEAK = """
import sys
from pdrbench_formats.detect import read
def peak_kib():
    return int(next(line for line in open("/proc/self/status") if line.startswith("VmHWM")).split()[1])
kind, small, path = sys.argv[1:]
read(small, kind)  # loads and compiles what is loaded and compiled once
open("/proc/self/clear_refs", "w").write("5")  # the peak begins anew
before = peak_kib()
read(path, kind)
print(1024 * (peak_kib() - before))
"""


def test_memory_for_a_walk_of_five_minutes(tmp_path: Path) -> None:
    sample = SAMPLES["getsensordata"]
    (tmp_path / "small").mkdir()
    small = sample.write(tmp_path / "small", make_walk(3.0))
    path = sample.write(tmp_path, make_walk(WALK_S))
    ran = subprocess.run(
        [sys.executable, "-c", PEAK, sample.reader, str(small), str(path)], capture_output=True, text=True, check=True
    )
    assert int(ran.stdout) <= MOST * path.stat().st_size
