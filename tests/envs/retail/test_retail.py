"""The shopping centres that users bring: copies, indexes, plans, splits and surveys, on a made-up copy of the set."""

from __future__ import annotations

import json
import lzma
import math
import shutil
import zipfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from pdrbench.errors import DatasetError, RecordingError
from pdrbench_envs.retail import buildings, environment, sources
from pdrbench_envs.retail.adding import add_kaggle_iln
from pdrbench_formats.taskfile import walks_of_file
from pdrbench_formats.taskfile.draft import write_draft
from pdrbench_formats.taskfile.schema import TaskFile, WalkTable

SITE, FLAT = "5c0000000000000000000001", "5c0000000000000000000002"
T0_MS, HOUR_MS = 1_559_378_273_000, 3_600_000
WALK_S = 20
BEGIN_M = {"a": (10.0, 5.0), "b": (10.0, 6.0), "c": (10.0, 7.0)}


def walk_text(begin_ms: int, name: str = "a", floor: str = "F1") -> str:
    """A walk of 20 m to the east with four waypoints, and a scan every two seconds."""
    lines = [
        f"#\tstartTime:{begin_ms}",
        f"#\tSiteID:{SITE}\tSiteName:x\tFloorName:{floor}",
        "#\tBrand:vivo\tModel:X21A",
    ]
    for k in range(WALK_S * 10):
        at = begin_ms + 100 * k
        lines += [
            f"{at}\tTYPE_ACCELEROMETER\t0.1\t0.2\t9.8{k % 7}\t2",
            f"{at}\tTYPE_GYROSCOPE\t0.0\t0.0\t0.0{k % 5}\t2",
        ]
    for second in range(0, WALK_S, 2):
        at = begin_ms + 1000 * second
        lines.append(f"{at}\tTYPE_WIFI\tssid\tbssid-1\t-{50 + second}\t2412\t{at - 100}")
    x_m, y_m = BEGIN_M[name]
    lines += [f"{begin_ms + 1000 * s}\tTYPE_WAYPOINT\t{x_m + s}\t{y_m}" for s in (0, 7, 14, 19)]
    return "\n".join(lines) + "\n"


def plan_files(folder: Path) -> None:
    """60 by 40 m with one shop of 10 by 10, in Web Mercator at a latitude where a metre is two."""
    folder.mkdir(parents=True)
    corner = np.array([13_000_000.0, 8_000_000.0])

    def ring(x0: float, y0: float, x1: float, y1: float) -> list[list[float]]:
        metres = np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)])
        return [row.tolist() for row in corner + 2.0 * metres]

    boxes = (ring(0, 0, 60, 40), ring(20, 20, 30, 30))
    features = [{"geometry": {"type": "MultiPolygon", "coordinates": [[one]]}, "properties": {}} for one in boxes]
    (folder / "geojson_map.json").write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    (folder / "floor_info.json").write_text(json.dumps({"map_info": {"width": 60.0, "height": 40.0}}))


@pytest.fixture
def download(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Two buildings; one with a plan, a damaged walk, and outings in three hours; one with a single floor and walk."""
    monkeypatch.delenv("PDRBENCH_DATA", raising=False)
    monkeypatch.setenv("PDRBENCH_CACHE", str(tmp_path / "cache"))
    folder = tmp_path / "download"
    for hour, name in enumerate("abc"):
        place = folder / "train" / SITE / "F1" / f"{name}.txt"
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text(walk_text(T0_MS + hour * HOUR_MS, name))
    (folder / "train" / SITE / "F1" / "bad.txt").write_text("no walk\n")
    (folder / "train" / SITE / "F1" / "._a.txt").write_text("what macOS adds")
    flat = folder / "train" / FLAT / "B1" / "d.txt.xz"
    flat.parent.mkdir(parents=True)
    flat.write_bytes(lzma.compress(walk_text(T0_MS, floor="B1").encode()))
    plan_files(folder / "metadata" / SITE / "F1")
    yield folder
    for each in (buildings._indexed, buildings._plan, environment._played_walks, environment._survey, sources._sites):
        each.cache_clear()


def zipped(folder: Path) -> Path:
    return Path(shutil.make_archive(str(folder), "zip", folder))


@pytest.mark.parametrize("as_zip", [False, True])
def test_a_copy_is_indexed_and_remembered(download: Path, as_zip: bool) -> None:
    place = zipped(download) if as_zip else download
    facts, lines = add_kaggle_iln(place, print)
    assert facts["buildings"] == [
        {"site": SITE, "walks": 3, "levels": [0], "levels_of_plan": [0]},
        {"site": FLAT, "walks": 1, "levels": [-1], "levels_of_plan": []},
    ]
    assert len(facts["problems"]) == 1 and "bad.txt: line 1" in facts["problems"][0]
    assert "4 walks in 2 buildings, 1 of them with a plan" in lines[-1]
    assert sources.sources() == (place.resolve(),)
    task = environment.task()
    walks = [walk for split in task.walks.values() for walk in split if walk != environment.NO_WALK]
    assert len(walks) == 4
    recording = task.load(next(walk for walk in walks if environment.played_walk(walk).walk.name == "a"))
    assert recording.building is not None
    assert recording.building.area_m2 == pytest.approx(60 * 40 - 100)
    assert recording.building.contains(np.array([[25.0, 25.0], [25.0, 15.0]]), 0).tolist() == [False, True]


def test_a_forked_process_reads_an_archive_by_itself(download: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    place = str(zipped(download))
    mine = sources._archive(place)
    assert sources._archive(place) is mine
    monkeypatch.setattr(sources.os, "getpid", lambda: -1)
    assert sources._archive(place) is not mine


def test_surveys_are_of_other_outings(download: Path) -> None:
    near = download / "train" / SITE / "F1" / "a.txt"
    (near.with_name("near.txt")).write_text(walk_text(T0_MS + 300_000))  # five minutes after the first walk
    add_kaggle_iln(download, print)
    by_name = {played.walk.name: played for played in environment.played_walks().values() if played.site == SITE}
    assert {name: [path[-1] for path in one.survey] for name, one in by_name.items()} == {
        "a": ["b", "c"], "near": ["b", "c"], "b": ["a", "c", "r"], "c": ["a", "b", "r"],
    }  # fmt: skip
    assert environment.density(by_name["a"]) == "survey within 3 m"
    survey = environment._radio_map(environment.task_lost().load(id_of("a")))
    assert survey is not None and sorted(set(survey.xy_m[:, 1].tolist())) == [6.0, 7.0]
    task_file = download / "task.toml"
    task_file.write_text(f'[[walk]]\nfile = "{near}"\n[survey]\nwalks = ["a"]\nfile = "train/{SITE}"\n')
    walks = walks_of_file(task_file)
    survey = walks.task.radio_map(walks.task.load("a"))
    assert survey is not None and sorted(set(survey.xy_m[:, 1].tolist())) == [6.0, 7.0]
    assert "2 of 3 files: the others are of its own outing" in walks.notes[-1]
    path, notes = write_draft([download / "train" / SITE], TaskFile(), WalkTable(file=""), download / "out")
    assert "played: F1/b.txt" in notes[0] and list(walks_of_file(path).facts) == ["b"]
    with pytest.raises(RecordingError, match="name one building"):
        write_draft([download / "train"], TaskFile(), WalkTable(file=""), download / "out")
    assert id_of("d") not in [walk for split in environment.task_lost().walks.values() for walk in split]


def id_of(name: str) -> str:
    return next(walk for walk, played in environment.played_walks().items() if played.walk.name == name)


def test_the_split_of_a_building_does_not_depend_on_others() -> None:
    names = [f"{number:024x}" for number in range(2000)]
    splits = [environment.split_of(name) for name in names]
    assert splits == [environment.split_of(name) for name in reversed(names)][::-1]
    for split, fraction in (("test", 0.5), ("val", 0.15), ("train", 0.35)):
        spread = math.sqrt(fraction * (1 - fraction) / len(names))
        assert abs(splits.count(split) / len(names) - fraction) < 4 * spread


def test_without_a_copy_the_walk_says_how_to_get_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("PDRBENCH_DATA", raising=False)
    monkeypatch.setenv("PDRBENCH_CACHE", str(tmp_path / "cache"))
    task = environment.task()
    with pytest.raises(DatasetError, match="pdrbench data add kaggle_iln FOLDER"):
        task.load(task.split("test")[0])


def test_what_is_no_copy_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PDRBENCH_CACHE", str(tmp_path / "cache"))
    with pytest.raises(DatasetError, match=r"expected SITE/FLOOR/WALK\.txt"):
        sources.add(tmp_path)
    torn = tmp_path / "torn.zip"
    with zipfile.ZipFile(torn, "w") as archive:
        archive.writestr("train/a/F1/a.txt", walk_text(T0_MS))
    torn.write_bytes(torn.read_bytes()[:-40])
    with pytest.raises(DatasetError, match="no folder and no zip archive"):
        sources.add(torn)
    with pytest.raises(DatasetError, match="no folder and no zip archive"):
        sources.add(tmp_path / "absent")
