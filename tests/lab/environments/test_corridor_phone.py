from __future__ import annotations

import numpy as np
import pytest

from pdrbench.errors import UnknownNameError
from pdrbench_lab.environments import phone_handling
from pdrbench_lab.papers.li2012.corridor_phone import environment as corridor_phone


@pytest.fixture(scope="module")
def task():
    return corridor_phone.task()


def test_splits_have_the_walks_that_were_promised(task):
    assert {split: len(walks) for split, walks in task.walks.items()} == {"train": 32, "val": 8, "test": 40}


def test_both_phones_of_a_lap_have_the_same_walk_and_tap_but_different_briefed_headings(task):
    hand, pocket = (task.load(walk) for walk in task.split("train")[:2])
    assert (hand.mounting, pocket.mounting) == ("hand", "pocket")
    assert hand.reference.xy_m.tobytes() == pocket.reference.xy_m.tobytes()
    starts = [task.brief(recording).start for recording in (hand, pocket)]
    assert starts[0].xy_m.tobytes() == starts[1].xy_m.tobytes()
    assert starts[0].heading_rad is None
    reference = pocket.reference
    moved_m = reference.xy_m[6] - reference.xy_m[0]  # the first three seconds
    off_rad = np.angle(np.exp(1j * (np.arctan2(moved_m[1], moved_m[0]) - starts[1].heading_rad)))
    assert abs(off_rad) < 0.5


def test_no_localizer_is_given_the_pedestrian(task):
    recording = task.load(task.split("test")[0])
    assert set(recording.subject) == {"height_m"}
    assert len(recording.id.removeprefix("test-")) == 12


def test_unknown_walks_are_named(task):
    with pytest.raises(UnknownNameError, match="no walk of CorridorPhone-v1"):
        task.load("train-99")


def test_no_pedestrian_walks_while_the_phone_is_handled():
    task = phone_handling.task()
    recording = task.load(task.split("test")[0])
    assert recording.end_s == pytest.approx(180.0)
    assert np.ptp(recording.reference.xy_m, axis=0).tolist() == [0.0, 0.0]
    start = task.brief(recording).start
    assert 0.0 < np.hypot(*(start.xy_m - recording.reference.xy_m[0])) <= start.radius_m
    others = [task.load(walk).reference.xy_m[0] for walk in task.split("val")]
    assert len(np.unique(others, axis=0)) == len(others)
