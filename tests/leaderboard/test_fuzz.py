"""The fuzzer of the readers runs, and finds nothing in a few seconds; it is meant to be run for longer by hand."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

FUZZER = Path(__file__).with_name("fuzz_readers.py")
SECONDS = 8
TARGETS = (
    *("bundle", "card", "estimates", "folder", "keys", "lock", "member", "records", "replies", "signed"),
    "wheel",
)
LEAST_RUNS = 500  # a machine on which it does fewer is no evidence


@pytest.mark.long(seconds=10)
@pytest.mark.parametrize("target", TARGETS)
def test_readers_raise_the_documented_error_only(target: str, tmp_path: Path) -> None:
    pytest.importorskip("atheris", reason="pip install atheris")
    ended = subprocess.run(
        [sys.executable, str(FUZZER), target, "--seconds", str(SECONDS), "--corpus", str(tmp_path / target)],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        text=True,
        errors="replace",
        timeout=200,
        check=False,
    )
    assert ended.returncode == 0, ended.stderr[-3000:]
    assert int(re.findall(r"Done (\d+) runs", ended.stderr)[0]) >= LEAST_RUNS
    assert [path.name for path in tmp_path.iterdir()] == [target], "no input was kept as a finding"
