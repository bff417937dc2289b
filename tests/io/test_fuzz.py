"""The fuzzer of the readers of recordings runs, and finds nothing in a few seconds; it is meant to run for longer."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

FUZZER = Path(__file__).with_name("fuzz_recordings.py")
SECONDS = 8
NAMES = ("getsensordata", "sensor logger, iOS", "sensor logger, JSON", "phyphox", "xsens mt", "csv", "ronin", "ros 1")


@pytest.mark.long(seconds=12)
@pytest.mark.parametrize("name", NAMES)
def test_readers_raise_the_documented_error_only(name: str, tmp_path: Path) -> None:
    pytest.importorskip("atheris", reason="pip install atheris")
    ended = subprocess.run(
        [sys.executable, str(FUZZER), name, "--seconds", str(SECONDS), "--corpus", str(tmp_path / "corpus")],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        text=True,
        errors="replace",
        timeout=200,
        check=False,
    )
    assert ended.returncode == 0, ended.stderr[-3000:]
    assert int(re.findall(r"Done (\d+) runs", ended.stderr)[0]) >= 20
    assert [path.name for path in tmp_path.iterdir()] == ["corpus"], "no input was kept as a finding"
