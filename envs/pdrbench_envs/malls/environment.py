"""The environments: which walks are played, what they are briefed with, and which share of the set is at hand.

Data: Indoor Location Competition 2.0, registered as `ilc20_full`. Splits and surveys: `pdrbench_envs.malls.splits`.
"""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Callable, Mapping
from pathlib import PurePosixPath
from typing import Final

import numpy as np

from pdrbench.building import Building
from pdrbench.datasets import datasets, find, is_available
from pdrbench.errors import DatasetError, unknown_name
from pdrbench.geometry import BoolArray
from pdrbench.io.log import Log
from pdrbench.recording import RadioMap, Recording
from pdrbench.sensors import sensor_spec
from pdrbench.task import SPLITS, Task
from pdrbench.trajectory import Trajectory
from pdrbench_envs.descriptions import describe
from pdrbench_envs.generated import start_place
from pdrbench_envs.malls.splits import TEST, Walk, survey_of, walks
from pdrbench_envs.malls.surveys import DATASET, checked, files, log_of, scans_of
from pdrbench_envs.recorded import opaque_id
from pdrbench_sim.readers import ilc20_map

PERIOD_S: Final = 0.2  # five answers a second: at most 0.3 m of walking between two
SENSORS: Final = ("accel", "gyro", "mag", "rotation", "wifi", "ble")
SAMPLED_CAPACITY: Final = 32  # 100 Hz for 0.2 s makes 20 rows
WIFI_CAPACITY: Final = 1024  # the largest scan delivers 670 rows; a whole scan comes with one observation
BLE_CAPACITY: Final = 64
PLAN_FILES: Final = (ilc20_map.PLAN, ilc20_map.SIZE)
MOUNTING: Final = "hand"  # held flat in front of the body

_ID_KEY: Final = b"pdrbench.malls"
# A walk of 3 s that ends before an answer could follow its first scan: `MallPhoneLost-v2` is without it.
ENDS_BEFORE_A_SCAN: Final = "site1/B1/path_data_files/5dda3331c5b77e0006b17635.txt.xz"


def task() -> Task:
    """Known start: first waypoint and level, heading unknown; every floor."""
    return _make_task(
        "MallPhone-v2",
        summary="Phone walks on 13 floors of two shopping centres, start known, sessions kept apart",
        description=describe("malls", "malls_known"),
        is_lost=False,
    )


def task_lost() -> Task:
    """Unknown start; floors with a radio survey."""
    return _make_task(
        "MallPhoneLost-v2",
        summary="Phone walks on 11 floors of two shopping centres, start unknown, radio survey of other sessions",
        description=describe("malls", "malls_lost"),
        is_lost=True,
    )


def _make_task(name: str, *, summary: str, description: str, is_lost: bool) -> Task:
    at_hand = walks_at_hand()
    offered = {
        name: walk
        for name, walk in played_walks().items()
        if walk.path in at_hand and (not is_lost or _is_surveyed(walk, at_hand))
    }
    is_whole = len(at_hand) == len(walks())
    registered = datasets()[DATASET]
    return Task(
        id=name,
        summary=summary,
        description=description,
        sensors=tuple(sensor_spec(sensor) for sensor in SENSORS),
        capacity=dict.fromkeys(SENSORS, SAMPLED_CAPACITY) | {"wifi": WIFI_CAPACITY, "ble": BLE_CAPACITY},
        period_s=PERIOD_S,
        start="unknown" if is_lost else "pose",
        walks={split: tuple(name for name, of in offered.items() if of.split == split) for split in SPLITS[:3]},
        load=functools.partial(_load, after_first_scan if is_lost else after_start),
        tell_start=start_place,
        radio_map=functools.partial(_radio_map, at_hand),
        licence=registered.licence,
        source=f"{registered.source_url} commit {registered.commit}",
        dataset=DATASET,
        note="" if is_whole else _note(len(at_hand)),
        files_sha256=functools.partial(_files_sha256, frozenset() if is_whole else at_hand),
        units={name: _unit_of(walk) for name, walk in offered.items()},
        unit_kind="outing",
        noise_m=0.3,  # places tapped on a plan
        groups={name: (walk.group,) for name, walk in offered.items() if walk.split == TEST},
        folds={name: walk.part for name, walk in offered.items() if isinstance(walk.part, int)},
    )


def _note(num_walks: int) -> str:
    return (
        f"{num_walks} of the {len(walks())} walks of {DATASET} are at hand: scores are not comparable with published "
        f"tables; `pdrbench data fetch {DATASET}` fetches the others"
    )


def _files_sha256(at_hand: frozenset[str], _walk: str) -> str:
    """Of the names of the walks that are at hand, since they make the surveys; each file is checked when it is read."""
    return hashlib.sha256("\n".join(sorted(at_hand)).encode()).hexdigest() if at_hand else ""


def walks_at_hand() -> frozenset[str]:
    """Paths of the walks that this machine has; all of them where it has none."""
    if not is_available(DATASET):
        return frozenset(walk.path for walk in walks())
    folder = find(DATASET)
    found = frozenset(walk.path for walk in walks() if (folder / walk.path).is_file())
    return found or frozenset(walk.path for walk in walks())


@functools.cache
def played_walks() -> Mapping[str, Walk]:
    """Every walk by id, in the order of play.

    Walks that localizers were developed on are left out of the test split, see `Walk.is_new`.
    """
    found: dict[str, Walk] = {}
    for walk in walks():
        if walk.split != TEST or walk.is_new:
            opaque = opaque_id(walk.path, _ID_KEY)
            found[f"test-{opaque}" if walk.split == TEST else f"{walk.site}-{walk.floor}-{opaque}"] = walk
    return dict(sorted(found.items(), key=lambda item: item[0][-8:]))


def _unit_of(walk: Walk) -> str:
    """Name of its outing."""
    return f"test-{opaque_id(walk.outing, _ID_KEY)}" if walk.split == TEST else walk.outing


def _is_surveyed(walk: Walk, at_hand: frozenset[str]) -> bool:
    """True where the floor of a walk has a survey, and the walk can be scored without a start."""
    return walk.path != ENDS_BEFORE_A_SCAN and (walk.site, walk.floor) in _surveyed_floors(walk.part, at_hand)


@functools.lru_cache(maxsize=16)
def _surveyed_floors(part: str | int, at_hand: frozenset[str]) -> frozenset[tuple[str, str]]:
    return frozenset((walk.site, walk.floor) for walk in survey_of(part) if walk.path in at_hand)


def played_walk(name: str) -> Walk:
    """A walk by its id."""
    if name not in played_walks():
        raise unknown_name("walk of the malls", name, played_walks())
    return played_walks()[name]


def _load(scored: Callable[[Log], BoolArray], walk: str) -> Recording:
    played = played_walk(walk)
    log = log_of(played.path)
    way = log.reference
    return log.recording(
        walk,
        building(played.site),
        sensor_spec,
        reference=Trajectory(t_s=way.t_s, xy_m=way.xy_m, level=way.level, surveyed=scored(log)),
        mounting=MOUNTING,
    )


def after_start(log: Log) -> BoolArray:
    """(T,) True for every waypoint but the first, which is the start."""
    return np.arange(len(log.reference)) > 0


def after_first_scan(log: Log) -> BoolArray:
    """(T,) True from one period after the first WiFi scan: before it no localizer can know anything."""
    if "wifi" not in log.rows:
        return np.zeros(len(log.reference), dtype=np.bool_)
    scored: BoolArray = log.reference.t_s >= log.rows["wifi"][0, 0] + PERIOD_S
    return scored


@functools.lru_cache(maxsize=4)
def building(site: str) -> Building:
    """All levels of a mall that have a plan."""
    plans = [path for path in files() if path.startswith(f"{site}/") and PurePosixPath(path).name in PLAN_FILES]
    for path in plans:
        checked(path)
    floors = sorted({PurePosixPath(path).parts[1] for path in plans})
    return ilc20_map.read_building(find(DATASET) / site, floors)


def _radio_map(at_hand: frozenset[str], recording: Recording) -> RadioMap:
    """The survey of the mall that the walk is given; see `splits.survey_of`."""
    walk = played_walk(recording.id)
    return _survey(walk.site, walk.part, at_hand)


@functools.lru_cache(maxsize=6)  # of some 30 MB each
def _survey(site: str, part: str | int, at_hand: frozenset[str]) -> RadioMap:
    paths = survey_paths(site, part, at_hand)
    return scans_of(paths_of(site, at_hand)).radio_map(paths)


def paths_of(site: str, at_hand: frozenset[str]) -> tuple[str, ...]:
    """The walks of a mall that a survey may hold: those of train."""
    return tuple(walk.path for walk in walks() if (walk.site, walk.split) == (site, "train") and walk.path in at_hand)


def survey_paths(site: str, part: str | int, at_hand: frozenset[str]) -> list[str]:
    """The walks that a survey of a mall is made of; see `splits.survey_of`."""
    paths = [walk.path for walk in survey_of(part) if walk.site == site and walk.path in at_hand]
    if not paths:
        raise DatasetError(f"{site}: no walk of its survey is at hand; run `pdrbench data fetch {DATASET}`")
    return paths
