"""BuildingSite-v1 and BuildingSiteDrift-v1."""

from __future__ import annotations

import numpy as np
import pytest

from pdrbench.metrics.position import percentile
from pdrbench_lab.papers.koeping2012.building_site import environment as building_site
from pdrbench_lab.papers.koeping2012.building_site.environment import DRIFT, IID, SPLITS

TASKS = {IID: building_site.task(), DRIFT: building_site.task_drift()}


@pytest.mark.parametrize("env", TASKS)
def test_splits_and_briefings(env: str) -> None:
    task = TASKS[env]
    assert {split: len(walks) for split, walks in task.walks.items()} == {"train": 8, "val": 4, "test": 20}
    assert task.start == "unknown" and task.period_s == 1.0
    assert task.brief(task.load(task.split("train")[0])).start is None
    assert all(walk.startswith("test-") and len(walk) == 17 for walk in task.split("test"))


def test_both_have_the_same_walks() -> None:
    for split in SPLITS:
        one, other = (task.load(task.split(split)[1]) for task in TASKS.values())
        assert one.reference.xy_m.tobytes() == other.reference.xy_m.tobytes()
        assert one.building == other.building
        assert one.streams["position"].rows.tobytes() != other.streams["position"].rows.tobytes()


@pytest.mark.parametrize("split", list(SPLITS))
def test_every_walk_takes_three_minutes_through_rooms(split: str) -> None:
    task = TASKS[DRIFT]
    for walk in task.split(split):
        recording = task.load(walk)
        building, reference = recording.building, recording.reference
        assert np.array_equal(reference.t_s, np.arange(181.0))
        assert building.contains(reference.xy_m, reference.level).all()
        speed_mps = np.hypot(*np.diff(reference.xy_m, axis=0).T)
        assert speed_mps.max() < 2.2 and percentile(speed_mps, 0.9) > 0.8
        assert len(set(building.locate(reference.xy_m, reference.level))) >= 4
        assert np.array_equal(recording.streams["position"].t_s, reference.t_s)
