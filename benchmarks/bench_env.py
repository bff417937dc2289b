"""Time per step of the environment beside an empty one, and of the native vector environment beside SyncVectorEnv.

    python benchmarks/bench_env.py [--env MallPhone-v0] [--num-envs 64] [--json]

Where the environment's data is not available, a made-up walk with the sensors of a phone takes its place, and the first
line says so.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np

import pdrbench
from pdrbench.bench import Timing
from pdrbench.errors import PdrbenchError
from pdrbench.gym.env import LocalizationEnv
from pdrbench.gym.vector import LocalizationVectorEnv
from pdrbench.recording import Recording, SensorStream
from pdrbench.sensors import sensor_spec
from pdrbench.task import Task
from pdrbench.trajectory import Start, Trajectory
from pdrbench_lab.cli.bench import print_timings

UNIT = "us/step"
STEP_GOAL_US = 5.0
VECTOR_GOAL = 5.0
CAPACITY = {"accel": 32, "gyro": 32, "mag": 32, "rotation": 32, "wifi": 1024, "ble": 64}


class EmptyEnv(gymnasium.Env[np.ndarray, np.ndarray]):
    """Does nothing: what Gymnasium itself costs."""

    observation_space = gymnasium.spaces.Box(0.0, 1.0, (1,), np.float64)
    action_space = gymnasium.spaces.Box(-1e5, 1e5, (3,), np.float64)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict]:
        super().reset(seed=seed)
        return np.zeros(1), {}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict]:
        return np.zeros(1), 0.0, False, False, {}


def made_up_recording(walk: str) -> Recording:
    """Four minutes at 50 Hz, a scan of 330 access points every 2.2 s."""
    rng = np.random.default_rng(list(walk.encode()))
    length_s = 240.0
    t_s = np.arange(0.0, length_s, 0.02)
    scans_s = np.arange(rng.uniform(0.0, 2.2), length_s, 2.2).repeat(330)
    streams = {}
    for name in CAPACITY:
        times_s = scans_s if name == "wifi" else t_s
        values = rng.uniform(0.0, 1.0, (len(times_s), len(sensor_spec(name).columns) - 1))
        streams[name] = SensorStream(sensor_spec(name), np.column_stack([times_s, values]))
    reference_t_s = np.arange(0.0, length_s, 5.0)
    reference = Trajectory(
        t_s=reference_t_s,
        xy_m=np.column_stack([reference_t_s, reference_t_s]),
        level=np.zeros(len(reference_t_s)),
        surveyed=np.ones(len(reference_t_s)),
    )
    return Recording(id=walk, building=None, streams=streams, reference=reference)


def made_up_task() -> Task:
    """A task with the shape of a walk with a phone through a shopping centre."""
    return Task(
        id="MadeUpPhone-v0",
        summary="Noise.",
        description="Noise.",
        sensors=tuple(sensor_spec(name) for name in CAPACITY),
        capacity=CAPACITY,
        period_s=0.2,
        start="pose",
        walks={"train": tuple(f"walk-{number}" for number in range(8))},
        load=made_up_recording,
        tell_start=lambda recording: Start(xy_m=recording.reference.xy_m[0], level=0),
        licence="MIT",
        source="generated",
    )


def find_task(name: str) -> Task:
    """The task asked for, or the made-up one where its data cannot be read."""
    try:
        task = pdrbench.make_task(name)
        task.load(task.split("train")[0])
    except PdrbenchError as error:
        print(f"made-up walks instead of {name}: {str(error).splitlines()[0]}", file=sys.stderr)
        return made_up_task()
    return task


def best_us(make: Callable[[], tuple[Any, Any]], rounds: int, max_steps: int = 2000) -> float:
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
        for steps in range(1, max_steps + 1):  # noqa: B007  used after the loop
            terminated = env.step(action)[2]
            if terminated is True or (terminated is not False and terminated.any()):
                break
        best_s = min(best_s, (time.perf_counter() - began_s) / steps)
    env.close()
    return best_s * 1e6


def measure(task: Task, num_envs: int) -> list[Timing]:
    gymnasium.register("pdrbench-bench/Empty-v0", EmptyEnv)
    gymnasium.register("pdrbench-bench/Walk-v0", lambda **options: LocalizationEnv(task, **options))
    action, actions = np.zeros(3), np.zeros((num_envs, 3))
    maker = [lambda: gymnasium.make("pdrbench-bench/Walk-v0")] * num_envs
    empty_us = best_us(lambda: (gymnasium.make("pdrbench-bench/Empty-v0"), action), 8)
    step_us = best_us(lambda: (gymnasium.make("pdrbench-bench/Walk-v0"), action), 200)
    sync_us = best_us(lambda: (gymnasium.vector.SyncVectorEnv(maker), actions), 8) / num_envs
    native_us = best_us(lambda: (LocalizationVectorEnv(num_envs, task), actions), 8) / num_envs
    return [
        Timing(f"step of an empty environment ({task.id})", empty_us, UNIT, "itself", 1.0),
        Timing("step through gymnasium.make", step_us, UNIT, f"empty; goal {STEP_GOAL_US:g} us", step_us / empty_us),
        Timing(f"SyncVectorEnv({num_envs}), per walk", sync_us, UNIT, "itself", 1.0),
        Timing(
            f"LocalizationVectorEnv({num_envs}), per walk",
            native_us,
            UNIT,
            f"SyncVectorEnv; goal {VECTOR_GOAL:g} times faster",
            sync_us / native_us,
        ),
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--env", default="MallPhone-v0")
    parser.add_argument("--num-envs", type=int, default=64)
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    rows = measure(find_task(arguments.env), arguments.num_envs)
    print_timings(rows, arguments.json)


if __name__ == "__main__":
    main()
