"""The page "Submit in ten minutes" works: every block, in order, in an empty folder."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from pdrbench_leaderboard.entry import read_entry

PAGE = Path(__file__).resolve().parents[2] / "docs" / "submit.md"
BLOCK = re.compile(r'^```(?P<kind>\w+)(?: title="(?P<title>[^"]+)")?\n(?P<text>.*?)^```$', re.MULTILINE | re.DOTALL)

pytestmark = pytest.mark.skipif(not PAGE.is_file(), reason="documentation is not part of a wheel")


@pytest.mark.long(seconds=60)
@pytest.mark.timeout(900)
def test_from_a_class_to_a_row(tmp_path: Path) -> None:
    """A folder outside the repository, with nothing but what the page writes there."""
    scripts = tmp_path / "bin"
    scripts.mkdir()
    command = scripts / "pdrbench"  # whatever else is installed under this name, the one under test is run
    command.write_text(f"#!{sys.executable}\nfrom pdrbench.cli import main\nmain()\n")
    command.chmod(0o755)
    folder = tmp_path / "empty"
    folder.mkdir()
    environment = os.environ | {"PATH": f"{scripts}{os.pathsep}{os.environ['PATH']}"}
    ran = 0
    for block in BLOCK.finditer(PAGE.read_text(encoding="utf-8")):
        if block["title"]:
            (folder / block["title"]).write_text(block["text"], encoding="utf-8")
        elif block["kind"] == "bash":
            done = subprocess.run(
                ["bash", "-euo", "pipefail", "-c", block["text"]],
                cwd=folder,
                env=environment,
                capture_output=True,
                text=True,
                check=False,
            )
            assert done.returncode == 0, f"{block['text']}\n{done.stdout}\n{done.stderr}"
            ran += 1
    assert ran == 4
    entry = folder / "leaderboards" / "OfficeStride-v1" / "mine-v0"
    assert read_entry(entry).tier == "reproduced"
    assert "mine-v0" in (entry.parent / "TABLE.md").read_text()
    assert (folder / "site" / "index.html").is_file()
