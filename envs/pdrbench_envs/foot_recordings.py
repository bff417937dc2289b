"""Recorded walks with a unit on the foot and no map: `FootVicon-v1`, `FootWalks-v1`.

Each is made of two registered datasets, parts of one published set, played whole as test walks. Where the folders found
hold other walks of the same kind, or one of the two is missing, the environment says so in `Task.note`.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Final

import numpy as np

from pdrbench.datasets import dataset, find, is_available
from pdrbench.files import known_sha256
from pdrbench.geometry import BoolArray, FloatArray, path_heading_rad
from pdrbench.io.log import Log
from pdrbench.recording import Recording, SensorSpec
from pdrbench.sensors import sensor_spec
from pdrbench.task import Task
from pdrbench.trajectory import Start, Trajectory
from pdrbench_envs.descriptions import describe
from pdrbench_envs.recorded import checked_file, opaque_id
from pdrbench_sim.readers import foot_stride_gcp, foot_vicon

PERIOD_S: Final = 0.05  # twenty answers a second: less than a rest of a running foot
CAPACITY: Final = 64  # 400 Hz for 0.05 s makes 20 rows; room for what comes in a heap
HEADING_AFTER_M: Final = 0.5  # within the first stride, so that no localizer has to guess for longer
STANDS_MPS: Final = 0.2  # slower than this a foot stands, as far as it matters for a heading
_ID_KEY: Final = b"pdrbench.foot_recordings"
_SLACK_S: Final = 1e-6  # as an episode has it: k * period_s is rounded
_NOTE: Final = "data differs from the registered {}: scores are not comparable with published tables"


@dataclass(frozen=True, slots=True)
class FootSet:
    """What one of these environments is made of."""

    env: str  # id of the environment
    datasets: tuple[str, ...]  # names of the registered datasets
    pattern: str  # which files of them are walks
    read: Callable[[Path], Log]  # reader of one walk
    reference: Callable[[Log], Trajectory]  # reference of the recording, from the log; its first row is the start
    device: str  # model of the unit
    noise_m: float  # error of the reference
    summary: str
    description: str
    sensors: tuple[str, ...] = ("accel", "gyro")
    rate_hz: float = 200.0

    @property
    def specs(self) -> tuple[SensorSpec, ...]:
        """Sensors at the rate of this unit."""
        return tuple(dataclasses.replace(sensor_spec(name), rate_hz=self.rate_hz) for name in self.sensors)

    @property
    def registered(self) -> dict[tuple[str, str], str]:
        """sha256 of every registered walk by the name of its set and its path in the folder of that."""
        rows = ((name, row) for name in self.datasets for row in dataset(name).files)
        return {(name, row.path): row.sha256 for name, row in rows if PurePosixPath(row.path).match(self.pattern)}


def motion_capture(log: Log) -> Trajectory:
    """Motion capture between its samples, at every time an estimate is asked for, so that the hold costs nothing.

    Not scored are the start and what lies beside a sample at which the foot was not seen. Heights count from the start.
    """
    captured = log.reference
    t_s = np.arange(math.floor((captured.t_s[-1] + _SLACK_S) / PERIOD_S) + 1) * PERIOD_S
    assert captured.z_m is not None
    x_m, y_m, z_m = (np.interp(t_s, captured.t_s, column) for column in (*captured.xy_m.T, captured.z_m))
    after = np.searchsorted(captured.t_s, t_s).clip(max=len(captured) - 1)
    seen = captured.surveyed[after] & captured.surveyed[np.maximum(after - 1, 0)]
    return on_the_ground(t_s, np.column_stack([x_m, y_m]), seen & (t_s > 0), z_m=z_m - z_m[0])


def rests(log: Log) -> Trajectory:
    """The foot at every stride, at the last time at or before it that an estimate is asked for.

    A stride index is the end of a stance, and at most a period earlier the foot stands, so that the hold costs nothing:
    under motion capture it is then 1 mm from where it is at the index (median), and 4 cm at most, in a run.
    """
    step = np.floor((log.reference.t_s + _SLACK_S) / PERIOD_S)
    is_new = np.diff(step, prepend=-1.0) > 0
    return on_the_ground(step[is_new] * PERIOD_S, log.reference.xy_m[is_new], np.arange(int(is_new.sum())) > 0)


def on_the_ground(t_s: FloatArray, xy_m: FloatArray, surveyed: BoolArray, z_m: FloatArray | None = None) -> Trajectory:
    return Trajectory(t_s=t_s, xy_m=xy_m, level=np.zeros(len(t_s), dtype=np.int64), surveyed=surveyed, z_m=z_m)


VICON: Final = FootSet(
    env="FootVicon-v1",
    datasets=("foot_vicon", "foot_vicon_2"),
    pattern="*.mat",
    read=foot_vicon.read,
    reference=motion_capture,
    device="LORD MicroStrain 3DM-GX3-25",
    noise_m=0.01,  # motion capture in a room, read between its samples
    summary="A unit on the foot under motion capture, walking and running in a room; start pose known",
    description=describe("foot_vicon", "foot", "foot_start", sensors="accelerometer and gyroscope at 200 Hz"),
)
WALKS: Final = FootSet(
    env="FootWalks-v1",
    datasets=("foot_stride_gcp", "foot_stride_gcp_2"),
    pattern="*_LLIO.mat",
    read=foot_stride_gcp.read,
    reference=rests,
    device="LORD MicroStrain 3DM-GX5-25",
    noise_m=0.02,  # by which places and inertial navigation agree over a stride
    summary="A unit on the foot, walks and runs of 40 to 116 m with a surveyed place at every stride; start pose known",
    description=describe("foot_walks", "foot", "foot_start", sensors="accelerometer and gyroscope at 200 Hz"),
)


def make_task(kind: FootSet) -> Task:
    found = found_walks(kind)
    walks = walk_ids(found)
    registered = dataset(kind.datasets[0])
    sources = dict.fromkeys(f"{of.source_url} commit {of.commit}" for of in map(dataset, kind.datasets))
    return Task(
        id=kind.env,
        summary=kind.summary,
        description=kind.description,
        sensors=kind.specs,
        capacity=dict.fromkeys(kind.sensors, CAPACITY),
        period_s=PERIOD_S,
        start="pose",
        walks={"test": tuple(walks)},
        load=lambda walk: _load(kind, walk, walks[walk], found[walks[walk]]),
        tell_start=tell_start,
        licence=registered.licence,
        source=", ".join(sources),
        files_sha256=lambda walk: "" if kind.registered.get(walks[walk]) == found[walks[walk]] else found[walks[walk]],
        units=dict.fromkeys(walks, "1"),  # Vicon: one person; the others do not say who walked, so they count as one
        unit_kind="person",
        noise_m=kind.noise_m,
        dataset=kind.datasets[0],
        note="" if found == kind.registered else _NOTE.format(" and ".join(kind.datasets)),
    )


def found_walks(kind: FootSet) -> Mapping[tuple[str, str], str]:
    """sha256 by set and path of the walks that this machine has, or of the registered ones where it has none.

    A registered name stands for the registered hash, which is checked when the walk is loaded.
    """
    registered, found = kind.registered, {}
    for of in filter(is_available, kind.datasets):
        folder = find(of)
        for path in folder.rglob("*"):
            if path.match(kind.pattern) and path.is_file():
                name = of, path.relative_to(folder).as_posix()
                found[name] = registered.get(name) or known_sha256(path)
    return found or registered


def walk_ids(found: Mapping[tuple[str, str], str]) -> dict[str, tuple[str, str]]:
    """Set and path by walk id, in the order of play, which is that of their opaque ids."""
    opaque = {name: opaque_id(name[1], _ID_KEY) for name in found}
    return {f"test-{opaque[name]}": name for name in sorted(found, key=lambda name: opaque[name])}


def _load(kind: FootSet, walk: str, name: tuple[str, str], sha256: str) -> Recording:
    log = _log(kind, name, find(name[0]) / name[1], sha256)
    rates = {spec.name: spec for spec in kind.specs}
    return dataclasses.replace(log, device=kind.device).recording(
        walk, None, lambda name: rates[name], reference=kind.reference(log), mounting="foot"
    )


@functools.lru_cache(maxsize=64)
def _log(kind: FootSet, name: tuple[str, str], place: Path, sha256: str) -> Log:
    """Reads a walk once it is known to be the one that is meant."""
    return kind.read(checked_file(place, sha256, name[0], "give another walk another name"))


def tell_start(recording: Recording) -> Start:
    """The first place of the reference, and the heading over the first `HEADING_AFTER_M`, if the walk goes so far."""
    reference = recording.reference
    stood_m = reference.xy_m[_stands(reference)]
    path_m = np.concatenate([reference.xy_m[:1], stood_m])
    heading_rad = path_heading_rad(path_m, HEADING_AFTER_M)
    return Start(xy_m=reference.xy_m[0], level=int(reference.level[0]), heading_rad=heading_rad)


def _stands(reference: Trajectory) -> BoolArray:
    """(T,) True where the foot stands, everywhere in a reference of places at which it does; in its swing a foot is off
    the path of its owner."""
    if len(reference) < 2 or np.median(np.diff(reference.t_s)) > 2 * PERIOD_S:
        return np.ones(len(reference), dtype=np.bool_)
    velocity_mps = np.gradient(reference.xy_m, reference.t_s, axis=0)
    stands: BoolArray = np.hypot(velocity_mps[:, 0], velocity_mps[:, 1]) < STANDS_MPS
    return stands


task_vicon = functools.partial(make_task, VICON)
task_walks = functools.partial(make_task, WALKS)
