"""Raw sensors of people who walk through synthetic offices: `OfficePhone-v1` (a phone), `OfficeFoot-v2` (on a shoe)."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from pdrbench.building import Building
from pdrbench.recording import RadioMap, Recording, SensorSpec
from pdrbench.sensors import sensor_spec
from pdrbench.task import Task
from pdrbench.trajectory import Start
from pdrbench_envs.foot_recordings import tell_start as tell_foot_start
from pdrbench_envs.generated import GeneratedWalks, Split, start_place, with_held_out
from pdrbench_envs.office_stride import draw_office

if TYPE_CHECKING:
    from pdrbench_sim.people.person import Person
    from pdrbench_sim.record import BuildingScene, Setup

FOOT: Final = "OfficeFoot-v2"
PHONE: Final = "OfficePhone-v1"
FOOT_PERIOD_S: Final = 0.05  # as the recorded walks with a unit on the foot have it
PHONE_PERIOD_S: Final = 0.2  # as the recorded walks with a phone have it
FOOT_HZ: Final = 120.0  # of an MTx
PHONE_HZ: Final = 100.0
FOOT_SENSORS: Final = ("accel", "gyro", "mag", "baro", "wifi")
PHONE_SENSORS: Final = ("accel", "gyro", "mag", "rotation", "baro", "wifi", "ble")
SURVEY_PLACES: Final = 2  # in each cell of at most 8 m, with two scans each; ours
SWITCHED_FRACTION: Final = 0.25  # of the walks with a phone, on which it is put elsewhere on the way; ours
_SEED: Final = 20261122
_BUILDING, _SCENE, _SURVEY, _PERSON, _PLAN, _WALK = range(6)  # one stream of random numbers each


SPLITS: Final = {
    "train": Split(walks=32, buildings=8, people=16),
    "val": Split(walks=8, buildings=4, people=8),
    "test": Split(walks=16, buildings=4, people=16),
}
_HELD_OUT: Final = Split(8, buildings=2, people=8)


@dataclass(frozen=True, slots=True)
class _SignalSet:
    """What differs between the environments."""

    env: str
    sensors: tuple[str, ...]
    rate_hz: float  # of the inertial unit
    period_s: float  # between observations
    duration_s: tuple[float, float]  # of a walk, least and most

    @property
    def walks(self) -> GeneratedWalks:
        """Its walks; buildings and people are those of both environments."""
        return GeneratedWalks(self.env, _SEED, SPLITS, _HELD_OUT)

    @property
    def specs(self) -> tuple[SensorSpec, ...]:
        """Sensors at the rate of this unit."""
        return tuple(
            dataclasses.replace(sensor_spec(name), rate_hz=self.rate_hz) if name in SAMPLED else sensor_spec(name)
            for name in self.sensors
        )

    @property
    def capacity(self) -> Mapping[str, int]:
        """Rows of each sensor in one observation."""
        return {name: CAPACITY.get(name, 32) for name in self.sensors}


SAMPLED: Final = frozenset({"accel", "gyro", "mag", "rotation"})
CAPACITY: Final = {"wifi": 1024, "ble": 64, "baro": 8}
_NUMBER: Final = {FOOT: 0, PHONE: 1}
_FOOT: Final = _SignalSet(FOOT, FOOT_SENSORS, FOOT_HZ, FOOT_PERIOD_S, (150.0, 240.0))
_PHONE: Final = _SignalSet(PHONE, PHONE_SENSORS, PHONE_HZ, PHONE_PERIOD_S, (120.0, 240.0))


_WHERE: Final = """\
People of all sizes visit rooms on three levels of synthetic office buildings: corridors, doors, stairwells with real
treads, pauses. Buildings and people differ between the splits: nothing learned on `train` was seen there.
"""
_ABOUT_FOOT: Final = """
**Handed out** every 0.05 s: accelerometer, gyroscope and magnetometer of an Xsens MTx on the shoe at 120 Hz (5 g, so
that brisk heel strikes are clipped), its mean rate of a minute at rest taken off; a barometer at 10 Hz; and the WLAN
scans of a phone, about every two seconds, of which half the rows repeat older sightings (`age_s`).

**Given**: the building, a radio map, the height of the person, place and level of the unit at the start, and as heading
the direction from there to where the foot has come half a metre away. **Scored** is the place of the unit at every rest
of the foot.

**What is hard**: the heading drifts, and near the floor the magnetic field is that of the floor, not of the Earth.
"""
_ABOUT_PHONE: Final = """
**Handed out** every 0.2 s: accelerometer, gyroscope, magnetometer and rotation vector of a phone at 100 Hz, a barometer
at 10 Hz, WLAN scans about every two seconds, of which half the rows repeat older sightings (`age_s`), and Bluetooth
beacons. The phone is held in front of the body in half of the walks and carried in a trouser pocket in the other half
(`Briefing.mounting`); in one walk out of four it is put elsewhere on the way, which is not reported.

**Given**: the building, a radio map, the height of the person, place and level of the start; no heading. **Scored** is
the place of the body every second.

**What is hard**: the yaw between phone and body is unknown, and every person has a stride of their own.
"""


def task_foot() -> Task:
    """A unit on the foot and WLAN; nothing is generated before it is loaded."""
    return _make_task(
        _FOOT,
        summary="Raw signals of a unit on the foot and WLAN, through synthetic three-level offices; start pose known",
        description=_WHERE + _ABOUT_FOOT,
        tell_start=tell_foot_start,
    )


def task_phone() -> Task:
    """A phone in hand or pocket; nothing is generated before it is loaded."""
    return _make_task(
        _PHONE,
        summary="Raw signals of a phone in hand or pocket, through synthetic three-level offices; start place known",
        description=_WHERE + _ABOUT_PHONE,
        tell_start=start_place,
    )


def _make_task(kind: _SignalSet, *, summary: str, description: str, tell_start: Callable[[Recording], Start]) -> Task:
    return with_held_out(
        Task(
            id=kind.env,
            summary=summary,
            description=description,
            sensors=kind.specs,
            capacity=kind.capacity,
            period_s=kind.period_s,
            start="pose",
            walks=kind.walks.ids(),
            load=functools.partial(_load, kind),
            tell_start=tell_start,
            radio_map=functools.partial(_radio_map, kind),
            licence="MIT",
            source="generated",
        ),
        kind.walks,
    )


def _load(kind: _SignalSet, walk: str) -> Recording:
    """A walk by its id; the same one whenever it is asked for."""
    from pdrbench_sim.record import simulate_walk

    split, index = kind.walks.place_of(walk)
    plan = kind.walks.split(split)
    rng = _FOOT.walks.rng(split, _PLAN, index)
    duration_s = float(rng.uniform(*kind.duration_s))
    recording = simulate_walk(
        _scene(split, index % plan.buildings),
        kind.walks.numbers(split, _WALK, index, _NUMBER[kind.env]),
        _setup(kind, index, duration_s, rng),
        duration_s=duration_s,
        person=_person(split, index % plan.people),
        name=walk,
    )
    return recording if kind is _PHONE else at_observations(recording)


def _setup(kind: _SignalSet, index: int, duration_s: float, rng: np.random.Generator) -> Setup:
    """What is carried on a walk."""
    from pdrbench_sim.record import IN_HAND, IN_POCKET, ON_FOOT

    if kind is not _PHONE:
        return dataclasses.replace(ON_FOOT, rate_hz=kind.rate_hz, sensors=kind.sensors)
    first, other = (IN_HAND, IN_POCKET) if index % 2 == 0 else (IN_POCKET, IN_HAND)
    switches = (
        ((duration_s * float(rng.uniform(0.3, 0.7)), other.mounting),) if rng.random() < SWITCHED_FRACTION else ()
    )
    device = "phone_mid" if rng.random() < 0.5 else "phone_good"
    return dataclasses.replace(first, rate_hz=kind.rate_hz, sensors=kind.sensors, switches=switches, device=device)


def at_observations(recording: Recording) -> Recording:
    """The same walk with its rests reported at the last observation of each: there the foot still stands."""
    from pdrbench_sim.resolution import rounded_reference

    step = np.floor(recording.reference.t_s / FOOT_PERIOD_S + 1e-9)
    step[0] = 0.0
    is_new = np.diff(step, prepend=-1.0) > 0
    reference = dataclasses.replace(recording.reference.rows(is_new), t_s=step[is_new] * FOOT_PERIOD_S)
    return dataclasses.replace(recording, reference=rounded_reference(reference))


def _radio_map(kind: _SignalSet, recording: Recording) -> RadioMap:
    """The survey of the building of a walk."""
    split, index = kind.walks.place_of(recording.id)
    return _survey(split, index % kind.walks.split(split).buildings)


def _person(split: str, number: int) -> Person:
    from pdrbench_sim.people.person import draw_person

    return draw_person(_FOOT.walks.rng(split, _PERSON, number))


@functools.lru_cache(maxsize=16)
def _building(split: str, number: int) -> Building:
    return draw_office(_FOOT.walks, split, _BUILDING, number)


@functools.lru_cache(maxsize=16)
def _scene(split: str, number: int) -> BuildingScene:
    from pdrbench_sim.record import make_scene

    return make_scene(_FOOT.walks.rng(split, _SCENE, number), _building(split, number))


@functools.lru_cache(maxsize=16)
def _survey(split: str, number: int) -> RadioMap:
    from pdrbench.radio import divide
    from pdrbench_sim.radio.survey import survey_standing

    scene, rng = _scene(split, number), _FOOT.walks.rng(split, _SURVEY, number)
    return survey_standing(rng, scene.networks, divide(scene.building), places=SURVEY_PLACES)
