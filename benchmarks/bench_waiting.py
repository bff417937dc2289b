"""What people wait for: processor and wall seconds of commands, as a new user runs them, with caches of their own.

    python benchmarks/bench_waiting.py [NAME...]

Names are those of the rows; without any, all rows are measured, in some minutes. Commands that a row needs beforehand
are run for it. Run it in a clone: the leaderboards are those of the clone, and what is written goes to a folder that is
removed.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

PDRBENCH = "from pdrbench.cli import main; main()"
COMPARE = ["compare", "--env", "OfficeStride-v1", "--jobs", "2", "--out", "{folder}/compared"]
BUILD = ["leaderboard", "build", "--out", "{folder}/site"]
PACK = ["submit", "pack", "stay-v0", "--suite", "pdr-core-v2", "--results", "{folder}/walks", "--jobs", "2"]
READ = "from pdrbench.registry import make_task; t = make_task('MallPhone-v1'); t.load(t.split('val')[0])"
ROWS: dict[str, list[str]] = {
    "numpy": ["-c", "import numpy"],  # in all that follow; shows how fast the machine is just now
    "import": ["-c", "import pdrbench"],
    "help": ["-c", PDRBENCH, "--help"],
    "compare": ["-c", PDRBENCH, *COMPARE],
    "compare_again": ["-c", PDRBENCH, *COMPARE],
    "build": ["-c", PDRBENCH, *BUILD],
    "build_again": ["-c", PDRBENCH, *BUILD],
    "check": ["-c", PDRBENCH, "leaderboard", "check"],
    "pack": ["-c", PDRBENCH, *PACK, "--out", "{folder}/packed.pdrz"],
    "pack_again": ["-c", PDRBENCH, *PACK, "--out", "{folder}/again.pdrz"],
    "check_localizer": ["-c", PDRBENCH, "check", "localizer", "stay-v0"],
    "check_network": ["-c", PDRBENCH, "check", "localizer", "learned-v2"],
    "read_mall_walk": ["-c", READ],
}
BEFORE = {"compare_again": "compare", "build_again": "build", "pack_again": "pack"}  # what has to have run


def run(arguments: list[str], folder: Path) -> tuple[float, float, int]:
    """Processor and wall seconds, and the exit status, with the caches of a folder."""
    caches = {"NUMBA_CACHE_DIR": f"{folder}/numba", "PDRBENCH_CACHE": f"{folder}/cache"}
    environ = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"} | caches
    before, began_s = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    command = [sys.executable, *(argument.format(folder=folder) for argument in arguments)]
    status = subprocess.run(command, env=environ, capture_output=True, check=False).returncode
    wall_s, after = time.perf_counter() - began_s, resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, wall_s, status


def main() -> None:
    wanted = sys.argv[1:] or list(ROWS)
    if unknown := set(wanted) - set(ROWS):
        sys.exit(f"no rows {', '.join(sorted(unknown))}; there are {', '.join(ROWS)}")
    print(f"{'row':>16} {'processor':>10} {'wall':>8}")
    with tempfile.TemporaryDirectory() as place:
        done: set[str] = set()
        for name in wanted:
            needed = BEFORE.get(name)
            for row in [needed, name] if needed and needed not in done else [name]:
                processor_s, wall_s, status = run(ROWS[row], Path(place))
                print(
                    f"{row:>16} {processor_s:8.2f} s {wall_s:6.1f} s{f', exit {status}' if status else ''}", flush=True
                )
                done.add(row)


if __name__ == "__main__":
    main()
