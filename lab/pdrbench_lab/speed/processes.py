"""Localizers in processes of their own, beside the same ones in the evaluating process."""

from __future__ import annotations

import atexit
import contextlib
import functools
import shutil
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final, Literal

import numpy as np
import psutil  # type: ignore[import-untyped]

from pdrbench.episode import Player
from pdrbench.localizer import Briefing, Observation
from pdrbench.process.budget import Budget
from pdrbench.process.localizer_process import LocalizerProcess, Terms
from pdrbench.sensors import sensor_spec
from pdrbench_lab.speed import busy
from pdrbench_lab.speed.busy import Busy
from pdrbench_lab.speed.timing import Prepared, Timing, median_s

PERIOD_S: Final = 0.2
BUSY_S: Final = 1e-3  # of processor time in each step: what the overhead is measured against
ROWS: Final = {"accel": 20, "gyro": 20}  # of an observation: two sensors of 100 Hz
SEED: Final = 1
Kind = Literal["process", "confined"]
OF_PROCESSORS: Final = "_processor"
TICK_S: Final = 0.01  # in which the system counts
KINDS: Final[tuple[Kind, ...]] = ("process", "confined")


def run(quick: bool, report: Callable[[str], None]) -> list[Timing]:
    """All rows; `report` is called with what comes next."""
    steps, rounds = (100, 5) if quick else (400, 15)
    rows = []
    report("starting processes")
    for kind in KINDS:
        _isolated(kind, 0.0).close()
    for kind in KINDS:
        report(f"steps of {1e3 * BUSY_S:g} ms, isolation {kind}")
        rows += _steps(kind, BUSY_S, steps, rounds)
        report(f"steps of no time, isolation {kind}")
        rows += _steps(kind, 0.0, steps, rounds)
    report("starts")
    starts: dict[str, Prepared] = {kind: functools.partial(_start_and_end, kind) for kind in KINDS}
    for what, taken_s in (("", median_s(starts, rounds)), (OF_PROCESSORS, _spent_s(starts, rounds))):
        rows += [Timing(f"start_{kind}{what}", 1e3 * taken_s[kind], "ms/walk") for kind in KINDS]
    return rows


def _steps(kind: Kind, busy_s: float, steps: int, rounds: int) -> list[Timing]:
    """Wall time of one step, the median over rounds of many steps, both localizers in turns; and processor time."""
    inprocess, isolated = Busy(busy_s), _isolated(kind, busy_s)
    things: dict[str, Prepared] = {
        "inprocess": lambda: lambda: _play(inprocess, steps),
        "isolated": lambda: lambda: _play(isolated, steps),
    }
    rows = []
    try:
        for what, taken_s in (("", median_s(things, rounds)), (OF_PROCESSORS, _spent_s(things, rounds))):
            name = f"step_{kind}_{1e3 * busy_s:g}ms{what}"
            ratio = taken_s["inprocess"] / taken_s["isolated"]
            us = 1e6 * taken_s["isolated"] / steps
            rows.append(Timing(name, us, "us/step", "the same localizer in this process", ratio))
    finally:
        isolated.close()
    return rows


def _spent_s(things: Mapping[str, Prepared], rounds: int) -> dict[str, float]:
    """Processor time of each thing, all processes together: what a shared machine leaves comparable."""
    spent_s = {}
    for name, prepare in things.items():
        began_s = _processor_s()
        for _ in range(rounds):
            prepare()()
        spent_s[name] = max(_processor_s() - began_s, TICK_S) / rounds
    return spent_s


def _processor_s() -> float:
    """Processor time so far of this process and all below it, those that have ended included."""
    taken_s = 0.0
    for one in [psutil.Process(), *psutil.Process().children(recursive=True)]:
        with contextlib.suppress(psutil.NoSuchProcess):
            taken_s += sum(one.cpu_times()[:4])
    return taken_s


def _play(localizer: Player, steps: int) -> None:
    rows = {name: np.ones((count, 4)) for name, count in ROWS.items()}
    for step in range(steps):
        localizer.step(Observation(step * PERIOD_S, {name: values.copy() for name, values in rows.items()}))


def _isolated(kind: Kind, busy_s: float) -> LocalizerProcess:
    terms = Terms(kind, Budget(), PERIOD_S, num_steps=1_000_000)
    target = f"{_copied(Path(busy.__file__))}:{Busy.__name__}"
    localizer = LocalizerProcess(target, target, parameters={"busy_s": busy_s}, terms=terms)
    localizer.start()
    sensors = {name: sensor_spec(name) for name in ROWS}
    localizer.reset(Briefing(None, sensors, PERIOD_S), np.random.default_rng(SEED))
    return localizer


@functools.cache
def _copied(source: Path) -> Path:
    """A copy where a confined process can read it: a package with environments is hidden from it."""
    folder = Path(tempfile.mkdtemp(prefix="pdrbench-bench-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(shutil.copy(source, folder))


def _start_and_end(kind: Kind) -> Callable[[], object]:
    return lambda: _isolated(kind, 0.0).close()
