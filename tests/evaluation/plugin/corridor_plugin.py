"""A package from outside: an environment of short straight walks along a corridor."""

from __future__ import annotations

import dataclasses
import hashlib
import os

import numpy as np

from pdrbench.building import Building, FloorPolygon
from pdrbench.recording import Recording, SensorSpec, SensorStream
from pdrbench.task import Task
from pdrbench.trajectory import Start, Trajectory

ENVIRONMENTS = {"Corridor-v0": "corridor_plugin:task", "CorridorLost-v0": "corridor_plugin:lost_task"}
LOCALIZERS: dict[str, str] = {}
WALKS = {
    "train": tuple(f"train-{i}" for i in range(2)),
    "val": ("val-0",),
    "test": tuple(f"test-{i:03d}" for i in range(200)),
}
STRIDE = SensorSpec("stride", ("t_s", "length_m"), np.array([0.0, 0.0]), np.array([1e3, 5.0]), None, "Strides.")


def corridor() -> Building:
    outline_xy_m = np.array([[0.0, -2.0], [100.0, -2.0], [100.0, 2.0], [0.0, 2.0]])
    return Building("corridor", (FloorPolygon("corridor", outline_xy_m, np.full(4, -1), 0.0, 0),))


def load(walk: str) -> Recording:
    """Twelve strides of a length that depends on the walk; that it was loaded is noted where a test asks for it."""
    note_load(walk)
    length_m = 0.5 + int(hashlib.sha256(walk.encode()).hexdigest(), 16) % 100 / 100
    t_s = np.arange(1.0, 13.0)
    stride = SensorStream(STRIDE, np.column_stack([t_s, np.full(12, length_m)]))
    xy_m = np.column_stack([t_s * length_m, np.zeros(12)])
    reference = Trajectory(t_s, xy_m, np.zeros(12, int), np.ones(12, bool))
    return Recording(walk, corridor(), {"stride": stride}, reference)


def task() -> Task:
    return Task(
        id="Corridor-v0",
        summary="Straight walks.",
        description="Straight walks along a corridor.",
        sensors=(STRIDE,),
        capacity={"stride": 4},
        period_s=1.0,
        start="pose",
        walks=WALKS,
        load=load,
        tell_start=lambda recording: Start(np.zeros(2), 0, heading_rad=0.0),
        licence="MIT",
        source="generated",
        units={walk: walk for split in WALKS.values() for walk in split},
        unit_kind="walk",
    )


def lost_task() -> Task:
    return dataclasses.replace(task(), id="CorridorLost-v0", start="unknown", note="the start is not known")


def note_load(walk: str) -> None:
    """Notes, in the file that a test names, that a process begins to compute a walk."""
    path = os.environ.get("CORRIDOR_LOADS")
    if path:
        handle = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
        os.write(handle, f"{walk} {os.getpid()}\n".encode())
        os.close(handle)
