from __future__ import annotations

import numpy as np

from pdrbench.registry import make_task
from pdrbench_lab.papers.frank2009.wlan_hallway.environment import SPLITS


def test_walks_differ_in_radio_and_walker_and_come_back_the_same() -> None:
    task = make_task("WlanHallway-v1")
    assert {split: len(task.walks[split]) for split in SPLITS} == {"train": 4, "val": 4, "test": 20}
    one, other = (task.load(walk) for walk in task.split("train")[:2])
    assert one.reference.t_s[-1] != other.reference.t_s[-1]
    maps = [task.radio_map(recording) for recording in (one, other)]
    assert not set(maps[0].access_point) & set(maps[1].access_point)  # type: ignore[union-attr]
    again = task.load(task.split("train")[0])
    assert all(stream.rows.tobytes() == again.streams[name].rows.tobytes() for name, stream in one.streams.items())


def test_neither_map_nor_place_is_given() -> None:
    task = make_task("WlanHallway-v1")
    recording = task.load(task.split("train")[0])
    briefing = task.brief(recording)
    assert briefing.building is None and briefing.start is not None and briefing.start.heading_rad is None
    off_m = np.hypot(*(recording.reference.xy_m - briefing.start.xy_m).T)
    assert briefing.start.radius_m > off_m.max()
    known = set(briefing.radio_map.access_point.tolist())  # type: ignore[union-attr]
    received = set(recording.streams["wifi"].column("access_point").astype(int).tolist())
    assert len(received & known) >= 8
