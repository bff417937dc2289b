"""Recorded phone walks through two shopping centres: `MallPhone-v0` (known start), `MallPhoneLost-v0` (unknown start).

Data: Indoor Location Competition 2.0, registered as `ilc20`. Where the folder found holds other walks with a manifest
of the same form, the environments are made of those, and say so in `Task.note`.
"""

from __future__ import annotations

import dataclasses
import functools
import hashlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Final

import msgspec
import numpy as np

from pdrbench.building import Building
from pdrbench.datasets import datasets, find, is_available
from pdrbench.errors import DatasetError
from pdrbench.geometry import BoolArray, FloatArray, IntArray
from pdrbench.io.log import Log
from pdrbench.radio import survey_of_readings
from pdrbench.recording import RadioMap, Recording
from pdrbench.sensors import sensor_spec
from pdrbench.task import Task, registered_files
from pdrbench.trajectory import Trajectory
from pdrbench_envs.generated import start_place
from pdrbench_envs.recorded import checked_file, opaque_id
from pdrbench_sim.readers import ilc20, ilc20_map

DATASET: Final = "ilc20"
MANIFEST: Final = "manifest.json"
PLAN_FILES: Final = (ilc20_map.PLAN, ilc20_map.SIZE)
PERIOD_S: Final = 0.2  # five answers a second: at most 0.3 m of walking between two
SENSORS: Final = ("accel", "gyro", "mag", "rotation", "wifi", "ble")
SAMPLED_CAPACITY: Final = 32  # 100 Hz for 0.2 s makes 20 rows
WIFI_CAPACITY: Final = 1024  # the largest scan delivers 670 rows; a whole scan comes with one observation
BLE_CAPACITY: Final = 64
SURVEY_ROLES: Final = ("train", "radiomap")
VAL_FRACTION: Final = 0.2
MOUNTING: Final = "hand"  # held flat in front of the body
_ID_KEY: Final = b"pdrbench.mall_phone"
_REMEDY: Final = f"take PDRBENCH_DATA away and run `pdrbench data fetch {DATASET}`"
_NOTE: Final = "data differs from the registered ilc20: scores are not comparable with published tables"


_DESCRIPTION: Final = """\
Two shopping centres with three levels each, walked by surveyors who held one model of phone (OPPO PBCM10, Android 8.1)
flat in front of the body and marked surveyed places about every six metres. Walks last from 3 s to 98 s and
never change level. The briefing carries the floor plan (outline and shops; doors and inner walls are not drawn; every
level has an origin of its own) and, where the site was surveyed, a radio map: the WiFi scans of other walks, placed by
interpolating between waypoints. Walks of `train` and `val` are part of that survey, so theirs lacks the scans of their
own recording session. Walks of `test` get the whole: many of its walks were recorded minutes before or after them,
which flatters any method that matches scans, compared with `val`.

**Handed out** every 0.2 s: accelerometer, gyroscope, magnetometer and rotation vector at 50 Hz, WiFi scans about every
2.2 s of which half the rows repeat older sightings (`age_s`), and Bluetooth beacons.

**What is hard**: the heading from the rotation vector is off by a constant of each walk and wanders on top of it;
scans are late and sparse; the plan leaves wide open space.

**Superseded** by `-v1`: here every test walk shares its hour, and often its recording session, with walks of the
survey, so that figures of radio methods measure how densely the survey was sampled.

**Splits**: `test` are the walks marked for evaluation, under opaque ids in shuffled order. `train` and `val` share the
training walks, parted by recording session. Only surveyed waypoints are scored.
"""
_KNOWN: Final = """
**Start**: place and level of the first waypoint are given, the heading is not; the first waypoint is not scored.
Walks on all floors; one floor of each site has a radio survey, so that a method that only matches scans answers that
floor on every other.
"""
_LOST: Final = """
**Start**: nothing is given, and only walks on floors with a radio survey are played. Waypoints earlier than one period
after the first WiFi scan are not scored: nothing can be known before.
"""


class _File(msgspec.Struct, frozen=True):
    """One walk of the set, as a manifest has it; its other fields are ignored."""

    path: str  # relative to the folder of the set
    sha256: str = msgspec.field(name="gz_sha256")
    role: str  # "train", "radiomap", "eval" or "edge"
    site: str  # name of its folder, as of the next
    floor: str
    session: str = msgspec.field(name="recording_session")  # walks of one were recorded without a break

    @property
    def opaque(self) -> str:
        """Its opaque id, which also gives the order of play."""
        return opaque_id(self.path, _ID_KEY)


@dataclass(frozen=True, slots=True)
class _Mall:
    """The walks of the set that this machine has, or of the registered one where it has none."""

    files: tuple[_File, ...]  # every walk, sorted by path
    plans: tuple[tuple[str, str], ...]  # path and sha256 of every file of a floor plan, sorted by path
    note: str = ""

    @property
    def surveyed_floors(self) -> frozenset[tuple[str, str]]:
        """Site and floor wherever there is material for a radio map."""
        return frozenset((file.site, file.floor) for file in self.files if file.role in SURVEY_ROLES)

    def floors(self, site: str) -> tuple[str, ...]:
        """Names of the floors of a site with recorded walks."""
        return tuple(sorted({file.floor for file in self.files if file.site == site}))


def task() -> Task:
    """Known start: first waypoint and level, heading unknown; every floor."""
    return _make_task(
        "MallPhone-v0",
        summary="Phone walks through two shopping centres, start known",
        description=_DESCRIPTION + _KNOWN,
        is_lost=False,
    )


def task_lost() -> Task:
    """Unknown start; floors with a radio survey."""
    return _make_task(
        "MallPhoneLost-v0",
        summary="Phone walks through two shopping centres, start unknown, radio survey known",
        description=_DESCRIPTION + _LOST,
        is_lost=True,
    )


def _make_task(name: str, *, summary: str, description: str, is_lost: bool) -> Task:
    mall = _mall()
    offered = [file for file in mall.files if not is_lost or (file.site, file.floor) in mall.surveyed_floors]
    splits = _splits(offered)
    files = {walk: file for split in splits.values() for walk, file in split.items()}
    registered = datasets()[DATASET]
    return Task(
        id=name,
        summary=summary,
        description=description,
        sensors=tuple(sensor_spec(sensor) for sensor in SENSORS),
        capacity=dict.fromkeys(SENSORS, SAMPLED_CAPACITY) | {"wifi": WIFI_CAPACITY, "ble": BLE_CAPACITY},
        period_s=PERIOD_S,
        start="unknown" if is_lost else "pose",
        walks={split: tuple(walks) for split, walks in splits.items()},
        load=functools.partial(_load, mall, files, after_first_scan if is_lost else after_start),
        tell_start=start_place,
        radio_map=functools.partial(_radio_map, mall, files),
        licence=registered.licence,
        source=f"{registered.source_url} commit {registered.commit}",
        files_sha256=(lambda _walk: _digest(name, mall)) if mall.note else registered_files,
        dataset=DATASET,
        note=mall.note,
        units={walk: file.session for walk, file in files.items()},
        unit_kind="session",
    )


def _mall() -> _Mall:
    """What the folder of the set holds, read from its manifest; the registered walks where it has no other."""
    registered = _mall_of_table()
    if not is_available(DATASET):
        return registered
    path = find(DATASET) / MANIFEST
    if not path.is_file():
        return registered
    found = _mall_of_manifest(path)
    return registered if found == registered else dataclasses.replace(found, note=_NOTE)


def _mall_of_table() -> _Mall:
    rows = datasets()[DATASET].files
    walks = [
        _File(
            path=row.path,
            sha256=row.sha256,
            role=row.role,
            site=str(row.facts["site"]),
            floor=str(row.facts["floor"]),
            session=str(row.facts["recording_session"]),
        )
        for row in rows
        if "recording_session" in row.facts
    ]
    plans = [(row.path, row.sha256) for row in rows if PurePosixPath(row.path).name in PLAN_FILES]
    return _Mall(_by_path(walks), tuple(sorted(plans)))


class _ManifestPlan(msgspec.Struct):
    """One file of a floor plan in a manifest."""

    path: str
    sha256: str


class _Manifest(msgspec.Struct):
    files: list[_File]
    maps: list[_ManifestPlan]


def _mall_of_manifest(path: Path) -> _Mall:
    try:
        manifest = msgspec.json.decode(path.read_bytes(), type=_Manifest)
    except (OSError, msgspec.DecodeError, UnicodeDecodeError) as error:
        raise DatasetError(f"{path}: {error}; mend the manifest, or remove it to use the registered walks") from error
    for named in (*(row.path for row in manifest.files), *(plan.path for plan in manifest.maps)):
        place = PurePosixPath(named)
        if place.is_absolute() or ".." in place.parts:
            raise DatasetError(f"{path}: the path {named!r} leaves the folder of the set; mend the manifest")
    plans = [(row.path, row.sha256) for row in manifest.maps if PurePosixPath(row.path).name in PLAN_FILES]
    return _Mall(_by_path(manifest.files), tuple(sorted(plans)))


def _by_path(walks: Iterable[_File]) -> tuple[_File, ...]:
    return tuple(sorted(walks, key=lambda file: file.path))


def _splits(files: Iterable[_File]) -> dict[str, dict[str, _File]]:
    """Walk by id and split, in the order of play."""
    train = [file for file in files if file.role == "train"]
    val = _val_sessions(train)
    splits: dict[str, dict[str, _File]] = {"train": {}, "val": {}, "test": {}}
    for file in sorted(files, key=lambda file: file.opaque):
        if file.role == "eval":
            splits["test"][f"test-{file.opaque}"] = file
        elif file.role == "train":
            split = "val" if file.session in val else "train"
            splits[split][f"{file.site}-{file.floor}-{file.opaque}"] = file
    return splits


def _val_sessions(train: list[_File]) -> frozenset[str]:
    """Of each site the sessions, in an order that no walk chooses, until they hold a fifth of its walks."""
    chosen: set[str] = set()
    for site in sorted({file.site for file in train}):
        here = [file for file in train if file.site == site]
        sessions = sorted({file.session for file in here}, key=_shuffle_key)
        taken = 0
        while taken < VAL_FRACTION * len(here):
            session = sessions.pop(0)
            chosen.add(session)
            taken += sum(file.session == session for file in here)
    return frozenset(chosen)


def _shuffle_key(name: str) -> bytes:
    return hashlib.blake2b(name.encode(), digest_size=8, key=_ID_KEY).digest()


def _digest(name: str, mall: _Mall) -> str:
    """Of everything that walks and radio maps are made from where they are not those registered."""
    walks = [(file.path, file.sha256, file.role, file.session) for file in mall.files]
    return hashlib.sha256(msgspec.json.encode((name, walks, mall.plans))).hexdigest()


def _load(mall: _Mall, files: Mapping[str, _File], scored: Callable[[Log], BoolArray], walk: str) -> Recording:
    file = files[walk]
    log = _log(file)
    way = log.reference
    return log.recording(
        walk,
        _building(mall, file.site),
        sensor_spec,
        reference=Trajectory(t_s=way.t_s, xy_m=way.xy_m, level=way.level, surveyed=scored(log)),
        mounting=MOUNTING,
    )


@functools.lru_cache(maxsize=512)
def _log(file: _File) -> Log:
    """Reads a walk once it is known to be the one that is registered."""
    return ilc20.read(_checked(file.path, file.sha256), floor=file.floor)


@functools.lru_cache(maxsize=16)
def _building(mall: _Mall, site: str) -> Building:
    """All floors of a site with recorded walks."""
    floors = mall.floors(site)
    for path, sha256 in mall.plans:
        if PurePosixPath(path).parts[:-1] in [(site, floor) for floor in floors]:
            _checked(path, sha256)
    return ilc20_map.read_building(find(DATASET) / site, floors)


def _checked(path: str, sha256: str) -> Path:
    return checked_file(find(DATASET) / path, sha256, DATASET, _REMEDY)


def after_start(log: Log) -> BoolArray:
    """(T,) True for every waypoint but the first, which is the start."""
    return np.arange(len(log.reference)) > 0


def after_first_scan(log: Log) -> BoolArray:
    """(T,) True from one period after the first WiFi scan: before it no localizer can know anything."""
    if "wifi" not in log.rows:
        return np.zeros(len(log.reference), dtype=np.bool_)
    scored: BoolArray = log.reference.t_s >= log.rows["wifi"][0, 0] + PERIOD_S
    return scored


def _radio_map(mall: _Mall, files: Mapping[str, _File], recording: Recording) -> RadioMap | None:
    """The survey of the site; None where there is none.

    Walks that are part of the survey themselves are briefed without the scans of their recording session. Walks of the
    test split are no part of it and get the whole survey, one and the same for all of a site: scans left out for one
    of them would reveal where it was walked.
    """
    file = files[recording.id]
    if all(site != file.site for site, _ in mall.surveyed_floors):
        return None
    return _survey_without(mall, file.site, file.session if file.role in SURVEY_ROLES else None)


@dataclass(frozen=True, slots=True)
class _SurveyWalk:
    """The scans of one walk between its first and its last waypoint."""

    session: str  # of the walk
    xy_m: FloatArray  # (S, 2) interpolated between waypoints at the time of delivery
    level: IntArray  # (S,)
    count: IntArray  # (S,) readings of each scan
    readings: FloatArray  # (R, 3) access point, RSSI, age


def _survey_walk(file: _File) -> _SurveyWalk:
    log = _log(file)
    way = log.reference
    wifi = log.rows.get("wifi", np.zeros((0, 5)))
    first_s, last_s = (way.t_s[0], way.t_s[-1]) if len(way) else (np.inf, -np.inf)
    wifi = wifi[(wifi[:, 0] >= first_s) & (wifi[:, 0] <= last_s)]
    scan_s, count = np.unique(wifi[:, 0], return_counts=True)
    return _SurveyWalk(
        session=file.session,
        xy_m=_interpolate(way, scan_s),
        level=np.full(len(scan_s), ilc20_map.level_of_floor(file.floor)),
        count=count,
        readings=wifi[:, [1, 2, 4]],
    )


def _interpolate(way: Trajectory, t_s: FloatArray) -> FloatArray:
    """(S, 2) on the straight lines between waypoints."""
    if not len(t_s):
        return np.zeros((0, 2))
    return np.column_stack([np.interp(t_s, way.t_s, way.xy_m[:, axis]) for axis in (0, 1)])


@functools.lru_cache(maxsize=16)
def _survey(mall: _Mall, site: str) -> tuple[_SurveyWalk, ...]:
    """Every survey walk of a site."""
    return tuple(_survey_walk(file) for file in mall.files if file.site == site and file.role in SURVEY_ROLES)


@functools.lru_cache(maxsize=128)
def _survey_without(mall: _Mall, site: str, session: str | None) -> RadioMap:
    """The radio map from every survey walk but those of a session; from all of them where it is None."""
    walks = [walk for walk in _survey(mall, site) if walk.session != session]
    if not walks:
        raise DatasetError(f"{site}: every survey walk belongs to session {session}; the set needs a second session")
    return survey_of_readings(
        np.vstack([walk.xy_m for walk in walks]),
        np.concatenate([walk.level for walk in walks]),
        np.repeat(np.arange(len(walks)), [len(walk.level) for walk in walks]),
        np.concatenate([walk.count for walk in walks]),
        np.vstack([walk.readings for walk in walks]),
        surveyed=False,
    )
