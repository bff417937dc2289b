"""A made-up walk of twelve seconds with the sensors of a phone, and one with strides, as tasks and as served trials."""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np
import pytest

from pdrbench.recording import RadioMap, Recording, SensorStream
from pdrbench.result import Result
from pdrbench.sensors import sensor_spec
from pdrbench.task import Task
from pdrbench.trajectory import Start, Trajectory

if TYPE_CHECKING:
    from pdrbench_evaal.server import TrialServer
    from pdrbench_evaal.trial import Trial

LENGTH_S = 12.0
PHONE = {"accel": 16, "gyro": 16, "mag": 16, "rotation": 16, "baro": 8, "wifi": 3, "ble": 8}
Serve = Callable[..., object]


def make_recording(walk: str, sensors: tuple[str, ...]) -> Recording:
    rng = np.random.default_rng(list(walk.encode()))
    streams = {name: SensorStream(sensor_spec(name), _rows(name, rng)) for name in sensors}
    t_s = np.arange(0.0, LENGTH_S, 1.0)
    reference = Trajectory(
        t_s=t_s, xy_m=np.column_stack([77.25 + t_s, np.sin(t_s)]), level=np.ones(12, np.int64), surveyed=t_s > 0
    )
    return Recording(id=walk, building=None, streams=streams, reference=reference)


def _rows(name: str, rng: np.random.Generator) -> np.ndarray:
    t_s = np.arange(0.013, LENGTH_S, 0.02)
    swing = np.sin(2 * np.pi * 1.8 * t_s)
    match name:
        case "accel":
            return np.column_stack([t_s, 0 * t_s, 2.5 * swing, 9.8 + 3.0 * swing])
        case "rotation":
            q = rng.normal(size=(len(t_s), 4)) * 0.05 + [0.9, 0.0, 0.0, 0.4]
            return np.column_stack([t_s, q / np.linalg.norm(q, axis=1)[:, None] * np.sign(rng.normal())])
        case "baro":
            return np.column_stack([t_s, rng.uniform(1000, 1001, len(t_s))])[::5]
        case "wifi":
            scan_s = np.repeat(np.arange(0.4, LENGTH_S, 2.0), 4)  # four access points, and a capacity of three
            rssi_dbm = rng.integers(-90, -40, 24)
            return np.column_stack([scan_s, np.tile([5, 6, 7, 2.0**47], 6), rssi_dbm, np.full(24, 2412), scan_s * 0.1])
        case "ble":
            return np.column_stack([t_s, rng.integers(1, 9, len(t_s)), 0 * t_s - 70, 0 * t_s - 59])[::25]
        case "stride":
            stride_s = np.arange(1.4, LENGTH_S, 1.2)
            return np.column_stack([stride_s, rng.uniform(1, 1.5, 9), 0 * stride_s, rng.normal(size=9) * 0.3])
    return np.column_stack([t_s, rng.normal(size=(len(t_s), 3))])


def survey(recording: Recording) -> RadioMap | None:
    if "wifi" not in recording.streams:
        return None
    return RadioMap(
        xy_m=np.arange(8.0).reshape(4, 2),
        level=[0, 0, 1, 1],
        walk=[0, 0, 1, 1],
        first=[0, 3, 6, 9, 12],
        access_point=[5, 6, 7, 5, 6, 2**47, 5, 7, 2**47, 6, 7, 2**47],
        rssi_dbm=np.linspace(-90, -40, 12),
        age_s=np.zeros(12),
    )


def make_task(capacity: dict[str, int]) -> Task:
    """A task with one training walk and one test walk."""
    return Task(
        id="Served-v0",
        summary="Made up.",
        description="Made up.",
        sensors=tuple(sensor_spec(name) for name in capacity),
        capacity=capacity,
        period_s=0.2,
        start="pose",
        walks={"train": ("walk-a",), "test": ("5ea1ed",)},
        load=functools.cache(lambda walk: make_recording(walk, tuple(capacity))),
        tell_start=lambda recording: Start(recording.reference.xy_m[0], 1, heading_rad=0.3),
        radio_map=survey,
        licence="MIT",
        source="generated",
    )


@pytest.fixture
def phone_task() -> Task:
    """Every sensor that GetSensorData has a type for."""
    return make_task(PHONE)


@pytest.fixture
def stride_task() -> Task:
    """Strides, which it has none for."""
    return make_task({"stride": 2})


@pytest.fixture
def serve() -> Callable[..., object]:
    """A context: a server of the walks of a task, and the results of trials that have ended, by walk."""

    @contextmanager
    def serving(
        task: Task, split: str = "train", **settings: object
    ) -> Iterator[tuple[TrialServer, dict[str, Result]]]:
        ended: dict[str, Result] = {}

        from pdrbench_evaal.server import TrialServer, make_trials  # this file is imported without it, too

        def keep(trial: Trial, result: Result) -> None:
            ended[trial.name] = result

        with TrialServer(make_trials(task, split, on_end=keep, **settings)) as server:  # type: ignore[arg-type]
            thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
            thread.start()
            try:
                yield server, ended
            finally:
                server.shutdown()
                thread.join()

    return serving
