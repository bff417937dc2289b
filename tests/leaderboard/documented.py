"""Pages of the documentation as a reader follows them: files are written, commands run, in order."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

BLOCK: Final = re.compile(
    r'^```(?P<kind>\w+)(?: title="(?P<title>[^"]+)")?\n(?P<text>.*?)^```$', re.MULTILINE | re.DOTALL
)
PROGRAMS: Final = {
    "pdrbench": f"#!{sys.executable}\nfrom pdrbench.cli import main\nmain()\n",
    "python": f'#!/bin/sh\nexec {sys.executable} "$@"\n',
}


def follow(
    page: Path,
    folder: Path,
    scripts: Path,
    variables: Mapping[str, str] | None = None,
    change: Callable[[str], str] = str,
) -> int:
    """Follows a page in a folder; how many blocks of commands ran, none of which may fail.

    Args:
        page: Markdown; a block with a title is a file.
        folder: Where its reader is.
        scripts: New folder for `pdrbench` and `python`: whatever else is installed under these names, those under test
            are run.
        variables: Of the environment, besides those of this process.
        change: Made to the text of each file.
    """
    scripts.mkdir()
    for name, text in PROGRAMS.items():
        (scripts / name).write_text(text)
        (scripts / name).chmod(0o755)
    environment = {**os.environ, "PATH": f"{scripts}{os.pathsep}{os.environ['PATH']}", **(variables or {})}
    ran = 0
    for block in BLOCK.finditer(page.read_text(encoding="utf-8")):
        if block["title"]:
            (folder / block["title"]).parent.mkdir(exist_ok=True)
            (folder / block["title"]).write_text(change(block["text"]), encoding="utf-8")
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
    return ran
