"""`LabStrideLost-v2` and `LabStrideWifi-v2`: strides through the replica of a laboratory, unknown start."""

from __future__ import annotations

import functools
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from pdrbench.building import Building
from pdrbench.recording import RadioMap, Recording, SensorStream
from pdrbench.sensors.radio import WIFI
from pdrbench.sensors.stride import STRIDE
from pdrbench.task import Task
from pdrbench_envs.campus.environment import STRIDE_PERIOD_S, record_strides, stride_recording
from pdrbench_envs.generated import GeneratedWalks, Split, start_pose, with_held_out

if TYPE_CHECKING:
    from pdrbench_sim.people.person import Person
    from pdrbench_sim.people.strides import Stances
    from pdrbench_sim.radio.wlan import PropagationParams, RadioField

LOST: Final = "LabStrideLost-v2"
WLAN: Final = "LabStrideWifi-v2"
DURATION_S: Final = (950.0, 990.0)  # W1: 16 minutes
AFTER_PASSES_S: Final = 12.0  # a walk goes on for at least that long after its last pass of the wing
_SEED: Final = 8725  # m2
OPEN_FRACTION: Final = 0.5  # of the doors, when the scan is taken; ours
_BUILDING, _PERSON, _WALK, _ERRORS, _FIELD, _SURVEY, _SCAN = range(7)  # one stream of random numbers each
# Fitted together to W14's "four strong access points" and 136 000 particles on the train walks.
W14_AREA_M2, W14_DETECTION_DBM = 190.0, -79.0
SPLITS: Final = {"train": Split(10), "val": Split(5), "test": Split(20)}
WALKS: Final = GeneratedWalks(LOST, _SEED, SPLITS)

_DESCRIPTION: Final = """\
A person walks through a laboratory building of 8725 m2 on three levels for 16 minutes without a stop: from far away six
times through one wing on level 2 and into its rooms, and between two passes to other wings and levels, as in the
evaluation of Woodman & Harle (2008). A foot-mounted unit reports every stride of one foot: length, change of height,
change of heading (W3), with errors that were measured on recordings of the foot: lengths about 2 cm short, by another
amount in every walk, a heading that drifts by a constant turn per stride of a law with heavy tails, and a third of
strides that err three times as much as the others.

Given before the walk: the building and the height of the person; not where the walk begins, nor its heading. Every
stance is scored; the zone of kind "tracked" is the wing in which the paper scored its own. Every walk has a building
and a person of its own. What is hard: wings repeat along the street and from level to level, so that many places
explain the first minutes of a walk equally well; and the heading drifts by a constant turn per stride, another one in
every walk.
"""

_ABOUT_WLAN: Final = """
One WLAN scan, taken at the start with half of the doors open, lists the access points received and their RSSI. The
radio map of the offline survey is given: 24 queries in each cell of at most 8 m, facing all ways, doors open
and closed (W13).
The walks are those of `LabStrideLost-v2`.
"""


def task() -> Task:
    """The environment without WLAN; no walk is generated before it is loaded."""
    return with_held_out(
        Task(
            id=LOST,
            summary=(
                "Strides of one foot with measured errors, 16 minutes through 8725 m² on three levels; start unknown."
            ),
            description=_DESCRIPTION,
            sensors=(STRIDE,),
            capacity={"stride": 2},
            period_s=STRIDE_PERIOD_S,
            start="unknown",
            walks=WALKS.ids(),
            load=load,
            tell_start=start_pose,
            licence="MIT",
            source="generated",
        ),
        WALKS,
    )


def task_wifi() -> Task:
    """The same walks with one WLAN scan at the start and the radio map of the building."""
    return with_held_out(
        replace(
            task(),
            id=WLAN,
            summary=f"The walks of {LOST} with one WLAN scan at the start and the radio map of the building.",
            description=_DESCRIPTION + _ABOUT_WLAN,
            sensors=(STRIDE, WIFI),
            capacity={"stride": 2, "wifi": 128},
            load=load_wifi,
            radio_map=radio_map,
        ),
        WALKS,
    )


def load(walk: str) -> Recording:
    """A walk by its id; the same one whenever it is asked for."""
    split, index = WALKS.place_of(walk)
    building, person, rests = _walk(split, index)
    rows, reference = record_strides(building, rests, WALKS.rng(split, _ERRORS, index))
    return stride_recording(walk, building, person, rows, reference)


def load_wifi(walk: str) -> Recording:
    """The same walk with the scan that the person takes before the first stride, standing."""
    from pdrbench_lab.papers.single_scans import receive, wifi_rows
    from pdrbench_sim.resolution import rounded_stream

    recording = load(walk)
    place = WALKS.place_of(walk)
    _, _, rests = _walk(*place)
    rng, field = WALKS.rng(place[0], _SCAN, place[1]), _radio_field(*place)
    doors_open = rng.random((1, field.num_doors)) < OPEN_FRACTION
    heading_rad = recording.reference.heading_rad
    assert heading_rad is not None
    now_s = np.zeros(1)
    rssi_dbm = receive(field, rng, now_s, rests.polygon[:1], rests.xy_m[:1], heading_rad[:1], doors_open=doors_open)
    wifi = rounded_stream(SensorStream(WIFI, wifi_rows(field, now_s, rssi_dbm)))
    return replace(recording, streams={**recording.streams, "wifi": wifi})


def radio_map(recording: Recording) -> RadioMap:
    """The offline survey of the building of a walk."""
    return _survey(*WALKS.place_of(recording.id))


@functools.lru_cache(maxsize=8)
def _building(split: str, index: int) -> Building:
    from pdrbench_lab.papers.woodman2008.lab_stride.lab import make_lab

    name = f"lab {WALKS.number(split)}.{index}"
    return make_lab(WALKS.rng(split, _BUILDING, index), name=name)


@functools.lru_cache(maxsize=8)
def _walk(split: str, index: int) -> tuple[Building, Person, Stances]:
    """Rests of one foot during the walk, cut off after about 16 minutes."""
    from pdrbench_lab.papers.woodman2008.lab_stride.lab import in_tracked_wing
    from pdrbench_lab.papers.woodman2008.lab_stride.walk import PEOPLE, STEADY, draw_rounds
    from pdrbench_sim.people.person import draw_person
    from pdrbench_sim.people.route import navigation_mesh
    from pdrbench_sim.people.strides import stances
    from pdrbench_sim.people.walker import walk_through

    building, rng = _building(split, index), WALKS.rng(split, _WALK, index)
    person = draw_person(WALKS.rng(split, _PERSON, index), PEOPLE)
    mesh = navigation_mesh(building)
    until_s = float(rng.uniform(*DURATION_S))
    walk = walk_through(rng, mesh, person, draw_rounds(rng, mesh, person, until_s), STEADY)
    left, right = stances(walk, rng)
    rests = left if rng.random() < 0.5 else right
    last_s = rests.mid_s[in_tracked_wing(building, rests.xy_m, building.level(rests.polygon))][-1]
    return building, person, rests.until(max(until_s, last_s + AFTER_PASSES_S))


@functools.lru_cache(maxsize=8)
def _radio_field(split: str, index: int) -> RadioField:
    from pdrbench_sim.radio.wlan import make_radio_field

    return make_radio_field(WALKS.rng(split, _FIELD, index), _building(split, index), params=propagation())


def propagation() -> PropagationParams:
    """How radio spreads in the laboratory; see W14 in the notebook."""
    from pdrbench_sim.radio.wlan import PropagationParams

    return PropagationParams(area_per_access_point_m2=W14_AREA_M2, detection_dbm=W14_DETECTION_DBM)


@functools.lru_cache(maxsize=8)
def _survey(split: str, index: int) -> RadioMap:
    from pdrbench.radio import divide
    from pdrbench_lab.papers.woodman2008.survey import survey

    field = _radio_field(split, index)
    return survey(WALKS.rng(split, _SURVEY, index), field, divide(_building(split, index)))
