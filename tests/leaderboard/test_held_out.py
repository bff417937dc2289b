"""Held-out walks: only the holder of the secret can make them, and it leaves the public ones as they are."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest

import pdrbench
from pdrbench.errors import PdrbenchError, UnknownNameError
from pdrbench.evaluation import evaluate
from pdrbench.registry import environments, make_task
from pdrbench.task import HELD_OUT, Task, commitment

from .conftest import STAY

SECRET = "c0ffee" * 8
OTHER = "decade" * 8
PRODUCT = [name for name, entry in environments().items() if entry.package == "pdrbench"]
GENERATED = [name for name in PRODUCT if make_task(name).held_out is not None]


def rows_of(task: Task, walk: str) -> bytes:
    recording = task.load(walk)
    return b"".join(stream.rows.tobytes() for _, stream in sorted(recording.streams.items()))


def test_every_environment_has_generated_walks_or_replays() -> None:
    assert set(GENERATED) >= {name for name in PRODUCT if make_task(name).source == "generated"}
    for name in set(PRODUCT) - set(GENERATED):
        task = make_task(name, SECRET)
        assert len(task.split(HELD_OUT)) == len(task.split("test")) * (2 if len(task.split("test")) < 8 else 1)


def test_a_secret_gives_walks_of_its_own() -> None:
    env = "CampusStride-v1"
    public, task, other = make_task(env), make_task(env, SECRET), make_task(env, OTHER)
    walks = task.split(HELD_OUT)
    assert HELD_OUT not in public.walks
    assert len(walks) == len(set(walks)) >= 4
    assert not set(walks) & set(other.split(HELD_OUT))
    first, second = rows_of(task, walks[0]), rows_of(other, other.split(HELD_OUT)[0])
    assert first != second
    assert first == rows_of(make_task(env, SECRET), walks[0])
    test = public.split("test")[0]
    assert rows_of(task, test) == rows_of(public, test)
    assert first != rows_of(public, test)
    recording = task.load(walks[0])
    assert recording.id == walks[0]
    if task.start != "unknown":
        assert np.hypot(*(task.brief(recording).start.xy_m - recording.reference.xy_m[0])) < 3.0


@pytest.mark.parametrize("env", GENERATED)
def test_no_delivered_object_holds_the_secret(env: str) -> None:
    task = make_task(env, SECRET)
    for text in (repr(task.split(HELD_OUT)), repr(make_task(env)), task.description):
        assert SECRET not in text
    with pytest.raises(UnknownNameError):
        make_task(env).load(task.split(HELD_OUT)[0])


def test_a_short_secret_is_refused_and_the_oracle_is_given_no_truth() -> None:
    with pytest.raises(PdrbenchError, match="32 characters"):
        make_task("ToyDeaf-v1", "short")
    with pytest.raises(PdrbenchError, match="secret goes with"):
        evaluate(STAY, "ToyDeaf-v1", split=HELD_OUT, seeds=1)
    with pytest.raises(PdrbenchError, match="secret goes with"):
        evaluate(STAY, "ToyDeaf-v1", secret=SECRET, seeds=1)
    results = evaluate("oracle", "Toy-v1", split=HELD_OUT, secret=SECRET, walks=1, seeds=1)
    assert results.results[0].status == "unsuitable"


def test_results_name_the_commitment_and_no_file_holds_the_secret(tmp_path: Path) -> None:
    results = evaluate(STAY, "Toy-v1", split=HELD_OUT, secret=SECRET, walks=2, out=tmp_path, seeds=1)
    assert [result.split for result in results.results] == [HELD_OUT, HELD_OUT]
    assert {result.provenance["held_out"] for result in results.results} == {
        hashlib.sha256(SECRET.encode()).hexdigest()
    }
    assert commitment(SECRET) == hashlib.sha256(SECRET.encode()).hexdigest()
    row = results.rows()[0]
    assert row["metrics"]["mean_m"]["value"] > 0
    assert SECRET not in repr(results)
    for path in tmp_path.rglob("*"):
        assert not path.is_file() or SECRET.encode() not in path.read_bytes()
    with pytest.raises(UnknownNameError):
        pdrbench.score(results.results[0])
