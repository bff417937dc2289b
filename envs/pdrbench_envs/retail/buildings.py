"""The index of a building: facts of its walks, their scans and places, read once and kept; and its plan."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np

from pdrbench.building import Building
from pdrbench.errors import MapError, PdrbenchError, RecordingError
from pdrbench.evaluation.store import keep_whole
from pdrbench.files import bytes_sha256
from pdrbench.io.log import Log
from pdrbench_envs.malls.surveys import ARRAYS, Scans, joined_scans, keep_arrays, kept_arrays, scans_of_walk
from pdrbench_envs.retail.sources import Member, Site, kept_folder, sites
from pdrbench_sim.readers import ilc20, ilc20_lines, ilc20_map
from pdrbench_sim.readers.ilc20_map import PLAN, SIZE, level_of_floor

MIN_PLACES: Final = 2  # the first is the start, which is not scored


class WalkFacts(msgspec.Struct, frozen=True):
    """One walk that can be played, without opening it.

    Attributes:
        name: Of its file, without suffix.
        floor: Name of the floor.
        device: Make and model of the phone.
        start_s: When it began, unix.
        end_s: When it ended, unix.
        first_scan_s: Of the first WiFi scan, from the start; None where there is none.
        num_scans: Between its first and its last place.
        places: Seconds from the start, x and y in metres of each waypoint.
    """

    name: str
    floor: str
    device: str
    start_s: float
    end_s: float
    first_scan_s: float | None
    num_scans: int
    places: tuple[tuple[float, float, float], ...]

    @property
    def level(self) -> int:
        """The level that it is on."""
        return level_of_floor(self.floor)


class BuildingIndex(msgspec.Struct, frozen=True):
    """Walks of a building, and what cannot be played.

    Attributes:
        site: Name of the building.
        walks: By floor and name.
        problems: Why files are left out, a sentence each.
    """

    site: str
    walks: tuple[WalkFacts, ...]
    problems: tuple[str, ...]

    def path(self, walk: WalkFacts) -> str:
        """Of a walk in `Scans`."""
        return f"{self.site}/{walk.floor}/{walk.name}"

    @property
    def digest(self) -> str:
        """Of the facts: where it is another, surveys and scores are."""
        return hashlib.sha256(msgspec.json.encode(self.walks)).hexdigest()


def index_of(site: str) -> BuildingIndex:
    """The index of a building, made where it is not kept."""
    return _indexed(site, _key(sites()[site]))[0]


def scans_of(site: str) -> Scans:
    """Scans and places of all walks of a building, in the order of its index."""
    return _indexed(site, _key(sites()[site]))[1]


def index_all(names: Iterable[str], jobs: int) -> Iterator[BuildingIndex]:
    """Indexes of buildings, several at a time, as they are made."""
    if jobs == 1:
        yield from map(index_of, names)
        return
    with ProcessPoolExecutor(jobs) as pool:
        yield from pool.map(index_of, names)


def _key(site: Site) -> str:
    """Of the files of a building and of the code that reads them."""
    code = bytes_sha256([Path(__file__), Path(ilc20.__file__), Path(ilc20_lines.__file__)])
    files = [(*of, member.num_bytes, member.stamp) for of, member in sorted(site.walks.items())]
    return hashlib.sha256(f"{code} {files}".encode()).hexdigest()[:16]


@functools.lru_cache(maxsize=8)  # of up to some 30 MB each
def _indexed(site: str, key: str) -> tuple[BuildingIndex, Scans]:
    place = kept_folder() / f"{site}-{key}"
    index = _kept_index(place.with_suffix(".json"))
    arrays = kept_arrays(place.with_suffix(".npz"), ARRAYS) if index is not None else None
    if index is None or arrays is None:
        index, arrays = _made(sites()[site])
        keep_arrays(place.with_suffix(".npz"), arrays)
        keep_whole(place.with_suffix(".json"), msgspec.json.encode(index))
    return index, Scans(tuple(index.path(walk) for walk in index.walks), **arrays)


def _kept_index(place: Path) -> BuildingIndex | None:
    try:
        return msgspec.json.decode(place.read_bytes(), type=BuildingIndex)
    except (OSError, msgspec.DecodeError):
        return None


def _made(site: Site) -> tuple[BuildingIndex, dict[str, Any]]:
    facts, arrays, problems = [], [], []
    for (floor, name), member in sorted(site.walks.items()):
        try:
            log = log_of(member, floor)
            facts.append(_facts(log, floor, name, member))
        except PdrbenchError as error:
            problems.append(str(error))
            continue
        arrays.append(scans_of_walk(log))
    if not facts:
        return BuildingIndex(site.name, (), tuple(problems)), {name: np.zeros(0) for name in ARRAYS}
    return BuildingIndex(site.name, tuple(facts), tuple(problems)), joined_scans(arrays)


def log_of(member: Member, floor: str) -> Log:
    """Reads a walk."""
    return ilc20.read_content(member.text(), member.path, floor=floor)


def _facts(log: Log, floor: str, name: str, member: Member) -> WalkFacts:
    """Of a walk that can be played; raises `RecordingError` with the reason where it cannot."""
    way, wifi = log.reference, log.rows.get("wifi")
    if len(way) < MIN_PLACES or "accel" not in log.rows or log.start_unix_s is None:
        lacks = "accelerometer" if "accel" not in log.rows else f"{MIN_PLACES} waypoints and a clock"
        raise RecordingError(f"{member.path}: without {lacks}: it cannot be scored, and is left out")
    last_s = max(rows[-1, 0] for rows in (*log.rows.values(), way.t_s[:, None]))
    return WalkFacts(
        name=name,
        floor=floor,
        device=log.device,
        start_s=log.start_unix_s,
        end_s=log.start_unix_s + float(last_s),
        first_scan_s=None if wifi is None else float(wifi[0, 0]),
        num_scans=0 if wifi is None else len(np.unique(wifi[:, 0])),
        places=tuple((t, x, y) for t, (x, y) in zip(way.t_s.tolist(), way.xy_m.tolist(), strict=True)),
    )


def plan_of(site: str) -> tuple[Building | None, tuple[str, ...]]:
    """The plan of all floors that have one that can be read, and why the others have none."""
    return _plan(site, tuple(sorted(sites()[site].plans.items())))


@functools.lru_cache(maxsize=4)
def _plan(site: str, files: tuple[tuple[tuple[str, str], Member], ...]) -> tuple[Building | None, tuple[str, ...]]:
    floors: dict[str, ilc20_map.Floor] = {}
    problems: list[str] = []
    by_floor = {floor: {name: member for (of, name), member in files if of == floor} for (floor, _), _ in files}
    for floor, of_floor in by_floor.items():
        try:
            if level_of_floor(floor) in map(level_of_floor, floors):
                raise MapError(f"{site}/{floor}: another floor is the same level; this one is left out")
            if len(of_floor) < 2:
                raise MapError(f"{site}/{floor}: a plan needs {PLAN} and {SIZE}")
            plan, size = of_floor[PLAN], of_floor[SIZE]
            floors[floor] = ilc20_map.floor_of(plan.content(), size.content(), plan.path, floor)
            problems += floors[floor].mended
        except (MapError, RecordingError) as error:
            problems.append(str(error))
    try:
        return ilc20_map.building_of(site, floors) if floors else None, tuple(problems)
    except MapError as error:
        return None, (*problems, f"{site}: {error}")
