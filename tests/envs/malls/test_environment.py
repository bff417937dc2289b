"""The environments of the malls: briefing, surveys, what is at hand, and no leaks."""

from __future__ import annotations

import lzma
import shutil
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pdrbench.datasets import find
from pdrbench.episode import Episode
from pdrbench.errors import DatasetError
from pdrbench.task import Task
from pdrbench_envs.malls import environment, surveys
from pdrbench_envs.malls.environment import ENDS_BEFORE_A_SCAN, played_walks, task, task_lost
from pdrbench_envs.malls.splits import walks


@pytest.fixture
def fresh(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A process that has read no walk, with an empty folder for data and one for the cache; plans may be known."""
    cached = (surveys.log_of, surveys.scans_of, environment._survey)
    for each in cached:
        each.cache_clear()
    monkeypatch.setenv("PDRBENCH_DATA", str(tmp_path / "data"))
    monkeypatch.setenv("PDRBENCH_CACHE", str(tmp_path / "cache"))
    yield tmp_path / "data" / "ilc20_full"
    for each in cached:
        each.cache_clear()


@pytest.fixture
def full(data_root: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The registered set; skips where it is absent."""
    monkeypatch.setenv("PDRBENCH_DATA", str(data_root))
    if not (data_root / "ilc20_full").is_dir():
        pytest.skip("ilc20_full is not under PDRBENCH_DATA")
    return find("ilc20_full")


def in_order(task: Task, split: str, site: str = "site1") -> list[str]:
    """The first walk of a split on every floor of a mall; all walks of a mall are parsed for its survey."""
    played = {walk: played_walks()[walk] for walk in task.split(split)}
    floors = {of.floor: walk for walk, of in reversed(played.items()) if of.site == site}
    return [*floors.values()][::-1]


@pytest.mark.parametrize("make", [task, task_lost])
def test_a_task_needs_no_data_until_it_loads(fresh: Path, make: Any) -> None:
    made = make()
    assert (made.note, made.dataset, made.unit_kind) == ("", "ilc20_full", "outing")
    with pytest.raises(DatasetError, match="data fetch ilc20_full"):
        made.load(made.split("test")[0])


def test_walks_of_both_environments() -> None:
    known, lost = task(), task_lost()
    assert {split: len(of) for split, of in known.walks.items()} == {"train": 450, "val": 87, "test": 150}
    assert {split: len(of) for split, of in lost.walks.items()} == {"train": 449, "val": 87, "test": 115}
    assert set(known.groups) == set(known.walks["test"])
    assert set(lost.groups.values()) == {("known floor",), ("two weeks later",)}
    assert set(known.folds) == set(known.walks["train"]) and set(known.folds.values()) == set(range(5))
    assert 25 <= len({known.units[walk] for walk in known.walks["test"]}) <= 35


def test_ids_of_test_walks_and_their_units_are_opaque_and_in_their_own_order() -> None:
    made = task()
    test = made.walks["test"]
    assert list(test) == sorted(test)
    assert all(len(name) == len("test-") + 8 for walk in test for name in (walk, made.units[walk]))
    start_s = [played_walks()[walk].start_s for walk in test]
    assert abs(np.corrcoef(np.arange(len(test)), np.argsort(np.argsort(start_s)))[0, 1]) < 0.3


@pytest.mark.data
def test_a_known_start_is_in_the_briefing_and_not_scored(full: Path) -> None:
    made = task()
    for walk in in_order(made, "test"):
        recording = made.load(walk)
        briefing = made.brief(recording)
        assert briefing.start is not None and briefing.start.heading_rad is None
        np.testing.assert_array_equal(briefing.start.xy_m, recording.reference.xy_m[0])
        assert recording.reference.surveyed.tolist() == [False] + [True] * (len(recording.reference) - 1)
        assert briefing.building is not None and briefing.building.levels == (-1, 0, 1, 2, 3)
        assert briefing.building.contains(recording.reference.xy_m, recording.reference.level).mean() > 0.9
        assert len(Episode(recording, made)) > 0  # every row fits into the observations
    other = made.load(in_order(made, "test", "site2")[0]).building
    assert other is not None and other.levels == tuple(range(-1, 8))


@pytest.mark.data
def test_without_a_start_every_level_with_a_survey_is_possible(full: Path) -> None:
    made = task_lost()
    for walk in in_order(made, "test"):
        recording = made.load(walk)
        briefing = made.brief(recording)
        assert briefing.start is None and briefing.radio_map is not None
        levels = set(briefing.radio_map.level.tolist())
        assert len(levels) >= 5 and int(recording.reference.level[0]) in levels
        first_s = recording.streams["wifi"].t_s[0]
        np.testing.assert_array_equal(recording.reference.surveyed, recording.reference.t_s >= first_s + 0.2)
        assert recording.reference.surveyed.any()


@pytest.mark.data
def test_the_walk_left_out_could_not_be_scored_without_a_start(full: Path) -> None:
    (left_out,) = set(task().walks["train"]) - set(task_lost().walks["train"])
    assert played_walks()[left_out].path == ENDS_BEFORE_A_SCAN
    assert not environment.after_first_scan(surveys.log_of(ENDS_BEFORE_A_SCAN)).any()
    shortest = sorted(task_lost().walks["train"], key=lambda walk: duration_s(walk))[:5]
    assert all(environment.after_first_scan(surveys.log_of(played_walks()[walk].path)).any() for walk in shortest)


def duration_s(walk: str) -> float:
    facts = played_walks()[walk]
    return facts.end_s - facts.start_s


@pytest.mark.data
def test_nothing_in_a_test_walk_reveals_where_or_when_it_was_recorded(full: Path) -> None:
    made = task()
    maps = set()
    for walk in made.split("test")[:12]:
        recording = made.load(walk)
        assert recording.id == walk and dict(recording.subject) == {}
        assert min(stream.t_s[0] for stream in recording.streams.values()) < 5.0
        if played_walks()[walk].site == "site1":
            maps.add(id(made.radio_map(recording)))
    assert len(maps) == 1


@pytest.mark.data
def test_a_survey_holds_the_scans_of_its_walks_and_none_of_the_walk(full: Path) -> None:
    """A scan is recognised by its readings."""
    made = task()
    for walk in [*in_order(made, "val")[:3], *in_order(made, "train")[:3]]:
        recording = made.load(walk)
        survey = made.radio_map(recording)
        assert survey is not None
        wifi = recording.streams["wifi"].rows
        own = {scan_of(wifi[wifi[:, 0] == t_s][:, [1, 2, 4]]) for t_s in np.unique(wifi[:, 0])}
        readings = np.column_stack([survey.access_point, survey.rssi_dbm, survey.age_s])
        found = [scan_of(readings[a:b]) for a, b in zip(survey.first[:-1], survey.first[1:], strict=True)]
        assert not own & set(found)
        assert (np.diff(survey.walk) >= 0).all()


def scan_of(readings: Any) -> bytes:
    return np.ascontiguousarray(readings, dtype=np.float64).tobytes()


def put(folder: Path, source: Path, paths: list[str]) -> None:
    """Copies some files of the set, and every plan."""
    plans = [path for path in surveys.files() if Path(path).name in environment.PLAN_FILES]
    for path in (*paths, *plans):
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(source / path, folder / path)


@pytest.fixture
def part(full: Path, fresh: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with one floor of the set."""
    floor = [walk.path for walk in walks() if (walk.site, walk.floor) == ("site2", "F5")]
    put(fresh, full, floor)
    monkeypatch.setenv("PDRBENCH_DATA", str(fresh.parent))
    return fresh


@pytest.mark.data
def test_a_part_of_the_set_is_played_under_a_note_that_says_how_much(part: Path) -> None:
    made = task()
    assert made.note.startswith("35 of the 698 walks of ilc20_full are at hand: scores are not comparable")
    assert sum(len(of) for of in made.walks.values()) == 35
    recording = made.load(made.split("train")[0])
    survey = made.radio_map(recording)
    assert survey is not None and set(survey.level.tolist()) == {4}
    one = part / played_walks()[made.split("train")[1]].path
    one.unlink()
    assert task().note.startswith("34 of") and len({t.files_sha256("") for t in (task(), made)}) == 2


@pytest.mark.data
def test_a_changed_walk_is_named_and_another_compression_is_none(part: Path) -> None:
    made = task()
    first, second = made.split("train")[:2]
    place = part / played_walks()[first].path
    text = lzma.decompress(place.read_bytes())
    place.write_bytes(lzma.compress(text, preset=0))
    assert len(made.load(first).reference) > 1
    place = part / played_walks()[second].path
    place.write_bytes(lzma.compress(lzma.decompress(place.read_bytes()) + b"\n"))
    with pytest.raises(DatasetError, match=place.name):
        made.load(second)


@pytest.mark.data
def test_a_survey_is_parsed_once_and_again_where_its_cache_is_damaged(part: Path) -> None:
    paths = tuple(sorted(walk.path for walk in walks() if (part / walk.path).is_file()))[:6]
    parsed = surveys.scans_of(paths)
    (kept,) = (part.parent.parent / "cache" / "surveys").iterdir()
    surveys.scans_of.cache_clear()
    written = kept.stat().st_mtime_ns
    again = surveys.scans_of(paths)
    assert kept.stat().st_mtime_ns == written
    for name in ("t_s", "xy_m", "count", "access_point", "rssi_dbm", "age_s", "place_xy_m"):
        np.testing.assert_array_equal(getattr(parsed, name), getattr(again, name))
    kept.write_bytes(kept.read_bytes()[:1000])
    surveys.scans_of.cache_clear()
    np.testing.assert_array_equal(surveys.scans_of(paths).access_point, parsed.access_point)
    assert len(parsed.radio_map(paths)) == len(parsed.t_s)
    alone = parsed.radio_map(paths[2:3])
    np.testing.assert_array_equal(alone.xy_m, parsed.scan_xy_m(paths[2:3]))
    assert len(alone.access_point) == parsed.readings[2] and set(alone.walk.tolist()) == {0}


@pytest.mark.data
def test_a_walk_is_opened_within_60_ms(full: Path) -> None:
    """Of processor time, once the plan of its mall is read: the median of nine walks."""
    made = task()
    chosen = [walk for walk in made.split("val") if played_walks()[walk].site == "site1"][:10]
    took_s = []
    for walk in chosen:
        surveys.log_of.cache_clear()
        begun_s = time.process_time()
        made.load(walk)
        took_s.append(time.process_time() - begun_s)
    assert np.median(took_s[1:]) < 0.06
