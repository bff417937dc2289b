"""Compiled code is loaded from the cache until a kernel that became part of it, or a number in it, has changed."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from pdrbench.compiled import compiled, inner

CALLEE = """
from pdrbench.compiled import compiled
FACTOR = {factor}
@compiled
def scaled(x):
    return {sign} FACTOR * x
"""
CALLER = """
from pdrbench.compiled import compiled
from callee import FACTOR, scaled
@compiled
def twice(x):
    return 2.0 * scaled(x) + 0.0 * FACTOR
print(twice(1.0), sum(twice.stats.cache_hits.values()))
"""


@pytest.fixture
def run(tmp_path: Path):
    """Writes both modules and runs the caller in a new process: its result, and how many functions the cache had."""

    def run(factor: float, sign: str = "") -> tuple[float, int]:
        (tmp_path / "callee.py").write_text(CALLEE.format(factor=factor, sign=sign))
        (tmp_path / "caller.py").write_text(CALLER)
        environ = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONDONTWRITEBYTECODE": "1"}
        command = [sys.executable, "caller.py"]
        done = subprocess.run(command, cwd=tmp_path, env=environ, check=True, capture_output=True, text=True)
        result, hits = done.stdout.split()
        return float(result), int(hits)

    return run


def test_a_change_of_a_called_kernel_or_of_a_number_is_noticed(run) -> None:
    assert run(3.0) == (6.0, 0)
    assert run(3.0) == (6.0, 1)
    assert run(4.0, "-") == (-8.0, 0)


def test_only_kernels_call_an_inner_one() -> None:
    part = inner(lambda x: x + 1)
    assert compiled(lambda x: 2 * part(x))(3) == 8
    with pytest.raises(TypeError, match="only kernels"):
        part(3)
