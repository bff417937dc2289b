from __future__ import annotations

import json
from types import SimpleNamespace
from typing import Any

import pytest

from pdrbench.bench import Timing
from pdrbench.cli import main


def fake(quick: bool, tell: Any) -> list[Timing]:
    tell("working")
    return [Timing("one", 1.0 if quick else 2.0, "s", "two", 0.5), Timing("two", 3.0, "s")]


@pytest.fixture
def stopwatch(monkeypatch: pytest.MonkeyPatch) -> None:
    table = {"fake": SimpleNamespace(load=lambda: fake)}
    monkeypatch.setattr("pdrbench.registry.entries", lambda group: table)


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    out, err = capsys.readouterr()
    return int(stop.value.code or 0), out, err


@pytest.mark.usefixtures("stopwatch")
def test_json_is_the_answer_and_nothing_else(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, err = run(capsys, "bench", "fake", "--quick", "--json")
    assert status == 0
    one, two = json.loads(out)["results"]
    assert one == {"name": "one", "value": 1.0, "unit": "s", "against": "two", "ratio": 0.5}
    assert two["ratio"] is None
    assert "working" in err


@pytest.mark.usefixtures("stopwatch")
def test_a_table_for_people(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = run(capsys, "bench", "fake")
    assert status == 0
    assert "0.5 x" in out


def test_an_unknown_bench(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, err = run(capsys, "bench", "particels")
    assert status == 1
    assert not out
    assert "particles" in err


@pytest.mark.slow
def test_warm_up_says_how_long_it_took(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = run(capsys, "warm-up", "--json")
    assert status == 0
    assert all(item["seconds"] > 0 for item in json.loads(out)["items"])
