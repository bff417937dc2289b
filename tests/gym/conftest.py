"""A made-up task with the sensors of a phone in a shopping centre, and one with strides only."""

from __future__ import annotations

import functools
from collections.abc import Mapping

import numpy as np
import pytest

from pdrbench.recording import RadioMap, Recording, SensorStream
from pdrbench.sensors import sensor_spec
from pdrbench.task import Task
from pdrbench.trajectory import Start, Trajectory

WALKS = {"train": ("walk-a", "walk-b", "walk-c"), "val": ("walk-d",), "test": ("sealed-1", "sealed-2")}
CAPACITY = {"accel": 24, "gyro": 24, "mag": 24, "rotation": 24, "wifi": 512}
SCAN_PERIOD_S = 2.2
READINGS = 330


def make_recording(walk: str, sensors: tuple[str, ...]) -> Recording:
    """A walk of 9 to 21 s along a wave, the same for the same id."""
    rng = np.random.default_rng(list(walk.encode()))
    length_s = 9.0 + 12.0 * rng.random()
    reference_t_s = np.arange(0.0, length_s, 1.7)
    reference = Trajectory(
        t_s=reference_t_s,
        xy_m=np.column_stack([reference_t_s, 3.0 * np.sin(reference_t_s)]) + rng.normal(size=2),
        level=(reference_t_s > length_s / 2).astype(np.int64),
        surveyed=np.arange(len(reference_t_s)) > 0,
    )
    t_s = np.sort(rng.uniform(0.0, length_s, int(50 * length_s)))
    streams = {}
    for name in sensors:
        rows = wifi_rows(rng, length_s) if name == "wifi" else np.column_stack([t_s, rng.uniform(-1, 1, (len(t_s), 4))])
        spec = sensor_spec(name)
        streams[name] = SensorStream(spec, rows[:, : len(spec.columns)])
    return Recording(id=walk, building=None, streams=streams, reference=reference, mounting="hand")


def wifi_rows(rng: np.random.Generator, length_s: float) -> np.ndarray:
    """(R, 5) scans of 330 readings, the first at a random time."""
    delivered_s = np.arange(rng.uniform(0, SCAN_PERIOD_S), length_s, SCAN_PERIOD_S).repeat(READINGS)
    count = len(delivered_s)
    access_point = rng.integers(1, 400, count)
    rssi_dbm = rng.uniform(-95, -30, count)
    return np.column_stack([delivered_s, access_point, rssi_dbm, np.full(count, 2412.0), rng.uniform(0, 2, count)])


def known_start(recording: Recording) -> Start:
    return Start(xy_m=recording.reference.xy_m[0], level=int(recording.reference.level[0]), heading_rad=0.0)


def survey(recording: Recording) -> RadioMap:
    """Three scans of four access points; the last access point depends on the walk."""
    access_point = [7, 8, 9, 100 + ord(recording.id[-1])] * 3
    return RadioMap(
        xy_m=np.arange(6.0).reshape(3, 2),
        level=[0, 0, 1],
        walk=[0, 0, 1],
        first=[0, 4, 8, 12],
        access_point=access_point,
        rssi_dbm=np.linspace(-90, -40, 12),
        age_s=np.zeros(12),
    )


def make_task(capacity: Mapping[str, int], walks: Mapping[str, tuple[str, ...]] = WALKS, **changes: object) -> Task:
    """A task of which everything can be changed."""
    load = functools.cache(lambda walk: make_recording(walk, tuple(capacity)))
    settings = {
        "id": "MadeUp-v0",
        "summary": "A wave.",
        "description": "A wave.",
        "sensors": tuple(sensor_spec(name) for name in capacity),
        "capacity": capacity,
        "period_s": 0.2,
        "start": "pose",
        "walks": walks,
        "load": load,
        "tell_start": known_start,
        "radio_map": survey,
        "licence": "MIT",
        "source": "generated",
    }
    return Task(**{**settings, **changes})


@pytest.fixture(scope="session")
def phone_task() -> Task:
    """Phone sensors at 50 Hz and a WiFi scan every 2.2 s."""
    return make_task(CAPACITY)


@pytest.fixture
def task_maker():
    """`make_task`, for tests that need a task with a difference."""
    return make_task
