"""`CampusStride-v1`, `CampusFoot-v1`, `CampusPhone-v1` and `CampusPhoneLost-v1`."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping
from typing import TYPE_CHECKING, Final

import numpy as np

from pdrbench.building import Building
from pdrbench.geometry import FloatArray
from pdrbench.recording import RadioMap, Recording, SensorSpec, SensorStream
from pdrbench.sensors import sensor_spec
from pdrbench.sensors.stride import STRIDE
from pdrbench.task import Task
from pdrbench.trajectory import Trajectory
from pdrbench_envs.campus.walks import CampusWalks
from pdrbench_envs.descriptions import describe
from pdrbench_envs.foot_recordings import tell_start as tell_foot_start
from pdrbench_envs.generated import start_place, start_pose, with_held_out
from pdrbench_sim.units.strides import fitted, measure

if TYPE_CHECKING:
    from pdrbench_sim.people.person import Person
    from pdrbench_sim.people.strides import Stances

STRIDE_PERIOD_S: Final = 0.2
FOOT_PERIOD_S: Final = 0.2  # a stance is longer: third quartiles are those of 20 Hz within 0.4 %, 8 val walks
PHONE_PERIOD_S: Final = 0.2  # as the recorded walks with a phone have it
# Of rest after a stride is reported, so that the next observation finds the foot at rest.
HOLD_S: Final = STRIDE_PERIOD_S + 0.01
FOOT_HZ: Final = 120.0  # of an MTx
PHONE_HZ: Final = 100.0  # nominal: phones of the kind "other phone" deliver 50 or 100 Hz
SAMPLED: Final = frozenset({"accel", "gyro", "mag", "rotation"})
FOOT_SENSORS: Final = ("accel", "gyro", "mag", "baro", "wifi")
PHONE_SENSORS: Final = ("accel", "gyro", "mag", "rotation", "baro", "wifi", "ble")
LEVEL_CHANGE: Final = "level_change"
CAPACITY: Final = {"wifi": 1024, "ble": 64, "baro": 8}  # rows in one observation; 32 of the others

GAITS: Final = ("usual", "gentle", "slow", "cart")  # of those whose foot is looked at
PHONES: Final = ("usual", "gentle", "slow", "pocket", "swing", "ear", "bag", "cart", "other phone")


STRIDES: Final = CampusWalks("CampusStride-v1", GAITS, 0, by_lift=False)
FEET: Final = CampusWalks("CampusFoot-v1", GAITS, 1, by_lift=True, held_out=400)
PEOPLE: Final = CampusWalks("CampusPhone-v1", PHONES, 2, by_lift=True)
LOST: Final = "CampusPhoneLost-v1"

LIFTS: Final = " or by lift where there is one"


# Strides.


def task_stride() -> Task:
    """Strides of one foot; nothing is generated before it is loaded."""
    return _made(
        STRIDES,
        Task(
            id=STRIDES.env,
            summary="Strides of one foot with measured errors, a new building for every walk; start pose known",
            description=describe("campus", "campus_gaits", "campus_strides", lifts=""),
            sensors=(STRIDE,),
            capacity={"stride": 2},
            period_s=STRIDE_PERIOD_S,
            start="pose",
            walks=STRIDES.walks.ids(),
            load=_load_strides,
            tell_start=start_pose,
            licence="MIT",
            source="generated",
        ),
    )


def _load_strides(walk: str) -> Recording:
    """A walk by its id; the same one whenever it is asked for."""
    from pdrbench_sim.people.route import navigation_mesh
    from pdrbench_sim.people.strides import NATURAL_GAIT, stances
    from pdrbench_sim.people.walker import walk_through

    building, bearer, rng = STRIDES.building(walk), STRIDES.bearer(walk), np.random.default_rng(STRIDES.seed(walk))
    mesh, until_s = navigation_mesh(building), STRIDES.duration_s(walk)
    places = STRIDES.places(walk, mesh)
    way_rng, gait_rng, error_rng = rng.spawn(3)
    way = walk_through(way_rng, mesh, bearer.person, places, bearer.walk, until_s=until_s)
    foot = stances(way, gait_rng, NATURAL_GAIT)[int(rng.integers(2))]
    rows, reference = record_strides(building, foot.until(until_s), error_rng)
    return stride_recording(walk, building, bearer.person, rows, reference)


def record_strides(building: Building, rests: Stances, rng: np.random.Generator) -> tuple[FloatArray, Trajectory]:
    """Stride events with errors, and where the foot rests at the observation that delivers each.

    Returns:
        rows: (S - 1, 4) columns of `STRIDE`.
        reference: S rows; the first is the start, given and not scored.
    """
    from pdrbench_sim.people.strides import report_times_s, strides
    from pdrbench_sim.resolution import TIME_STEP_S, in_steps

    true = strides(building, rests)
    reported = in_steps(report_times_s(rests, HOLD_S), TIME_STEP_S)
    rows = measure(np.column_stack([reported[1:], true.length_m, true.height_m, true.turn_rad]), rng, fitted())
    observation = np.ceil(reported / STRIDE_PERIOD_S - 1e-9)
    observation[0] = 0
    return rows, Trajectory(
        t_s=observation * STRIDE_PERIOD_S,
        xy_m=rests.xy_m,
        level=building.level(rests.polygon),
        surveyed=np.arange(len(rests)) > 0,
        heading_rad=true.heading_rad,
        z_m=building.height(rests.polygon),
    )


def stride_recording(
    walk: str, building: Building, person: Person, rows: FloatArray, reference: Trajectory
) -> Recording:
    """Stride events (S - 1, 4) of a person's walk with their reference, in whole steps."""
    from pdrbench_sim.resolution import rounded

    recording = Recording(
        id=walk,
        building=building,
        streams={"stride": SensorStream(STRIDE, rows)},
        reference=reference,
        subject={"height_m": round(person.height_m, 2)},
        device="simulated foot-mounted inertial unit",
        mounting="foot",
    )
    return rounded(recording)


# A unit on the foot.


def task_foot() -> Task:
    """A unit on the foot and WLAN; nothing is generated before it is loaded."""
    specs = _specs(FOOT_SENSORS, FOOT_HZ)
    return _made(
        FEET,
        Task(
            id=FEET.env,
            summary="Raw signals of a unit on the foot and WLAN, a new building for every walk; start pose known",
            description=describe("campus", "campus_gaits", "campus_foot", "campus_survey", lifts=LIFTS),
            sensors=specs,
            capacity=_capacity(specs),
            period_s=FOOT_PERIOD_S,
            start="pose",
            walks=FEET.walks.ids(),
            load=_load_foot,
            tell_start=tell_foot_start,
            radio_map=functools.partial(_survey, FEET),
            licence="MIT",
            source="generated",
        ),
    )


def _load_foot(walk: str) -> Recording:
    from pdrbench_sim.record import ON_FOOT, simulate_walk

    bearer, scene = FEET.bearer(walk), FEET.scene(walk)
    recording = simulate_walk(
        scene,
        FEET.seed(walk),
        dataclasses.replace(ON_FOOT, rate_hz=FOOT_HZ, sensors=FOOT_SENSORS),
        duration_s=FEET.duration_s(walk),
        person=bearer.person,
        places=FEET.places(walk, scene.mesh),
        walk=bearer.walk,
        name=walk,
    )
    return at_observations(recording)


def at_observations(recording: Recording) -> Recording:
    """The same walk with its rests reported at the last observation of each: there the foot still stands."""
    from pdrbench_sim.resolution import rounded_reference

    step = np.floor(recording.reference.t_s / FOOT_PERIOD_S + 1e-9)
    step[0] = 0.0
    is_new = np.diff(step, prepend=-1.0) > 0
    reference = dataclasses.replace(recording.reference.rows(is_new), t_s=step[is_new] * FOOT_PERIOD_S)
    return dataclasses.replace(recording, reference=rounded_reference(reference))


# A phone.


def task_phone() -> Task:
    """A phone, start known; nothing is generated before it is loaded."""
    return _phone_task(PEOPLE.env, "start place known", "campus_known", is_lost=False)


def task_lost() -> Task:
    """The same walks, start unknown."""
    return _phone_task(LOST, "start unknown", "campus_lost", is_lost=True)


def _phone_task(env: str, start: str, about_start: str, *, is_lost: bool) -> Task:
    derived = dataclasses.replace(sensor_spec(LEVEL_CHANGE), derived=True)
    specs = (*_specs(PHONE_SENSORS, PHONE_HZ), derived)
    return _made(
        PEOPLE,
        Task(
            id=env,
            summary=f"A phone of nine kinds of people, a new building for every walk; {start}",
            description=describe("campus", "campus_phone", "campus_survey", about_start, lifts=LIFTS),
            sensors=specs,
            capacity=_capacity(specs),
            period_s=PHONE_PERIOD_S,
            start="unknown" if is_lost else "pose",
            walks=PEOPLE.walks.ids(),
            load=functools.partial(_load_phone, is_lost),
            tell_start=start_place,
            radio_map=functools.partial(_survey, PEOPLE),
            licence="MIT",
            source="generated",
        ),
    )


def _load_phone(is_lost: bool, walk: str) -> Recording:
    from pdrbench_formats.derive import derive
    from pdrbench_sim.resolution import rounded

    recording = _carried(walk)
    start = None if is_lost else start_place(recording)
    derived = derive(recording.streams, recording.mounting, (LEVEL_CHANGE,), start=start, building=recording.building)
    specs = {spec.name: spec for spec in _specs(PHONE_SENSORS, PHONE_HZ)}
    streams = {name: SensorStream(specs.get(name, stream.spec), stream.rows) for name, stream in derived.items()}
    reference = _after_first_scan(recording) if is_lost else recording.reference
    return rounded(dataclasses.replace(recording, streams=streams, reference=reference, device="simulated phone"))


@functools.lru_cache(maxsize=1)  # where the start is known and where it is not, one after the other
def _carried(walk: str) -> Recording:
    from pdrbench_sim.record import IN_HAND, simulate_walk

    bearer, scene = PEOPLE.bearer(walk), PEOPLE.scene(walk)
    profile = bearer.manner.profile
    setup = dataclasses.replace(
        IN_HAND,
        mounting=bearer.mounting,
        rate_hz=profile.rate_hz if profile else PHONE_HZ,
        sensors=PHONE_SENSORS,
        device=PEOPLE.phone(walk),
        manner=bearer.manner,
    )
    return simulate_walk(
        scene,
        PEOPLE.seed(walk),
        setup,
        duration_s=PEOPLE.duration_s(walk),
        person=bearer.person,
        places=PEOPLE.places(walk, scene.mesh),
        walk=bearer.walk,
        name=walk,
    )


def _after_first_scan(recording: Recording) -> Trajectory:
    """The reference, surveyed from one period after the first WLAN scan on."""
    reference, scans_s = recording.reference, recording.streams["wifi"].t_s
    first_s = scans_s[0] + PHONE_PERIOD_S if len(scans_s) else np.inf
    return dataclasses.replace(reference, surveyed=reference.t_s >= first_s)


# What all of them share.


def _made(of: CampusWalks, task: Task) -> Task:
    return with_held_out(task, of.walks, groups=of.groups)


def _survey(of: CampusWalks, recording: Recording) -> RadioMap:
    return _surveyed(of, recording.id)


_surveyed = functools.lru_cache(maxsize=1)(CampusWalks.survey)


def _specs(sensors: tuple[str, ...], rate_hz: float) -> tuple[SensorSpec, ...]:
    """Sensors at the rate of this unit."""
    return tuple(
        dataclasses.replace(sensor_spec(name), rate_hz=rate_hz) if name in SAMPLED else sensor_spec(name)
        for name in sensors
    )


def _capacity(specs: tuple[SensorSpec, ...]) -> Mapping[str, int]:
    return {spec.name: CAPACITY.get(spec.name, 32) for spec in specs}
