"""`WifiFingerprints-v1`: published WLAN fingerprints at surveyed places, walked scan by scan.

Data: UJIIndoorLoc, one set of Tampere and one of a library, with the split that the literature uses, registered as
`wifi_fingerprints`. The test part of a set is test; its training part is the radio map, and makes train and val.
"""

from __future__ import annotations

import functools
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import replace
from importlib.resources import files as package_files
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from pdrbench.datasets import dataset, find
from pdrbench.errors import RecordingError, unknown_name
from pdrbench.geometry import IntArray
from pdrbench.radio import scans_of
from pdrbench.recording import RadioMap, Recording, SensorStream
from pdrbench.sensors import sensor_spec
from pdrbench.task import SPLITS, Task
from pdrbench.trajectory import Trajectory
from pdrbench_envs.descriptions import describe
from pdrbench_envs.generated import start_place
from pdrbench_envs.recorded import checked_file, opaque_id
from pdrbench_sim.readers.wifi_fingerprints import FingerprintSet, SurveyRows, read

ENV: Final = "WifiFingerprints-v1"
DATASET: Final = "wifi_fingerprints"
TRAIN_WALKS: Final = {"LIB1": 4, "TUT3": 8, "UJI1": 8}  # by set, of each fold; LIB1 has 48 training places
PAUSE_S: Final = 600.0  # between scans, so that whoever walks can be anywhere at the next
CAPACITY: Final = 1024  # more than there are access points in any set: a scan comes with one observation
TEST_WALKS: Final = 40  # of each set
FOLDS: Final = 5  # of the training places; the first is val
MAX_SCANS: Final = 4  # at a place of the training part; there are up to 80
_ID_KEY: Final = b"pdrbench.wifi_fingerprints"
_REMEDY: Final = f"copy it again ({DATASET})"


class Group(NamedTuple):
    """Places that make a walk."""

    of: str  # name of the set
    fold: int | None  # of the training places; None in test
    number: int  # of the group, in its set and fold

    @property
    def split(self) -> str:
        """Split of the walk."""
        return "test" if self.fold is None else "train" if self.fold else "val"


def task() -> Task:
    """The environment."""
    registered = dataset(DATASET)
    walks = groups()
    return Task(
        id=ENV,
        summary="Scans of three published fingerprint sets at surveyed places, radio survey, start unknown",
        description=describe("wifi_fingerprints"),
        sensors=(sensor_spec("wifi"),),
        capacity={"wifi": CAPACITY},
        period_s=PAUSE_S,
        start="unknown",
        walks={split: tuple(w for w, group in walks.items() if group.split == split) for split in SPLITS[:3]},
        load=load,
        tell_start=start_place,
        radio_map=lambda recording: survey(*groups()[recording.id][:2]),
        licence=registered.licence,
        source=f"{registered.source_url} commit {registered.commit}",
        dataset=DATASET,
        units={walk: walk for walk in walks},
        unit_kind="group of places",
        noise_m=0.3,  # points of a plan on which a person stood
        groups={walk: (group.of,) for walk, group in walks.items()},
        folds={walk: group.fold for walk, group in walks.items() if group.split == "train" and group.fold is not None},
    )


@functools.cache
def groups() -> Mapping[str, Group]:
    """Group by walk, in the order of play; no file is needed."""
    tests = [Group(of, None, number) for of in TRAIN_WALKS for number in range(TEST_WALKS)]
    others = [
        Group(of, fold, number)
        for of, num_walks in TRAIN_WALKS.items()
        for fold in range(FOLDS)
        for number in range(num_walks)
    ]
    named = {f"{group.split}-{opaque_id(' '.join(map(str, group)), _ID_KEY)}": group for group in (*tests, *others)}
    return dict(sorted(named.items()))


def load(walk: str) -> Recording:
    """The scans of one group of places.

    Raises:
        UnknownNameError: There is no such walk.
        DatasetError: The file of its set is not available, or was changed.
    """
    if walk not in groups():
        raise unknown_name(f"walk of {ENV}", walk, groups())
    group = groups()[walk]
    rows, part = rows_of(group), _part(group.of, group.fold)
    t_s = np.arange(len(rows), dtype=np.float64) * PAUSE_S
    scan, access_point = np.nonzero(~np.isnan(part.rssi_dbm[rows]))
    none = np.zeros(len(scan))  # of frequency, which is not in the files, and of age
    wifi = np.column_stack([t_s[scan], access_point, part.rssi_dbm[rows][scan, access_point], none, none])
    reference = Trajectory(t_s, part.xy_m[rows], part.level[rows], np.ones(len(rows), dtype=np.bool_))
    return Recording(walk, None, {"wifi": SensorStream(sensor_spec("wifi"), wifi)}, reference)


@functools.lru_cache(maxsize=3)  # of up to 15 MB
def survey(of: str, fold: int | None) -> RadioMap:
    """The training part of a set, without the places of a fold, and without scans that some of these repeat."""
    part = fingerprints(of).train
    place, rank = _places(of, is_test=False)
    whole = replace(part.radio_map(), walk=place)
    if fold is None:
        return whole
    is_out = rank[place] % FOLDS == fold
    scans = [scan.tobytes() for scan in np.nan_to_num(part.rssi_dbm).astype(np.int8)]
    left_out = {scan for scan, out in zip(scans, is_out, strict=True) if out}
    return scans_of(whole, np.array([scan not in left_out for scan in scans]))


def rows_of(group: Group) -> IntArray:
    """(N,) rows of the part that a walk is made of: first one of each place, then a second one, and so on."""
    place, rank = _places(group.of, is_test=group.fold is None)
    if group.fold is None:
        mine = rank % TEST_WALKS == group.number
    else:
        mine = (rank % FOLDS == group.fold) & (rank // FOLDS % TRAIN_WALKS[group.of] == group.number)
    rows = _shuffled(np.flatnonzero(mine[place]).tolist(), f"{group.of} {group.split}")
    seen = dict.fromkeys(place[rows].tolist(), 0)
    turn = []
    for row in rows:
        seen[int(place[row])] += 1
        turn.append((seen[int(place[row])], rank[place[row]], row))
    return np.array([row for count, _, row in sorted(turn) if group.fold is None or count <= MAX_SCANS])


@functools.lru_cache(maxsize=6)
def _places(of: str, *, is_test: bool) -> tuple[IntArray, IntArray]:
    """Number of the place of each row (N,), and where each place (P,) stands in a shuffled order."""
    part = _part(of, None if is_test else 0)
    labels = np.column_stack([part.building, part.level, part.xy_m])
    labels, place = np.unique(labels, axis=0, return_inverse=True)
    rank = np.empty(len(labels), dtype=np.int64)
    rank[_shuffled(range(len(labels)), f"{of} {is_test}")] = np.arange(len(labels))
    return place.ravel(), rank


def _shuffled(numbers: Iterable[int], what: str) -> list[int]:
    return sorted(numbers, key=lambda number: opaque_id(f"{what} {number}", _ID_KEY))


def _part(of: str, fold: int | None) -> SurveyRows:
    return fingerprints(of).test if fold is None else fingerprints(of).train


@functools.lru_cache(maxsize=len(TRAIN_WALKS))
def fingerprints(of: str) -> FingerprintSet:
    """Reads a set once it is known to be the one that is registered."""
    file = next(row for row in dataset(DATASET).files if row.path == f"{of}.mat")
    return read(checked_file(find(DATASET) / file.path, file.sha256, DATASET, _REMEDY))


def read_set(name: str, folder: Path | str) -> FingerprintSet:
    """Reads a set that users get by themselves; `fingerprint_sets.toml` says what its files are called.

    Args:
        name: As in that table.
        folder: Where its files are.

    Raises:
        UnknownNameError: The table has no such set.
        RecordingError: A file is not of its layout.
    """
    sets = other_sets()
    if name not in sets:
        raise unknown_name("fingerprint set", name, sets)
    columns = sets[name]
    if columns["train"].endswith(".mat"):
        return read(Path(folder) / columns["train"])
    train, test = (_read_csv(Path(folder) / columns[part], columns) for part in ("train", "test"))
    return FingerprintSet(train, test, ground_scale=1.0)


@functools.cache
def other_sets() -> Mapping[str, Mapping[str, Any]]:
    """`fingerprint_sets.toml`, by name."""
    text = (package_files("pdrbench_envs") / "fingerprint_sets.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)


def _read_csv(file: Path, columns: Mapping[str, Any]) -> SurveyRows:
    import pandas

    table = pandas.read_csv(file)
    places = [columns[name] for name in ("x", "y", "level")]
    if lacking := [name for name in places if name not in table.columns]:
        raise RecordingError(f"{file}: no column {lacking[0]!r}; columns end with {', '.join(table.columns[-8:])}")
    rssi_dbm = table.filter(regex=f"^(?:{columns['access_point']})$").to_numpy(np.float64)
    rssi_dbm = np.where(rssi_dbm == columns["missing"], np.nan, rssi_dbm)
    xy_m, level = table[places[:2]].to_numpy(np.float64), table[places[2]].to_numpy(np.int64)
    return SurveyRows(rssi_dbm, xy_m, np.full(len(table), np.nan), level, np.zeros(len(table), dtype=np.int64))
