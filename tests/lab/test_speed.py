"""What the benches share, and those without a test beside their subject: rows, turns, what is compared with what."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable

import pytest

from pdrbench_lab.speed import environment, evaluation, processes
from pdrbench_lab.speed.timing import Timing, median_s


def test_things_take_turns_and_preparing_is_not_timed() -> None:
    order: list[str] = []

    def thing(name: str) -> Callable[[], Callable[[], object]]:
        def prepare() -> Callable[[], object]:
            time.sleep(0.05)
            return lambda: order.append(name)

        return prepare

    taken = median_s({"a": thing("a"), "b": thing("b")}, 3)
    assert order == ["a", "b"] * 3
    assert max(taken.values()) < 0.04


def test_a_row_has_json_types_only() -> None:
    row = dataclasses.asdict(Timing("full_step", 50.0, "M particles/s", "NumPy", 3.0))
    assert row == {"name": "full_step", "value": 50.0, "unit": "M particles/s", "against": "NumPy", "ratio": 3.0}


def checked(rows: list[Timing]) -> dict[str, Timing]:
    assert all(row.value > 0 and (row.ratio is None or (row.ratio > 0 and row.against)) for row in rows)
    return {row.name: row for row in rows}


def test_the_bench_of_environments_has_its_rows() -> None:
    rows = checked(environment.run(True, lambda line: None))
    assert set(rows) == {"step", "import"}
    assert rows["step"].ratio < 1  # type: ignore[operator]  # a step costs more than one that does nothing


def test_the_bench_of_evaluation_has_its_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(evaluation, "WALKS", {True: 6})
    rows = checked(evaluation.run(True, lambda line: None))
    assert set(rows) == {"cold", "warm", "stored", "again"}


def test_the_bench_of_processes_has_its_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(processes, "KINDS", ("process",))
    rows = checked(processes.run(True, lambda line: None))
    assert all(name.startswith(("step_", "start_")) for name in rows)
