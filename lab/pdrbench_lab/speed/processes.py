"""Localizers in processes of their own, beside the same ones in the evaluating process."""

from __future__ import annotations

import atexit
import functools
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Final, Literal

import numpy as np

from pdrbench.episode import Player
from pdrbench.localizer import Briefing, Observation
from pdrbench.process.budget import Budget
from pdrbench.process.localizer_process import LocalizerProcess, Terms
from pdrbench.sensors import sensor_spec
from pdrbench_lab.speed import busy
from pdrbench_lab.speed.busy import Busy
from pdrbench_lab.speed.timing import Timing, median_s

PERIOD_S: Final = 0.2
BUSY_S: Final = 1e-3  # of processor time in each step: what the overhead is measured against
ROWS: Final = {"accel": 20, "gyro": 20}  # of an observation: two sensors of 100 Hz
SEED: Final = 1
Kind = Literal["process", "confined"]
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
        rows.append(_steps(kind, BUSY_S, steps, rounds))
        report(f"steps of no time, isolation {kind}")
        rows.append(_steps(kind, 0.0, steps, rounds))
    report("starts")
    starts = median_s({kind: functools.partial(_start_and_end, kind) for kind in KINDS}, rounds)
    rows += [Timing(f"start_{kind}", 1e3 * taken_s, "ms/walk") for kind, taken_s in starts.items()]
    return rows


def _steps(kind: Kind, busy_s: float, steps: int, rounds: int) -> Timing:
    """Wall time of one step: the median over rounds of many steps, both localizers in turns."""
    inprocess, isolated = Busy(busy_s), _isolated(kind, busy_s)
    try:
        taken_s = median_s(
            {"inprocess": lambda: lambda: _play(inprocess, steps), "isolated": lambda: lambda: _play(isolated, steps)},
            rounds,
        )
    finally:
        isolated.close()
    name = f"step_{kind}_{1e3 * busy_s:g}ms"
    ratio = taken_s["inprocess"] / taken_s["isolated"]
    return Timing(name, 1e6 * taken_s["isolated"] / steps, "us/step", "the same localizer in this process", ratio)


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
