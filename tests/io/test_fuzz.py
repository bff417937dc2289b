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
READERS = ("getsensordata", "sensor_logger", "phyphox", "xsens", "csv", "ronin", "ros")
MODULES = {"csv": "csv_columns"}


@pytest.mark.long(seconds=12)
@pytest.mark.parametrize("reader", READERS)
def test_readers_raise_the_documented_error_only(reader: str, tmp_path: Path) -> None:
    pytest.importorskip("atheris", reason="pip install atheris")
    ended = subprocess.run(
        [sys.executable, str(FUZZER), reader, str(SECONDS), "--keep", str(tmp_path / "found")],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        text=True,
        errors="replace",
        timeout=200,
        check=False,
    )
    assert ended.returncode == 0, ended.stderr[-3000:]
    assert f"Instrumenting pdrbench_formats.recordings.{MODULES.get(reader, reader)}\n" in ended.stderr
    assert int(re.findall(r"Done (\d+) runs", ended.stderr)[0]) >= 20
    assert not list(tmp_path.iterdir()), "no input was kept as a finding"
