"""PhoneSteps-v1: counts as places."""

from __future__ import annotations

import numpy as np
import pytest

from pdrbench.errors import DatasetError, UnknownNameError
from pdrbench.evaluation import evaluate, score
from pdrbench.registry import make_task
from pdrbench_lab.environments import phone_steps

ENV = "PhoneSteps-v1"


@pytest.fixture
def recorded(data_root):
    if not (data_root / "phone_steps").is_dir():
        pytest.skip("phone_steps not found")


def test_it_can_be_listed_without_data(monkeypatch, tmp_path):
    monkeypatch.setenv("PDRBENCH_DATA", str(tmp_path))
    monkeypatch.setenv("PDRBENCH_CACHE", str(tmp_path))
    task = make_task(ENV)
    assert {split: len(walks) for split, walks in task.walks.items()} == {"train": 12, "test": 24}
    with pytest.raises(DatasetError, match="not available"):
        task.load(task.split("test")[0])
    with pytest.raises(UnknownNameError):
        task.load("test-1")


def test_people_are_parted_and_positions_are_all_there():
    task = make_task(ENV)
    for split, subject in (("train", "A"), ("test", "B")):
        facts = [phone_steps.facts(walk) for walk in task.split(split)]
        assert {fact["subject"] for fact in facts} == {subject}
    positions = {phone_steps.facts(walk)["position"] for split in task.walks for walk in task.split(split)}
    assert positions == set(phone_steps.MOUNTINGS)


def test_the_place_is_the_count(recorded):
    task = make_task(ENV)
    walk = task.load(task.split("train")[0])
    start = task.tell_start(walk)
    counted, aside = (walk.reference.xy_m - start.xy_m).T
    np.testing.assert_array_equal(counted, np.arange(len(counted)))
    assert not aside.any() and start.heading_rad == 0.0
    assert 200 < counted[-1] < 400 and walk.mounting in phone_steps.MOUNTINGS.values()


def test_a_counter_errs_by_few_steps_and_standing_still_by_all(recorded):
    """Errors in metres are steps: the final count errs by at most 3 %, without any step by 100 %."""
    scores: dict[str, list[dict[str, float]]] = {}
    for result in evaluate(
        ["step_count?adapts=false", "stay"], ENV, split="train", walks=2, isolation="none", seeds=1
    ).results:
        scores.setdefault(result.localizer, []).append(score(result))
    assert all(one["drift_pct"] < 3 and one["p95_m"] < 6 for one in scores["step_count?adapts=false"])
    assert all(abs(one["drift_pct"] - 100) < 1 for one in scores["stay"])
