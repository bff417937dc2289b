"""Simulated walks whose truth is public are made once; others are never on the disk."""

from __future__ import annotations

import dataclasses

import pytest

from pdrbench.process.serialise import encoder
from pdrbench.registry import make_task
from pdrbench_envs import kept

ENV = "CampusStride-v1"


@pytest.fixture
def made(monkeypatch, tmp_path) -> list[str]:
    """Walks that were made, in their order, with a cache folder of this test."""
    monkeypatch.setenv("PDRBENCH_CACHE", str(tmp_path))
    kept.kept_folder.cache_clear()
    names: list[str] = []

    task = make_task(ENV)
    counting = dataclasses.replace(task, load=lambda walk: names.append(walk) or task.load(walk))
    monkeypatch.setattr(kept, "make_task", lambda name: counting)
    yield names
    kept.kept_folder.cache_clear()


def test_only_walks_whose_truth_is_public_are_kept_and_they_are_the_same_to_the_bit(made, tmp_path) -> None:
    task, walk, bytes_of = kept.kept_task(ENV), "train-00", encoder().encode
    first, again = task.load(walk), kept.kept_task(f"pdrbench/{ENV}").load(walk)
    assert made == [walk]
    assert bytes_of(first) == bytes_of(again) == bytes_of(make_task(ENV).load(walk))
    assert bytes_of(task.brief(first)) == bytes_of(make_task(ENV).brief(first))
    for file in tmp_path.rglob(f"{walk}.*"):
        file.write_bytes(b"torn")
    assert bytes_of(kept.kept_task(ENV).load(walk)) == bytes_of(first)
    test = task.split("test")[0]
    task.brief(task.load(test))
    task.load(test)
    assert made == [walk, walk, test, test]
    assert not list(tmp_path.rglob(f"{test}*"))
