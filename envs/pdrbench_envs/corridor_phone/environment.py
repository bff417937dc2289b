"""CorridorPhone-v0: a lap of 92 m round an office corridor, a phone in the hand or in a pocket (Li et al. 2012)."""

from __future__ import annotations

import dataclasses
import functools
from typing import TYPE_CHECKING, Final

import numpy as np

from pdrbench.recording import Recording
from pdrbench.sensors import sensor_spec
from pdrbench.task import HELD_OUT, Task
from pdrbench.trajectory import Start
from pdrbench_envs.generated import HELD_OUT_NUMBER, WalkTable, entropy_of, kind_of, with_held_out

if TYPE_CHECKING:
    from pdrbench_envs.corridor_phone.corridor import Laps
    from pdrbench_sim.record import BuildingScene

ENV: Final = "CorridorPhone-v0"
PEOPLE: Final = {"train": 8, "val": 4, "test": 13}  # nobody belongs to two splits
LAPS: Final = {"train": 16, "val": 4, "test": 20}  # each with two phones
PLACES: Final = ("hand", "pocket")
PERIOD_S: Final = 0.2  # ours, as the recorded walks with a phone have it
RATE_HZ: Final = 50.0
SENSORS: Final = ("accel", "gyro", "mag", "rotation")
CAPACITY: Final = 32  # ten rows each a period
_PEOPLE: Final = {**PEOPLE, HELD_OUT: 4}
_NUMBER: Final = {"train": 0, "val": 1, "test": 2, HELD_OUT: HELD_OUT_NUMBER}
_SEED: Final = 20120908  # the last day of UbiComp 2012
_SCENE, _PERSON, _LAPS, _WALK, _TAP = range(5)  # one stream of random numbers each
_TABLE: Final = WalkTable(ENV, {split: len(PLACES) * count for split, count in LAPS.items()})
_DESCRIPTION: Final = """\
People of all sizes walk a lap of 92 m round the corridor of an office level, 31 m by 15 m, as in the evaluation of Li
et al. (2012), with one phone in the hand and another in a trouser pocket; each phone is a walk of its own. Laps begin
anywhere and go either way round. Doors are closed. The plan is always the same; the magnetic field and the people
differ between the splits: 8 people and 16 laps to train on, 4 and 4 to choose with, 13 and 20, as in the paper, to be
judged.

**Handed out** every 0.2 s: accelerometer, gyroscope, magnetometer and rotation vector at 50 Hz. **Told**: the building,
the height of the person, where the phone is carried, and what a user tells who taps on the map and sets off: the
place, with an error of 0.5 m per axis, and for a phone in a pocket which way the corridor leads (one in the hand points
there). **Scored** is the place of the body every 0.5 s, which has covered some 0.7 m since: the paper has a tag every
0.5 m.

**What is hard**: people's steps differ by a tenth from what their cadence tells, a compass in a building is off by 15°,
and 92 m later nothing but the corners has told how far one has come. Read `along_path_mean_m`, the error of the paper,
beside `mean_m`: it is blind across the corridor.
"""


def task() -> Task:
    """The environment; no walk is generated before it is loaded."""
    return with_held_out(
        Task(
            id=ENV,
            summary="A phone in the hand or in a pocket, one lap of an office corridor; map, start by a tap",
            description=_DESCRIPTION,
            sensors=tuple(dataclasses.replace(sensor_spec(name), rate_hz=RATE_HZ) for name in SENSORS),
            capacity=dict.fromkeys(SENSORS, CAPACITY),
            period_s=PERIOD_S,
            start="area",
            walks={split: _TABLE.ids(split) for split in LAPS},
            load=load,
            tell_start=tell_start,
            licence="MIT",
            source="generated",
        )
    )


def load(walk: str) -> Recording:
    """A walk by its id; the same one whenever it is asked for."""
    from pdrbench_envs.corridor_phone.corridor import PHONES, record_laps
    from pdrbench_sim.people.person import draw_person

    split, lap, place = _place_of(walk)
    person = draw_person(_rng(split, _PERSON, lap % _PEOPLE[kind_of(split)]))
    seed = [_SEED, _NUMBER[kind_of(split)], _WALK, lap, *entropy_of(split)]
    return record_laps(_scene(split), seed, _laps(split, lap), person, PHONES[place], name=walk)


def tell_start(recording: Recording) -> Start:
    """A tap on the corridor, the same for both phones of a lap, and of one in a pocket the heading at first."""
    from pdrbench_envs.corridor_phone.corridor import start_heading_rad, tapped

    split, lap, place = _place_of(recording.id)
    heading_rad = start_heading_rad(_laps(split, lap), place)
    return tapped(recording.reference.xy_m[0], _rng(split, _TAP, lap), heading_rad)


def _place_of(walk: str) -> tuple[str, int, str]:
    """Split, number of the lap, where the phone is carried."""
    split, index = _TABLE.place_of(walk)
    return split, index // len(PLACES), PLACES[index % len(PLACES)]


def _laps(split: str, lap: int) -> Laps:
    from pdrbench_envs.corridor_phone.corridor import draw_laps

    return draw_laps(_rng(split, _LAPS, lap))


@functools.lru_cache(maxsize=4)
def _scene(split: str) -> BuildingScene:
    from pdrbench_envs.corridor_phone.corridor import make_corridor_scene

    return make_corridor_scene(_rng(split, _SCENE, 0))


def _rng(split: str, stream: int, index: int) -> np.random.Generator:
    return np.random.default_rng([_SEED, _NUMBER[kind_of(split)], stream, index, *entropy_of(split)])
