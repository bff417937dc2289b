"""Windows of walks for training: simulated people with phones of every kind, the `train` walks of the malls, and sets.

Sources are those of `learned.data`: people who walk for training only, the way between surveyed places of
`MallPhone-v2` train reckoned from steps, and public sets in a folder, whose people of the test part are left out.
No `val` and no `test` walk of an environment is read here.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from joblib import Parallel, delayed

from pdrbench.errors import DatasetError, PdrbenchError
from pdrbench.geometry import FloatArray, IntArray
from pdrbench.recording import Recording
from pdrbench_lab.learned.data import Way, way_of
from pdrbench_lab.learned.kept_arrays import keep, kept
from pdrbench_lab.learned.odometry.aligned import LENGTH, RATE_HZ, aligned
from pdrbench_lab.learned.people import train_bearer
from pdrbench_lab.learned.public_sets import stabilised
from pdrbench_lab.learned.recordings import own_recordings

PEOPLE: Final = "people"
MALL: Final = "mall"
SETS: Final = "sets"
KINDS: Final = (PEOPLE, MALL, SETS)
ENVIRONMENT: Final = "MallPhone-v2"
EVERY: Final = 10  # samples between the beginnings of windows, as of both papers
USED: Final = ("accel", "gyro", "rotation")


@dataclass(frozen=True, slots=True, eq=False)
class OdometryWindows:
    """Samples of many walks, one after the other, and the windows in them whose displacement is known.

    Attributes:
        rows: (n, 6) float32 as in `Aligned`.
        begin: (N,) sample at which each window begins.
        move_m: (N, 2) float32 by how much the body moved meanwhile, in the frame of the rows.
        source: (N,) number of its source in `KINDS`.
        walk: (N,) number of its walk.
        outing: (N,) number of the unit that repeats, an outing through a mall or a person, within its source.
    """

    rows: np.ndarray
    begin: IntArray
    move_m: np.ndarray
    source: IntArray
    walk: IntArray
    outing: IntArray

    def __len__(self) -> int:
        return len(self.begin)

    def inputs(self, which: IntArray) -> np.ndarray:
        """(B, 6, `LENGTH`) float32 windows by number."""
        at = self.begin[which][:, None] + np.arange(LENGTH)
        return np.ascontiguousarray(self.rows[at].transpose(0, 2, 1))


class WalkWindows(NamedTuple):
    """What a walk gives to learn from.

    Attributes:
        name: Of the walk.
        unit: Name of the outing, or of the person.
        rows, begin, move_m: See `windows_of`.
    """

    name: str
    unit: str
    rows: np.ndarray
    begin: IntArray
    move_m: FloatArray


def walks(kind: str, people: int, group: str, sets: Path | None, jobs: int = 1) -> Iterable[WalkWindows]:
    """Windows of every walk of a source; with `group` "val" there are simulated people only, who are others.

    Args:
        kind: One of `KINDS`.
        people: Simulated ones.
        group: "train" or "val".
        sets: Folder of the source "sets".
        jobs: Processes among which people are divided; the same comes of any number.

    Raises:
        PdrbenchError: No such source, or recorded data that is not there.
    """
    if kind == PEOPLE:
        tasks = (delayed(_of_person)(number, group) for number in range(people))
        found: Iterable[WalkWindows] = Parallel(n_jobs=jobs, return_as="generator")(tasks)
        return found
    if kind == MALL:
        return _of_mall()
    if kind == SETS:
        if sets is None:
            raise PdrbenchError(f"the source {SETS!r} needs a folder of recordings: --sets DIR")
        return (_of_recording(recording, recording.id) for recording in own_recordings(sets))
    raise PdrbenchError(f"no source of training data named {kind!r}; choose from {', '.join(KINDS)}")


def _of_person(number: int, group: str) -> WalkWindows:
    recording = train_bearer(number, group=group)
    return WalkWindows(recording.id, recording.id, *windows_of(recording, Way(recording.reference)))


def _of_mall() -> Iterator[WalkWindows]:
    from pdrbench.registry import make_task

    task = make_task(ENVIRONMENT)
    for name in task.split("train"):
        yield _of_recording(task.load(name), task.units[name])


def _of_recording(recording: Recording, unit: str) -> WalkWindows:
    return WalkWindows(recording.id, unit, *windows_of(recording, way_of(recording)))


def windows_of(recording: Recording, way: Way) -> tuple[np.ndarray, IntArray, FloatArray]:
    """Samples of a walk, and the windows in it whose displacement is known.

    Returns:
        rows: (n, 6) float32.
        begin: (N,) sample at which each window begins.
        move_m: (N, 2).
    """
    rows = {name: recording.streams[name].rows for name in USED}
    rows["rotation"] = stabilised(rows["rotation"], rows["gyro"])
    from_s = max(float(one[0, 0]) for one in rows.values())
    till_s = min(float(one[-1, 0]) for one in rows.values())
    count = max(int((till_s - from_s) * RATE_HZ) + 1, 0)
    samples = aligned(rows["accel"], rows["gyro"], rows["rotation"], from_s, count)
    begin = np.arange(0, max(count - LENGTH, 0), EVERY)
    begin_s = from_s + begin / RATE_HZ
    end_s = begin_s + LENGTH / RATE_HZ
    places = way.places
    known = way.holds(begin_s, end_s)
    missing = np.concatenate([[0], np.cumsum(~samples.is_whole)])
    known &= missing[begin + LENGTH] == missing[begin]
    at = [np.column_stack([np.interp(t_s, places.t_s, xy) for xy in places.xy_m.T]) for t_s in (begin_s, end_s)]
    return samples.rows.astype(np.float32), begin[known], (at[1] - at[0])[known]


def load_or_gather(
    folder: Path, kinds: tuple[str, ...], people: int, group: str = "train", sets: Path | None = None, jobs: int = 1
) -> OdometryWindows:
    """Windows of sources, each kept in a folder, made where they are not there yet, with a manifest beside them.

    Raises:
        PdrbenchError: What is kept there was made of something else, or is torn.
    """
    return joined([_source(folder, kind, people, group, sets, jobs) for kind in kinds])


def _source(folder: Path, kind: str, people: int, group: str, sets: Path | None, jobs: int) -> OdometryWindows:
    path, manifest_path = (folder / f"odometry-{kind}-{group}{end}" for end in (".npz", ".json"))
    asked = {
        "kind": kind,
        "people": people if kind == PEOPLE else 0,
        "group": group,
        "sets": str(sets.resolve()) if sets is not None and kind == SETS else "",
    }
    if (found := kept(OdometryWindows, path, manifest_path, asked)) is not None:
        return found
    windows, names = gather(kind, walks(kind, people, group, sets, jobs))
    keep(windows, path, manifest_path, asked, walks=names)
    return windows


def gather(kind: str, found: Iterable[WalkWindows]) -> tuple[OdometryWindows, list[str]]:
    """Windows of walks of a source, and the names of those walks.

    Raises:
        DatasetError: Not one window.
    """
    parts: dict[str, list[np.ndarray]] = {field.name: [] for field in fields(OdometryWindows)}
    names: list[str] = []
    units: dict[str, int] = {}
    first = 0
    for walk in found:
        count = len(walk.begin)
        if not count:
            continue
        unit = units.setdefault(walk.unit, len(units))
        parts["rows"].append(walk.rows)
        parts["begin"].append(first + walk.begin)
        parts["move_m"].append(walk.move_m.astype(np.float32))
        for name, number in (("source", KINDS.index(kind)), ("walk", len(names)), ("outing", unit)):
            parts[name].append(np.full(count, number))
        names.append(walk.name)
        first += len(walk.rows)
    if not names:
        raise DatasetError(f"no window to learn from in the source {kind!r}: more people, or another source")
    return OdometryWindows(**{name: np.concatenate(values) for name, values in parts.items()}), names


def joined(windows: list[OdometryWindows]) -> OdometryWindows:
    """Windows of several sources as one."""
    first_row = np.cumsum([0, *(len(one.rows) for one in windows)])
    first_walk = np.cumsum([0, *(int(one.walk.max()) + 1 for one in windows)])
    parts = {field.name: [getattr(one, field.name) for one in windows] for field in fields(OdometryWindows)}
    for name, first in (("begin", first_row), ("walk", first_walk)):
        parts[name] = [values + begin for values, begin in zip(parts[name], first, strict=False)]
    return OdometryWindows(**{name: np.concatenate(values) for name, values in parts.items()})
