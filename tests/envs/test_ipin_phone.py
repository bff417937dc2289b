"""IpinPhone-v1: routes parted, walks begun at their first landmark, a survey of other routes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pdrbench.errors import DatasetError
from pdrbench.registry import make_task
from pdrbench_envs import ipin_phone

ENV = "IpinPhone-v1"


def test_it_can_be_listed_without_data(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PDRBENCH_DATA", str(tmp_path))
    monkeypatch.setenv("PDRBENCH_CACHE", str(tmp_path))
    task = make_task(ENV)
    assert {split: len(walks) for split, walks in task.walks.items()} == {"train": 4, "val": 4, "test": 8}
    assert not any("02" in walk.split("-")[1:] for walk in task.split("test"))  # opaque
    assert "unconfirmed" in task.licence
    with pytest.raises(DatasetError, match="Zenodo"):
        task.load(task.split("val")[0])


@pytest.mark.data
def test_a_walk_begins_at_its_first_landmark(data_root: Path) -> None:
    if not (data_root / ipin_phone.DATASET).is_dir():
        pytest.skip("ipin2023_track3 not found")
    task = make_task(ENV)
    walk = task.load("val-23-01")
    start = task.tell_start(walk)
    assert start.level == -2 and start.heading_rad is None
    assert walk.reference.t_s[0] == 0.0 and not walk.reference.surveyed[0] and walk.reference.surveyed[1:].all()
    assert all(0.0 <= stream.t_s[0] < 6.0 for stream in walk.streams.values())
    assert 80.0 < walk.end_s < 90.0  # the recording has 147 s, the first 61 s lie before the landmark
    radio_map = task.radio_map(walk)
    assert radio_map is not None and len(np.unique(radio_map.walk)) == 6  # two each of routes 01, 21 and 03
