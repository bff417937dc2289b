"""Fixtures for the tests of every room."""

from __future__ import annotations

import contextlib
import ctypes
import json
import os
import re
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
from hypothesis import HealthCheck, settings

from pdrbench.building import Building
from pdrbench.cli import main
from pdrbench.isolation.spawned import NOT_CONFINED
from pdrbench_sim.buildings.office import make_office

# How long drawing takes says how busy a machine is, and nothing of what is tested.
settings.register_profile("busy", suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("busy")

DAYS = 21  # in which every long test runs once
LONG_S = 20.0  # what a long test takes that states no time
PR_SET_CHILD_SUBREAPER = 36
GONE_WITHIN_S = 20.0  # a process that has just been started takes some seconds to look around


@pytest.fixture
def rng() -> np.random.Generator:
    """A generator with a fixed seed: same numbers in every run."""
    return np.random.default_rng(20080921)


@pytest.fixture(scope="session")
def office() -> Building:
    """Two levels of 750 m2, with stairs."""
    return make_office(np.random.default_rng(7), num_levels=2, area_m2=1500.0)


@pytest.fixture(scope="session")
def data_root() -> Path:
    """Folder that holds the recorded datasets by name; skips where there is none."""
    for place in os.environ.get("PDRBENCH_DATA", "").split(os.pathsep):
        if place and Path(place).is_dir() and any(Path(place).iterdir()):
            return Path(place)
    pytest.skip("recorded data not found: set PDRBENCH_DATA to the folder that holds ilc20/")


@dataclass(frozen=True)
class Outcome:
    """The outcome of a command."""

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
    """Inside, processes whose parents end become children of this one (Linux), so that none is missed."""

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
        """New children and their descendants; older children, such as a browser, may start processes of their own."""
        ours = set(psutil.Process().children()) - self._before
        with contextlib.suppress(psutil.Error):
            ours |= {process for child in ours for process in child.children(recursive=True)}
        return {process for process in ours if self._lives(process)}

    def _lives(self, process: psutil.Process) -> bool:
        """False for an ended process; an ended adopted child is reaped."""
        with contextlib.suppress(psutil.Error, ChildProcessError):
            if process.status() != psutil.STATUS_ZOMBIE:
                return True
            if process not in getattr(self, "_before", ()):
                os.waitpid(process.pid, os.WNOHANG)
        return False


def pytest_addoption(parser: pytest.Parser) -> None:
    text = f"run one part of the long tests: K/N, or auto for today's of {DAYS}, so that each runs once in {DAYS} days"
    parser.addoption("--long-shard", metavar="K/N", help=text)


@pytest.hookimpl(tryfirst=True)
def pytest_configure(config: pytest.Config) -> None:
    """Resolves `auto` once, before workers get the options: a day may end while they start."""
    if config.option.long_shard == "auto":
        config.option.long_shard = f"{datetime.now(UTC).toordinal() % DAYS + 1}/{DAYS}"


def shard_of(seconds: Mapping[str, float], number: int, count: int) -> set[str]:
    """Names in shard 1 to `count`: from the longest on, each goes to the shard with the least to do so far."""
    shards: list[set[str]] = [set() for _ in range(count)]
    sums_s = [0.0] * count
    for name in sorted(seconds, key=lambda name: (-seconds[name], name)):
        least = sums_s.index(min(sums_s))
        shards[least].add(name)
        sums_s[least] += seconds[name]
    return shards[number - 1]


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """A long test is slow as well, so that `-m "not slow"` leaves it out; `--long-shard` leaves out other shards.

    Tests of confinement skip where there is none.
    """
    for item in items:
        if NOT_CONFINED and item.get_closest_marker("confinement"):
            item.add_marker(pytest.mark.skip(reason=NOT_CONFINED))
    long = {item.nodeid: mark for item in items if (mark := item.get_closest_marker("long"))}
    for item in items:
        if item.nodeid in long:
            item.add_marker(pytest.mark.slow)
    if (shard := config.option.long_shard) is None:
        return
    found = re.fullmatch(r"(\d+)/(\d+)", shard)
    if found is None or not 1 <= int(found[1]) <= int(found[2]):
        raise pytest.UsageError(f"--long-shard is auto or K/N with K from 1 to N, got {shard!r}")
    seconds = {name: float(mark.kwargs.get("seconds", LONG_S)) for name, mark in long.items()}
    kept = shard_of(seconds, int(found[1]), int(found[2]))
    config.hook.pytest_deselected(items=[item for item in items if item.nodeid not in kept])
    items[:] = [item for item in items if item.nodeid in kept]


@pytest.fixture(scope="session")
def orphans() -> type[Orphans]:
    """The class, to be used as a context."""
    return Orphans
