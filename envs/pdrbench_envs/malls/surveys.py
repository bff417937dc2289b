"""WiFi scans of the walks of a mall at their places, parsed once and kept in the cache folder."""

from __future__ import annotations

import functools
import hashlib
import io
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from pdrbench.datasets import cache_folder, datasets, find
from pdrbench.datasets.catalogue import DataFile
from pdrbench.evaluation.store import keep_whole
from pdrbench.files import bytes_sha256
from pdrbench.geometry import BoolArray, FloatArray, IntArray
from pdrbench.io.log import Log
from pdrbench.radio import survey_of_readings
from pdrbench.recording import RadioMap
from pdrbench_envs.recorded import checked_file
from pdrbench_sim.readers import ilc20, ilc20_map

DATASET: Final = "ilc20_full"
REMEDY: Final = f"delete it and run `pdrbench data fetch {DATASET}`"
_OF_WALK: Final = ("scans", "readings", "places")  # arrays of `Scans` with a row for each walk
_JOINED: Final = ("t_s", "xy_m", "count", "access_point", "rssi_dbm", "age_s", "place_xy_m")  # walk after walk
ARRAYS: Final = (*_OF_WALK, *_JOINED)


@dataclass(frozen=True, slots=True)
class Scans:
    """Scans and waypoints of W walks of one mall, walk by walk.

    Attributes:
        paths: (W,) of the files.
        scans: (W,) int, scans of each walk between its first and its last waypoint.
        readings: (W,) int, readings of these.
        places: (W,) int, waypoints of each walk.
        t_s: (S,) when each scan was delivered, from the start of its walk.
        xy_m: (S, 2) interpolated between waypoints at that time.
        count: (S,) int, readings of each scan.
        access_point: (R,) int.
        rssi_dbm: (R,).
        age_s: (R,).
        place_xy_m: (P, 2) waypoints.
    """

    paths: tuple[str, ...]
    scans: IntArray
    readings: IntArray
    places: IntArray
    t_s: FloatArray
    xy_m: FloatArray
    count: IntArray
    access_point: IntArray
    rssi_dbm: FloatArray
    age_s: FloatArray
    place_xy_m: FloatArray

    def scan_xy_m(self, paths: Sequence[str]) -> FloatArray:
        """(S, 2) places of the scans of some walks."""
        return np.asarray(self.xy_m[np.repeat(self._is_of(paths), self.scans)])

    def waypoint_xy_m(self, paths: Sequence[str]) -> FloatArray:
        """(P, 2) waypoints of some walks."""
        return np.asarray(self.place_xy_m[np.repeat(self._is_of(paths), self.places)])

    def radio_map(self, paths: Sequence[str]) -> RadioMap:
        """The survey that some walks make, those without a scan left out."""
        is_walk = self._is_of(paths)
        is_scan, is_reading = np.repeat(is_walk, self.scans), np.repeat(is_walk, self.readings)
        levels = [level_of(path) for path in self.paths]
        return survey_of_readings(
            self.xy_m[is_scan],
            np.repeat(levels, self.scans)[is_scan],
            np.repeat(np.cumsum(is_walk) - 1, self.scans)[is_scan],
            self.count[is_scan],
            np.column_stack([self.access_point, self.rssi_dbm, self.age_s])[is_reading],
            surveyed=False,
        )

    def _is_of(self, paths: Sequence[str]) -> BoolArray:
        return np.isin(self.paths, list(paths))


@functools.cache
def files() -> Mapping[str, DataFile]:
    """Every file of the set by path."""
    return {row.path: row for row in datasets()[DATASET].files}


def checked(path: str) -> Path:
    """Where a file of the set lies, once its content is known to be the registered one."""
    row = files()[path]
    return checked_file(find(DATASET) / path, row.sha256, DATASET, REMEDY, row.content_sha256)


@functools.lru_cache(maxsize=64)
def log_of(path: str) -> Log:
    """Reads a walk once it is known to be the one that is registered."""
    return log_once(path)


@functools.lru_cache(maxsize=4)
def scans_of(paths: tuple[str, ...]) -> Scans:
    """Scans of some walks, parsed once."""
    here = Path(__file__)
    code = bytes_sha256([here, Path(ilc20.__file__)])
    return Scans(paths, **parsed_once(paths, code, ARRAYS, _parsed))


def parsed_once(
    paths: tuple[str, ...], code: str, names: Sequence[str], parse: Callable[[Sequence[str]], dict[str, Any]]
) -> dict[str, Any]:
    """Arrays of some walks, from the cache folder where they were parsed before from the same files by the same code.

    Args:
        paths: Of the walks.
        code: Digest of everything that `parse` does.
        names: Of the arrays that it makes.
        parse: Makes them of the walks, of which it reads each by `log_once`.
    """
    contents = [files()[path].content_sha256 for path in paths]
    key = hashlib.sha256("\n".join((code, *paths, *contents)).encode()).hexdigest()
    kept = cache_folder() / "surveys" / f"{DATASET}-{key[:16]}.npz"
    arrays = kept_arrays(kept, names)
    if arrays is None:
        arrays = parse(paths)
        keep_arrays(kept, arrays)
    return arrays


def log_once(path: str) -> Log:
    """Reads a walk as `log_of` does, and keeps nothing."""
    return ilc20.read(checked(path), floor=Path(path).parts[1])


def level_of(path: str) -> int:
    """The level that a walk is on."""
    return ilc20_map.level_of_floor(Path(path).parts[1])


def kept_arrays(place: Path, names: Sequence[str]) -> dict[str, Any] | None:
    """Arrays that `keep_arrays` wrote; None where they are not there or damaged."""
    try:
        with np.load(place, allow_pickle=False) as found:
            return {name: found[name] for name in names}
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None


def keep_arrays(place: Path, arrays: Mapping[str, Any]) -> None:
    """Keeps what was parsed for the next process."""
    content = io.BytesIO()
    np.savez(content, **arrays)
    keep_whole(place, content.getvalue())


def _parsed(paths: Sequence[str]) -> dict[str, Any]:
    """The arrays of `Scans`."""
    return joined_scans([scans_of_walk(log_once(path)) for path in paths])


def joined_scans(by_walk: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The arrays of `Scans`, from those of one walk or more."""
    joined = {name: np.concatenate([walk[name] for walk in by_walk]) for name in _JOINED}
    counted = zip(_OF_WALK, ("t_s", "access_point", "place_xy_m"), strict=True)
    return joined | {name: np.array([len(walk[of]) for walk in by_walk]) for name, of in counted}


def scans_of_walk(log: Log) -> dict[str, Any]:
    """Arrays of one walk, under the names of `Scans`."""
    way = log.reference
    wifi = log.rows.get("wifi", np.zeros((0, 5)))
    first_s, last_s = (way.t_s[0], way.t_s[-1]) if len(way) else (np.inf, -np.inf)
    wifi = wifi[(wifi[:, 0] >= first_s) & (wifi[:, 0] <= last_s)]
    t_s, count = np.unique(wifi[:, 0], return_counts=True)
    xy_m = np.column_stack([np.interp(t_s, way.t_s, way.xy_m[:, k]) for k in (0, 1)]) if len(t_s) else np.zeros((0, 2))
    return {
        "t_s": t_s,
        "xy_m": xy_m,
        "count": count,
        "access_point": wifi[:, 1].astype(np.int64),
        "rssi_dbm": wifi[:, 2],
        "age_s": wifi[:, 4],
        "place_xy_m": way.xy_m,
    }
