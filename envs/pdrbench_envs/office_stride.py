"""OfficeStride-v0: a synthetic office of three levels, strides of one foot, a known start."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from pdrbench.building import Building
from pdrbench.geometry import FloatArray
from pdrbench.recording import Recording, SensorStream
from pdrbench.sensors.stride import STRIDE, measure
from pdrbench.task import HELD_OUT, Task
from pdrbench.trajectory import Start, Trajectory
from pdrbench_envs.generated import HELD_OUT_NUMBER, WalkTable, entropy_of, kind_of, with_held_out

if TYPE_CHECKING:
    from pdrbench_sim.people.person import Person
    from pdrbench_sim.people.route import NavigationMesh, Place
    from pdrbench_sim.people.strides import Stances

ENV: Final = "OfficeStride-v0"
PERIOD_S: Final = 0.2
HOLD_S: Final = PERIOD_S + 0.01  # of rest after a stride is told, so that the next observation finds the foot at rest
NUM_LEVELS: Final = 3
AREA_M2: Final = (2400.0, 4200.0)
DURATION_S: Final = (185.0, 295.0)
AFTER_STAIRS_S: Final = 10.0  # a walk goes on for at least that long after its first stairs
_SEED: Final = 20080921  # first day of UbiComp 2008
_BUILDING, _PERSON, _WALK, _ERRORS = range(4)  # one stream of random numbers each


class _Split(NamedTuple):
    """How many walks a split has, in how many buildings, by how many people; none of them shared with another split."""

    number: int
    walks: int
    buildings: int
    people: int


SPLITS: Final = {
    "train": _Split(0, walks=24, buildings=6, people=8),
    "val": _Split(1, walks=10, buildings=5, people=5),
    "test": _Split(2, walks=20, buildings=5, people=10),
}
_PLANS: Final = {**SPLITS, HELD_OUT: _Split(HELD_OUT_NUMBER, walks=8, buildings=4, people=8)}
WALKS: Final = WalkTable(ENV, {name: split.walks for name, split in SPLITS.items()})


_DESCRIPTION: Final = """\
A person visits rooms on several levels of an office building for three to five minutes: corridors, doors, stairwells
with real treads, pauses. A foot-mounted unit reports every stride of one foot: length, change of height, change of
course (W3), with the errors measured against motion capture (sources.md, note 1): lengths 1.9 % short and
2.7 cm noisy, heights 2.6 cm noisy, and a heading that drifts by a constant turn per stride, different for every walk.

Told before the walk: the building, the start with its heading (the course of the first stride), the height of the
person. A stride is told while the foot rests, and the foot still rests at the observation that delivers it: that is
when and where the position of the foot is scored. Buildings and people differ between the splits. What is hard: the
drift bends a path by some ten degrees a minute, which the walls and the stairs give away.
"""


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
            walks={split: WALKS.ids(split) for split in SPLITS},
            load=load,
            tell_start=tell_start,
            licence="MIT",
            source="generated",
        )
    )


def load(walk: str) -> Recording:
    """A walk by its id; the same one whenever it is asked for."""
    split, index = WALKS.place_of(walk)
    plan = _PLANS[kind_of(split)]
    building = _building(split, index % plan.buildings)
    person = _person(split, index % plan.people)
    rests = _draw_rests(building, person, _rng(split, _WALK, index))
    rows, reference = record_strides(building, rests, _rng(split, _ERRORS, index))
    return Recording(
        id=walk,
        building=building,
        streams={"stride": SensorStream(STRIDE, rows)},
        reference=reference,
        subject={"height_m": round(person.height_m, 2)},
        device="simulated foot-mounted inertial unit",
        mounting="foot",
    )


def tell_start(recording: Recording) -> Start:
    """The first row of the reference: where the foot stands, and the course of its first stride."""
    reference = recording.reference
    assert reference.heading_rad is not None
    return Start(xy_m=reference.xy_m[0], level=int(reference.level[0]), heading_rad=float(reference.heading_rad[0]))


def _rng(split: str, stream: int, index: int) -> np.random.Generator:
    return np.random.default_rng([_SEED, _PLANS[kind_of(split)].number, stream, index, *entropy_of(split)])


@functools.lru_cache(maxsize=16)
def _building(split: str, number: int) -> Building:
    from pdrbench_sim.buildings.office import make_office

    rng = _rng(split, _BUILDING, number)
    name = f"office {_PLANS[kind_of(split)].number}.{number}"
    return make_office(rng, num_levels=NUM_LEVELS, area_m2=float(rng.uniform(*AREA_M2)), name=name)


def _person(split: str, number: int) -> Person:
    from pdrbench_sim.people.person import draw_person

    return draw_person(_rng(split, _PERSON, number))


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
        reference: S rows; the first is the start, told and not scored.
    """
    from pdrbench_sim.people.strides import report_times_s, strides

    true = strides(building, rests)
    reported = report_times_s(rests, HOLD_S)
    rows = measure(np.column_stack([reported[1:], true.length_m, true.height_m, true.turn_rad]), rng)
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
