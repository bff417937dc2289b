"""Simulated people in a real building of seven levels: `WestportPhone-v1` (a phone), `WestportFoot-v2` (on a shoe).

The plan is that of Westport House in the registered set `maps`; walks can be made only where that is found.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from pdrbench.building import Building
from pdrbench.building.connectivity import largest_part
from pdrbench.datasets import datasets, find
from pdrbench.recording import RadioMap, Recording
from pdrbench.sensors import sensor_spec
from pdrbench.task import Task
from pdrbench.trajectory import Start
from pdrbench_envs.foot_recordings import tell_start as tell_foot_start
from pdrbench_envs.generated import GeneratedWalks, Split, start_place, with_held_out
from pdrbench_envs.office_signals import (
    CAPACITY,
    FOOT_HZ,
    FOOT_PERIOD_S,
    FOOT_SENSORS,
    PHONE_HZ,
    PHONE_PERIOD_S,
    PHONE_SENSORS,
    SAMPLED,
    SURVEY_PLACES,
    at_observations,
)
from pdrbench_envs.recorded import checked_file

if TYPE_CHECKING:
    from pdrbench_sim.people.route import NavigationMesh, Place
    from pdrbench_sim.record import BuildingScene, Setup

DATASET: Final = "maps"
FOLDER: Final = "westport_house/westport-house"
PHONE: Final = "WestportPhone-v1"
FOOT: Final = "WestportFoot-v2"
SPLITS: Final = {
    "train": Split(walks=12, people=12),
    "val": Split(walks=6, people=6),
    "test": Split(walks=12, people=12),
}
DURATION_S: Final = (150.0, 270.0)
CHANGE_LEVEL: Final = 0.5  # of the places on the way, those on another level than the one before; ours
LIFT_FRACTION: Final = 0.5  # of those, the ones that people go to by lift, where one stops; ours
MAX_LEVELS_AWAY: Final = 2  # farther than that people take a lift; ours
MIN_WAY_M: Final = 2.0  # between two places; ours
_SEED: Final = 20261123
_SCENE, _SURVEY, _PERSON, _PLAN, _PLACES, _WALK = range(6)  # one stream of random numbers each


@dataclass(frozen=True, slots=True)
class _Kind:
    """What differs between the two environments.

    Attributes:
        env: Id.
        sensors: Recorded and offered.
        derived: Computed from them, and offered.
        rate_hz: Of the inertial unit.
        period_s: Between observations.
        number: In seeds.
    """

    env: str
    sensors: tuple[str, ...]
    derived: tuple[str, ...]
    rate_hz: float
    period_s: float
    number: int

    @property
    def walks(self) -> GeneratedWalks:
        """Its walks; people are those of both environments."""
        return GeneratedWalks(self.env, _SEED, SPLITS, Split(8, people=8))


_PHONE: Final = _Kind(PHONE, PHONE_SENSORS, ("level_change",), PHONE_HZ, PHONE_PERIOD_S, 0)
_FOOT: Final = _Kind(FOOT, FOOT_SENSORS, (), FOOT_HZ, FOOT_PERIOD_S, 1)
_DESCRIPTION: Final = """\
Simulated people visit rooms of Westport House in Dundee, after its published plan (WRLD 3D, CC BY 4.0): seven levels,
from a shopping floor to a tower, offices on both sides of long corridors, and eight stairs, one of which reaches all
levels. The plan draws stairs as outlines; treads are laid out in them, 3.5 m from level to level are assumed,
and what no door or stair leads to is left out. Where one of five lifts stops on both levels, half of the ways from
one to the other go by lift.

The building is the same in all splits; people differ. Sensors, magnetic field and radio are those of the synthetic
offices.
"""
_ABOUT_PHONE: Final = """
**Handed out** every 0.2 s: as in `OfficePhone-v1`, and `level_change`, which is computed from pressure and steps by
`pdrbench_formats.derive`. The phone is in the hand in half of the walks, in a trouser pocket
in the others. **Given**: the building, a radio map, the height of the person, place and level of the start.
**Scored** is the place of the body every second.
"""
_ABOUT_FOOT: Final = """
**Handed out** every 0.05 s: as in `OfficeFoot-v2`. **Given**: the building, a radio map, the height of the person,
place, level and heading of the start. **Scored** is the place of the unit at every rest of the foot.
"""


def task_phone() -> Task:
    """A phone in hand or pocket; nothing is generated before it is loaded."""
    summary = "Simulated people with a phone in a real building of seven levels; start place known"
    return _make_task(_PHONE, summary, _DESCRIPTION + _ABOUT_PHONE, start_place)


def task_foot() -> Task:
    """A unit on the foot; nothing is generated before it is loaded."""
    summary = "Simulated people with a unit on the foot in a real building of seven levels; start pose known"
    return _make_task(_FOOT, summary, _DESCRIPTION + _ABOUT_FOOT, tell_foot_start)


def _make_task(kind: _Kind, summary: str, description: str, tell_start: Callable[[Recording], Start]) -> Task:
    registered = datasets()[DATASET]
    recorded = tuple(
        dataclasses.replace(sensor_spec(name), rate_hz=kind.rate_hz) if name in SAMPLED else sensor_spec(name)
        for name in kind.sensors
    )
    derived = tuple(dataclasses.replace(sensor_spec(name), derived=True) for name in kind.derived)
    return with_held_out(
        Task(
            id=kind.env,
            summary=summary,
            description=description,
            sensors=(*recorded, *derived),
            capacity={name: CAPACITY.get(name, 32) for name in (*kind.sensors, *kind.derived)},
            period_s=kind.period_s,
            start="pose",
            walks=kind.walks.ids(),
            load=functools.partial(_load, kind),
            tell_start=tell_start,
            radio_map=_radio_map,
            licence="CC-BY-4.0",
            source=f"generated in the plan of {registered.source_url} commit {registered.commit}",
            dataset=DATASET,
        ),
        kind.walks,
        person=kind.walks.person,
    )


def _load(kind: _Kind, walk: str) -> Recording:
    """A walk by its id; the same one whenever it is asked for."""
    from pdrbench_formats.derive import derive
    from pdrbench_sim.people.person import draw_person
    from pdrbench_sim.record import simulate_walk
    from pdrbench_sim.resolution import rounded

    split, index = kind.walks.place_of(walk)
    rng = _PHONE.walks.rng(split, _PLAN, index)
    duration_s = float(rng.uniform(*DURATION_S))
    scene = _scene()
    recording = simulate_walk(
        scene,
        kind.walks.numbers(split, _WALK, index, kind.number),
        _setup(kind, index, rng),
        duration_s=duration_s,
        person=draw_person(_PHONE.walks.rng(split, _PERSON, index % kind.walks.split(split).people)),
        places=_places(_PHONE.walks.rng(split, _PLACES, index), scene.mesh, duration_s),
        name=walk,
    )
    if not kind.derived:
        return at_observations(recording)
    streams = derive(
        recording.streams, recording.mounting, kind.derived, start=start_place(recording), building=recording.building
    )
    return rounded(dataclasses.replace(recording, streams=streams))


def _setup(kind: _Kind, index: int, rng: np.random.Generator) -> Setup:
    """What is carried on a walk."""
    from pdrbench_sim.record import IN_HAND, IN_POCKET, ON_FOOT

    if kind is not _PHONE:
        return dataclasses.replace(ON_FOOT, rate_hz=kind.rate_hz, sensors=kind.sensors)
    carried = IN_HAND if index % 2 == 0 else IN_POCKET
    device = "phone_mid" if rng.random() < 0.5 else "phone_good"
    return dataclasses.replace(carried, rate_hz=kind.rate_hz, sensors=kind.sensors, device=device)


def _places(rng: np.random.Generator, mesh: NavigationMesh, duration_s: float) -> list[Place]:
    """Places to visit, half of them on another level than the one before: more than there is time for.

    Before and after a ride in a lift stands its cabin.
    """
    from pdrbench_sim.people.walker import draw_place, lift_ride

    building = mesh.building
    level = int(rng.choice(building.levels))
    places = [draw_place(rng, mesh, level=level)]
    for _ in range(3 + int(duration_s / 15.0)):
        if rng.random() < CHANGE_LEVEL:
            here_m, others = places[-1].xy_m, [other for other in building.levels if other != level]
            by_lift = [other for other in others if lift_ride(building, here_m, (level, other))]
            rides = bool(by_lift) and rng.random() < LIFT_FRACTION
            near = by_lift if rides else [other for other in others if abs(other - level) <= MAX_LEVELS_AWAY]
            before, level = level, int(rng.choice(near))
            places += lift_ride(building, here_m, (before, level)) if rides else []
        place = draw_place(rng, mesh, level=level)
        while np.hypot(*(place.xy_m - places[-1].xy_m)) < MIN_WAY_M:
            place = draw_place(rng, mesh, level=level)
        places.append(place)
    return places


@functools.lru_cache(maxsize=1)
def _building() -> Building:
    """What one can walk to in Westport House, once its plan is known to be the registered one."""
    from pdrbench_envs import westport_plan

    root = find(DATASET)
    for file in datasets()[DATASET].files:
        if file.path.startswith(f"{FOLDER}/"):
            checked_file(root / file.path, file.sha256, DATASET, "copy the registered commit again")
    return largest_part(westport_plan.read(root / FOLDER).building)


@functools.lru_cache(maxsize=1)
def _scene() -> BuildingScene:
    from pdrbench_sim.record import make_scene

    return make_scene(np.random.default_rng([_SEED, _SCENE]), _building())


@functools.lru_cache(maxsize=1)
def _survey() -> RadioMap:
    from pdrbench.radio import divide
    from pdrbench_sim.radio.survey import survey_standing

    scene = _scene()
    rng = np.random.default_rng([_SEED, _SURVEY])
    return survey_standing(rng, scene.networks, divide(scene.building), places=SURVEY_PLACES)


def _radio_map(recording: Recording) -> RadioMap:
    """The survey of the building, which is the same for all walks."""
    return _survey()
