"""A package from outside that does not load."""

from __future__ import annotations

from pathlib import Path

import pytest
from installed import declare


@pytest.fixture
def outside(tmp_path: Path) -> Path:
    """A folder for PYTHONPATH with an installed package: one entry point is broken, one names a module that is."""
    (tmp_path / "outside_plugin.py").write_text(
        'LOCALIZERS = {"rusty-v0": "outside_rusty:Rusty"}\nENVIRONMENTS = {"Rust-v0": "outside_rusty:task"}\n'
    )
    (tmp_path / "outside_rusty.py").write_text('print("on import")\nraise RuntimeError("rusted through")\n')
    declare(
        tmp_path,
        "outside",
        "[pdrbench.localizers]\nmine = outside_plugin:LOCALIZERS\ngone = outside_gone:LOCALIZERS\n"
        "[pdrbench.environments]\nmine = outside_plugin:ENVIRONMENTS\n",
    )
    return tmp_path
