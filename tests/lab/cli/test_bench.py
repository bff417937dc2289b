from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from pdrbench_lab import BENCHES
from pdrbench_lab.speed.timing import Timing


def fake(quick: bool, tell: Any) -> list[Timing]:
    tell("working")
    return [Timing("one", 1.0 if quick else 2.0, "s", "two", 0.5), Timing("two", 3.0, "s")]


def test_a_bench_prints_json_or_a_table(command: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pdrbench_lab.cli.bench.find_entry", lambda *_: SimpleNamespace(load=lambda: fake))
    outcome = command("bench", "fake", "--quick", "--json")
    one, two = outcome.json["results"]
    assert one == {"name": "one", "value": 1.0, "unit": "s", "against": "two", "ratio": 0.5}
    assert two["ratio"] is None
    assert outcome.code == 0 and "working" in outcome.err
    table = command("bench", "fake")
    assert table.code == 0 and "0.5 x" in table.out


def test_without_a_name_the_benches_are_listed(command: Any) -> None:
    items = {item["id"]: item["summary"] for item in command("bench", "--json").json["items"]}
    assert set(BENCHES) <= set(items) and all(items.values())
    assert "particles" in command("bench").out


def test_an_unknown_bench(command: Any) -> None:
    outcome = command("bench", "particels")
    assert (outcome.code, outcome.out) == (1, "") and "particles" in outcome.err


def test_warm_up_prints_its_seconds(command: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    compiled: list[str] = []
    entry = SimpleNamespace(load=lambda: lambda: compiled.append("kernels"))
    monkeypatch.setattr("pdrbench_lab.cli.bench.entries", lambda group: {"some": entry, "others": entry})
    outcome = command("warm-up", "--json")
    assert outcome.code == 0 and [item["id"] for item in outcome.json["items"]] == ["some", "others"]
    assert all(item["seconds"] >= 0 for item in outcome.json["items"]) and len(compiled) == 2
