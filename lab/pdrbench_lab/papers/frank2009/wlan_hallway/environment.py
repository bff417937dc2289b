"""WlanHallway-v1: a shoe and a laptop's WLAN on four laps of a hallway, no map (Frank et al. 2009, F1 to F3)."""

from __future__ import annotations

import dataclasses
import functools
from typing import TYPE_CHECKING, Final

import numpy as np

from pdrbench.recording import RadioMap, Recording
from pdrbench.sensors import sensor_spec
from pdrbench.task import Task
from pdrbench.trajectory import Start
from pdrbench_envs.generated import GeneratedWalks, Split, with_held_out

if TYPE_CHECKING:
    from pdrbench_sim.people.person import PersonParams
    from pdrbench_sim.radio.wlan import RadioField
    from pdrbench_sim.record import BuildingScene

ENV: Final = "WlanHallway-v1"
SPLITS: Final = {"train": Split(4), "val": Split(4), "test": Split(20)}
PERIOD_S: Final = 0.1  # ours
RATE_HZ: Final = 120.0  # of an MTx
_SEED: Final = 31777  # 3.1777 m
_SCENE, _RADIO, _SURVEY, _WALK, _AIR = range(5)  # one stream of random numbers each
WALKS: Final = GeneratedWalks(ENV, _SEED, SPLITS)
_DESCRIPTION: Final = """\
A person walks four laps of 104 m through the rectangular hallway of a university building, as in the evaluation of
Frank et al. (2009): on the shoe an Xsens MTx, in the hands a laptop that scans the WLAN once a second, with nothing
left over from earlier scans. Eleven access points hang on the level. Every walk has a walker and a radio field of its
own, whichever way round.

**Handed out** every 0.1 s: accelerometer, gyroscope and magnetometer at 120 Hz, the scans. **Given**: the level, a disc
around the hallway, and the radio survey: 60 scans at each of 42 points along the hallway, 2.5 m from each other. No
building is given, nor where on the lap the walk begins. **Scored** are the 68 moments at which one of 17 marks on the
floor is passed.

**What is hard**: a fingerprint often looks like one several metres away, and some do so lap after lap.
"""


def task() -> Task:
    """The environment; no walk is generated before it is loaded."""
    sampled = [dataclasses.replace(sensor_spec(name), rate_hz=RATE_HZ) for name in ("accel", "gyro", "mag")]
    return with_held_out(
        Task(
            id=ENV,
            summary="A unit on the foot and WLAN once a second, four laps of a hallway; survey, no map, start unknown",
            description=_DESCRIPTION,
            sensors=(*sampled, sensor_spec("wifi")),
            capacity={"accel": 32, "gyro": 32, "mag": 32, "wifi": 64},
            period_s=PERIOD_S,
            start="area",
            walks=WALKS.ids(),
            load=load,
            tell_start=tell_start,
            radio_map=radio_map,
            licence="MIT",
            source="generated",
        ),
        WALKS,
        person=WALKS.person,
    )


def load(walk: str) -> Recording:
    """A walk by its id; the same one whenever it is asked for."""
    from pdrbench_lab.papers.frank2009.wlan_hallway.hallway import HALLWAY_PEOPLE

    return load_of(walk, HALLWAY_PEOPLE)


def load_of(walk: str, people: PersonParams) -> Recording:
    """The same walk in the same radio field by a person who is drawn among others."""
    from pdrbench_lab.papers.frank2009.wlan_hallway.hallway import record_hallway

    split, index = WALKS.place_of(walk)
    seed, rng = WALKS.numbers(split, _WALK, index), WALKS.rng(split, _AIR, index)
    return record_hallway(scene(split, index), radio(split, index), seed, rng, people=people, name=walk)


def tell_start(recording: Recording) -> Start:
    """A disc around the whole hallway: no more than the level."""
    from pdrbench_lab.papers.frank2009.wlan_hallway.hallway import HALLWAY

    corners_xy_m = HALLWAY.xy_m(HALLWAY.corners_m)
    middle_m = corners_xy_m.mean(axis=0)
    return Start(middle_m, level=0, radius_m=float(np.hypot(*(corners_xy_m[0] - middle_m))) + 1.0)


def radio_map(recording: Recording) -> RadioMap:
    """The survey of the radio field of a walk."""
    return _survey(*WALKS.place_of(recording.id))


def scene(split: str, index: int) -> BuildingScene:
    """The building of a walk, which is always the same, and its magnetic field, which is not."""
    from pdrbench_lab.papers.frank2009.wlan_hallway.hallway import CONCRETE, make_hallway
    from pdrbench_sim.record import make_scene

    return make_scene(WALKS.rng(split, _SCENE, index), make_hallway(), magnetic=CONCRETE)


@functools.lru_cache(maxsize=4)
def radio(split: str, index: int) -> RadioField:
    """The radio field of a walk."""
    from pdrbench_lab.papers.frank2009.wlan_hallway.hallway import make_hallway, make_hallway_radio

    return make_hallway_radio(WALKS.rng(split, _RADIO, index), make_hallway())


@functools.lru_cache(maxsize=4)
def _survey(split: str, index: int) -> RadioMap:
    from pdrbench_lab.papers.frank2009.wlan_hallway.hallway import survey_hallway

    return survey_hallway(WALKS.rng(split, _SURVEY, index), radio(split, index))
