"""`OfficeStride-v2`: a synthetic office of three levels, strides of one foot, a known start."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Final

import numpy as np

from pdrbench.building import Building
from pdrbench.geometry import FloatArray
from pdrbench.recording import Recording, SensorStream
from pdrbench.sensors.stride import STRIDE, StrideErrors, measure
from pdrbench.task import Task
from pdrbench.trajectory import Trajectory
from pdrbench_envs.generated import GeneratedWalks, Split, start_pose, with_held_out
from pdrbench_sim.units import STRIDE_LAW

if TYPE_CHECKING:
    from pdrbench_sim.people.person import Person
    from pdrbench_sim.people.route import NavigationMesh, Place
    from pdrbench_sim.people.strides import Stances

ENV: Final = "OfficeStride-v2"
PERIOD_S: Final = 0.2
HOLD_S: Final = (
    PERIOD_S + 0.01
)  # of rest after a stride is reported, so that the next observation finds the foot at rest
NUM_LEVELS: Final = 3
AREA_M2: Final = (2400.0, 4200.0)
DURATION_S: Final = (185.0, 295.0)
AFTER_STAIRS_S: Final = 10.0  # a walk goes on for at least that long after its first stairs
_SEED: Final = 20080921  # first day of UbiComp 2008
_BUILDING, _PERSON, _WALK, _ERRORS = range(4)  # one stream of random numbers each


SPLITS: Final = {
    "train": Split(walks=24, buildings=6, people=8),
    "val": Split(walks=10, buildings=5, people=5),
    "test": Split(walks=20, buildings=5, people=10),
}
WALKS: Final = GeneratedWalks(ENV, _SEED, SPLITS, Split(8, buildings=4, people=8))


_DESCRIPTION: Final = """\
A person visits rooms on several levels of an office building for three to five minutes: corridors, doors, stairwells
with real treads, pauses. A foot-mounted unit reports every stride of one foot: length, change of height, change of
heading (W3), with errors that were measured on recordings of the foot: lengths about 2 cm
short, by another amount in every walk, a heading that drifts by a constant turn per stride of a law with heavy tails,
and a third of strides that err three times as much as the others.

Given before the walk: the building, the start with its heading (the heading of the first stride), the height of the
person. A stride is reported while the foot rests, and the foot still rests at the observation that delivers it: that is
when and where the position of the foot is scored. Buildings and people differ between the splits. What is hard: the
drift bends a path by some ten degrees a minute, which the walls and the stairs give away.
"""


@functools.cache
def stride_errors() -> StrideErrors:
    """The law that strides are drawn with, as `pdrbench error-model --law` of the laboratory fitted it."""

    return StrideErrors.read(STRIDE_LAW)


def task() -> Task:
    """The environment; no walk is generated before it is loaded."""
    return with_held_out(
        Task(
            id=ENV,
            summary=(
                "Strides of one foot with measured errors, through synthetic three-level offices; start pose known."
            ),
            description=_DESCRIPTION,
            sensors=(STRIDE,),
            capacity={"stride": 2},
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
    split, index = WALKS.place_of(walk)
    plan = WALKS.split(split)
    building = _building(split, index % plan.buildings)
    person = _person(split, index % plan.people)
    rests = _draw_rests(building, person, WALKS.rng(split, _WALK, index))
    rows, reference = record_strides(building, rests, WALKS.rng(split, _ERRORS, index))
    return stride_recording(walk, building, person, rows, reference)


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


@functools.lru_cache(maxsize=16)
def _building(split: str, number: int) -> Building:
    return draw_office(WALKS, split, _BUILDING, number)


def draw_office(walks: GeneratedWalks, split: str, stream: int, number: int) -> Building:
    """An office of three levels from one stream of random numbers of an environment."""
    from pdrbench_sim.buildings.office import make_office

    rng = walks.rng(split, stream, number)
    name = f"office {walks.number(split)}.{number}"
    return make_office(rng, num_levels=NUM_LEVELS, area_m2=float(rng.uniform(*AREA_M2)), name=name)


def _person(split: str, number: int) -> Person:
    from pdrbench_sim.people.person import draw_person

    return draw_person(WALKS.rng(split, _PERSON, number))


def _draw_rests(building: Building, person: Person, rng: np.random.Generator) -> Stances:
    """Rests of one foot during a walk that uses stairs, cut off after three to five minutes."""
    from pdrbench_sim.people.route import navigation_mesh
    from pdrbench_sim.people.strides import stances
    from pdrbench_sim.people.walker import walk_through

    mesh = navigation_mesh(building)
    until_s = float(rng.uniform(*DURATION_S))
    walk = walk_through(rng, mesh, person, _draw_places(rng, mesh), until_s=until_s)
    left, right = stances(walk, rng)
    rests = left if rng.random() < 0.5 else right
    is_off_ground = np.abs(building.height(rests.polygon) - building.height(rests.polygon[:1])) > 1.0
    first_s = rests.mid_s[is_off_ground][0]
    return rests.until(max(until_s, first_s + AFTER_STAIRS_S))


def _draw_places(rng: np.random.Generator, mesh: NavigationMesh) -> list[Place]:
    """Places to visit: the second or the third is on another level than the first, the others anywhere."""
    from pdrbench_sim.people.walker import draw_place

    levels = rng.integers(NUM_LEVELS, size=16)
    levels[1 + rng.integers(2)] = (levels[0] + 1 + rng.integers(NUM_LEVELS - 1)) % NUM_LEVELS
    return [draw_place(rng, mesh, level=int(level)) for level in levels]


def record_strides(building: Building, rests: Stances, rng: np.random.Generator) -> tuple[FloatArray, Trajectory]:
    """Stride events with errors, and where the foot rests at the observation, every `PERIOD_S`, that delivers each.

    Returns:
        rows: (S - 1, 4) columns of `STRIDE`.
        reference: S rows; the first is the start, given and not scored.
    """
    from pdrbench_sim.people.strides import report_times_s, strides
    from pdrbench_sim.resolution import TIME_STEP_S, in_steps

    true = strides(building, rests)
    reported = in_steps(report_times_s(rests, HOLD_S), TIME_STEP_S)
    rows = measure(np.column_stack([reported[1:], true.length_m, true.height_m, true.turn_rad]), rng, stride_errors())
    observation = np.ceil(reported / PERIOD_S - 1e-9)
    observation[0] = 0
    return rows, Trajectory(
        t_s=observation * PERIOD_S,
        xy_m=rests.xy_m,
        level=building.level(rests.polygon),
        surveyed=np.arange(len(rests)) > 0,
        heading_rad=true.heading_rad,
        z_m=building.height(rests.polygon),
    )
