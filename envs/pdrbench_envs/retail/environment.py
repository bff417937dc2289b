"""Two environments made of whatever buildings of the set are found; split by building, surveyed by other outings."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from pdrbench.building import Building
from pdrbench.datasets import datasets, find
from pdrbench.errors import DatasetError, unknown_name
from pdrbench.geometry import FloatArray
from pdrbench.recording import RadioMap, Recording
from pdrbench.sensors import sensor_spec
from pdrbench.task import SPLITS, Task
from pdrbench.trajectory import Trajectory
from pdrbench_envs.descriptions import describe
from pdrbench_envs.generated import start_place
from pdrbench_envs.malls.environment import PERIOD_S, SENSORS, after_first_scan, after_start
from pdrbench_envs.recorded import opaque_id
from pdrbench_envs.retail.buildings import BuildingIndex, WalkFacts, index_of, log_of, plan_of, scans_of
from pdrbench_envs.retail.sources import DATASET, sites
from pdrbench_formats.outings import surveyed

MOUNTING: Final = "hand"  # held flat in front of the body, as the app asks for
SAMPLED_CAPACITY: Final = 128  # 400 Hz for 0.2 s makes 80 rows
WIFI_CAPACITY: Final = 1024
BLE_CAPACITY: Final = 64
NOISE_M: Final = 0.3  # places tapped on a plan, as in the malls
TEST_BELOW, VAL_BELOW = 0.5, 0.65  # of the keyed hash of a building
MIN_BUILDINGS: Final = 8  # of the test split; with fewer, outings are the units
DENSITY_M: Final = ((3.0, "survey within 3 m"), (10.0, "survey within 10 m"), (np.inf, "survey beyond 10 m"))
_SAMPLE_M: Final = 1.0  # between places along the legs of a survey
MANY_LEVELS: Final = 5

NO_WALK: Final = "test-none"  # stands for the test walks where none is at hand: loading it says why

_ID_KEY: Final = b"pdrbench.retail"
# A number with which the six buildings that it was written with make three test buildings and one of val, such that
# both environments have test walks; chosen by counts of walks in each building, without scores.
_SPLIT_KEY: Final = b"pdrbench.retail split 16"


@dataclass(frozen=True, slots=True)
class Played:
    """One walk under its id."""

    index: BuildingIndex  # of its building
    walk: WalkFacts
    outing: str  # first walk of its outing
    survey: tuple[str, ...]  # names of the files of its survey, as in `Scans`

    @property
    def site(self) -> str:
        """Name of the building."""
        return self.index.site

    @property
    def surveyed(self) -> list[WalkFacts]:
        """Walks of the survey on the level of this one that have scans."""
        kept = set(self.survey)
        level = self.walk.level
        walks = (walk for walk in self.index.walks if self.index.path(walk) in kept)
        return [walk for walk in walks if walk.num_scans and walk.level == level]


def task() -> Task:
    """Known start: first waypoint and level, heading unknown."""
    return _make_task("RetailPhone-v1", "start known", describe("retail", "retail_known"), is_lost=False)


def task_lost() -> Task:
    """Unknown start; levels with a radio survey."""
    return _make_task("RetailPhoneLost-v1", "start unknown", describe("retail", "retail_lost"), is_lost=True)


def _make_task(name: str, what: str, description: str, *, is_lost: bool) -> Task:
    played = {walk: one for walk, one in played_walks().items() if not is_lost or _can_be_found(one)}
    walks = {split: tuple(walk for walk, one in played.items() if split_of(one.site) == split) for split in SPLITS[:3]}
    num_walks, num_sites = len(walks["test"]), len({played[walk].site for walk in walks["test"]})
    walks["test"] = walks["test"] or (NO_WALK,)
    is_by_building = num_sites >= MIN_BUILDINGS
    registered = datasets()[DATASET]
    return Task(
        id=name,
        summary=f"Phone walks in shopping centres that users bring, {what}, split by building",
        description=description,
        sensors=tuple(sensor_spec(sensor) for sensor in SENSORS),
        capacity=dict.fromkeys(SENSORS, SAMPLED_CAPACITY) | {"wifi": WIFI_CAPACITY, "ble": BLE_CAPACITY},
        period_s=PERIOD_S,
        start="unknown" if is_lost else "pose",
        walks=walks,
        load=functools.partial(_load, is_lost),
        tell_start=start_place,
        radio_map=_radio_map,
        licence=registered.licence,
        source=registered.source_url,
        dataset=DATASET,
        note=f"{num_walks} test walks in {num_sites} buildings are at hand: scores hold for these",
        files_sha256=_files_sha256,
        units={NO_WALK: NO_WALK}
        | {walk: one.site if is_by_building else _unit(walk, one) for walk, one in played.items()},
        unit_kind="building" if is_by_building else "outing",
        noise_m=NOISE_M,
        groups={walk: _groups(played[walk]) for walk in walks["test"] if walk != NO_WALK},
    )


def split_of(site: str) -> str:
    """The split of a building, whatever other buildings there are."""
    digest = hashlib.blake2b(site.encode(), digest_size=8, key=_SPLIT_KEY).digest()
    fraction = int.from_bytes(digest) / 2**64
    return "test" if fraction < TEST_BELOW else "val" if fraction < VAL_BELOW else "train"


def played_walks() -> Mapping[str, Played]:
    """Every walk by id, in the order of play."""
    return _played_walks(tuple(index_of(site) for site in sites()))


@functools.lru_cache(maxsize=2)
def _played_walks(indexes: tuple[BuildingIndex, ...]) -> Mapping[str, Played]:
    found = {}
    for index in indexes:
        for played in _of_building(index):
            path = index.path(played.walk)
            is_test = split_of(index.site) == "test"
            opaque = opaque_id(path, _ID_KEY)
            found[f"test-{opaque}" if is_test else f"{index.site}-{played.walk.floor}-{opaque}"] = played
    return dict(sorted(found.items(), key=lambda item: item[0][-8:]))


def _of_building(index: BuildingIndex) -> list[Played]:
    return [
        Played(index, walk, index.path(outing[0]), tuple(sorted(map(index.path, survey))))
        for outing, survey in surveyed(index.walks)
        for walk in outing
    ]


def _unit(walk: str, played: Played) -> str:
    unit = opaque_id(played.outing, _ID_KEY)
    return f"test-{unit}" if walk.startswith("test-") else f"{played.site}-{unit}"


def _can_be_found(played: Played) -> bool:
    first_s = played.walk.first_scan_s
    return first_s is not None and played.walk.places[-1][0] >= first_s + PERIOD_S and bool(played.surveyed)


def _groups(played: Played) -> tuple[str, ...]:
    """Strata: building, phone, number of levels, density of the survey, and whether there is a plan."""
    levels = {walk.level for walk in played.index.walks}
    return (
        f"building {played.site}",
        f"phone {played.walk.device or 'not named'}",
        f"{MANY_LEVELS} levels or more" if len(levels) >= MANY_LEVELS else f"fewer than {MANY_LEVELS} levels",
        density(played),
        "with a plan" if _plan_of(played) is not None else "without a plan",
    )


def density(played: Played) -> str:
    """How far the waypoints of a walk are from its survey on their level, in the median."""
    from scipy.spatial import KDTree

    lines = [_along(walk.places) for walk in played.surveyed]
    if not lines:
        return "level not surveyed"
    away_m = float(np.median(KDTree(np.vstack(lines)).query(np.array(played.walk.places)[:, 1:])[0]))
    return next(name for below_m, name in DENSITY_M if away_m <= below_m)


def _along(places: Sequence[tuple[float, float, float]]) -> FloatArray:
    """(N, 2) places along the legs between waypoints."""
    xy_m = np.array(places)[:, 1:]
    gone_m = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(xy_m, axis=0), axis=1)))
    at_m = np.linspace(0.0, gone_m[-1], max(2, int(gone_m[-1] / _SAMPLE_M)))
    return np.column_stack([np.interp(at_m, gone_m, xy_m[:, axis]) for axis in (0, 1)])


def _plan_of(played: Played) -> Building | None:
    """The plan of a building, where the level of a walk is drawn."""
    plan, _ = plan_of(played.site)
    return plan if plan is not None and played.walk.level in plan.levels else None


def played_walk(walk: str) -> Played:
    """A walk by its id.

    Raises:
        DatasetError: No copy of the set is found, or none of its buildings is of the test split.
    """
    if walk == NO_WALK:
        found = find(DATASET)
        raise DatasetError(
            f"{found}: none of the {len(sites())} buildings at hand is of the split; add other buildings"
        )
    if walk not in played_walks():
        raise unknown_name(f"walk of {DATASET}", walk, played_walks())
    return played_walks()[walk]


def _load(is_lost: bool, walk: str) -> Recording:
    played = played_walk(walk)
    member = sites()[played.site].walks[played.walk.floor, played.walk.name]
    log = log_of(member, played.walk.floor)
    way = log.reference
    scored = after_first_scan(log) if is_lost else after_start(log)
    return log.recording(
        walk,
        _plan_of(played),
        sensor_spec,
        reference=Trajectory(t_s=way.t_s, xy_m=way.xy_m, level=way.level, surveyed=scored),
        mounting=MOUNTING,
    )


def _radio_map(recording: Recording) -> RadioMap | None:
    """The scans of the walks of its survey; None where they have none."""
    played = played_walk(recording.id)
    return _survey(played.site, played.index.digest, played.survey)


@functools.lru_cache(maxsize=6)
def _survey(site: str, _digest: str, paths: tuple[str, ...]) -> RadioMap | None:
    scans = scans_of(site)
    return scans.radio_map(paths) if len(scans.scan_xy_m(paths)) else None


def _files_sha256(walk: str) -> str:
    """Of the facts of its building, since they make the surveys."""
    return played_walk(walk).index.digest
