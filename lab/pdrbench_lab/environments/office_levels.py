"""`OfficePhoneLevels-v1`: a phone in the hand through synthetic offices, from level to level by stairs and by lift."""

from __future__ import annotations

import dataclasses
import functools
from typing import TYPE_CHECKING, Final

import numpy as np

from pdrbench.building import Building
from pdrbench.recording import Recording
from pdrbench.sensors import sensor_spec
from pdrbench.task import Task
from pdrbench_envs.generated import GeneratedWalks, Split, start_pose, with_held_out

if TYPE_CHECKING:
    from pdrbench_sim.people.person import Person
    from pdrbench_sim.people.route import NavigationMesh, Place
    from pdrbench_sim.record import BuildingScene

ENV: Final = "OfficePhoneLevels-v1"
SPLITS: Final = {
    "train": Split(walks=12, buildings=4, people=12),
    "val": Split(walks=4, buildings=2, people=4),
    "test": Split(walks=12, buildings=4, people=12),
}
PERIOD_S: Final = 0.2
RATE_HZ: Final = 100.0
RECORDED: Final = ("accel", "gyro", "mag", "rotation", "baro")
DERIVED: Final = ("level_change",)
NUM_LEVELS: Final = 3
AREA_M2: Final = (2400.0, 3600.0)  # of all levels; ours
DURATION_S: Final = (180.0, 300.0)  # of a walk, least and most; ours
CHANGE_FRACTION: Final = 0.5  # of the ways to the next place lead to another level; ours
LIFT_FRACTION: Final = 0.5  # of those go by lift; ours
_CAPACITY: Final = {"baro": 8, "level_change": 8}
_SEED: Final = 20261123
_BUILDING, _SCENE, _PERSON, _PLAN, _WALK = range(5)  # one stream of random numbers each
_HELD_OUT: Final = Split(8, buildings=2, people=8)
WALKS: Final = GeneratedWalks(ENV, _SEED, SPLITS, _HELD_OUT)
_DESCRIPTION: Final = """\
Simulated people with a phone in the hand visit rooms on three levels of synthetic office buildings. Half of their ways
lead to another level, half of these by a lift, the others by stairs. Buildings and people differ between the splits.

**Handed out** every 0.2 s: accelerometer, gyroscope, magnetometer and rotation vector at 100 Hz, a barometer at 10 Hz,
and `level_change`, which is computed from pressure and steps by `pdrbench_formats.derive`. No radio.

**Given**: the building, the height of the person, place, level and heading of the start. **Scored** is the place of the
body every second; a wrong level counts 15 m in the score of the competitions.

**What is hard**: weather and doors change the pressure like stairs do, a lift is left where no step has led to, and the
yaw of the phone wanders.
"""


def task() -> Task:
    """The environment; nothing is generated before it is loaded."""
    recorded = tuple(
        sensor_spec(name) if name == "baro" else dataclasses.replace(sensor_spec(name), rate_hz=RATE_HZ)
        for name in RECORDED
    )
    derived = tuple(dataclasses.replace(sensor_spec(name), derived=True) for name in DERIVED)
    return with_held_out(
        Task(
            id=ENV,
            summary="A phone in the hand through synthetic three-level offices, by stairs and lifts; start pose known",
            description=_DESCRIPTION,
            sensors=(*recorded, *derived),
            capacity={name: _CAPACITY.get(name, 32) for name in (*RECORDED, *DERIVED)},
            period_s=PERIOD_S,
            start="pose",
            walks=WALKS.ids(),
            load=_load,
            tell_start=start_pose,
            licence="MIT",
            source="generated",
        ),
        WALKS,
    )


def _load(walk: str) -> Recording:
    """A walk by its id; the same one whenever it is asked for."""
    from pdrbench_formats.derive import derive
    from pdrbench_sim.record import IN_HAND, simulate_walk
    from pdrbench_sim.resolution import rounded

    split, index = WALKS.place_of(walk)
    plan, rng = WALKS.split(split), WALKS.rng(split, _PLAN, index)
    scene, duration_s = _scene(split, index % plan.buildings), float(rng.uniform(*DURATION_S))
    recording = simulate_walk(
        scene,
        WALKS.numbers(split, _WALK, index),
        dataclasses.replace(
            IN_HAND, rate_hz=RATE_HZ, sensors=RECORDED, device="phone_mid" if rng.random() < 0.5 else "phone_good"
        ),
        duration_s=duration_s,
        person=_person(split, index % plan.people),
        places=_draw_places(rng, scene.mesh, duration_s),
        name=walk,
    )
    streams = derive(
        recording.streams, recording.mounting, DERIVED, start=start_pose(recording), building=recording.building
    )
    return rounded(dataclasses.replace(recording, streams=streams))


def _draw_places(rng: np.random.Generator, mesh: NavigationMesh, duration_s: float) -> list[Place]:
    """More places than one can visit in that time; before and after a ride stands the cabin of the nearest lift."""
    from pdrbench_sim.people.walker import draw_place, lift_ride

    building = mesh.building
    level = int(rng.choice(building.levels))
    places = [draw_place(rng, mesh, level=level)]
    while len(places) < 3 + duration_s / 6.0:
        if rng.random() < CHANGE_FRACTION:
            others = [other for other in building.levels if other != level]
            before, level = level, int(rng.choice(others))
            if rng.random() < LIFT_FRACTION:
                places += lift_ride(building, places[-1].xy_m, (before, level))
        places.append(draw_place(rng, mesh, level=level))
    return places


def _person(split: str, number: int) -> Person:
    from pdrbench_sim.people.person import draw_person

    return draw_person(WALKS.rng(split, _PERSON, number))


@functools.lru_cache(maxsize=16)
def _building(split: str, number: int) -> Building:
    from pdrbench_sim.buildings.office import OfficeParams, make_office

    rng = WALKS.rng(split, _BUILDING, number)
    return make_office(
        rng,
        num_levels=NUM_LEVELS,
        area_m2=float(rng.uniform(*AREA_M2)),
        name=f"office with lifts {WALKS.number(split)}.{number}",
        params=OfficeParams(has_lifts=True),
    )


@functools.lru_cache(maxsize=16)
def _scene(split: str, number: int) -> BuildingScene:
    from pdrbench_sim.record import make_scene

    return make_scene(WALKS.rng(split, _SCENE, number), _building(split, number))
