"""Experiments on recordings of the foot, behind `claims`: one function for each set and question.

What a localizer can know is played through its environment. What it cannot, such as labels of zero velocity or the
covariance at every sample, is measured with the functions of `pdrbench.inertial` on the same recordings.
"""

from __future__ import annotations

import math
import re
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from pdrbench.datasets import find
from pdrbench.evaluation import evaluate
from pdrbench.geometry import FloatArray, IntArray, wrap_rad
from pdrbench.inertial import (
    DETECTORS,
    LITERAL,
    FootParams,
    FootStates,
    Rest,
    Strides,
    detect,
    find_strides,
    navigate,
    navigate_smoothed,
)
from pdrbench.io.log import Log
from pdrbench.metrics.odometry import align_se2
from pdrbench.registry import make_task
from pdrbench.result import FAILED, OFFLINE, ONLINE
from pdrbench.trajectory import Trajectory
from pdrbench_lab.readers import foot_dual, foot_loops, foot_short, foot_vicon_labels
from pdrbench_sim.foot.known_walk import walk as synthetic_walk
from pdrbench_sim.readers import foot_stride_gcp, foot_vicon

VICON: Final = "FootVicon-v1"
WALKS: Final = "FootWalks-v1"
LOOPS: Final = "FootLoops-v1"
SHORT: Final = "FootShort-v1"
REVISED: Final = "foot_ins_smooth"  # key of what the localizer makes of a walk when it is over
# Names of localizers by the keys of their figures.
PLAYED: Final = {
    "foot_ins": "foot_ins?revises=false",
    "foot_ins_adaptive": "foot_ins_robust?revises=false",
    "foot_ins_smooth": "foot_ins_robust",
}
BY_DETECTOR: Final = {
    f"foot_ins_{name}": f"foot_ins?detector={name}&revises=false" for name in ("are", "mv", "mag", "interval")
}
WALKING: Final = (31, 32, 33, 36)  # of `foot_stride_gcp`, by the number in the name of the file
RUNNING: Final = (34, 35)
SAME_STANCE_S: Final = 0.35  # a rest and a surveyed stride farther apart belong to two stances
GROWTH_STRIDES: Final = 24  # W2: how many strides errors are followed over
TURNED_BY_RAD: Final = math.radians(25.0)  # F8: of the unit on the synthetic foot
STILL: Final = 0.01  # m/s, F7: the velocity of a foot that rests, where rests are given
_READERS: Final[Mapping[str, tuple[str, Callable[[Path], Log]]]] = MappingProxyType(
    {
        "foot_vicon": ("*.mat", foot_vicon.read),
        "foot_vicon_2": ("*.mat", foot_vicon.read),
        "foot_stride_gcp": ("*_LLIO.mat", foot_stride_gcp.read),
        "foot_stride_gcp_2": ("*_LLIO.mat", foot_stride_gcp.read),
        "foot_dual": ("imuMeas*.csv", foot_dual.read),
        "foot_loops": ("Measurement_*/data_inert.txt", foot_loops.read),
        "foot_short": ("*.csv", foot_short.read),
    }
)


@dataclass(frozen=True, slots=True)
class FootWalk:
    """One recording of a foot.

    Attributes:
        path: Its file.
        t_s: (n,) seconds.
        accel: (n, 3) m/s2.
        gyro: (n, 3) rad/s.
        reference: As recorded, at every sample or every stride.
    """

    path: Path
    t_s: FloatArray
    accel: FloatArray
    gyro: FloatArray
    reference: Trajectory

    @property
    def number(self) -> int:
        """The first number in the name of the file."""
        found = re.search(r"\d+", self.path.name)
        return int(found.group()) if found else -1

    @property
    def rows(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """As `navigate` takes them."""
        return self.t_s, self.accel, self.gyro


def walks_of(dataset: str) -> list[FootWalk]:
    """Every walk of a set, in the order of its files.

    Raises:
        DatasetError: The data is not available.
    """
    pattern, read = _READERS[dataset]
    return [walk_of(path, read) for path in sorted(find(dataset).rglob(pattern))]


def walk_of(path: Path, read: Callable[[Path], Log]) -> FootWalk:
    """One recording."""
    log = read(path)
    accel, gyro = log.rows["accel"], log.rows["gyro"]
    return FootWalk(path, accel[:, 0], accel[:, 1:4], gyro[:, 1:4], log.reference)


def capture_played(seed: int) -> dict[str, Any]:
    """Motion capture, every localizer: `ate_se2_aligned_m` of each walk."""
    return played(VICON, PLAYED | BY_DETECTOR, "ate_se2_aligned_m", seed)


def walks_played(seed: int) -> dict[str, Any]:
    """A place at every stride: `ate_se2_aligned_m` of each walk, of the six that gates name and of all."""
    found = played(WALKS, PLAYED, "ate_se2_aligned_m", seed)
    numbers = _numbers_of_walks()
    groups = {"walks": np.isin(numbers, WALKING), "runs": np.isin(numbers, RUNNING)}
    groups["others"] = ~(groups["walks"] | groups["runs"])
    return {
        **found,
        **{f"{name}_{group}": found[name][rows] for name in PLAYED for group, rows in groups.items()},
        "number": numbers,
    }


def loops_played(seed: int) -> dict[str, Any]:
    """Loops: `loop_closure_pct` of each walk, and the closure of the filters in height."""
    found = played(LOOPS, PLAYED, "loop_closure_pct", seed)
    for name, params in (("literal", LITERAL), ("adaptive", FootParams())):
        ends_m = np.array([closure_m(navigate(*walk.rows, params)) for walk in walks_of("foot_loops")])
        found[f"{name}_flat_m"], found[f"{name}_height_m"] = np.hypot(ends_m[:, 0], ends_m[:, 1]), np.abs(ends_m[:, 2])
    return found


def short_played(seed: int) -> dict[str, Any]:
    """One loop of 25 m: closure, of the localizers in the plane and of the filters in space."""
    found = played(SHORT, PLAYED, "loop_closure_pct", seed)
    for name, params in (("literal", LITERAL), ("adaptive", FootParams())):
        ends_m = np.array([closure_m(navigate(*walk.rows, params)) for walk in walks_of("foot_short")])
        found[f"{name}_flat_m"] = np.hypot(ends_m[:, 0], ends_m[:, 1])
        found[f"{name}_m"] = np.linalg.norm(ends_m, axis=1)
    return found


def capture_labels(seed: int) -> dict[str, Any]:
    """Motion capture, the literal filter: with rests as labelled, and with each detector.

    Names with `axis` are in the reading of the authors, see `per_axis_m`; the others are root mean squares of the
    horizontal distance where motion capture saw the foot, after SE(2) alignment.
    """
    found: dict[str, list[float]] = defaultdict(list)
    for walk in walks_of("foot_vicon"):
        published = foot_vicon_labels.read_published(walk.path)
        for name in foot_vicon_labels.DETECTORS:
            states = navigate(*walk.rows, LITERAL, rest=labelled(walk, published, name))
            found[f"labels_{name}_m"].append(rmse_m(states, walk.reference))
            if name == "shoe":
                found["labels_axis_m"].append(per_axis_m(states, walk.reference))
        for name, detector in DETECTORS.items():
            states = navigate(*walk.rows, replace(LITERAL, detector=detector))
            found[f"{name}_m"].append(rmse_m(states, walk.reference))
            if name == "shoe":
                found["literal_axis_m"].append(per_axis_m(states, walk.reference))
        found["adaptive_m"].append(rmse_m(navigate(*walk.rows), walk.reference))
        found["smoothed_m"].append(rmse_m(navigate_smoothed(*walk.rows, LITERAL), walk.reference))
        found["published_m"].append(published.error_m["shoe"])
    arrays = _arrays(found)
    ours, theirs = arrays["literal_axis_m"], arrays["published_m"]
    return {
        **arrays,
        "unit": np.zeros(len(ours), dtype=np.int64),  # one person
        "smoothed_share": arrays["smoothed_m"].mean() / arrays["shoe_m"].mean(),
        "axis_difference_m": ours - theirs,
        "labels_axis_difference_m": arrays["labels_axis_m"] - theirs,
        "axis_correlation": float(np.corrcoef(ours, theirs)[0, 1]) if len(ours) > 1 else math.nan,
    }


def capture_consistency(seed: int) -> dict[str, Any]:
    """Motion capture: whether errors and innovations are as large as the filter says; 1 is consistent."""
    found: dict[str, list[float]] = defaultdict(list)
    for walk in walks_of("foot_vicon"):
        for name, params in (("literal", LITERAL), ("adaptive", FootParams())):
            states = navigate(*walk.rows, params)
            found[f"{name}_nees"].append(float(np.mean(nees(states, walk.reference))))
            found[f"{name}_nis"].append(float(np.nanmean(states.nis)) / 3)
            found[f"{name}_nis_median"].append(float(np.nanmedian(states.nis)) / 3)
    arrays = _arrays(found)
    return {**arrays, "unit": np.zeros(len(arrays["literal_nees"]), dtype=np.int64)}  # one person


def strides_measured(seed: int) -> dict[str, Any]:
    """Strides against surveyed ones: lengths with and without a foot that rolls, courses; how errors grow (W2).

    Growth is that of the literal filter, as W2 has it, over walks.
    """
    found: dict[str, list[FloatArray]] = defaultdict(list)
    growth: dict[str, list[float]] = defaultdict(list)
    for walk in walks_of("foot_stride_gcp"):
        group = "runs" if walk.number in RUNNING else "walks"
        for name, params in (("rolling", FootParams()), ("still", FootParams(unit_height_m=0.0))):
            states = navigate(*walk.rows, params)
            pairs = matched(find_strides(states), walk.reference)
            found[f"{name}_{group}_m"].append(pairs[:, 0] - pairs[:, 1])
            found[f"{name}_{group}_share"].append(pairs[:, 0] / pairs[:, 1] - 1)
            if name == "rolling":
                found[f"turn_{group}_deg"].append(np.degrees(pairs[1:, 2]))
                found[f"found_{group}"].append(np.array([len(pairs) / (len(walk.reference) - 1)]))
        if group == "walks":
            states = navigate(*walk.rows, LITERAL)
            pairs = matched(find_strides(states), walk.reference)
            growth["length_r2"].append(straightness(np.cumsum(pairs[:, 0] - pairs[:, 1])))
            growth["growth_exponent"].append(growth_exponent(states, walk.reference))
    errors = {name: np.concatenate(parts) for name, parts in found.items()}
    lengths = [np.abs(errors[name]) for name in ("rolling_walks_m", "rolling_runs_m") if name in errors]
    return {**errors, **_arrays(growth), "length_error_m": np.concatenate(lengths)}


def rests(seed: int) -> dict[str, Any]:
    """Share of the samples of the loops at which each detector has the foot rest (F6)."""
    loops = walks_of("foot_loops")
    return {"unit": units_of(LOOPS)} | {
        name: np.array([float(np.mean(detect(*walk.rows, detector).is_rest)) for walk in loops])
        for name, detector in DETECTORS.items()
    }


def step_sensor(seed: int) -> dict[str, Any]:
    """F8 on a foot whose truth is known: what the misalignment of the unit does, and that it can be taken off."""
    length_m = 1.3
    motion = synthetic_walk(20, length_m=length_m)
    c, s = math.cos(TURNED_BY_RAD), math.sin(TURNED_BY_RAD)
    into_body = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])  # of a unit turned clockwise
    strides = find_strides(navigate(motion.t_s, motion.accel @ into_body.T, motion.gyro @ into_body.T, LITERAL))
    raw, mended = strides.steps(), strides.steps(TURNED_BY_RAD)
    return {
        "raw_lateral_share": np.abs(raw[:, 1]) / length_m,
        "lateral_m": np.abs(mended[:, 1]),
        "ahead_m": np.abs(mended[:, 0] - length_m),
        "yaw_turn_deg": np.abs(np.degrees(mended[:, 2])),
    }


def played(env: str, localizers: Mapping[str, str], metric: str, seed: int) -> dict[str, Any]:
    """(W,) a metric of each walk of an environment, by localizer, and how many walks failed.

    Through the ordinary evaluation. The localizers draw nothing, so that the seed does not matter.
    """
    results = evaluate(list(dict.fromkeys(localizers.values())), env, split="test", seeds=1, isolation="none")
    walks = results.walks()
    order = list(make_task(env).walks["test"])
    tables = {
        division: of_one.pivot(index="walk", columns="localizer", values=metric).loc[order]
        for division, of_one in walks.groupby("division")
    }
    found: dict[str, Any] = {
        key: tables[OFFLINE if key == REVISED else ONLINE][name].to_numpy(np.float64)
        for key, name in localizers.items()
    }
    num_failed = int((walks[walks["division"] == ONLINE]["status"] == FAILED).sum())
    smooth, online = found["foot_ins_smooth"], found["foot_ins_adaptive"]
    found |= {"failed": num_failed, "smoothed_share": float(np.mean(smooth) / np.mean(online))}
    return {**found, "unit": units_of(env)}


def units_of(env: str) -> IntArray:
    """(W,) number of the unit of replication of each test walk."""
    task = make_task(env)
    names = [task.units.get(walk, walk) for walk in task.walks["test"]]
    return np.unique(names, return_inverse=True)[1].astype(np.int64)


def labelled(walk: FootWalk, published: foot_vicon_labels.Published, name: str) -> Rest:
    """Zero velocity where the authors labelled it."""
    sample = np.searchsorted(published.t_s, walk.t_s).clip(max=len(published.t_s) - 1)
    is_rest = published.zero_velocity[name][sample]
    never = np.full(len(walk.t_s), np.inf)
    return Rest(np.where(is_rest, STILL, np.inf), never, np.where(is_rest, 0.0, np.inf))


def places_m(states: FootStates, t_s: FloatArray) -> FloatArray:
    """(T, 3) where the filter was at some times; at its origin before it had started."""
    row = np.maximum(np.searchsorted(states.t_s, t_s + 1e-6, side="right") - 1, 0)
    places: FloatArray = np.nan_to_num(states.position_m[row])
    return places


def offsets_m(states: FootStates, reference: Trajectory) -> FloatArray:
    """(T, 2) from the reference to the estimate after SE(2) alignment, at the rows of the reference."""
    track_m = places_m(states, reference.t_s)[:, :2]
    offsets: FloatArray = align_se2(track_m, reference.xy_m).xy_m - reference.xy_m
    return offsets


def rmse_m(states: FootStates, reference: Trajectory) -> float:
    """Root mean square of the horizontal distance after SE(2) alignment, over surveyed rows."""
    seen = reference.rows(reference.surveyed)
    return float(np.sqrt(np.mean(np.square(offsets_m(states, seen)).sum(axis=1))))


def per_axis_m(states: FootStates, reference: Trajectory) -> float:
    """The error as the authors of `foot_vicon` state it, as far as is known: root mean square per horizontal axis.

    That is the distance over sqrt(2), over all rows, those included at which motion capture had lost the foot. Found by
    trial: of the readings per axis or as distance, in the plane or in space, this one is nearest.
    """
    return float(np.sqrt(np.mean(np.square(offsets_m(states, reference)))))


def nees(states: FootStates, reference: Trajectory) -> FloatArray:
    """(m,) normalised squared error of the position in the plane over 2, at surveyed rows; 1 is consistent.

    The covariance counts from the start, whose place is known; its direction is not, so the track is turned about the
    start to lie best on the reference. That hides a part of the error of heading, and flatters the filter.
    """
    seen = reference.rows(reference.surveyed & (reference.t_s > states.t_s[np.isfinite(states.x[:, 0])][0]))
    track_m, onto_m = places_m(states, seen.t_s)[:, :2], seen.xy_m - reference.xy_m[0]
    cross = float(np.sum(track_m[:, 0] * onto_m[:, 1] - track_m[:, 1] * onto_m[:, 0]))
    angle = math.atan2(cross, float(np.vdot(track_m, onto_m)))
    c, s = math.cos(angle), math.sin(angle)
    error_m = track_m - onto_m @ np.array([[c, -s], [s, c]])
    row = np.searchsorted(states.t_s, seen.t_s + 1e-6, side="right") - 1
    cov = states.cov[row, :2, :2] + 1e-6 * np.eye(2)  # motion capture is good to a millimetre
    squares: FloatArray = np.einsum("ki,ki->k", error_m, np.linalg.solve(cov, error_m[:, :, None])[:, :, 0]) / 2
    return squares


def closure_m(states: FootStates) -> FloatArray:
    """(3,) from the start to the end."""
    known = states.position_m[np.isfinite(states.x[:, 0])]
    gap: FloatArray = known[-1] - known[0]
    return gap


def matched(strides: Strides, reference: Trajectory) -> FloatArray:
    """(m, 3) length of each stride that was found, of the surveyed one, and error of the change of heading.

    A surveyed stride leads from one row of the reference to the next. It is matched where the rests at both of its ends
    are those of one stride found.
    """
    if not len(strides.start_s):
        return np.zeros((0, 3))
    starts, ends = _nearest(strides.start_s, reference.t_s[:-1]), _nearest(strides.end_s, reference.t_s[1:])
    both = (starts == ends) & (starts >= 0)
    ours, surveyed = starts[both], np.diff(reference.xy_m, axis=0)[both]
    heading_rad = np.arctan2(surveyed[:, 1], surveyed[:, 0])
    turn_rad = np.diff(heading_rad, prepend=heading_rad[:1])
    turn_error_rad = np.diff(strides.heading_rad[ours], prepend=strides.heading_rad[ours][:1]) - turn_rad
    return np.column_stack([strides.length_m[ours], np.hypot(*surveyed.T), wrap_rad(turn_error_rad)])


def growth_exponent(states: FootStates, reference: Trajectory) -> float:
    """b of an error that grows as the number of strides to the power b; 1 is linear (W2), 0.5 a random walk.

    The error over n strides is the root mean square, over all stretches of n strides, of the vector by which the
    displacement is wrong, once the whole track is aligned: a constant error of heading is not in it.
    """
    offset_m = offsets_m(states, reference)
    count = np.arange(1, min(GROWTH_STRIDES, len(offset_m) // 2) + 1)
    error_m = np.array([np.sqrt(np.mean(np.square(offset_m[n:] - offset_m[:-n]).sum(axis=1))) for n in count])
    return float(np.polyfit(np.log(count), np.log(error_m), 1)[0])


def straightness(values: FloatArray) -> float:
    """R^2 of a line through the origin: fraction of the variance of (n,) values that their number explains."""
    count = np.arange(1, len(values) + 1)
    line = count * float(count @ values) / float(count @ count)
    return 1.0 - float(np.sum((values - line) ** 2) / np.sum((values - values.mean()) ** 2))


def _nearest(moments_s: FloatArray, wanted_s: FloatArray) -> Any:
    """(m,) index of the moment nearest to each that is wanted; -1 where none is within `SAME_STANCE_S`."""
    after = np.searchsorted(moments_s, wanted_s).clip(1, len(moments_s) - 1) if len(moments_s) > 1 else 0 * wanted_s
    after = np.asarray(after, dtype=np.int64)
    before = np.maximum(after - 1, 0)
    nearest = np.where(wanted_s - moments_s[before] < moments_s[after] - wanted_s, before, after)
    return np.where(np.abs(moments_s[nearest] - wanted_s) <= SAME_STANCE_S, nearest, -1)


def _numbers_of_walks() -> Any:
    """(W,) int, number in the name of the file of each walk of `WALKS`, in the order of play; 0 of a later set.

    Walk ids are opaque; the file is the one whose samples are played.
    """
    by_samples = {walk.accel.tobytes(): walk.number for walk in walks_of("foot_stride_gcp")}
    task = make_task(WALKS)
    samples = [np.ascontiguousarray(task.load(walk).streams["accel"].rows[:, 1:4]) for walk in task.walks["test"]]
    return np.array([by_samples.get(rows.tobytes(), 0) for rows in samples])


def _arrays(found: Mapping[str, Sequence[float]]) -> dict[str, FloatArray]:
    return {name: np.array(values) for name, values in found.items()}
