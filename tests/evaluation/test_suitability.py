"""Localizers that decline an environment are found without playing, and remembered by the code of both."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from pdrbench.evaluation import evaluate, suitability
from pdrbench.evaluation.store import keep_whole
from pdrbench.evaluation.suitability import declining
from pdrbench.registry import make_task

NAMES = ("stay", "dead_reckoning", "wifi_knn", "li2012?map=false", "oracle")


@pytest.fixture(autouse=True)
def cache(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    monkeypatch.setenv("PDRBENCH_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def test_who_declines_is_what_playing_says() -> None:
    found = declining(NAMES, "CampusStride-v1", "val")
    results = evaluate(NAMES[:4], "CampusStride-v1", split="val", walks=1, seeds=1, isolation="none").results
    assert found == {result.localizer: result.failure for result in results if result.status == "unsuitable"}
    assert "stay" not in found and "needs the sensor 'wifi'" in found["wifi_knn"]
    assert "needs the reference" in declining(["oracle"], "CampusStride-v1", "test")["oracle"]


def test_it_is_tried_once_and_again_where_the_split_is_another(monkeypatch: pytest.MonkeyPatch, cache: Path) -> None:
    tried: list[str] = []
    reason = suitability._reason
    monkeypatch.setattr(suitability, "_reason", lambda name, *rest: tried.append(name) or reason(name, *rest))
    names = ("stay", "wifi_knn")
    first = declining(names, "CampusStride-v1", "val")
    assert set(tried) == set(names)
    tried.clear()
    assert declining(names, "CampusStride-v1", "val") == first and not tried
    declining(names[:1], "CampusStride-v1", "train")
    assert tried == ["stay"]
    (cache / "suitability.json").write_text("torn")
    assert declining(names, "CampusStride-v1", "val") == first


def test_a_localizer_that_takes_one_of_the_first_walks_suits(monkeypatch: pytest.MonkeyPatch) -> None:
    first = make_task("CampusStride-v1").split("val")[0]
    monkeypatch.setattr(
        suitability, "_reason", lambda name, episode, split: "not this" if episode.recording.id == first else ""
    )
    assert declining(["stay"], "CampusStride-v1", "val") == {}


def test_code_of_strangers_is_not_loaded(tmp_path: Path) -> None:
    (tmp_path / "loud.py").write_text("raise SystemExit('loaded')\n")
    assert declining([f"{tmp_path / 'loud.py'}:Loud"], "CampusStride-v1", "val") == {}


def test_how_long_a_run_takes_is_said_before_and_learned(capsys: pytest.CaptureFixture[str], cache: Path) -> None:
    for known, said in (
        ('{"stay on CampusStride-v1": 7200.0}', "4 h"),
        ("torn", "6 s"),
        ('{"stay on Other-v1": 1.0}', "1 s"),
    ):
        keep_whole(cache / "durations.json", known.encode())
        evaluate("stay", "CampusStride-v1", split="val", walks=2, isolation="none", progress=True)
        assert f"2 walks, about {said}\n" in capsys.readouterr().err
        assert 0.0 < json.loads((cache / "durations.json").read_text())["stay on CampusStride-v1"] < 7200.0
