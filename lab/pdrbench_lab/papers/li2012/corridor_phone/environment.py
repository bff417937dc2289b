"""CorridorPhone-v1: a lap of 92 m round an office corridor, a phone in the hand or in a pocket (Li et al. 2012)."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from typing import TYPE_CHECKING, Final

from pdrbench.recording import Recording
from pdrbench.sensors import sensor_spec
from pdrbench.task import Task
from pdrbench.trajectory import Start
from pdrbench_envs.generated import GeneratedWalks, Split, with_held_out

if TYPE_CHECKING:
    from pdrbench_lab.papers.li2012.corridor_phone.corridor import Laps
    from pdrbench_sim.record import BuildingScene

ENV: Final = "CorridorPhone-v1"
PLACES: Final = ("hand", "pocket")  # each lap is walked with two phones
SPLITS: Final = {"train": Split(2 * 16, people=8), "val": Split(2 * 4, people=4), "test": Split(2 * 20, people=13)}
PERIOD_S: Final = 0.2  # ours, as the recorded walks with a phone have it
RATE_HZ: Final = 50.0
SENSORS: Final = ("accel", "gyro", "mag", "rotation")
CAPACITY: Final = 32  # ten rows each a period
_SCENE, _PERSON, _LAPS, _WALK, _TAP = range(5)  # one stream of random numbers each
_SEED: Final = 20120908  # the last day of UbiComp 2012
WALKS: Final = GeneratedWalks(ENV, _SEED, SPLITS, held_out=Split(8, people=4))
_DESCRIPTION: Final = """\
People of all sizes walk a lap of 92 m round the corridor of an office level, 31 m by 15 m, as in the evaluation of Li
et al. (2012), with one phone in the hand and another in a trouser pocket; each phone is a walk of its own. Laps begin
anywhere and go either way round. Doors are closed. The plan is always the same; the magnetic field and the people
differ between the splits: 8 people and 16 laps to train on, 4 and 4 to choose with, 13 and 20, as in the paper, to be
scored on.

**Handed out** every 0.2 s: accelerometer, gyroscope, magnetometer and rotation vector at 50 Hz. **Given**: the
building, the height of the person, where the phone is carried, and what a user reports who taps on the map and sets
off: the place, with an error of 0.5 m per axis, and for a phone in a pocket which way the corridor leads (one in the
hand points there). **Scored** is the place of the body every 0.5 s, which has covered some 0.7 m since: the paper has
a tag every 0.5 m.

**What is hard**: people's steps differ by a tenth from what their cadence suggests, a compass in a building is off by
15°, and 92 m later only the corners have shown how far one has come. Read `along_path_mean_m`, the error of the paper,
beside `mean_m`: it is blind across the corridor.
"""


def task() -> Task:
    """The environment; no walk is generated before it is loaded."""
    summary = "A phone in the hand or in a pocket, one lap of an office corridor; map, start by a tap"
    person = functools.partial(WALKS.person, each=len(PLACES))
    return phone_task(WALKS, summary, _DESCRIPTION, load, tell_start, person)


def phone_task(
    walks: GeneratedWalks,
    summary: str,
    description: str,
    load: Callable[[str], Recording],
    tell_start: Callable[[Recording], Start],
    person: Callable[[str], str],
) -> Task:
    """An environment of a phone in the corridor, whose start is a tap on the map."""
    return with_held_out(
        Task(
            id=walks.env,
            summary=summary,
            description=description,
            sensors=tuple(dataclasses.replace(sensor_spec(name), rate_hz=RATE_HZ) for name in SENSORS),
            capacity=dict.fromkeys(SENSORS, CAPACITY),
            period_s=PERIOD_S,
            start="area",
            walks=walks.ids(),
            load=load,
            tell_start=tell_start,
            licence="MIT",
            source="generated",
        ),
        walks,
        person=person,
    )


def load(walk: str) -> Recording:
    """A walk by its id; the same one whenever it is asked for."""
    from pdrbench_lab.papers.li2012.corridor_phone.corridor import PHONES, record_laps
    from pdrbench_sim.people.person import draw_person

    split, lap, place = _place_of(walk)
    person = draw_person(WALKS.rng(split, _PERSON, lap % WALKS.split(split).people))
    return record_laps(
        _scene(split), WALKS.numbers(split, _WALK, lap), _laps(split, lap), person, PHONES[place], name=walk
    )


def tell_start(recording: Recording) -> Start:
    """A tap on the corridor, the same for both phones of a lap, and of one in a pocket the heading at first."""
    from pdrbench_lab.papers.li2012.corridor_phone.corridor import start_heading_rad, tapped

    split, lap, place = _place_of(recording.id)
    heading_rad = start_heading_rad(_laps(split, lap), place)
    return tapped(recording.reference.xy_m[0], WALKS.rng(split, _TAP, lap), heading_rad)


def _place_of(walk: str) -> tuple[str, int, str]:
    """Split, number of the lap, where the phone is carried."""
    split, index = WALKS.place_of(walk)
    return split, index // len(PLACES), PLACES[index % len(PLACES)]


def _laps(split: str, lap: int) -> Laps:
    from pdrbench_lab.papers.li2012.corridor_phone.corridor import draw_laps

    return draw_laps(WALKS.rng(split, _LAPS, lap))


@functools.lru_cache(maxsize=4)
def _scene(split: str) -> BuildingScene:
    from pdrbench_lab.papers.li2012.corridor_phone.corridor import make_corridor_scene

    return make_corridor_scene(WALKS.rng(split, _SCENE, 0))
