"""The file of real values: rounding, round trip, provenance, comparison."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest

from pdrbench.datasets import datasets
from pdrbench.errors import DatasetError, RecordingError
from pdrbench_lab.realism import BLOCKS
from pdrbench_lab.realism.block import Block, Distribution, Order, RealismStatistic, Values
from pdrbench_lab.realism.targets import (
    EMPTY,
    PACKAGED,
    DatasetSource,
    differing,
    encode,
    read_targets,
    reduce,
    source_of,
    with_blocks,
)


def block(**changes: object) -> Block:
    rows = (
        RealismStatistic("x", "an x", "m", "walk", Distribution()),
        RealismStatistic("order", "who is better", "m", "localizer", Order()),
    )
    fields: dict[str, object] = {"name": "Toy", "statistics": rows, "datasets": ("ilc20",)}
    fields |= {"real": lambda part: {}, "synthetic": lambda seed, count: {}, "features": ("x",)}
    return Block(**{**fields, **changes})  # type: ignore[arg-type]


def values(rng: np.random.Generator, count: int = 1000) -> Values:
    return {"x": rng.normal(5, 2, count), "order": np.array([3.0, 1.0, 2.0]), "unused": np.zeros(3)}


def test_many_values_become_quantiles_of_the_same_law(rng: np.random.Generator) -> None:
    found = values(rng)
    kept = reduce(block(), found).statistics["x"]
    assert kept.num == 1000 and len(kept.values) == 200 and kept.values == sorted(kept.values)
    at = np.linspace(-1, 11, 500)[:, None]
    exact, stored = ((at >= np.asarray(side)).mean(axis=1) for side in (found["x"], kept.values))
    assert np.abs(exact - stored).max() <= 1 / 400 + 1 / 1000  # half a step of either


def test_few_values_are_kept_sorted_and_the_order_as_it_is(rng: np.random.Generator) -> None:
    kept = reduce(block(), {**values(rng), "x": np.array([2.00004, np.nan, 1.23456])})
    assert kept.statistics["x"].values == [1.235, 2.0] and kept.statistics["x"].num == 2
    assert kept.statistics["order"].values == [3.0, 1.0, 2.0]
    assert kept.features["x"] == [2.0, None, 1.235]  # by walk: unsorted, gaps kept


def test_an_infinite_value_is_refused(rng: np.random.Generator) -> None:
    with pytest.raises(RecordingError, match="infinite"):
        reduce(block(), {"x": np.array([1.0, np.inf])})


def test_values_read_are_those_written(
    rng: np.random.Generator, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = DatasetSource(source_url="a page", commit="abc", licence="MIT", sha256="0" * 64, num_files=3)
    monkeypatch.setattr("pdrbench_lab.realism.targets.source_of", lambda name: source)
    toy = reduce(block(), values(rng))
    written = with_blocks(EMPTY, {"b": toy, "a": toy}, ["a", "b", "c"])
    path = tmp_path / "targets.json"
    path.write_text(encode(written))
    found = read_targets(path)
    assert found == written and list(found.blocks) == ["a", "b"] and found.datasets == {"ilc20": source}
    assert encode(with_blocks(found, {}, ["b"])).count('"statistics"') == 1  # what is no longer known goes


@pytest.mark.parametrize("text", ["", "{}", "[1]", '{"format": 1, "blocks": {}, "more": 1}', "\x00\xff"])
def test_a_file_that_is_none(tmp_path: Path, text: str) -> None:
    path = tmp_path / "targets.json"
    path.write_text(text, encoding="latin-1")
    with pytest.raises(DatasetError, match=r"targets\.json.*--write-targets"):
        read_targets(path)
    with pytest.raises(DatasetError, match="--write-targets"):
        read_targets(tmp_path / "none.json")


def test_a_later_format_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "targets.json"
    path.write_text(encode(msgspec.structs.replace(EMPTY, format=2)))
    with pytest.raises(DatasetError, match="has format 2"):
        read_targets(path)


def test_differences_are_named(rng: np.random.Generator) -> None:
    found = values(rng)
    stored = reduce(block(), found)
    assert differing(stored, stored) == []
    assert differing(stored, reduce(block(), {**found, "x": found["x"] * (1 + 1e-5)})) == []  # below the rounding
    assert differing(stored, reduce(block(), {**found, "x": found["x"] * 1.02})) == ["x", "x by walk"]
    assert differing(stored, reduce(block(), {**found, "x": found["x"][:-1]})) == ["x", "x by walk"]
    assert differing(stored, reduce(block(), {"x": found["x"]})) == ["order"]
    assert differing(reduce(block(), {"x": found["x"]}), stored) == ["order"]


def test_packaged_values_are_of_registered_blocks_and_sets() -> None:
    if not PACKAGED.is_file():
        pytest.skip("no targets are packaged yet")
    found = read_targets()
    assert set(found.blocks) <= set(BLOCKS)
    for name, source in found.datasets.items():
        assert source.commit == datasets()[name].commit and source.licence == datasets()[name].licence
    for target in found.blocks.values():
        assert set(target.datasets) <= set(found.datasets)
        assert all(len(stored.values) == min(stored.num, 200) for stored in target.statistics.values())


def test_the_source_of_an_available_set(data_root: Path) -> None:
    found = source_of("foot_short")
    assert found.licence == "MIT" and len(found.sha256) == 64 and found.num_files >= 1


def test_a_changed_set_gives_no_targets(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "foot_short").mkdir()
    (tmp_path / "foot_short" / "LICENSE").write_text("none")
    monkeypatch.setenv("PDRBENCH_DATA", str(tmp_path))
    with pytest.raises(DatasetError, match="pdrbench data verify foot_short"):
        source_of("foot_short")
