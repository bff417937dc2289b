"""Experiments behind the claims of Frank et al. 2009; `claims` holds the table.

Walks are those of the test split of `WlanHallway-v1`, one for each seed, with its own radio field and walker.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, Final

import numpy as np

from pdrbench.episode import Episode
from pdrbench.geometry import FloatArray, IntArray, wrap_rad
from pdrbench.inertial import DETECTORS
from pdrbench.localizer import Briefing, Localizer, Observation
from pdrbench.radio import scans_of
from pdrbench.recording import RadioMap, Recording, SensorStream
from pdrbench.registry import make_task
from pdrbench.trajectory import Trajectory
from pdrbench_baselines.frank2009.ekf import moved, moved_jacobian
from pdrbench_baselines.frank2009.localizer import (
    LOWER,
    FingerprintingParams,
    Frank2009,
    Frank2009Params,
    WlanFrank2009,
)
from pdrbench_baselines.frank2009.step_sensor import FootSteps
from pdrbench_lab.papers.paper_walks import walk_of

ENV: Final = "WlanHallway-v1"
RECORDED: Final = 49  # F1: points that the paper scores, of 4 laps with 17 marks
LAP_MARKS: Final = 17  # F1
FEWER: Final = (6, 3)  # F3: access points, of 11
TURNED_BY_RAD: Final = math.radians(40.0)  # F8: of the sensor about its z axis, ours
MINUTE_S: Final = 60.0  # of a walk, where so much is enough
BESIDE_M: Final = 0.5  # F2
FAR_M: Final = 4.0  # F2
LETTER: Final = FingerprintingParams(unknown="ignore")  # F4, eq. (1) as it stands
CASCADE: Final = Frank2009Params(wlan=LETTER)


def answers(localizer: Localizer, recording: Recording, briefing: Briefing, until_s: float = math.inf) -> FloatArray:
    """(K, 3) time, x, y of everything that a localizer answers on a walk."""
    episode = Episode(recording, make_task(ENV))
    localizer.reset(briefing, np.random.default_rng(0))
    found = []
    while not episode.done:
        observation: Observation = episode.observe()
        if observation.now_s > until_s:
            break
        estimate = localizer.step(observation)
        found.append((observation.now_s, *estimate.xy_m.tolist()))
        episode.submit(estimate)
    return np.array(found)


def errors_m(found: FloatArray, recording: Recording) -> FloatArray:
    """(68,) distances from the marks at the moments at which they are passed, of the last answer by then (F13)."""
    reference = recording.reference
    row = np.searchsorted(found[:, 0], reference.t_s, side="right") - 1
    error_m: FloatArray = np.hypot(*(found[row, 1:] - reference.xy_m).T)
    return error_m


def recorded(seed: int, count: int) -> IntArray:
    """(49,) passages, drawn at random: the paper scored as many of its own and does not say which."""
    return np.sort(np.random.default_rng([seed, RECORDED]).choice(count, RECORDED, replace=False))


def hallway(seed: int) -> dict[str, Any]:
    """F1, F2, F10: both localizers, and the robust one, on the same walk."""
    recording, briefing = walk_of(ENV, seed)
    cascade = Frank2009(CASCADE)
    numbers: dict[str, Any] = {}
    made: dict[str, Localizer] = {
        "wlan": WlanFrank2009(LETTER),
        "fused": cascade,
        "robust": Frank2009(replace(CASCADE, degrees=3.0)),
    }
    for name, localizer in made.items():
        error_m = errors_m(answers(localizer, recording, briefing), recording)
        some_m = error_m[recorded(seed, len(error_m))]
        numbers |= {
            f"{name}_error_m": error_m,
            f"{name}_49_error_m": some_m,
            f"{name}_beside": error_m < BESIDE_M,
            f"{name}_far": error_m > FAR_M,
            f"{name}_later_error_m": error_m[LAP_MARKS:],
        }
    for name in ("fused", "robust"):
        for kind in ("", "_49"):
            ratio = numbers[f"{name}{kind}_error_m"].mean() / numbers[f"wlan{kind}_error_m"].mean()
            numbers[f"{name}{kind}_ratio"] = float(ratio)
    assert briefing.radio_map is not None
    return numbers | {
        "nis": float(np.mean(cascade.debug()["nis"])),
        "heard_in_a_scan": float(np.diff(briefing.radio_map.first).mean()),
        "heard_at_a_point": heard_at_points(briefing.radio_map),
        "maps_given": int(briefing.building is not None),
    }


def pace(seed: int) -> dict[str, Any]:
    """F1 at the pace measured on people (sources.md 1.2), with the interval of F6 and with SHOE, which holds there.

    Way, radio field and survey are those of the walk of `hallway`, whose walkers were chosen for the interval.
    """
    from pdrbench_lab.papers.frank2009.wlan_hallway.environment import load_of
    from pdrbench_sim.people.person import PersonParams

    task = make_task(ENV)
    walk = task.split("test")[seed]
    slow, recording = task.load(walk), load_of(walk, PersonParams())
    briefing = task.brief(recording)
    shoe = replace(CASCADE, lower=replace(LOWER, detector=DETECTORS["shoe"]))
    makes: dict[str, Localizer] = {
        "wlan": WlanFrank2009(LETTER),
        "interval": Frank2009(CASCADE),
        "shoe": Frank2009(shoe),
    }
    numbers = {name: errors_m(answers(made, recording, briefing), recording) for name, made in makes.items()}
    numbers["slow_shoe"] = errors_m(answers(Frank2009(shoe), slow, briefing), slow)
    return {
        **{f"{name}_error_m": error_m for name, error_m in numbers.items()},
        **{f"{name}_ratio": float(numbers[name].mean() / numbers["wlan"].mean()) for name in ("interval", "shoe")},
        "speed_mps": mean_speed_mps(recording.reference),
        "slow_speed_mps": mean_speed_mps(slow.reference),
    }


def mean_speed_mps(passages: Trajectory) -> float:
    """Between the first passage of a mark and the last, along the hallway."""
    from pdrbench_lab.papers.frank2009.wlan_hallway.hallway import HALLWAY

    along_m = np.unwrap(HALLWAY.along_m(passages.xy_m), period=HALLWAY.lap_m)
    return float(abs(along_m[-1] - along_m[0]) / (passages.t_s[-1] - passages.t_s[0]))


def heard_at_points(radio_map: RadioMap) -> IntArray:
    """(P,) access points that were heard at each calibration point."""
    point = radio_map.walk[np.repeat(np.arange(len(radio_map)), np.diff(radio_map.first))]
    pairs = np.unique(np.column_stack([point, radio_map.access_point]), axis=0)
    return np.bincount(pairs[:, 0], minlength=int(radio_map.walk.max()) + 1)


def ablation(seed: int) -> dict[str, Any]:
    """F3: calibration points every 5 m, and fewer access points; mean errors of both localizers."""
    recording, briefing = walk_of(ENV, seed)
    assert briefing.radio_map is not None
    known = np.random.default_rng([seed, 3]).permutation(np.unique(briefing.radio_map.access_point))
    surveys = {"5m": scans_of(briefing.radio_map, briefing.radio_map.walk % 2 == 0)}
    surveys |= {f"{count}_access_points": only(briefing.radio_map, known[:count]) for count in FEWER}
    numbers: dict[str, Any] = {}
    for name, survey in surveys.items():
        given = replace(briefing, radio_map=survey)
        makes: dict[str, Callable[[], Localizer]] = {
            "wlan": partial(WlanFrank2009, LETTER),
            "fused": partial(Frank2009, CASCADE),
        }
        for key, make in makes.items():
            numbers[f"{key}_{name}_m"] = float(errors_m(answers(make(), recording, given), recording).mean())
    return numbers


def only(radio_map: RadioMap, access_point: IntArray) -> RadioMap:
    """A survey that knows some access points only."""
    reading = np.isin(radio_map.access_point, access_point)
    scan = np.repeat(np.arange(len(radio_map)), np.diff(radio_map.first))[reading]
    return replace(
        radio_map,
        first=np.searchsorted(scan, np.arange(len(radio_map) + 1)),
        access_point=radio_map.access_point[reading],
        rssi_dbm=radio_map.rssi_dbm[reading],
        age_s=radio_map.age_s[reading],
    )


def misalignment(seed: int) -> dict[str, Any]:
    """F8: the same minute from a turned sensor: the misalignment differs by that turn, the steps are the same."""
    recording, _ = walk_of(ENV, seed)
    c, s = math.cos(TURNED_BY_RAD), math.sin(TURNED_BY_RAD)
    into_sensor = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])  # turned clockwise, as seen from above
    found = []
    for matrix in (np.eye(3), into_sensor):
        lower = FootSteps(120.0, replace(CASCADE.lower, field=None))
        streams = {name: recording.streams[name].rows for name in ("accel", "gyro")}
        rows = {name: row[row[:, 0] < MINUTE_S] for name, row in streams.items()}
        rows = {name: np.column_stack([row[:, 0], row[:, 1:] @ matrix.T]) for name, row in rows.items()}
        steps = lower.update(rows)
        # A foot that is moved before the first stride has no frame yet.
        fixed = int(np.flatnonzero(steps.misalignment_change_rad)[0])
        found.append((steps.step[fixed:], lower.sensor.misalignment_rad))
    (straight, before_rad), (turned, after_rad) = found
    off_rad = float(wrap_rad(after_rad - before_rad - TURNED_BY_RAD))
    same = min(len(straight), len(turned))
    return {
        "off_by_deg": abs(math.degrees(off_rad)),
        "step_off_m": np.hypot(*(straight[:same] - turned[:same])[:, :2].T),
        "lateral_m": np.abs(turned[5:, 1]),
    }


def jacobian(seed: int) -> dict[str, Any]:
    """F11: eq. (15)-(17) against central differences at a thousand states and steps."""
    rng = np.random.default_rng(seed)
    off = 0.0
    for _ in range(1000):
        mean = rng.normal(0.0, [20.0, 20.0, 2.0])
        step = rng.normal([1.3, 0.0, 0.0], [0.5, 0.5, 0.5])
        change = np.column_stack([moved(mean + h, step) - moved(mean - h, step) for h in 1e-5 * np.eye(3)])
        change[2] = wrap_rad(change[2])
        off = max(off, float(np.abs(change / 2e-5 - moved_jacobian(mean, step)).max()))
    return {"off_by": off}


def no_map(seed: int) -> dict[str, Any]:
    """F14: a minute of answers with a map and without; those that differ."""
    from pdrbench_lab.papers.frank2009.wlan_hallway.hallway import make_hallway

    recording, briefing = walk_of(ENV, seed)
    rows = {name: stream.rows[stream.t_s < MINUTE_S] for name, stream in recording.streams.items()}
    streams = {name: SensorStream(recording.streams[name].spec, row) for name, row in rows.items()}
    short = replace(recording, streams=streams)
    without = answers(Frank2009(CASCADE), short, briefing, MINUTE_S)
    mapped = answers(Frank2009(CASCADE), short, replace(briefing, building=make_hallway()), MINUTE_S)
    return {"differ": int((without != mapped).any(axis=1).sum())}
