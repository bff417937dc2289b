"""What a launcher loads of Numba for its children."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from pdrbench.arithmetic import THREADS
from pdrbench.registry import localizers
from pdrbench_leaderboard.confine.read_permissions import permissions_of

COUNT = """
from pathlib import Path
import pdrbench_baselines.woodman2008.localizer
from pdrbench_leaderboard.confine import numba_cache
before = len(list(Path("/proc/self/task").iterdir()))
numba_cache.prepare()
assert len(list(Path("/proc/self/task").iterdir())) == before, "a process with threads must not be forked"
"""


@pytest.mark.parametrize(
    ("line", "calls"),
    [
        ("from pdrbench.filters.map_walk import walk_sorted", True),
        ("import numba", True),
        ("from pdrbench.localizer import Estimate", False),
        ("import numpy", False),
    ],
)
def test_sources_of_a_user_say_whether_compiled_functions_are_called(tmp_path: Path, line: str, calls: bool) -> None:
    file = tmp_path / "mine.py"
    file.write_text(f"{line}\n\n\nclass Mine:\n    pass\n")
    assert permissions_of(f"{file}:Mine", f"{file}:Mine").calls_compiled is calls


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="threads are counted in /proc")
def test_preparing_starts_no_thread() -> None:
    done = subprocess.run(
        [sys.executable, "-c", COUNT], env={**os.environ, **THREADS}, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("localizer", "named", "left_out"),
    [("stay", set(), {"torch", "pandas", "scipy.signal"}), ("learned", {"safetensors"}, {"torch"})],
)
def test_a_launcher_imports_the_libraries_of_the_localizer_not_of_its_package(
    localizer: str, named: set[str], left_out: set[str]
) -> None:
    imports = set(permissions_of(localizer, localizers()[localizer].target).imports)
    assert "pdrbench.localizer" in imports
    assert named <= imports
    assert not left_out & imports
