"""Time per step of an environment beside an empty one, and of the import.

The walks are made up, with the sensors of a phone: four minutes at 50 Hz, a scan of 330 access points every 2.2 s.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any, Final

import gymnasium
import numpy as np

from pdrbench.geometry import FloatArray
from pdrbench.gym.env import LocalizationEnv
from pdrbench.recording import Recording, SensorStream
from pdrbench.sensors import sensor_spec
from pdrbench.task import Task
from pdrbench.trajectory import Start, Trajectory
from pdrbench_lab.speed.timing import Timing

CAPACITY: Final = {"accel": 32, "gyro": 32, "mag": 32, "rotation": 32, "wifi": 1024, "ble": 64}
LENGTH_S: Final = 240.0
MAX_STEPS: Final = 1200  # of a walk that are timed
IMPORT: Final = "import time; began_s = time.perf_counter(); import {}; print(time.perf_counter() - began_s)"


class EmptyEnv(gymnasium.Env[FloatArray, FloatArray]):
    """Does nothing: what Gymnasium itself costs."""

    observation_space = gymnasium.spaces.Box(0.0, 1.0, (1,), np.float64)
    action_space = gymnasium.spaces.Box(-1e5, 1e5, (3,), np.float64)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[FloatArray, dict[str, Any]]:
        super().reset(seed=seed)
        return np.zeros(1), {}

    def step(self, action: FloatArray) -> tuple[FloatArray, float, bool, bool, dict[str, Any]]:
        return np.zeros(1), 0.0, False, False, {}


def run(quick: bool, report: Callable[[str], None]) -> list[Timing]:
    """All rows; `report` is called with what comes next."""
    task = made_up_task()
    rounds = 2 if quick else 8
    action = np.zeros(3)
    gymnasium.register("pdrbench-bench/Empty-v0", lambda **options: EmptyEnv())
    gymnasium.register("pdrbench-bench/Walk-v0", lambda **options: LocalizationEnv(task, **options))
    report("steps of an environment")
    empty_us = best_us(lambda: (gymnasium.make("pdrbench-bench/Empty-v0"), action), rounds)
    step_us = best_us(lambda: (gymnasium.make("pdrbench-bench/Walk-v0"), action), rounds)
    report("imports")
    ours_s, numpy_s = (min(import_s(name) for _ in range(1 + rounds)) for name in ("pdrbench", "numpy"))
    return [
        Timing("step", step_us, "us", "a step of an empty environment", empty_us / step_us),
        Timing("import", ours_s, "s", "import numpy", numpy_s / ours_s),
    ]


def import_s(name: str) -> float:
    """Seconds for the import of a package in a new process."""
    ran = subprocess.run([sys.executable, "-c", IMPORT.format(name)], check=True, capture_output=True, text=True)
    return float(ran.stdout)


def best_us(make: Callable[[], tuple[Any, Any]], rounds: int, max_steps: int = MAX_STEPS) -> float:
    """Microseconds per `step` until a walk ends, without `reset`, the best of some rounds.

    Args:
        make: Returns a fresh environment and an action.
        rounds: Walks to play.
        max_steps: Per walk.
    """
    env, action = make()
    best_s = np.inf
    for round_ in range(rounds):
        env.reset(seed=round_)
        env.step(action)
        env.step(action)  # Gymnasium's own checks look at the first two
        began_s = time.perf_counter()
        for _ in range(max_steps):
            env.step(action)
        best_s = min(best_s, (time.perf_counter() - began_s) / max_steps)
    env.close()
    return float(best_s * 1e6)


def made_up_task() -> Task:
    """A task with the shape of a walk with a phone through a shopping centre."""
    return Task(
        id="MadeUpPhone-v1",
        summary="Noise.",
        description="Noise.",
        sensors=tuple(sensor_spec(name) for name in CAPACITY),
        capacity=CAPACITY,
        period_s=0.1,
        start="pose",
        walks={"train": tuple(f"walk-{number}" for number in range(8))},
        load=made_up_recording,
        tell_start=lambda recording: Start(xy_m=recording.reference.xy_m[0], level=0),
        licence="MIT",
        source="generated",
    )


def made_up_recording(walk: str) -> Recording:
    """A walk of noise."""
    rng = np.random.default_rng(list(walk.encode()))
    t_s = np.arange(0.0, LENGTH_S, 0.02)
    scans_s = np.arange(rng.uniform(0.0, 2.2), LENGTH_S, 2.2).repeat(330)
    streams = {}
    for name in CAPACITY:
        times_s = scans_s if name == "wifi" else t_s
        values = rng.uniform(0.0, 1.0, (len(times_s), len(sensor_spec(name).columns) - 1))
        streams[name] = SensorStream(sensor_spec(name), np.column_stack([times_s, values]))
    reference_t_s = np.arange(0.0, LENGTH_S, 5.0)
    reference = Trajectory(
        t_s=reference_t_s,
        xy_m=np.column_stack([reference_t_s, reference_t_s]),
        level=np.zeros(len(reference_t_s), dtype=np.int64),
        surveyed=np.ones(len(reference_t_s), dtype=np.bool_),
    )
    return Recording(id=walk, building=None, streams=streams, reference=reference)
