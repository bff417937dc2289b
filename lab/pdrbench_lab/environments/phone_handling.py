"""PhoneHandling-v1: people stand still and call, type or play with a phone (Li et al. 2012, TC1)."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Final

from pdrbench.recording import Recording
from pdrbench.task import Task
from pdrbench.trajectory import Start
from pdrbench_envs.generated import GeneratedWalks, Split
from pdrbench_lab.papers.li2012.corridor_phone.environment import RATE_HZ, phone_task

if TYPE_CHECKING:
    from pdrbench_sim.record import BuildingScene

ENV: Final = "PhoneHandling-v1"
SPLITS: Final = {"train": Split(4), "val": Split(4), "test": Split(8)}  # people; L7 has eight
DURATION_S: Final = 180.0  # ours
_SEED: Final = 20120909
_SCENE, _PLACE, _HANDS, _TAP = range(4)  # one stream of random numbers each
WALKS: Final = GeneratedWalks(ENV, _SEED, SPLITS)
_DESCRIPTION: Final = """\
Eight people stand in the corridor of an office for three minutes and handle their phones, as in the first test case of
Li et al. (2012): they make calls, type, play games, turn the phone about, and take not a single step.

**Handed out** every 0.2 s: accelerometer, gyroscope, magnetometer and rotation vector at 50 Hz. **Given**: the
building, and where they stand, as a tap on the map that is off by 0.5 m per axis. **Scored** is the place, every
second: no answer but by chance errs less than the tap itself, and every step made up leads away from it by 0.7 m.

**What is hard**: games go on for seconds in a rhythm like that of steps.
"""


def task() -> Task:
    """The environment; nothing is generated before it is loaded."""
    summary = "A phone is handled by people who stand still; every step found is a false one"
    return phone_task(WALKS, summary, _DESCRIPTION, load, tell_start, WALKS.person)


def load(walk: str) -> Recording:
    """Three minutes by their id; the same ones whenever they are asked for."""
    from pdrbench_lab.papers.li2012.corridor_phone.corridor import CORRIDOR
    from pdrbench_lab.papers.li2012.handling import record_handling
    from pdrbench_lab.papers.ring_floor import corridor_polygon
    from pdrbench_sim.people.route import Place

    split, index = WALKS.place_of(walk)
    scene = _scene(split)
    along_m = WALKS.rng(split, _PLACE, index).uniform(0.0, CORRIDOR.lap_m, 1)
    place = Place(int(corridor_polygon(scene.building, 1)[0]), CORRIDOR.xy_m(along_m)[0])
    seed = WALKS.numbers(split, _HANDS, index)
    return record_handling(scene, seed, place, duration_s=DURATION_S, rate_hz=RATE_HZ, name=walk)


def tell_start(recording: Recording) -> Start:
    """A tap on the corridor; the direction of view is not given."""
    from pdrbench_lab.papers.li2012.corridor_phone.corridor import tapped

    split, index = WALKS.place_of(recording.id)
    return tapped(recording.reference.xy_m[0], WALKS.rng(split, _TAP, index))


@functools.lru_cache(maxsize=4)
def _scene(split: str) -> BuildingScene:
    from pdrbench_lab.papers.li2012.corridor_phone.corridor import make_corridor_scene

    return make_corridor_scene(WALKS.rng(split, _SCENE, 0))
