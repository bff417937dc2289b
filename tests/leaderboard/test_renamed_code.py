"""Entries stay valid when code is rewritten: an entry consists of its estimates."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
ENTRIES = ("BuildingSite-v1/stay-v0", "BuildingSite-v1/koeping2012-v0", "PhoneHandling-v1/li2012-v0")
RENAMED = "wrap_rad"  # that the simulator, the filters and the localizers call


@pytest.mark.long(seconds=100)
def test_a_function_renamed_everywhere_refuses_no_entry(tmp_path: Path) -> None:
    if not (ROOT / "leaderboards").is_dir() or not (ROOT / "envs").is_dir():
        pytest.skip("not a checkout")
    for folder in ("pdrbench", "envs", "baselines"):
        shutil.copytree(ROOT / folder, tmp_path / folder, ignore=shutil.ignore_patterns("__pycache__"))
    for entry in ENTRIES:
        shutil.copytree(ROOT / "leaderboards" / entry, tmp_path / "leaderboards" / entry)
    shutil.copy(ROOT / "leaderboards" / "keys.toml", tmp_path / "leaderboards")  # by which verifications are signed
    changed = 0
    for path in tmp_path.rglob("*.py"):
        text = path.read_text()
        changed += len(re.findall(rf"\b{RENAMED}\b", text))
        path.write_text(re.sub(rf"\b{RENAMED}\b", "wrapped_rad", "# Another first line.\n" + text))
    assert changed > 50
    for entry in ENTRIES:
        out = command(tmp_path, "submit", "verify", f"leaderboards/{entry}", "--rerun", "--share", "0.1", "--seed", "1")
        assert "give the same bytes" in out
    command(tmp_path, "leaderboard", "build", "--root", "leaderboards", "--out", "site")
    assert "5 of 5 checks passed" in command(tmp_path, "leaderboard", "check", "--root", "leaderboards")


def command(copy: Path, *arguments: str) -> str:
    """Output of a command of the copy; fails where the code that runs is not that of the copy."""
    places = [str(copy), str(copy / "envs"), str(copy / "baselines")]
    program = (
        "import sys, pdrbench_sim, pdrbench_baselines\n"
        "import pdrbench.geometry as geometry, pdrbench.cli as cli\n"
        "assert hasattr(geometry, 'wrapped_rad') and pdrbench_sim.__file__.startswith(sys.path[1])\n"
        f"sys.argv = ['pdrbench', *{arguments!r}]\n"
        "cli.main()\n"
    )
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(places), "PDRBENCH_CACHE": str(copy / "cache")}
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=copy, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout
