"""PhoneFiddle-v0: nobody walks; a phone is called with, typed on, played with (Li et al. 2012, TC1)."""

from __future__ import annotations

import dataclasses
import functools
from typing import TYPE_CHECKING, Final

import numpy as np

from pdrbench.recording import Recording
from pdrbench.sensors import sensor_spec
from pdrbench.task import HELD_OUT, Task
from pdrbench.trajectory import Start
from pdrbench_envs.corridor_phone.environment import CAPACITY, PERIOD_S, RATE_HZ, SENSORS
from pdrbench_envs.generated import HELD_OUT_NUMBER, WalkTable, entropy_of, kind_of, with_held_out

if TYPE_CHECKING:
    from pdrbench_sim.record import BuildingScene

ENV: Final = "PhoneFiddle-v0"
SPLITS: Final = {"train": 4, "val": 4, "test": 8}  # people; L7 has eight
DURATION_S: Final = 180.0  # ours
_NUMBER: Final = {"train": 0, "val": 1, "test": 2, HELD_OUT: HELD_OUT_NUMBER}
_SEED: Final = 20120909
_SCENE, _PLACE, _HANDS, _TAP = range(4)  # one stream of random numbers each
_TABLE: Final = WalkTable(ENV, SPLITS)
_DESCRIPTION: Final = """\
Eight people stand in the corridor of an office for three minutes and handle their phones, as in the first test case of
Li et al. (2012): they make calls, type, play games, turn the phone about, and take not a single step.

**Handed out** every 0.2 s: accelerometer, gyroscope, magnetometer and rotation vector at 50 Hz. **Told**: the building,
and where they stand, as a tap on the map that is off by 0.5 m per axis. **Scored** is the place, every second: nobody
errs less than whoever answers the tap all the time, but by chance, and every step made up leads away from it by 0.7 m.

**What is hard**: games go on for seconds in a rhythm like that of steps.
"""


def task() -> Task:
    """The environment; nothing is generated before it is loaded."""
    return with_held_out(
        Task(
            id=ENV,
            summary="A phone is handled by people who stand still; every step found is a false one",
            description=_DESCRIPTION,
            sensors=tuple(dataclasses.replace(sensor_spec(name), rate_hz=RATE_HZ) for name in SENSORS),
            capacity=dict.fromkeys(SENSORS, CAPACITY),
            period_s=PERIOD_S,
            start="area",
            walks={split: _TABLE.ids(split) for split in SPLITS},
            load=load,
            tell_start=tell_start,
            licence="MIT",
            source="generated",
        )
    )


def load(walk: str) -> Recording:
    """Three minutes by their id; the same ones whenever they are asked for."""
    from pdrbench_envs.corridor_phone.corridor import CORRIDOR
    from pdrbench_sim.buildings.ring_floor import corridor_polygon
    from pdrbench_sim.handling import record_handling
    from pdrbench_sim.people.route import Place

    split, index = _TABLE.place_of(walk)
    scene = _scene(split)
    along_m = _rng(split, index, _PLACE).uniform(0.0, CORRIDOR.lap_m, 1)
    place = Place(int(corridor_polygon(scene.building, 1)[0]), CORRIDOR.xy_m(along_m)[0])
    seed = [_SEED, _NUMBER[kind_of(split)], _HANDS, index, *entropy_of(split)]
    return record_handling(scene, seed, place, duration_s=DURATION_S, rate_hz=RATE_HZ, name=walk)


def tell_start(recording: Recording) -> Start:
    """A tap on the corridor; nobody says which way they look."""
    from pdrbench_envs.corridor_phone.corridor import tapped

    return tapped(recording.reference.xy_m[0], _rng(*_TABLE.place_of(recording.id), stream=_TAP))


@functools.lru_cache(maxsize=4)
def _scene(split: str) -> BuildingScene:
    from pdrbench_envs.corridor_phone.corridor import make_corridor_scene

    return make_corridor_scene(_rng(split, 0, _SCENE))


def _rng(split: str, index: int, stream: int) -> np.random.Generator:
    return np.random.default_rng([_SEED, _NUMBER[kind_of(split)], stream, index, *entropy_of(split)])
