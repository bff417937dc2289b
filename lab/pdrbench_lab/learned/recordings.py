"""A user's own recordings as a source of training data: phones carried along places that are known."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np

from pdrbench.errors import DatasetError
from pdrbench.recording import Recording
from pdrbench.sensors import sensor_spec
from pdrbench_formats.recordings import native
from pdrbench_lab.learned.public_sets import LISTS, TRAIN, load, public_walks
from pdrbench_sim.readers import ilc20

INDEX: Final = "recording.json"  # of a recording in the project's own storage
LOGS: Final = (".txt", ".txt.gz")  # of the form of the Indoor Location Competition 2.0
NEEDED: Final = ("accel", "gyro", "rotation")
DENSE_S: Final = 1.5  # places this close together are taken as the way itself; else the way is reckoned between them


def own_recordings(folder: Path) -> Iterator[Recording]:
    """Every recording below a folder, in the order of their names, then the walks to train on of public sets.

    Args:
        folder: Holds folders as `recordings.native` of the formats writes them, logs as `pdrbench_sim.readers.ilc20`
            reads them, and walks of `public_sets`.

    Raises:
        DatasetError: There is none, or one that lacks a sensor or has fewer than two places.
    """
    paths = {path.parent for path in folder.rglob(INDEX)}
    paths |= {path for path in folder.rglob("*.txt*") if path.name.endswith(LOGS)}
    paths -= {path for path in paths if path.name in LISTS}
    public = [walk for walk in public_walks(folder) if walk.part == TRAIN]
    if not paths and not public:
        raise DatasetError(
            f"{folder}: no recording; needs folders with {INDEX}, logs that end in {LOGS[0]}, or walks of RoNIN, RIDI "
            "or OxIOD"
        )
    for path in sorted(paths):
        if path.is_dir():
            recording = native.read(path)
        else:
            recording = ilc20.read(path).recording(path.relative_to(folder).as_posix(), None, sensor_spec)
        missing = [name for name in NEEDED if name not in recording.streams]
        if missing or len(recording.reference) < 2:
            what = f"{', '.join(missing)} is missing" if missing else "fewer than two known places"
            raise DatasetError(f"{path}: {what}; nothing can be learned from it, take it out of the folder")
        yield recording
    yield from map(load, public)


def is_dense(recording: Recording) -> bool:
    """Whether places follow each other so closely that the way between them is straight."""
    return float(np.median(np.diff(recording.reference.t_s))) <= DENSE_S
