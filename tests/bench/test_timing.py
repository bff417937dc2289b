from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable

import pytest

from pdrbench.bench import BENCHES, Timing
from pdrbench.bench.timing import median_s
from pdrbench_formats import bench as readers


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


def test_the_bench_of_readers_has_its_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(readers, "QUICK", 0.01)
    rows = {row.name: row for row in readers.run(True, lambda line: None)}
    assert {"getsensordata", "sensor logger, iOS", "sensor logger, JSON", "phyphox", "androsensor", "xio", "csv"} < set(
        rows
    )
    assert all(row.value > 0 and row.ratio and row.against for row in rows.values())


@pytest.mark.long(seconds=10)
def test_the_particle_bench_has_its_rows() -> None:
    """Every row of the table, from a small run; ratios are positive and name their denominator."""
    from pdrbench_lab.papers.woodman2008.bench import run

    lines: list[str] = []
    rows = {row.name: row for row in run(True, lines.append)}
    wanted = {"full_step", "propagate_correct", "tracking_170", "tracking_500", "bandwidth_share", "memory"}
    assert wanted <= set(rows)
    left_out = [line for line in lines if line.startswith("left out the GPU: ")]
    assert len(left_out) == (0 if {"full_step_on_gpu", "tracking_500_on_gpu_256_walks"} <= set(rows) else 1)
    for row in rows.values():
        assert row.value > 0
        assert row.ratio is None or (row.ratio > 0 and row.against)
    assert rows["memory"].value <= 41


def test_every_bench_is_there() -> None:
    assert all(":" in target for target in BENCHES.values())
