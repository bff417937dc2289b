"""BuildingSite-v1 and BuildingSiteDrift-v1: the position that an inertial system reports, on one floor."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Final

import numpy as np

from pdrbench.building import Building
from pdrbench.geometry import wrap_rad
from pdrbench.recording import Recording, SensorStream
from pdrbench.sensors.position import POSITION
from pdrbench.task import Task
from pdrbench.trajectory import Trajectory
from pdrbench_envs.generated import GeneratedWalks, Split, start_pose, with_held_out
from pdrbench_lab.papers.koeping2012.positions import Reading, measure

if TYPE_CHECKING:
    from pdrbench_sim.people.person import Person
    from pdrbench_sim.people.walk import BodyPath

IID: Final = "BuildingSite-v1"
DRIFT: Final = "BuildingSiteDrift-v1"
UPDATE_S: Final = 1.0  # K6
DURATION_S: Final = 180.0
_BUILDING, _PERSON, _WALK, _ERRORS = range(4)  # one stream of random numbers each
_BODY_HZ: Final = 10.0
SPLITS: Final = {"train": Split(8), "val": Split(4), "test": Split(20)}
_SEED: Final = 20120531  # received May 2012
_READINGS: Final[dict[str, Reading]] = {IID: "iid", DRIFT: "drift"}

_DESCRIPTION: Final = """\
A person visits rooms on one floor of about 16 m x 30 m for three minutes: a corridor, doors, pauses, as a person who
takes photos of a building under construction (Köping et al. 2012, K7). The geometry of the paper's floor is shown in a
figure only; here every walk has a floor of the same size, and a person, of its own.

**Handed out** every second: the position that an inertial system believes in (`position`), in the frame of the
building. **Given**: the building; not where the walk begins (K2). **Scored** is the place of the body at every second.
"""
_ABOUT: Final[dict[Reading, str]] = {
    "iid": """
**What is hard**: the error has a variance that grows evenly with time, 0.3 m per axis at first and 1.9 m after three
minutes, and is drawn anew every second: the literal reading of the paper's simulated sensor (K5). Walls and walking
speed have to take the noise out.
""",
    "drift": """
**What is hard**: the same variance as in `BuildingSite-v1`, 0.3 m per axis at first and 1.9 m after three minutes, but
the error is an offset that walks at random, as that of inertial systems does (K5). The shape of the path is nearly
right and its place is not: no mean over time takes that out, walls and doors do. The walks are those of
`BuildingSite-v1`.
""",
}


def task() -> Task:
    """Errors drawn anew every second; no walk is generated before it is loaded."""
    return _make_task(IID, "Positions of an inertial system with white errors of growing variance, 480 m²")


def task_drift() -> Task:
    """Errors that are an offset walking at random."""
    return _make_task(DRIFT, "Positions of an inertial system whose offset walks at random, 480 m²")


def _make_task(env: str, summary: str) -> Task:
    return with_held_out(
        Task(
            id=env,
            summary=f"{summary}; start unknown.",
            description=_DESCRIPTION + _ABOUT[_READINGS[env]],
            sensors=(POSITION,),
            capacity={"position": 2},
            period_s=UPDATE_S,
            start="unknown",
            walks=_walks(env).ids(),
            load=functools.partial(load, env),
            tell_start=start_pose,
            licence="MIT",
            source="generated",
        ),
        _walks(IID),
    )


def load(env: str, walk: str) -> Recording:
    """A walk of an environment by its id; the same one whenever it is asked for."""
    from pdrbench_sim.resolution import rounded

    split, index = _walks(env).place_of(walk)
    building, person, body = _walk(split, index)
    row = np.rint(np.arange(0.0, DURATION_S + UPDATE_S / 2, UPDATE_S) * _BODY_HZ).astype(np.int64)
    reference = Trajectory(
        t_s=row / _BODY_HZ,
        xy_m=body.xy_m[row],
        level=building.level(body.polygon[row]),
        surveyed=np.ones(len(row), dtype=np.bool_),
        heading_rad=wrap_rad(body.heading_rad[row]),
        z_m=body.z_m[row],
    )
    rows = measure(reference.t_s, reference.xy_m, _walks(env).rng(split, _ERRORS, index), _READINGS[env])
    recording = Recording(
        id=walk,
        building=building,
        streams={"position": SensorStream(POSITION, rows)},
        reference=reference,
        subject={"height_m": round(person.height_m, 2)},
        device="simulated inertial navigation system",
        mounting="body",
    )
    return rounded(recording)


@functools.cache
def _walks(env: str) -> GeneratedWalks:
    return GeneratedWalks(env, _SEED, SPLITS)


@functools.lru_cache(maxsize=8)
def _walk(split: str, index: int) -> tuple[Building, Person, BodyPath]:
    """The floor, who walks there, and the body until after the end of the recording."""
    from pdrbench_lab.papers.koeping2012.building_site.site import draw_visits, make_site
    from pdrbench_sim.people.person import draw_person
    from pdrbench_sim.people.route import navigation_mesh
    from pdrbench_sim.people.walk import body_path
    from pdrbench_sim.people.walker import walk_through

    walks = _walks(IID)
    name = f"site {walks.number(split)}.{index}"
    building = make_site(walks.rng(split, _BUILDING, index), name=name)
    person = draw_person(walks.rng(split, _PERSON, index))
    mesh, rng = navigation_mesh(building), walks.rng(split, _WALK, index)
    walk = walk_through(rng, mesh, person, draw_visits(rng, mesh), until_s=DURATION_S)
    return building, person, body_path(walk, _BODY_HZ)
