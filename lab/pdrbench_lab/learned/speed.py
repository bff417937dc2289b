"""How fast the learned localizers are on one core, and how much memory a process with them takes."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Final

import numpy as np

from pdrbench.localizer import Briefing
from pdrbench.recording import SensorSpec
from pdrbench.sensors import sensor_spec
from pdrbench_baselines.learned.reckoning import Reckoner, WindowNetwork
from pdrbench_baselines.learned.row_checks import SENSORS
from pdrbench_lab.speed.simulate import peak_kib

WALK_S: Final = 120.0
PHONE_HZ: Final = 100.0
PERIOD_S: Final = 0.2  # between observations, as the environments with a phone have it


@dataclass(frozen=True, slots=True)
class Speed:
    """Processor time of one thread that a walk took.

    Attributes:
        second_ms: Median over seconds of a walk: signals of one window, the network, one displacement.
        slowest_ms: The 99th percentile.
        times_real_time: Length of the walk over the time that all of it took.
        memory_mb: Most that the process ever held, with PyTorch if it computes the network.
    """

    second_ms: float
    slowest_ms: float
    times_real_time: float
    memory_mb: float

    def line(self) -> str:
        """All of it in one line of text."""
        return (
            f"{self.second_ms:.1f} ms a second of walk (99 %: {self.slowest_ms:.1f} ms), "
            f"{self.times_real_time:.0f} x real time, {self.memory_mb:.0f} MB"
        )


def measured(network: WindowNetwork) -> Speed:
    """Plays a phone that swings at the pace of a walk, observation by observation; one thread, one window at a time."""
    t_s = np.arange(0.0, WALK_S, 1.0 / PHONE_HZ)
    swing = np.sin(2.0 * np.pi * 1.8 * t_s)
    nothing = np.zeros(len(t_s))
    rows = {
        "accel": np.column_stack([t_s, 1.5 * swing, 0.5 * swing, 9.81 + 3.0 * swing]),
        "gyro": np.column_stack([t_s, 0.3 * swing, nothing, 0.2 * swing]),
        "rotation": np.column_stack([t_s, np.ones(len(t_s)), nothing, nothing, nothing]),
    }
    specs: dict[str, SensorSpec] = {name: sensor_spec(name) for name in SENSORS}
    reckoner = Reckoner(network, Briefing(None, specs, PERIOD_S))
    bounds = np.searchsorted(t_s, np.arange(0.0, WALK_S + PERIOD_S, PERIOD_S))
    of_seconds, began_s = [], time.thread_time()
    for first, last in zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True):
        step_s = time.thread_time()
        if list(reckoner.update({name: one[first:last] for name, one in rows.items()})):
            of_seconds.append(time.thread_time() - step_s)
    took_s = time.thread_time() - began_s
    return Speed(
        1e3 * float(np.median(of_seconds)),
        1e3 * float(np.percentile(of_seconds, 99)),
        WALK_S / took_s,
        peak_kib() * 1024 / 1e6,
    )
