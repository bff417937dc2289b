"""Runs the command line inside the test's process, and a stranger's package that does not load."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from pdrbench.cli import main


@dataclass(frozen=True)
class Outcome:
    """What a command left behind."""

    code: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        """Standard output, which must be one JSON document without NaN and nothing else."""
        return json.loads(self.out, parse_constant=lambda name: pytest.fail(f"{name} is not JSON"))


Command = Callable[..., Outcome]


@pytest.fixture
def command(capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Command:
    """Runs `pdrbench ARGUMENTS...` as in a log, where no terminal says how wide it is."""
    monkeypatch.delenv("COLUMNS", raising=False)

    def run(*arguments: object) -> Outcome:
        with pytest.raises(SystemExit) as stop:
            main([str(argument) for argument in arguments])
        captured = capfd.readouterr()
        assert isinstance(stop.value.code, int)
        return Outcome(stop.value.code, captured.out, captured.err)

    return run


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
