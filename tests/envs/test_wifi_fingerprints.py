"""WifiFingerprints-v1: published figures hold, surveys lack the places of a walk, places lie in one walk."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from sklearn.neighbors import NearestNeighbors

from pdrbench.errors import DatasetError, UnknownNameError
from pdrbench.geometry import FloatArray, IntArray
from pdrbench.registry import make_task
from pdrbench.task import Task
from pdrbench_envs import wifi_fingerprints

ENV = "WifiFingerprints-v1"
WEAKEST_DBM = -104.0  # of the training part of UJI1, which stands for what was not received


def test_it_can_be_listed_without_data(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PDRBENCH_DATA", str(tmp_path))
    monkeypatch.setenv("PDRBENCH_CACHE", str(tmp_path))
    wifi_fingerprints.fingerprints.cache_clear()
    task = make_task(ENV)
    tests = task.split("test")
    assert Counter(task.groups[walk][0] for walk in tests) == {"UJI1": 40, "TUT3": 40, "LIB1": 40}
    assert (len(task.split("train")), len(task.split("val"))) == (80, 20)
    assert len({task.units[walk] for walk in tests}) == 120
    with pytest.raises(DatasetError, match="copy UJI1"):
        task.load(tests[0])


@pytest.fixture(scope="module")
def task(data_root: Path) -> Task:
    if not (data_root / wifi_fingerprints.DATASET).is_dir():
        pytest.skip("wifi_fingerprints not found")
    return make_task(ENV)


def table_of(row: IntArray, access_point: FloatArray, rssi_dbm: FloatArray) -> FloatArray:
    """(N, 520) scans of UJI1, the weakest reading where nothing was received."""
    table = np.full((int(row.max()) + 1, 520), WEAKEST_DBM)
    table[row, access_point.astype(int)] = rssi_dbm
    return table


@pytest.mark.data
def test_the_nearest_neighbour_has_its_published_errors(task: Task) -> None:
    """UJIIndoorLoc, IPIN 2014: 89.92 % on the right level of the right building, and these are 7.90 m off."""
    walks = [task.load(walk) for walk in task.split("test") if task.groups[walk] == ("UJI1",)]
    survey = task.radio_map(walks[0])
    assert survey is not None
    scan = np.repeat(np.arange(len(survey)), np.diff(survey.first))
    known = table_of(scan, survey.access_point.astype(np.float64), survey.rssi_dbm)
    search = NearestNeighbors(n_neighbors=1, algorithm="brute").fit(known)
    heard = [walk.streams["wifi"].rows.T for walk in walks]
    scans = np.concatenate([table_of((t_s / task.period_s).astype(int), *rows[:2]) for t_s, *rows in heard])
    found = search.kneighbors(scans, return_distance=False)[:, 0]
    xy_m, level = (np.concatenate([getattr(walk.reference, name) for walk in walks]) for name in ("xy_m", "level"))
    is_hit = survey.level[found] == level  # the building is right in each
    assert len(is_hit) == 1111 and round(100 * is_hit.mean(), 2) == 89.92
    hit_m = np.hypot(*(survey.xy_m[found] - xy_m)[is_hit].T).mean()
    assert round(hit_m / wifi_fingerprints.fingerprints("UJI1").ground_scale, 2) == 7.90


@pytest.mark.data
@pytest.mark.parametrize("of", ["LIB1", "TUT3", "UJI1"])
def test_every_scan_is_in_one_walk_and_no_survey_has_its_place(task: Task, of: str) -> None:
    """A place of test is in one walk of test; a place of a fold is in no survey of this fold."""
    parts = wifi_fingerprints.fingerprints(of)
    walks = {walk: group for walk, group in wifi_fingerprints.groups().items() if group.of == of}
    tested = [wifi_fingerprints.rows_of(group) for group in walks.values() if group.split == "test"]
    assert sorted(np.concatenate(tested).tolist()) == list(range(len(parts.test)))
    places = [{(*xy, level) for *xy, level in np.c_[parts.test.xy_m, parts.test.level][rows]} for rows in tested]
    assert sum(map(len, places)) == len(set().union(*places))
    for walk in (next(w for w, group in walks.items() if group.split == split) for split in ("train", "val")):
        recording = task.load(walk)
        survey = task.radio_map(recording)
        assert survey is not None and 0.7 < len(survey) / len(parts.train) < 0.9
        surveyed = {(*xy, level) for *xy, level in np.c_[survey.xy_m, survey.level]}
        way = recording.reference
        assert not surveyed & {(*xy, level) for *xy, level in np.c_[way.xy_m, way.level]}
        assert Counter(map(tuple, np.c_[way.xy_m, way.level])).most_common(1)[0][1] <= 4
        assert (np.diff(way.xy_m, axis=0).any(axis=1) | (np.diff(way.level) != 0)).all()


def test_a_set_of_ones_own_is_read_as_its_table_says(tmp_path: Path) -> None:
    head, row = "MAC1,MAC2,ECoord,NCoord,FloorID,UserID", "-40,100,1.5,2.5,3,7"
    (tmp_path / "CETC331").mkdir()
    for part in ("Training", "Testing"):
        (tmp_path / "CETC331" / f"{part}_CETC331.csv").write_text(f"{head}\n{row}\n")
    found = wifi_fingerprints.read_set("SOD_CETC331", tmp_path).train
    np.testing.assert_array_equal(found.rssi_dbm, [[-40, np.nan]])
    assert (found.xy_m.tolist(), found.level.tolist()) == ([[1.5, 2.5]], [3])
    with pytest.raises(UnknownNameError, match="SOD_SYL"):
        wifi_fingerprints.read_set("SOD_SIL", tmp_path)
    assert all(
        {"train", "test", "missing", "licence", "source"} <= of.keys() for of in wifi_fingerprints.other_sets().values()
    )
