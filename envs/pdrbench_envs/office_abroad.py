"""`OfficePhoneAbroad-v1`: phones of people who differ more than those that localizers here were tuned on."""

from __future__ import annotations

import dataclasses
import functools
from typing import TYPE_CHECKING, Final

from pdrbench.recording import RadioMap, Recording, SensorStream
from pdrbench.sensors import sensor_spec
from pdrbench.task import Task
from pdrbench_envs.generated import GeneratedWalks, Split, start_place, with_held_out
from pdrbench_envs.office_signals import CAPACITY, SAMPLED, SURVEY_PLACES
from pdrbench_envs.office_stride import draw_office

if TYPE_CHECKING:
    from pdrbench.building import Building
    from pdrbench_sim.record import BuildingScene

ENV: Final = "OfficePhoneAbroad-v1"
GROUPS: Final = ("usual", "gentle", "slow", "pocket", "swing", "ear", "bag", "cart", "other phone")  # in turn
SPLITS: Final = {  # every walk by a person of its own; no group is bound to a building
    "train": Split(walks=36, buildings=4, people=36),
    "val": Split(walks=36, buildings=4, people=36),
    "test": Split(walks=54, buildings=5, people=54),
}
PERIOD_S: Final = 0.2
RATE_HZ: Final = 100.0  # nominal: phones of the last group deliver 50 or 100 Hz
DURATION_S: Final = (90.0, 150.0)  # of a walk, least and most; ours
SENSORS: Final = ("accel", "gyro", "mag", "rotation", "baro", "wifi")
SPECS: Final = {
    name: dataclasses.replace(sensor_spec(name), rate_hz=RATE_HZ) if name in SAMPLED else sensor_spec(name)
    for name in SENSORS
}
_SEED: Final = 20261124
_BUILDING, _SCENE, _SURVEY, _PERSON, _PLAN, _WALK = range(6)  # one stream of random numbers each
WALKS: Final = GeneratedWalks(ENV, _SEED, SPLITS, Split(9, buildings=2, people=9))
_DESCRIPTION: Final = """\
Simulated people of nine kinds, each walk by a person of its own, visit rooms on three levels of synthetic offices. A
network or a filter that learned from brisk people with a known phone in the hand shows here whether it holds for
others. Results are also given by kind:

* `usual`: people of every stiffness of gait, the phone in the hand; `gentle`: bent knees, less than half of the rise
  of the surveyors of `MallPhone`; `slow`: slow and old people, uneven and unsteady;
* `pocket`: a phone that rattles in a trouser pocket; `swing`: in a swinging hand; `ear`: at the ear; `bag`: in a bag
  that swings and bounces at the shoulder; `cart`: on the handle of a cart or a stroller, which hardly shows steps but
  the vibration of wheels, joints of tiles and steering;
* `other phone`: in the hand, another phone for each person: bias, range, rate, noise, bandwidth, rounding, late stamps,
  and an attitude that follows the compass within a second or hardly at all.

**Handed out** every 0.2 s: accelerometer, gyroscope, magnetometer and rotation vector at 100 Hz (50 or 100 Hz of other
phones), a barometer at 10 Hz, WLAN scans about every two seconds. Where the phone is carried is given
(`Briefing.mounting`), nothing else of the kind.

**Given**: the building, a radio map, the height of the person, place and level of the start; no heading. **Scored** is
the place of the body every second.

**What is hard**: steps that are hardly seen, or seen where there are none.
"""


def task() -> Task:
    """The environment; nothing is generated before it is loaded."""
    ids = WALKS.ids()
    made = Task(
        id=ENV,
        summary="Phones of gentle, slow and other people, at the ear, in bags, on carts; start place known",
        description=_DESCRIPTION,
        sensors=tuple(SPECS.values()),
        capacity={name: CAPACITY.get(name, 32) for name in SENSORS},
        period_s=PERIOD_S,
        start="pose",
        walks=ids,
        load=_load,
        tell_start=start_place,
        radio_map=_radio_map,
        licence="MIT",
        source="generated",
        groups={walk: (kind_of(WALKS.place_of(walk)[1]),) for walks in ids.values() for walk in walks},
    )
    return with_held_out(made, WALKS, person=WALKS.person)


def kind_of(index: int) -> str:
    """The kind of the person of a walk, by its place in the order of play of its split."""
    return GROUPS[index % len(GROUPS)]


def _load(walk: str) -> Recording:
    """A walk by its id; the same one whenever it is asked for."""
    from pdrbench_sim.phone.population import KINDS, draw_bearer
    from pdrbench_sim.record import IN_HAND, simulate_walk

    split, index = WALKS.place_of(walk)
    plan = WALKS.rng(split, _PLAN, index)
    duration_s = float(plan.uniform(*DURATION_S))
    bearer = draw_bearer(WALKS.rng(split, _PERSON, index), KINDS[kind_of(index)])
    setup = dataclasses.replace(
        IN_HAND,
        mounting=bearer.mounting,
        rate_hz=bearer.manner.profile.rate_hz if bearer.manner.profile else RATE_HZ,
        sensors=SENSORS,
        device="phone_mid" if plan.random() < 0.5 else "phone_good",
        manner=bearer.manner,
    )
    recording = simulate_walk(
        _scene(split, index % WALKS.split(split).buildings),
        WALKS.numbers(split, _WALK, index),
        setup,
        duration_s=duration_s,
        person=bearer.person,
        walk=bearer.walk,
        name=walk,
    )
    streams = {name: SensorStream(SPECS[name], stream.rows) for name, stream in recording.streams.items()}
    return dataclasses.replace(recording, streams=streams, device="simulated phone")


def _radio_map(recording: Recording) -> RadioMap:
    """The survey of the building of a walk."""
    split, index = WALKS.place_of(recording.id)
    return _survey(split, index % WALKS.split(split).buildings)


@functools.lru_cache(maxsize=16)
def _building(split: str, number: int) -> Building:
    return draw_office(WALKS, split, _BUILDING, number)


@functools.lru_cache(maxsize=16)
def _scene(split: str, number: int) -> BuildingScene:
    from pdrbench_sim.record import make_scene

    return make_scene(WALKS.rng(split, _SCENE, number), _building(split, number))


@functools.lru_cache(maxsize=16)
def _survey(split: str, number: int) -> RadioMap:
    from pdrbench.radio import divide
    from pdrbench_sim.radio.survey import survey_standing

    rng = WALKS.rng(split, _SURVEY, number)
    return survey_standing(rng, _scene(split, number).networks, divide(_building(split, number)), places=SURVEY_PLACES)
