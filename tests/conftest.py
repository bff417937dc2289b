"""Fixtures that every room's tests share."""

from __future__ import annotations

import contextlib
import ctypes
import json
import os
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
from hypothesis import HealthCheck, settings

from pdrbench.cli import main

# How long drawing takes says how busy a machine is, and nothing of what is tested.
settings.register_profile("busy", suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("busy")

PR_SET_CHILD_SUBREAPER = 36
GONE_WITHIN_S = 20.0  # a process that has just been started takes some seconds to look around


@pytest.fixture
def rng() -> np.random.Generator:
    """A generator with a fixed seed: same numbers in every run."""
    return np.random.default_rng(20080921)


@pytest.fixture(scope="session")
def data_root() -> Path:
    """Folder that holds the recorded datasets by name; skips where there is none."""
    for place in os.environ.get("PDRBENCH_DATA", "").split(os.pathsep):
        if place and Path(place).is_dir() and any(Path(place).iterdir()):
            return Path(place)
    pytest.skip("recorded data not found: set PDRBENCH_DATA to the folder that holds ilc20/")


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


class Orphans:
    """Inside, processes whose parents end come to this one (Linux), so that whoever is left behind is seen."""

    def __enter__(self) -> Orphans:
        self._adopt(True)
        self._before = set(psutil.Process().children())
        return self

    def __exit__(self, *error: object) -> None:
        self._adopt(False)

    def left(self) -> list[str]:
        """Command lines of processes that came to be and are still there after some seconds; they are ended."""
        until_s = time.monotonic() + GONE_WITHIN_S
        while (left := self._living()) and time.monotonic() < until_s:
            time.sleep(0.05)
        names = []
        for process in left:
            with contextlib.suppress(psutil.Error):
                names.append(" ".join(process.cmdline())[:200])
                process.kill()
        return names

    def _adopt(self, adopts: bool) -> None:
        if sys.platform == "linux":
            ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, int(adopts), 0, 0, 0)

    def _living(self) -> set[psutil.Process]:
        """Children since then, and theirs: what was there before, such as a browser, may start processes of its own."""
        ours = set(psutil.Process().children()) - self._before
        with contextlib.suppress(psutil.Error):
            ours |= {process for child in ours for process in child.children(recursive=True)}
        return {process for process in ours if self._lives(process)}

    def _lives(self, process: psutil.Process) -> bool:
        """False for what has ended; the end of an adopted child is taken note of."""
        with contextlib.suppress(psutil.Error, ChildProcessError):
            if process.status() != psutil.STATUS_ZOMBIE:
                return True
            if process not in getattr(self, "_before", ()):
                os.waitpid(process.pid, os.WNOHANG)
        return False


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What is long is slow as well, so that `-m "not slow"` leaves it out."""
    for item in items:
        if item.get_closest_marker("long") is not None:
            item.add_marker(pytest.mark.slow)


@pytest.fixture(scope="session")
def orphans() -> type[Orphans]:
    """The class, to be used as a context."""
    return Orphans
