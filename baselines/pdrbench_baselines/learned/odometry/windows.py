"""Windows of walks for training: simulated people with phones of every kind, the `train` walks of the malls, and sets.

Sources are those of `learned.data`: people who walk for training only, the way between surveyed places of
`MallPhone-v1` train reckoned from steps, and public sets in a folder, whose people of the test part are left out.
No `val` and no `test` walk of an environment is read here.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Final

import numpy as np

from pdrbench.errors import DatasetError, PdrbenchError
from pdrbench.geometry import FloatArray, IntArray
from pdrbench.recording import Recording
from pdrbench_baselines.learned.data import Way, simulated_way, way_of
from pdrbench_baselines.learned.kept_arrays import keep, kept
from pdrbench_baselines.learned.odometry.aligned import LENGTH, RATE_HZ, aligned
from pdrbench_baselines.learned.people import train_bearer
from pdrbench_baselines.learned.recordings import own_recordings
from pdrbench_baselines.learned.yaw_stabiliser import stabilised

PEOPLE: Final = "people"
MALL: Final = "mall"
SETS: Final = "sets"
KINDS: Final = (PEOPLE, MALL, SETS)
ENVIRONMENT: Final = "MallPhone-v1"
EVERY: Final = 10  # samples between the beginnings of windows, as of both papers
USED: Final = ("accel", "gyro", "rotation")
EDGE_S: Final = 0.1  # between places of `bent_way`: next to a leg that is left out the way may leap


@dataclass(frozen=True, slots=True, eq=False)
class OdometryWindows:
    """Samples of many walks, one after the other, and the windows in them whose displacement is known.

    Attributes:
        rows: (n, 6) float32 as in `Aligned`.
        begin: (N,) sample at which each window begins.
        move_m: (N, 2) float32 by how much the body moved meanwhile, in the frame of the rows.
        source: (N,) number of its source in `KINDS`.
        walk: (N,) number of its walk.
    """

    rows: np.ndarray
    begin: IntArray
    move_m: np.ndarray
    source: IntArray
    walk: IntArray

    def __len__(self) -> int:
        return len(self.begin)

    def inputs(self, which: IntArray) -> np.ndarray:
        """(B, 6, `LENGTH`) float32 windows by number."""
        at = self.begin[which][:, None] + np.arange(LENGTH)
        return np.ascontiguousarray(self.rows[at].transpose(0, 2, 1))


def walks(kinds: tuple[str, ...], people: int, group: str, sets: Path | None) -> Iterator[tuple[str, Recording, Way]]:
    """Kind, recording and way of every walk; with `group` "val" simulated people only, who are others.

    Raises:
        PdrbenchError: No such source, or recorded data that is not there.
    """
    for kind in kinds:
        if kind not in KINDS:
            raise PdrbenchError(f"no source of training data named {kind!r}; choose from {', '.join(KINDS)}")
        if kind == PEOPLE:
            for number in range(people):
                recording, person = train_bearer(number, group=group)
                yield kind, recording, simulated_way(recording.reference, person)
        elif kind == MALL and group == "train":
            from pdrbench.registry import make_task

            task = make_task(ENVIRONMENT)
            for name in task.split("train"):
                recording = task.load(name)
                yield kind, recording, way_of(recording)
        elif kind == SETS and group == "train":
            if sets is None:
                raise PdrbenchError(f"the source {SETS!r} needs a folder of recordings: --sets DIR")
            for recording in own_recordings(sets):
                yield kind, recording, way_of(recording)


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
    inside_s = np.array([EDGE_S, -EDGE_S])
    known_s = places.t_s[None, [0, -1]] if way.known_s is None else way.known_s + inside_s
    known = np.zeros(len(begin), dtype=np.bool_)
    for first_s, last_s in known_s.tolist():
        known |= (begin_s >= first_s - 1e-6) & (end_s <= last_s + 1e-6)
    missing = np.concatenate([[0], np.cumsum(~samples.is_whole)])
    known &= missing[begin + LENGTH] == missing[begin]
    at = [np.column_stack([np.interp(t_s, places.t_s, xy) for xy in places.xy_m.T]) for t_s in (begin_s, end_s)]
    return samples.rows.astype(np.float32), begin[known], (at[1] - at[0])[known]


def load_or_gather(
    folder: Path, kinds: tuple[str, ...], people: int, group: str = "train", sets: Path | None = None
) -> OdometryWindows:
    """Windows kept in a folder, made where they are not there yet, with `manifest-<group>.json` beside them.

    Raises:
        PdrbenchError: What is kept there was made of something else, or is torn.
    """
    path, manifest_path = folder / f"odometry-{group}.npz", folder / f"manifest-odometry-{group}.json"
    asked = {"kinds": list(kinds), "people": people, "group": group, "sets": str(sets.resolve()) if sets else ""}
    if (found := kept(OdometryWindows, path, manifest_path, asked)) is not None:
        return found
    windows, names = gather(walks(kinds, people, group, sets))
    keep(windows, path, manifest_path, asked, walks=names)
    return windows


def gather(found: Iterator[tuple[str, Recording, Way]]) -> tuple[OdometryWindows, list[str]]:
    """Windows of walks, and the names of those walks.

    Raises:
        DatasetError: Not one window.
    """
    parts: dict[str, list[np.ndarray]] = {field.name: [] for field in fields(OdometryWindows)}
    names: list[str] = []
    first = 0
    for kind, recording, way in found:
        rows, begin, move_m = windows_of(recording, way)
        if not len(begin):
            continue
        parts["rows"].append(rows)
        parts["begin"].append(first + begin)
        parts["move_m"].append(move_m.astype(np.float32))
        parts["source"].append(np.full(len(begin), KINDS.index(kind)))
        parts["walk"].append(np.full(len(begin), len(names)))
        names.append(f"{kind}: {recording.id}")
        first += len(rows)
    if not names:
        raise DatasetError("no window to learn from: more people, or another source")
    return OdometryWindows(**{name: np.concatenate(values) for name, values in parts.items()}), names
