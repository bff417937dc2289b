"""Step detection of Li et al. 2012 measured: handling a phone (L7), walking with it (L8), recorded walks (L9).

Every function takes a seed and returns numbers by name. Steps are matched with the moments at which a heel comes down,
at which the low-passed specific force peaks.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np

from pdrbench.datasets import dataset
from pdrbench.geometry import FloatArray
from pdrbench.inertial.step_detection import GENTLE, STAGES, Stage, StepParams, find_steps
from pdrbench_lab.papers.li2012.handling import TC1
from pdrbench_lab.papers.li2012.handling_motion import HandlingParams, handling_motion
from pdrbench_lab.papers.li2012.step_scores import EventMatch, match_events
from pdrbench_lab.papers.ring_floor import bare_ring
from pdrbench_lab.readers import phone_steps
from pdrbench_lab.readers.registered_files import locate
from pdrbench_sim.people.person import draw_person
from pdrbench_sim.people.route import NavigationMesh, Place, navigation_mesh
from pdrbench_sim.people.strides import Stances, stances
from pdrbench_sim.people.walk import SimulatedWalk
from pdrbench_sim.people.walker import NATURAL_WALK, walk_through
from pdrbench_sim.phone.gait import CLOSING_S
from pdrbench_sim.phone.phone import phone_motion
from pdrbench_sim.units.device import draw_unit
from pdrbench_sim.units.motion import RigidMotion
from pdrbench_sim.units.profiles import imu_profile

RECORDED: Final = "phone_steps"
PEOPLE: Final = 8  # L7
RATE_HZ: Final = 50.0  # L3
MOTION_HZ: Final = 100.0
HANDLED_S: Final = 180.0  # for each person and seed: 20 seeds make an hour each
WITHIN_S: Final = 0.35  # L8
CARRIED: Final = ("hand", "pocket")  # L8
LAPS: Final = 2
LONG_M, SHORT_M, WIDTH_M = 31.0, 15.0, 2.0  # L1, of the middle of the corridor; its width is ours
FLAT_S: Final = 0.08  # from the strike of a heel until its foot rests (sources.md 1.3)
# Seconds that a phone is handled before each walk, so that PD finds 7.7 % false steps in the hand: fitted, as `TC1`
# was. All five other fractions of false steps follow.
BEFORE_S: Final = 70.0
TAIL_S: Final = 2.0  # at the end of a recording, in which a step can be made and not yet be known
TC2_WALK: Final = replace(NATURAL_WALK, stop_fraction=0.0, pause_every_s=1e6)  # "free style", without a stop


def handling(seed: int, people: int = PEOPLE, duration_s: float = HANDLED_S) -> dict[str, float]:
    """TC1: false steps of phones that are handled without walking.

    Returns:
        For each stage its number of false steps `count_<stage>`, how many a minute `per_min_<stage>`, and the
        fraction of those of PD, `share_<stage>`.
    """
    people_rng = np.random.default_rng([seed, 7]).spawn(people)
    rows = [handled(rng, duration_s) for rng in people_rng]
    counts = {stage: sum(len(find_steps(one, RATE_HZ, stage=stage)) for one in rows) for stage in STAGES}
    minutes = people * duration_s / 60.0
    found = {}
    for stage, count in counts.items():
        found[f"count_{stage}"] = float(count)
        found[f"per_min_{stage}"] = count / minutes
        found[f"share_{stage}"] = count / max(counts["PD"], 1)
    return found


def walking(seed: int, people: int = PEOPLE, laps: int = LAPS) -> dict[str, Any]:
    """TC2: false and missed steps of people who take two phones round a corridor, one in the hand, one in a pocket.

    Returns:
        For each stage and place `false_pct_<stage>_<place>` and `missed_pct_<stage>_<place>`, in percent of the steps
        that were made, and `count_error_pct_<place>` of the last stage: the mean size of the error of the count over
        walks. By person (P,) the numbers that these are made of: `false_`, `missed_`, `made_` and `miscount_pct_`.
    """
    matches: dict[tuple[Stage, str], list[EventMatch]] = {(stage, place): [] for stage in STAGES for place in CARRIED}
    mesh = navigation_mesh(bare_ring(LONG_M, SHORT_M, WIDTH_M))
    for rng in np.random.default_rng([seed, 8]).spawn(people):
        phones, heel_s = walked(rng, mesh, laps)
        for (stage, place), found in matches.items():
            steps_s = find_steps(phones[place], RATE_HZ, stage=stage).peak_s
            till_s = phones[place][-1, 0] - TAIL_S
            found.append(match_events(steps_s[steps_s < till_s], heel_s[heel_s < till_s], tolerance_s=WITHIN_S))
    numbers: dict[str, Any] = {}
    for (stage, place), found in matches.items():
        made = np.array([match.num_reference for match in found])
        false = np.array([match.false_positives for match in found])
        missed = np.array([match.false_negatives for match in found])
        of = f"{stage}_{place}"
        numbers |= {f"made_{of}": made, f"false_{of}": false, f"missed_{of}": missed}
        numbers |= {
            f"{kind}_pct_{of}": 100.0 * n.sum() / made.sum() for kind, n in (("false", false), ("missed", missed))
        }
    for place in CARRIED:
        miscount_pct = np.array([abs(match.count_error_pct) for match in matches[STAGES[-1], place]])
        numbers |= {f"count_error_pct_{place}": float(miscount_pct.mean()), f"miscount_pct_{place}": miscount_pct}
    return numbers


def recorded(seed: int, params: StepParams = GENTLE) -> dict[str, Any]:
    """L9 on recorded walks, all carry positions, one set of parameters: what the last stage makes of them.

    Args:
        seed: Of nothing: there is no chance in it.
        params: `StepParams()` for the paper's.

    Returns:
        By walk (W,) arrays: signed `count_error_pct` against the steps that were made, its size `count_size_pct`, the
        same against every contact of a switch, flicker included, `raw_size_pct`, `f1`, the person `is_b` 0 or 1, and
        for each position its means `count_size_pct_<position>` and `f1_<position>`.

    Raises:
        DatasetError: The data is not available.
    """
    registered = {file.path: file.facts for file in dataset(RECORDED).files}
    rows = []
    for path, at in locate(RECORDED).items():
        if not path.endswith("accelerometer.csv.gz"):
            continue
        log = phone_steps.read(at)
        made_s = phone_steps.step_times_s(log.reference)
        accel = log.rows["accel"]
        match = match_events(find_steps(accel, 1 / float(np.median(np.diff(accel[:, 0]))), params).peak_s, made_s)
        contacts = len(made_s) + log.report.dropped.get("contact without a swing", 0)
        of_contacts_pct = 100.0 * abs(match.num_estimated - contacts) / contacts
        facts = registered[path]
        rows.append((facts["position"], facts["subject"] == "B", match.count_error_pct, of_contacts_pct, match.f1))
    position, is_b, error_pct, raw_pct, f1 = (np.array(column) for column in zip(*rows, strict=True))
    found: dict[str, Any] = {
        "count_error_pct": error_pct,
        "count_size_pct": np.abs(error_pct),
        "raw_size_pct": raw_pct,
        "f1": f1,
        "is_b": is_b.astype(float),
    }
    for name in np.unique(position).tolist():
        here = position == name
        found[f"count_size_pct_{name}"] = float(np.abs(error_pct[here]).mean())
        found[f"f1_{name}"] = float(f1[here].mean())
    return found


def handled(rng: np.random.Generator, duration_s: float, params: HandlingParams = TC1) -> FloatArray:
    """(n, 4) accelerometer rows of a phone that a standing person handles."""
    how, unit, noise = rng.spawn(3)
    motion = handling_motion(how, duration_s, (0.0, 0.0, 1.2), rate_hz=MOTION_HZ, params=params)
    return measured(motion, unit, noise)


def walked(
    rng: np.random.Generator, mesh: NavigationMesh, laps: int, before_s: float = BEFORE_S
) -> tuple[Mapping[str, FloatArray], FloatArray]:
    """A person handles a phone, standing, and then walks round the corridor with it.

    Returns:
        Accelerometer rows (n, 4) by where the phone is carried on the walk, and (S,) when a heel comes down.
    """
    who, how, gait, before, *own = rng.spawn(4 + len(CARRIED))
    way = walk_through(how, mesh, draw_person(who), round_trip(laps), TC2_WALK)
    feet = stances(way, gait)
    phones = {}
    for place, stream, handling_rng in zip(CARRIED, own, before.spawn(len(CARRIED)), strict=True):
        carried, unit, noise = stream.spawn(3)
        motion = phone_motion(way, feet, carried, carry=((0.0, place),), rate_hz=MOTION_HZ)
        rows = measured(motion, unit, noise)
        rows[:, 0] += before_s
        first = handled(handling_rng, before_s)
        phones[place] = np.concatenate([first[first[:, 0] < rows[0, 0]], rows])
    return phones, before_s + heel_strikes(way, feet)


def heel_strikes(way: SimulatedWalk, feet: Sequence[Stances]) -> FloatArray:
    """(S,) when a heel comes down, in order; where the person stands at the beginning no heel does."""
    strikes = [
        foot.begin_s[(foot.mid_s > bout.t_s[0]) & (foot.mid_s <= bout.t_s[-1] + CLOSING_S)] - FLAT_S
        for foot in feet
        for bout in way.bouts
    ]
    return np.sort(np.concatenate(strikes))


def round_trip(laps: int) -> list[Place]:
    """The middles of the sides, lap by lap."""
    half_x, half_y = LONG_M / 2, SHORT_M / 2
    lap = [(half_x, 0.0), (LONG_M, half_y), (half_x, SHORT_M), (0.0, half_y)]
    return [Place(0, np.array(at)) for at in [*lap * laps, lap[0]]]


def measured(motion: RigidMotion, unit: np.random.Generator, noise: np.random.Generator) -> FloatArray:
    """(n, 4) rows of the accelerometer of a phone."""
    profile = replace(imu_profile("phone_mid"), rate_hz=RATE_HZ)
    t_s, accel, _ = draw_unit(profile, unit).measure(motion.t_s, *motion.ideal_signals(), noise)
    return np.column_stack([t_s, accel])
