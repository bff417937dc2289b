"""A package from outside with two environments of short walks, each in a corridor of its own, generated in no time."""

from __future__ import annotations

import dataclasses
import functools
import hashlib

import numpy as np

from pdrbench.building import Building, FloorPolygon
from pdrbench.recording import Recording, SensorStream
from pdrbench.sensors import sensor_spec
from pdrbench.task import HELD_OUT, Task
from pdrbench.trajectory import Start, Trajectory

ENVIRONMENTS = {"Toy-v1": "toy_boards:task", "ToyDeaf-v1": "toy_boards:deaf_task"}
WALKS = {"train": ("train-0",), "val": ("val-0",), "test": tuple(f"test-{i}" for i in range(6))}
STEPS = 70  # a second apart, or some more
WIDTH_M = 4.0


def load(sensor: str, secret: str, walk: str) -> Recording:
    """A walk along a corridor whose length, and whose errors, follow from its name, and from the secret."""
    seeds = np.frombuffer(
        hashlib.sha256(f"{secret if walk.startswith(HELD_OUT) else ''}{walk}".encode()).digest(), "<u4"
    )
    rng = np.random.default_rng(seeds)
    t_s = np.arange(1.0, STEPS + rng.integers(20))
    pace_mps = rng.uniform(0.8, 1.4)
    xy_m = np.column_stack([1.0 + pace_mps * t_s, rng.uniform(-0.5, 0.5, len(t_s))])
    length_m = float(xy_m[-1, 0] + rng.uniform(2.0, 9.0))
    outline_xy_m = np.array([[0.0, -1.0], [length_m, -1.0], [length_m, 1.0], [0.0, 1.0]]) * [1.0, WIDTH_M / 2]
    building = Building(f"corridor {walk}", (FloorPolygon("corridor", outline_xy_m, np.full(4, -1), 0.0, 0),))
    measured = xy_m + rng.normal(0.0, 0.3, xy_m.shape)
    columns = {"position": measured, "level_change": np.zeros((len(t_s), len(sensor_spec(sensor).columns) - 1))}
    stream = SensorStream(sensor_spec(sensor), np.column_stack([t_s, columns[sensor]]))
    reference = Trajectory(t_s, xy_m, np.zeros(len(t_s), int), np.ones(len(t_s), bool))
    return Recording(walk, building, {sensor: stream}, reference)


def make(env: str, sensor: str, secret: str = "") -> Task:
    walks = WALKS | ({HELD_OUT: tuple(f"{HELD_OUT}-{i}" for i in range(12))} if secret else {})
    return Task(
        id=env,
        summary="Walks along corridors.",
        description="Walks along corridors, each in one of its own.",
        sensors=(sensor_spec(sensor),),
        capacity={sensor: 4},
        period_s=1.0,
        start="pose",
        walks=walks,
        load=functools.partial(load, sensor, secret),
        tell_start=lambda recording: Start(np.array([1.0, 0.0]), 0, heading_rad=0.0),
        licence="MIT",
        source="generated",
    )


def task() -> Task:
    return dataclasses.replace(make("Toy-v1", "position"), held_out=functools.partial(make, "Toy-v1", "position"))


def deaf_task() -> Task:
    held_out = functools.partial(make, "ToyDeaf-v1", "level_change")
    return dataclasses.replace(make("ToyDeaf-v1", "level_change"), held_out=held_out)
