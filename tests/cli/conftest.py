"""A stranger's package that does not load."""

from __future__ import annotations

from pathlib import Path

import pytest


@pytest.fixture
def stranger(tmp_path: Path) -> Path:
    """A folder for PYTHONPATH with an installed package: one entry point is broken, one names a module that is."""
    (tmp_path / "stranger_plugin.py").write_text(
        'LOCALIZERS = {"rusty-v0": "stranger_rusty:Rusty"}\nENVIRONMENTS = {"Rust-v0": "stranger_rusty:task"}\n'
    )
    (tmp_path / "stranger_rusty.py").write_text('print("on import")\nraise RuntimeError("rusted through")\n')
    info = tmp_path / "stranger-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: stranger\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(
        "[pdrbench.localizers]\nmine = stranger_plugin:LOCALIZERS\ngone = stranger_gone:LOCALIZERS\n"
        "[pdrbench.environments]\nmine = stranger_plugin:ENVIRONMENTS\n"
    )
    return tmp_path
