"""Cuts walks into windows for `pdrbench.learning.windows`, and keeps them below the cache folder."""

from __future__ import annotations

import contextlib
import hashlib
import json
import shutil
import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from pdrbench.errors import PdrbenchError
from pdrbench.evaluation.origin import environment_version
from pdrbench.geometry import FloatArray, IntArray
from pdrbench.inertial import PeakStepDetector, to_world
from pdrbench.learning.windows import Cut, Floats
from pdrbench.registry import make_kept_task
from pdrbench.trajectory import Trajectory
from pdrbench_envs.kept import kept_folder

MAX_GAP_S: Final = 0.25  # half a step; samples are not made up for longer
DENSE_S: Final = 1.5  # places this close together are the way itself; these three as in the training of `learned`
STEP_M: Final = 0.63
MAX_OFF: Final = 0.45  # of the length of a leg by which steps may differ from it: more were detours
Part = tuple[dict[str, Any], Floats, IntArray, Floats]


def kept_windows(envs: tuple[str, ...], split: str, walks: int | None, cut: Cut, jobs: int) -> Path:
    """The folder of windows, which are cut where it is not there yet."""
    from joblib import Parallel, delayed

    calls, asked = [], [str(cut)]
    for env in envs:
        task = make_kept_task(env)
        asked += [task.id, environment_version(env.removeprefix("pdrbench/"))]
        for walk in task.split(split)[:walks]:
            calls.append(delayed(_windows_of)(env, walk, cut))
            asked += [walk, *task.walk_identity(walk).values()]
    folder = kept_folder("windows") / hashlib.sha256("\n".join(asked).encode()).hexdigest()[:24]
    if not folder.is_dir():
        _write(folder, Parallel(n_jobs=jobs)(calls))
    return folder


def _windows_of(env: str, walk: str, cut: Cut) -> Part:
    """Facts on a walk, its samples (n, C), the first of each window (N,), and by how much that moves (N, 2)."""
    task = make_kept_task(env)
    recording = task.load(walk)
    streams = {name: stream.rows for name, stream in recording.streams.items() if len(stream.rows) > 1}
    needed = (*cut.sensors, "rotation") if cut.frame == "level" else cut.sensors
    if lacking := [name for name in needed if name not in streams]:
        raise PdrbenchError(f"{task.id} {walk} has no {lacking[0]!r}; windows ask for {', '.join(map(repr, needed))}")
    times_s = [streams[name][:, 0] for name in needed]
    from_s, till_s = max(t_s[0] for t_s in times_s), min(t_s[-1] for t_s in times_s)
    edges_s = from_s + np.arange(max(int((till_s - from_s) * cut.rate_hz), 0) + 1) / cut.rate_hz
    after = [np.searchsorted(t_s, edges_s[:-1], side="right").clip(1, len(t_s) - 1) for t_s in times_s]
    gaps_s = [t_s[row] - t_s[row - 1] for t_s, row in zip(times_s, after, strict=True)]
    missing = np.concatenate([[0], np.cumsum(np.max(gaps_s, axis=0) > MAX_GAP_S)])
    begin = np.arange(0, max(len(edges_s) - 1 - cut.length, 0), cut.stride)
    span_s = edges_s[begin], edges_s[begin + cut.length]
    way, known_s = _way(recording.reference, streams.get("accel", np.zeros((0, 4))))
    inside = (span_s[0][:, None] >= known_s[:, 0] - 1e-6) & (span_s[1][:, None] <= known_s[:, 1] + 1e-6)
    known = inside.any(axis=1) & (missing[begin + cut.length] == missing[begin])
    first, last = (np.column_stack([np.interp(t_s, way[:, 0], xy) for xy in way[:, 1:].T]) for t_s in span_s)
    values = [_means(streams, name, cut, edges_s) for name in cut.sensors]
    ends = np.cumsum([0, *(one.shape[1] for one in values)]).tolist()
    facts = {
        "walk": f"{task.id} {walk}",
        "building": "" if recording.building is None else recording.building.name,
        "person": f"{task.id} {walk if task.unit_kind == 'building' else task.units.get(walk, walk)}",
        "device": recording.device,
        "env": task.id,
        "channels": {name: ends[number : number + 2] for number, name in enumerate(cut.sensors)},
    }
    return facts, np.hstack(values), begin[known], (last - first)[known].astype(np.float32)


def _means(streams: Mapping[str, FloatArray], name: str, cut: Cut, edges_s: FloatArray) -> Floats:
    """(n, C) means of a sensor between `edges_s` (n + 1,)."""
    t_s, values = streams[name][:, 0], streams[name][:, 1:]
    if cut.frame == "level" and values.shape[1] == 3:
        rotation = streams["rotation"]
        row = np.searchsorted(rotation[:, 0], t_s, side="right").clip(1, len(rotation)) - 1
        values = to_world(rotation[row, 1:], values)
    areas = (values[1:] + values[:-1]) / 2 * np.diff(t_s)[:, None]
    summed = np.vstack([np.zeros(values.shape[1]), np.cumsum(areas, axis=0)])
    means = [np.diff(np.interp(edges_s, t_s, one)) * cut.rate_hz for one in summed.T]
    return np.column_stack(means).astype(np.float32)


def _way(places: Trajectory, accel: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Times and places (n, 3), and spans (K, 2) of time in which they are known: see `windows` and `MAX_OFF`."""
    way = np.column_stack([places.t_s, places.xy_m])
    if len(way) < 2 or np.median(np.diff(way[:, 0])) <= DENSE_S:
        return way, np.array([way[[0, -1], 0]] if len(way) else []).reshape(-1, 2)
    step_s = PeakStepDetector(float(len(accel) / np.ptp(accel[:, 0]))).update(accel) if len(accel) else way[:0, 0]
    t_s = np.unique(np.concatenate([way[:, 0], step_s[(step_s > way[0, 0]) & (step_s < way[-1, 0])]]))
    taken = np.interp(t_s, step_s, np.arange(len(step_s))) if len(step_s) else np.zeros(len(t_s))
    at = np.interp(way[:, 0], t_s, taken)
    steps, length_m = np.diff(at), np.hypot(*np.diff(way[:, 1:], axis=0).T)
    goes = (steps >= 2) & (np.abs(STEP_M * steps - length_m) <= MAX_OFF * length_m)
    legs = [np.interp(taken, at, xy) for xy in way[:, 1:].T]
    return np.column_stack([t_s, *legs]), np.column_stack([way[:-1, 0], way[1:, 0]])[goes]


def _write(folder: Path, parts: Iterable[Part]) -> None:
    """Puts walks one after the other into a folder, which is there once it is whole."""
    facts, rows, begin, move_m = zip(*parts, strict=True)
    first = np.cumsum([0, *map(len, rows)])
    new = Path(tempfile.mkdtemp(dir=folder.parent))
    np.save(new / "rows.npy", np.concatenate(rows))
    np.save(new / "begin.npy", np.concatenate([one + at for one, at in zip(begin, first, strict=False)]))
    np.save(new / "move_m.npy", np.concatenate(move_m))
    np.save(new / "walk.npy", np.repeat(np.arange(len(facts)), list(map(len, begin))))
    (new / "facts.json").write_text(json.dumps(facts), encoding="utf-8")
    with contextlib.suppress(OSError):  # another process was faster
        new.rename(folder)
    shutil.rmtree(new, ignore_errors=True)
