"""A user's own recordings as a source of training data: phones carried along places that are known."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np

from pdrbench.errors import DatasetError
from pdrbench.recording import Recording, SensorStream
from pdrbench.registry import TASK_FILE
from pdrbench.sensors import sensor_spec
from pdrbench_formats.derive.attitude import attitude
from pdrbench_formats.recordings import native
from pdrbench_formats.taskfile import task_of_file
from pdrbench_lab.learned.public_sets import LISTS, TRAIN, in_phone_frame, load, public_walks
from pdrbench_sim.readers import ilc20

INDEX: Final = "recording.json"  # of a recording in the project's own storage
LOGS: Final = (".txt", ".txt.gz")  # of the form of the Indoor Location Competition 2.0
NEEDED: Final = ("accel", "gyro", "rotation")
DENSE_S: Final = 1.5  # places this close together are taken as the way itself; else the way is reckoned between them


def own_recordings(folder: Path) -> Iterator[Recording]:
    """Every recording below a folder, in the order of their names, then the walks to train on of public sets.

    Args:
        folder: Holds a `task.toml`, whose walks of the split "train" count, whatever format they are in; or folders as
            `recordings.native` of the formats writes them, logs as `pdrbench_sim.readers.ilc20` reads them, and walks
            of `public_sets`.

    Raises:
        DatasetError: There is none, or one that lacks a sensor or has fewer than two places.
    """
    if (folder / TASK_FILE).is_file():
        yield from _of_task(folder / TASK_FILE)
        return
    paths = {path.parent for path in folder.rglob(INDEX)}
    paths |= {path for path in folder.rglob("*.txt*") if path.name.endswith(LOGS)}
    paths -= {path for path in paths if path.name in LISTS}
    public = [walk for walk in public_walks(folder) if walk.part == TRAIN]
    if not paths and not public:
        raise DatasetError(
            f"{folder}: no recording; needs a {TASK_FILE} that names recordings of the split {TRAIN!r}, folders with "
            f"{INDEX}, logs that end in {LOGS[0]}, or walks of RoNIN, RIDI or OxIOD"
        )
    for path in sorted(paths):
        if path.is_dir():
            recording = native.read(path)
        else:
            recording = ilc20.read(path).recording(path.relative_to(folder).as_posix(), None, sensor_spec)
        yield _whole(path, recording)
    yield from map(load, public)


def _of_task(path: Path) -> Iterator[Recording]:
    """Walks to train on that a task file names; an attitude that is computed has a frame of its own, places with it."""
    task = task_of_file(path)
    walks = task.walks.get(TRAIN, ())
    if not walks:
        raise DatasetError(f"{path}: no walk of the split {TRAIN!r}; write split = {TRAIN!r} in a [[walk]]")
    for walk in walks:
        recording = _whole(path.parent / walk, task.load(walk))
        accel, gyro, rotation = (recording.streams[name].rows for name in NEEDED)
        if recording.streams["rotation"].spec.derived and is_dense(recording):
            reference = in_phone_frame(recording.reference, accel, gyro, rotation)
            recording = dataclasses.replace(recording, reference=reference)
        yield recording


def _whole(path: Path, recording: Recording) -> Recording:
    """A recording that something can be learned from; an attitude that it lacks is computed."""
    streams = dict(recording.streams)
    if "rotation" not in streams and {"accel", "gyro"} <= streams.keys():
        rows = {name: stream.rows for name, stream in streams.items()}
        spec = dataclasses.replace(sensor_spec("rotation"), derived=True)
        streams["rotation"] = SensorStream(spec, attitude(rows["accel"], rows["gyro"], rows.get("mag")))
        recording = dataclasses.replace(recording, streams=streams)
    missing = [name for name in NEEDED if name not in streams]
    if missing or len(recording.reference) < 2:
        what = f"{', '.join(missing)} is missing" if missing else "fewer than two known places"
        raise DatasetError(f"{path}: {what}; nothing can be learned from it, take it out of the folder")
    return recording


def is_dense(recording: Recording) -> bool:
    """Whether places follow each other so closely that the way between them is straight."""
    return float(np.median(np.diff(recording.reference.t_s))) <= DENSE_S
