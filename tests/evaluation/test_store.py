"""Result files."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from pdrbench.errors import ResultError
from pdrbench.evaluation import store
from pdrbench.result import FAILED, OFFLINE, Result
from pdrbench.trajectory import Estimates


@pytest.fixture
def result(rng: np.random.Generator) -> Result:
    xy_m = rng.normal(size=(5, 2))
    xy_m[2] = np.nan
    return Result(
        env="Corridor-v0",
        split="test",
        walk="walk 7",
        localizer="path/to/file.py:Good",
        seed=3,
        estimates=Estimates(
            t_s=np.arange(5) * 0.2,
            xy_m=xy_m,
            level=np.array([0.0, 1.0, np.nan, -1.0, 2.0]),
            heading_rad=np.full(5, np.nan),
            sigma_m=np.array([1.0, -1.0, np.inf, 0.0, np.nan]),
            converged=np.array([0.0, 0.0, np.nan, 1.0, np.nan]),
        ),
        step_s=rng.random(5),
        reset_s=0.25,
        status=FAILED,
        failure="Traceback …\nZeroDivisionError",
        missing={"nan": 1},
        provenance={"parameters": {"noise_m": 0.5}, "versions": {"numpy": "2.0"}},
        division=OFFLINE,
        revise_s=1.5,
    )


def assert_same(one: Result, other: Result) -> None:
    for field in dataclasses.fields(Result):
        if field.name in ("estimates", "step_s", "reset_s", "revise_s"):
            continue
        assert getattr(one, field.name) == getattr(other, field.name), field.name
    np.testing.assert_array_equal(
        [one.reset_s, one.revise_s, *one.step_s], [other.reset_s, other.revise_s, *other.step_s]
    )
    for field in dataclasses.fields(Estimates):  # answers are stored in steps of 0.1 mm and 0.1 mrad
        were = getattr(other.estimates, field.name)
        np.testing.assert_allclose(getattr(one.estimates, field.name), were, rtol=0, atol=0.5001e-4)


def test_a_result_comes_back_as_it_was_and_is_the_same_bytes_each_time(result: Result, tmp_path: Path) -> None:
    store.write_whole(tmp_path / "a.result", store.encode(result))
    assert_same(store.load(tmp_path / "a.result"), result)
    assert [path.name for path in tmp_path.iterdir()] == ["a.result"]
    swapped = dataclasses.replace(result, provenance=dict(reversed(result.provenance.items())))
    assert store.encode(result) == store.encode(swapped)


def test_a_result_without_answers_comes_back(result: Result, tmp_path: Path) -> None:
    none = np.zeros(0)
    empty = dataclasses.replace(
        result,
        estimates=Estimates(none, np.zeros((0, 2)), none, none, none, none),
        step_s=none,
        reset_s=math.nan,
        revise_s=math.nan,
    )
    store.write_whole(tmp_path / "a.result", store.encode(empty))
    assert_same(store.load(tmp_path / "a.result"), empty)


def test_revised_estimates_are_kept_beside_the_answers(result: Result) -> None:
    moved = dataclasses.replace(result.estimates, xy_m=result.estimates.xy_m + 1.0)
    both = dataclasses.replace(result, revised=moved)
    found = store.decode(store.encode(both), "x")
    assert_same(dataclasses.replace(found, revised=None), result)
    assert found.revised is not None and store.decode(store.encode(result), "x").revised is None
    np.testing.assert_allclose(found.revised.columns, moved.columns, rtol=0, atol=0.5001e-4)


def test_a_third_division_and_provenance_that_json_cannot_hold_are_refused(result: Result, tmp_path: Path) -> None:
    with pytest.raises(ResultError, match="online or offline; got 'late'"):
        dataclasses.replace(result, division="late")
    with pytest.raises(ResultError, match=r"walk 'walk 7'.*JSON"):
        store.write_whole(tmp_path / "a.result", store.encode(dataclasses.replace(result, provenance={"x": object()})))


def test_every_cut_and_every_changed_byte_is_noticed(result: Result, tmp_path: Path) -> None:
    content = store.encode(result)
    path = tmp_path / "a.result"
    for length in range(0, len(content), 7):
        path.write_bytes(content[:length])
        with pytest.raises(ResultError, match=r"a\.result is (torn|no result)"):
            store.load(path)
    for place in range(0, len(content), 7):
        path.write_bytes(content[:place] + bytes([content[place] ^ 1]) + content[place + 1 :])
        with pytest.raises(ResultError, match=r"a\.result is (torn|no result)"):
            store.load(path)


def test_a_missing_file_or_folder_is_an_error(tmp_path: Path, result: Result) -> None:
    with pytest.raises(ResultError, match="No such file"):
        store.load(tmp_path / "nothing.result")
    with pytest.raises(ResultError, match="No such file"):
        store.write_whole(tmp_path / "nowhere" / "a.result", store.encode(result))


def test_an_old_result_survives_a_write_that_fails(
    result: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.result"
    store.write_whole(path, store.encode(result))
    before = path.read_bytes()

    def fail(handle: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", fail)
    with pytest.raises(ResultError, match="No space left on device"):
        store.write_whole(path, store.encode(dataclasses.replace(result, seed=4)))
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["a.result"]


def test_keys_ignore_order_and_names_are_fit_for_a_file_system() -> None:
    key = store.result_key({"a": 1, "b": {"c": 2.5, "d": "x"}})
    assert key == store.result_key({"b": {"d": "x", "c": 2.5}, "a": 1})
    assert key != store.result_key({"a": 1, "b": {"c": 2.5, "d": "y"}})
    assert len(key) == 64
    name = store.result_name("A-v0", "/very/long/" + "x" * 300 + ".py:Class", "walk 7/odd", 3, "f" * 64)
    assert len(name) < 200
    assert "/" not in name
    assert " " not in name
    assert name.endswith(".s3." + "f" * 20 + ".result")
