"""Windows for training: where they come from, the displacement of each, a manifest of everything that went in.

Sources: simulated people of every kind with phones of every kind, who walk for training only (`bearers`), the `train`
walks of CampusPhone-v1, those of MallPhone-v2 (`mall`), of RetailPhone-v1 (`retail`) and of IpinPhone-v1 (`museum`), of
the last two also those of `val`, and a user's own recordings. Between two surveyed places the way is reckoned from
steps and bent to meet both. No other `val` walk and no `test` walk of an environment is ever read here.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass, fields
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import numpy as np
from joblib import Parallel, delayed

from pdrbench.errors import DatasetError, PdrbenchError
from pdrbench.geometry import BoolArray, FloatArray, IntArray
from pdrbench.inertial import PeakStepDetector, phone_heading_rad
from pdrbench.recording import Recording
from pdrbench.trajectory import Trajectory
from pdrbench_baselines.learned.signals import HORIZON, MIN_RATE_HZ, RATE_HZ, Signals, grid_signals
from pdrbench_lab.learned.kept_arrays import keep, kept
from pdrbench_lab.learned.people import train_bearer
from pdrbench_lab.learned.public_sets import stabilised
from pdrbench_lab.learned.recordings import is_dense, own_recordings

OWN: Final = "own"
BEARERS: Final = "bearers"
SOURCES: Final = ("campus", "mall", OWN, BEARERS, "museum", "retail")
# Samples between windows: recorded walks are few.
EVERY: Final = {"campus": 50, "mall": 25, OWN: 10, BEARERS: 50, "museum": 10, "retail": 10}
ENVIRONMENTS: Final = {
    "campus": "CampusPhone-v1",
    "mall": "MallPhone-v2",
    "museum": "IpinPhone-v1",
    "retail": "RetailPhone-v1",
}
PARTS: Final = {"museum": ("train", "val"), "retail": ("train", "val")}  # learned from; ("train",) of the others
UNKNOWN_HEIGHT_M: Final = 0.0
STEP_M: Final = 0.63  # of DeadReckoning; only the fraction of each step in its leg matters
MAX_LEG_S: Final = 25.0
MAX_BEND: Final = 0.45  # of the length of a leg by which steps may miss its end: more were detours, or turned back
MIN_LEG_M: Final = 2.0
EDGE_S: Final = 0.1  # between places of `bent_way`: next to a leg that is left out the way may leap


@dataclass(frozen=True, slots=True, eq=False)
class Windows:
    """Signals of many walks, one after the other, and their windows whose displacement is known.

    Attributes:
        accel, gyro, up: (n, 3) as in `Signals`.
        twist: (n, 2).
        end: (N,) sample at which each window ends.
        begin: (N,) sample at which its walk begins.
        move_m: (N, 2) by how much the body moved in the last second of it, in the frame of the rotation vector.
        walk: (N,) number of its walk.
        height_m: (N,) of the person, 0 where unknown.
        source: (N,) number of its source in `SOURCES`.
        pocket: (N,) whether the walk began with the phone in a pocket.
    """

    accel: FloatArray
    gyro: FloatArray
    up: FloatArray
    twist: FloatArray
    end: IntArray
    begin: IntArray
    move_m: FloatArray
    walk: IntArray
    height_m: FloatArray
    source: IntArray
    pocket: IntArray

    def __len__(self) -> int:
        return len(self.end)


@dataclass(frozen=True, slots=True, eq=False)
class WalkWindows:
    """What a walk gives to learn from.

    Attributes:
        name: Id of the walk.
        kind: Its source.
        signals: With a steady yaw.
        end: (N,) sample at which each window ends whose displacement is known.
        move_m: (N, 2) by how much the body moved in its last second.
        height_m: Of the person, 0 where unknown.
        in_pocket: Whether the walk began with the phone in a pocket.
    """

    name: str
    kind: str
    signals: Signals
    end: IntArray
    move_m: FloatArray
    height_m: float
    in_pocket: bool


def windows_of_sources(
    kinds: tuple[str, ...], people: int, group: str = "train", recordings: Path | None = None, jobs: int = 1
) -> Iterator[WalkWindows]:
    """Walks to learn from, or with `group` "val" those of other people, to choose by.

    Args:
        kinds: Some of `SOURCES`; all but "bearers" have walks to learn from only.
        people: Number of simulated people, of whom more begin like fewer.
        group: "train" or "val".
        recordings: Folder of the source "own".
        jobs: Processes among which people are divided; the same comes of any number.

    Raises:
        PdrbenchError: No such source, or recorded data that is not available.
    """
    for kind in kinds:
        if kind not in SOURCES:
            raise PdrbenchError(f"no source of training data named {kind!r}; choose from {', '.join(SOURCES)}")
        if kind == BEARERS:
            yield from Parallel(n_jobs=jobs, return_as="generator")(
                delayed(_windows_of_person)(number, group) for number in range(people)
            )
        elif group == "train" and kind == OWN:
            if recordings is None:
                raise PdrbenchError(f"the source {OWN!r} needs a folder of recordings: --recordings DIR")
            for recording in own_recordings(recordings):
                yield windows_of(recording.id, kind, recording, way_of(recording))
        elif group == "train":
            from pdrbench.registry import make_task

            task = make_task(ENVIRONMENTS[kind])
            for name in [walk for part in PARTS.get(kind, ("train",)) for walk in task.split(part)]:
                recording = task.load(name)
                yield windows_of(name, kind, recording, way_of(recording))


def _windows_of_person(number: int, group: str) -> WalkWindows:
    walk = train_bearer(number, group=group)
    return windows_of(f"{group}-{walk.id}", BEARERS, walk, Way(walk.reference))


@dataclass(frozen=True, slots=True, eq=False)
class Way:
    """Where a walk led.

    Attributes:
        places: Of the body.
        known_s: (K, 2) spans within which they are right; None for all of them.
    """

    places: Trajectory
    known_s: FloatArray | None = None

    def holds(self, begin_s: FloatArray, end_s: FloatArray) -> BoolArray:
        """(N,) whether places are right from `begin_s` (N,) to `end_s` (N,)."""
        known_s = self.places.t_s[None, [0, -1]] if self.known_s is None else self.known_s + np.array([EDGE_S, -EDGE_S])
        inside = (begin_s[:, None] >= known_s[:, 0] - 1e-6) & (end_s[:, None] <= known_s[:, 1] + 1e-6)
        known: BoolArray = np.logical_or.reduce(inside, axis=1)
        return known


def way_of(recording: Recording) -> Way:
    """The way of a recording: its reference where places are dense, else bent between places."""
    return Way(recording.reference) if is_dense(recording) else Way(*bent_way(recording))


def bent_way(recording: Recording) -> tuple[Trajectory, FloatArray]:
    """The way between surveyed places: steps along the reported heading, bent so that every leg ends at its place.

    What steps miss a place by is spread over the leg in proportion to the steps taken. Legs that steps miss by more
    than `MAX_BEND` of their length are left out, as are short and long ones.

    Returns:
        way: Places of the body.
        known_s: (K, 2) spans of the legs that are not left out.
    """
    accel, places = recording.streams["accel"].rows, recording.reference
    rotation = stabilised(recording.streams["rotation"].rows, recording.streams["gyro"].rows)
    rate_hz = (len(accel) - 1) / (accel[-1, 0] - accel[0, 0])
    step_s = PeakStepDetector(float(rate_hz)).update(accel)
    t_s = np.arange(places.t_s[0], places.t_s[-1] + 0.05, 0.1)
    steps = np.interp(t_s, *_count(step_s, t_s))
    row = np.maximum(np.searchsorted(rotation[:, 0], t_s, side="right") - 1, 0)
    heading_rad = phone_heading_rad(rotation[row, 1:5])
    heading = np.column_stack([np.cos(heading_rad), np.sin(heading_rad)])
    reckoned_m = np.cumsum(STEP_M * np.diff(steps, prepend=steps[0])[:, None] * heading, axis=0)
    xy_m, known = reckoned_m.copy(), []
    for i in range(len(places) - 1):
        begin_s, end_s = float(places.t_s[i]), float(places.t_s[i + 1])
        span = (t_s >= begin_s - 1e-9) & (t_s <= end_s + 1e-9)
        leg_m = places.xy_m[i + 1] - places.xy_m[i]
        taken = steps[span]
        length_m = float(np.hypot(*leg_m))
        if len(taken) < 2 or taken[-1] - taken[0] < 2 or length_m < MIN_LEG_M:
            continue
        fraction = (taken - taken[0]) / (taken[-1] - taken[0])
        own_m = reckoned_m[span] - reckoned_m[span][0]
        missed_m = leg_m - own_m[-1]
        xy_m[span] = places.xy_m[i] + own_m + fraction[:, None] * missed_m
        if np.hypot(*missed_m) <= MAX_BEND * length_m and end_s - begin_s <= MAX_LEG_S:
            known.append((begin_s, end_s))
    way = Trajectory(t_s=t_s, xy_m=xy_m, level=np.full(len(t_s), places.level[0]), surveyed=np.zeros(len(t_s), bool))
    return way, np.array(known).reshape(-1, 2)


def _count(step_s: FloatArray, t_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Times and number of steps taken until then; a step is spread over the time since the one before, up to 1 s."""
    if not len(step_s):
        return t_s[[0, -1]], np.zeros(2)
    began_s = np.maximum(step_s - 1.0, np.concatenate([[step_s[0] - 0.6], step_s[:-1]]))
    times_s = np.column_stack([began_s, step_s]).ravel()
    number = np.arange(len(step_s))
    return times_s, np.column_stack([number, number + 1]).ravel().astype(np.float64)


def gather(walks: Iterator[WalkWindows]) -> tuple[Windows, list[dict[str, Any]]]:
    """Windows of walks, and what the manifest says of each.

    Raises:
        DatasetError: Not one window.
    """
    parts: dict[str, list[np.ndarray]] = {field.name: [] for field in fields(Windows)}
    rows: list[dict[str, Any]] = []
    begin = 0
    for walk in walks:
        signals, count = walk.signals, len(walk.end)
        digest = _digest(signals, walk.move_m)
        rows.append({"name": walk.name, "source": walk.kind, "windows": count, "sha256": digest})
        if not count:
            continue
        for name in ("accel", "gyro", "up", "twist"):
            parts[name].append(getattr(signals, name).astype(np.float32))
        parts["end"].append(begin + walk.end)
        parts["move_m"].append(walk.move_m.astype(np.float32))
        same = {
            "begin": begin,
            "walk": len(rows) - 1,
            "height_m": walk.height_m,
            "source": SOURCES.index(walk.kind),
            "pocket": int(walk.in_pocket),
        }
        for name, value in same.items():
            parts[name].append(np.full(count, value, dtype=np.float32 if name == "height_m" else np.int64))
        begin += len(signals)
    if not parts["end"]:
        raise DatasetError("no window to learn from: more people, or another source")
    return Windows(**{name: np.concatenate(values) for name, values in parts.items()}), rows


def windows_of(name: str, kind: str, recording: Recording, way: Way) -> WalkWindows:
    """Signals of a walk, and the displacements that its windows are to give.

    Args:
        name: Id of the walk.
        kind: One of `SOURCES`.
        recording: Its signals.
        way: Where it led.

    Raises:
        DatasetError: A sensor slower than `MIN_RATE_HZ`.
    """
    places = way.places
    rows = {sensor: recording.streams[sensor].rows for sensor in ("accel", "gyro", "rotation")}
    rows["rotation"] = stabilised(rows["rotation"], rows["gyro"])
    for sensor in ("accel", "gyro"):
        rate_hz = (len(rows[sensor]) - 1) / max(rows[sensor][-1, 0] - rows[sensor][0, 0], 1e-9)
        if rate_hz < MIN_RATE_HZ:
            raise DatasetError(f"{name}: {sensor} at {rate_hz:.0f} Hz; {MIN_RATE_HZ:g} Hz are needed")
    # A window ends at every full second, where many references have places.
    from_s = np.ceil(max(float(one[0, 0]) for one in rows.values()))
    till_s = min(float(one[-1, 0]) for one in rows.values())
    signals = grid_signals(rows["accel"], rows["gyro"], rows["rotation"], from_s, till_s)
    end = np.arange(HORIZON, len(signals) + 1, EVERY[kind])
    end_s = from_s + end / RATE_HZ
    begin_s = end_s - HORIZON / RATE_HZ
    known = way.holds(begin_s, end_s)
    known &= np.array([bool(signals.is_whole[e - HORIZON : e].all()) for e in end], dtype=np.bool_).reshape(len(end))
    at = [np.column_stack([np.interp(t_s, places.t_s, xy) for xy in places.xy_m.T]) for t_s in (begin_s, end_s)]
    height_m = float(recording.subject.get("height_m", UNKNOWN_HEIGHT_M))
    in_pocket = recording.mounting == "pocket"
    return WalkWindows(name, kind, signals, end[known], (at[1] - at[0])[known], height_m, in_pocket)


def _digest(signals: Signals, move_m: FloatArray) -> str:
    """sha256 of what a walk gives, to single precision."""
    content = hashlib.sha256()
    for values in (signals.accel, signals.gyro, signals.up, signals.twist, move_m):
        content.update(np.ascontiguousarray(values, dtype=np.float32).tobytes())
    return content.hexdigest()


def load_or_gather(
    folder: Path,
    kinds: tuple[str, ...],
    people: int,
    group: str = "train",
    recordings: Path | None = None,
    jobs: int = 1,
) -> Windows:
    """Windows kept in a folder, made where they are not there yet, with `manifest-<group>.json` beside them.

    Args:
        folder: Of a training run.
        kinds, people, group, recordings, jobs: See `windows_of_sources`.

    Raises:
        PdrbenchError: What is kept there was made of something else, or is torn.
    """
    path, manifest_path = folder / f"windows-{group}.npz", folder / f"manifest-{group}.json"
    own = "" if recordings is None else str(recordings.resolve())
    asked = {"sources": list(kinds), "people": people, "group": group, "recordings": own}
    if (found := kept(Windows, path, manifest_path, asked)) is not None:
        return found
    windows, rows = gather(windows_of_sources(kinds, people, group, recordings, jobs))
    keep(windows, path, manifest_path, asked, made_with=_made_with(kinds), walks=rows)
    return windows


def _made_with(kinds: tuple[str, ...]) -> dict[str, str]:
    """Versions of packages, and the id of the environment that a source takes its walks from."""
    versions = {name: version(name) for name in ("pdrbench", "numpy", "scipy")}
    return versions | {kind: ENVIRONMENTS[kind] for kind in kinds if kind in ENVIRONMENTS}
