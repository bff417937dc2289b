"""Walks of surveyors with a phone in the hand, recorded and synthetic, and the legs between the places they marked."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Final

import numpy as np

from pdrbench.datasets import DataFile, dataset, find
from pdrbench.geometry import FloatArray, IntArray
from pdrbench.io.log import Log
from pdrbench.recording import Recording, SensorStream
from pdrbench.sensors import sensor_spec
from pdrbench_lab.realism.block import Block, Control, Part, RealismStatistic, Values
from pdrbench_lab.realism.phone_rows import phone_rows
from pdrbench_lab.realism.survey_walk import survey_walk
from pdrbench_lab.realism.wide_field import draw_magnetic_field
from pdrbench_sim.fields.magnetic import MagneticParams
from pdrbench_sim.people.strides import stances
from pdrbench_sim.phone.heading import rotation_vector
from pdrbench_sim.phone.phone import phone_motion
from pdrbench_sim.readers import ilc20
from pdrbench_sim.units.profiles import imu_profile

DATASET: Final = "ilc20"
ROLES: Final = ("train", "eval")  # walks with every sensor, each of two marked places or more
FIT_SITE: Final = "site1"  # parameters were fitted on its train walks
RATE_HZ: Final = 50.0  # of the phone that recorded the set
FLOOR_WALKS: Final = 8  # synthetic walks on one floor: the 46 recorded ones to judge by were walked on 6 floors
NUM_WALKS: Final = 200  # synthetic, on 25 floors: floors differ so much that fewer make the scorecard one of the seed
# Declination west, eastern China [R]; headings of 15 walks are 9 degrees off so [M].
_FIELD: Final = MagneticParams(declination_rad=math.radians(6.0))
_MOTION_HZ: Final = 200.0
_FLOOR_M: Final = 100.0  # the middles of the walks on one floor lie anywhere in a square of this side
_DIPOLE_BOUNDS_M: Final = (-50.0, -50.0, 150.0, 150.0)  # few walks leave it, none of them far


@dataclass(frozen=True, slots=True)
class Leg:
    """The way between two marked places.

    Attributes:
        start_s, end_s: When they were marked.
        step_m: (2,) from the first place to the second.
    """

    start_s: float
    end_s: float
    step_m: FloatArray

    @property
    def length_m(self) -> float:
        """Of the straight line."""
        return float(np.hypot(*self.step_m))

    @property
    def bearing_rad(self) -> float:
        """Counter-clockwise from +x."""
        return float(np.arctan2(self.step_m[1], self.step_m[0]))


def legs(recording: Recording) -> Iterator[Leg]:
    """The legs of a walk, in order."""
    way = recording.reference
    for i in range(len(way) - 1):
        yield Leg(float(way.t_s[i]), float(way.t_s[i + 1]), way.xy_m[i + 1] - way.xy_m[i])


@functools.lru_cache(maxsize=2)
def recorded_walks(part: Part) -> tuple[Recording, ...]:
    """Walks of the public set with all sensors, sorted by path."""
    logs = surveyor_logs(part, ROLES, ("train",))
    return tuple(log.recording(file.path, None, sensor_spec) for file, log in logs)


def surveyor_logs(part: Part, roles: Sequence[str], fit_roles: Sequence[str]) -> Iterator[tuple[DataFile, Log]]:
    """Walks of the public set that have one of `roles`, sorted by path.

    Args:
        part: "fit" for the walks of `FIT_SITE` that have one of `fit_roles`, "judge" for all others.
        roles: Roles that are read.
        fit_roles: Roles of the walks that parameters were fitted on.
    """
    folder = find(DATASET)
    for file in _files(roles):
        if (file.facts["site"] == FIT_SITE and file.role in fit_roles) == (part == "fit"):
            yield file, ilc20.read(folder / file.path, floor=str(file.facts["floor"]))


@functools.lru_cache(maxsize=4)
def synthetic_walks(seed: int, count: int) -> tuple[Recording, ...]:
    """Walks with as many places as those of the set have; a longer series begins like a shorter one."""
    return tuple(synthetic_walk(seed, number) for number in range(count))


def resampled(count: int, seed: int, sets: int = 100, floors: int = 6) -> list[IntArray]:
    """Numbers of the walks of so many sets, each of so many whole floors of `count` walks, drawn with replacement."""
    by_floor = np.split(np.arange(count), np.arange(FLOOR_WALKS, count, FLOOR_WALKS))
    rng = np.random.default_rng(seed)
    return [np.concatenate([by_floor[i] for i in rng.integers(len(by_floor), size=floors)]) for _ in range(sets)]


def synthetic_walk(seed: int, number: int, rotate: Callable[..., FloatArray] = rotation_vector) -> Recording:
    """One of the synthetic walks; `FLOOR_WALKS` in a row are on one floor and share its field.

    Args:
        seed: Of all walks.
        number: Of this one, from 0.
        rotate: Called like `rotation_vector`, in its place.
    """
    plan, gait, carry, where, *rngs = np.random.default_rng([seed, number]).spawn(8)
    floor = np.random.default_rng([seed, number // FLOOR_WALKS, 1])
    places = [int(file.facts["n_waypoints"]) for file in _files(ROLES)]
    walk, marks = survey_walk(plan, int(plan.choice(places)))
    motion = phone_motion(walk, stances(walk, gait), carry, rate_hz=_MOTION_HZ)
    every = round(_MOTION_HZ / RATE_HZ)
    begin_m = np.append(where.uniform(0.0, _FLOOR_M, 2), 0.0)
    met_ut = draw_magnetic_field(floor, [0.0], _FIELD, _DIPOLE_BOUNDS_M).at(begin_m + motion.xyz_m[::every])
    kind = imu_profile("phone_mid")
    slow = {name: replace(getattr(kind, name), bandwidth_hz=0.4 * RATE_HZ) for name in ("accel", "gyro")}
    profile = replace(kind, rate_hz=RATE_HZ, **slow)
    sampled = motion.t_s[::every], motion.quaternion[::every], met_ut
    rows = phone_rows(motion, profile, rngs, sampled, rotate=rotate)
    streams = {name: SensorStream(sensor_spec(name), values) for name, values in rows.items()}
    return Recording(f"walk-{seed}-{number}", None, streams, marks)


@functools.cache
def _files(roles: Sequence[str]) -> tuple[DataFile, ...]:
    """The registered walks, whether the set is available or not."""
    return tuple(sorted((file for file in dataset(DATASET).files if file.role in roles), key=lambda file: file.path))


def walk_block(
    name: str,
    rows: tuple[RealismStatistic, ...],
    values: Callable[[Sequence[Recording], Sequence[IntArray]], Values],
    *,
    controls: Mapping[str, Control] = MappingProxyType({}),
    features: tuple[str, ...] = (),
) -> Block:
    """A block on walks of surveyors, by a function of walks and of the sets that are made of them."""

    def real(part: Part) -> Values:
        walks = recorded_walks(part)
        return values(walks, [np.arange(len(walks))])

    def synthetic(seed: int, count: int) -> Values:
        return values(synthetic_walks(seed, count), resampled(count, seed))

    return Block(name, rows, (DATASET,), real, synthetic, NUM_WALKS, controls, features)
