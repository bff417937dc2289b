"""Synthetic walks of surveyors through shopping centres, like those of the Indoor Location Competition 2.0.

How long walks are, how they bend and how far apart waypoints lie was read off the train and survey walks of site 1 [M].
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from pdrbench.building import Building
from pdrbench.recording import Recording
from pdrbench_lab.realism.surveyors import SURVEYORS
from pdrbench_sim.buildings.mall import make_mall
from pdrbench_sim.buildings.walls import walls_along
from pdrbench_sim.fields.magnetic import MagneticParams
from pdrbench_sim.people.person import Person, draw_person
from pdrbench_sim.people.route import Place
from pdrbench_sim.people.walker import NATURAL_WALK
from pdrbench_sim.radio.networks import draw_mall_networks
from pdrbench_sim.record import IN_HAND, BuildingScene, Setup, make_scene, simulate_walk

NUM_FLOORS: Final = 5  # over which walks are spread, each in a building of its own
AREA_M2: Final = (24000.0, 34000.0)  # of the outline; survey walks of site 1 span 190 m by 150 m
DURATION_MEDIAN_S: Final = 29.0  # [M] of all walks; 13 s of the train walks, 42 s of the survey walks
DURATION_LOG_SIGMA: Final = 0.7  # [M]
DURATION_S: Final = (5.0, 98.0)
NEXT_M: Final = (4.0, 14.0)  # to the next place that a surveyor turns to; ours: bends walks as much as recorded ones
ONWARD_FRACTION: Final = 0.7  # of the turns are less than right angles; ours, likewise
PASSAGE_FRACTION: Final = 0.6  # of the places lie in service passages, none in shops: 0.3 of scans then receive little
NUM_PLACES: Final = 300  # to choose from
CLEARANCE_M: Final = 0.5  # of a place from the walls round it; ours
_TRIED: Final = 60  # places anywhere, for each that is wanted: passages are small
SURVEYOR: Final[Setup] = replace(
    IN_HAND,
    rate_hz=50.0,
    sensors=("accel", "gyro", "mag", "rotation", "wifi", "ble"),
    waypoint_m=(3.5, 10.0),  # [M]
)
# A surveyor hardly ever stops; ours.
STEADY: Final = replace(NATURAL_WALK, pause_every_s=400.0, pause_median_s=0.5, stop_fraction=0.05)
FIELD: Final = MagneticParams(declination_rad=math.radians(6.0))  # west, eastern China [R]
_SCENE, _PLAN, _WALK, _PLACES = range(4)  # one stream of random numbers each


@functools.lru_cache(maxsize=16)
def mall_scene(seed: int, floor: int) -> BuildingScene:
    """One floor of a shopping centre, with its fields."""
    rng = np.random.default_rng([seed, floor, _SCENE])
    building = make_mall(rng, area_m2=float(rng.uniform(*AREA_M2)), name=f"mall {seed}.{floor}")
    return make_scene(rng, building, networks=draw_mall_networks(rng), magnetic=FIELD)


@functools.lru_cache(maxsize=16)
def _places(seed: int, floor: int) -> tuple[Place, ...]:
    """Where surveyors on a floor may turn to."""
    return draw_survey_places(np.random.default_rng([seed, floor, _PLACES]), mall_scene(seed, floor).building)


def draw_survey_places(rng: np.random.Generator, building: Building) -> tuple[Place, ...]:
    """Where surveyors of a shopping centre walk: in its concourses and service passages, not in its shops.

    On site 1, level F1, 0.5 % of the scans of survey walks lie in shops. In 39 % little is received, less than 0.54 of
    what the best tenth receives; nearly all of these lie in narrow dead ends behind shops.
    """
    kinds = {zone.id: zone.kind for zone in building.zones}
    kind = np.array([kinds.get(polygon.id, "") for polygon in building.polygons])
    polygon, xy_m = building.sample_uniform(rng, _TRIED * NUM_PLACES)
    is_walked = np.isin(kind[polygon], ("concourse", "passage"))
    polygon, xy_m = polygon[is_walked], xy_m[is_walked]
    is_free = np.ones(len(polygon), dtype=np.bool_)
    is_free[walls_along(building, xy_m, polygon, CLEARANCE_M, 0).point] = False
    in_passage = kind[polygon] == "passage"
    passages, concourses = np.flatnonzero(is_free & in_passage), np.flatnonzero(is_free & ~in_passage)
    num_passages = min(int(rng.binomial(NUM_PLACES, PASSAGE_FRACTION)), len(passages))
    chosen = np.concatenate([passages[:num_passages], concourses[: NUM_PLACES - num_passages]])
    return tuple(Place(int(polygon[i]), xy_m[i]) for i in rng.permutation(chosen))


@functools.lru_cache(maxsize=8)
def mall_walks(seed: int, count: int) -> tuple[Recording, ...]:
    """Walks of surveyors who hold a phone in front of the body, floor by floor in turn; ids end in the floor.

    The first walks are the same whatever their number.
    """
    return tuple(mall_walk(seed, number % NUM_FLOORS, number) for number in range(count))


def mall_walk(seed: int, floor: int, number: int, *, median_s: float = DURATION_MEDIAN_S) -> Recording:
    """One of `mall_walks`, from a law of durations with this median."""
    rng = np.random.default_rng([seed, floor, _PLAN, number])
    length = median_s * math.exp(DURATION_LOG_SIGMA * float(rng.standard_normal()))
    duration_s = float(np.clip(length, *DURATION_S))
    person = draw_person(rng, SURVEYORS)
    return simulate_walk(
        mall_scene(seed, floor),
        [seed, floor, _WALK, number],
        SURVEYOR,
        duration_s=duration_s,
        person=person,
        places=_draw_tour(rng, _places(seed, floor), person, duration_s),
        walk=STEADY,
        name=f"walk-{number:03d}-floor-{floor}",
    )


def floor_of(recording: Recording) -> int:
    """The floor that a walk of `mall_walks` belongs to."""
    return int(recording.id.rpartition("-")[2])


def _draw_tour(rng: np.random.Generator, places: Sequence[Place], person: Person, duration_s: float) -> list[Place]:
    """From place to place, some metres apart, until there is more to walk than time."""
    xy_m = np.array([place.xy_m for place in places])
    tour = [int(rng.integers(len(places)))]
    left_m = 1.2 * person.speed_mps * duration_s
    while left_m > 0.0:
        away_m = np.hypot(*(xy_m - xy_m[tour[-1]]).T)
        ahead = np.ones(len(places), dtype=np.bool_)
        if len(tour) > 1 and rng.random() < ONWARD_FRACTION:
            ahead = (xy_m - xy_m[tour[-1]]) @ (xy_m[tour[-1]] - xy_m[tour[-2]]) > 0.0
        near = np.flatnonzero((away_m >= NEXT_M[0]) & (away_m <= NEXT_M[1]) & ahead)
        tour.append(int(rng.choice(near)) if len(near) else int(away_m.argmax()))
        left_m -= float(away_m[tour[-1]])
    return [places[i] for i in tour]
