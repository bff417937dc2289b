from __future__ import annotations

import numpy as np
import pytest

from pdrbench.errors import UnknownNameError
from pdrbench.recording import Recording
from pdrbench_envs import office_signals
from pdrbench_envs.office_signals import SPLITS

TASKS = {"foot": office_signals.task_foot, "phone": office_signals.task_phone}


@pytest.fixture(scope="module", params=sorted(TASKS))
def task(request):
    return TASKS[request.param]()


@pytest.fixture(scope="module")
def recording(task) -> Recording:
    return task.load(task.split("val")[0])


def test_splits_have_the_walks_that_were_promised(task):
    assert {split: len(walks) for split, walks in task.walks.items()} == {"train": 32, "val": 8, "test": 16}
    assert task.split("train")[0] == "train-00"
    assert all(len(walk.removeprefix("test-")) == 12 for walk in task.split("test"))


def test_no_person_or_building_is_in_two_splits():
    people, plans = {}, {}
    for split, plan in SPLITS.items():
        for number in range(plan.people):
            people.setdefault(office_signals._person(split, number), set()).add(split)
        for number in range(plan.buildings):
            polygons = office_signals._building(split, number).polygons
            plans.setdefault(b"".join(p.outline_xy_m.tobytes() for p in polygons), set()).add(split)
    assert len(people) == sum(plan.people for plan in SPLITS.values())
    assert len(plans) == sum(plan.buildings for plan in SPLITS.values())


def test_streams_are_those_of_the_task(task, recording):
    assert {name: stream.spec for name, stream in recording.streams.items()} == {
        spec.name: spec for spec in task.sensors
    }
    assert 100.0 < recording.end_s < 245.0


def test_the_radio_map_knows_what_the_phone_receives(task, recording):
    survey = task.radio_map(recording)
    received = np.unique(recording.streams["wifi"].column("access_point"))
    assert np.isin(received, survey.access_point).mean() > 0.9
    assert set(survey.level.tolist()) == {0, 1, 2}


def test_a_foot_rests_at_the_observation_that_it_is_scored_at():
    task = office_signals.task_foot()
    recording = task.load(task.split("val")[0])
    gyro = recording.streams["gyro"].rows
    rate = np.linalg.norm(gyro[:, 1:], axis=1)
    at = np.searchsorted(gyro[:, 0], recording.reference.t_s[1:])
    steps = recording.reference.t_s / task.period_s
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-6)
    # A foot that swings turns by 4 rad/s and more; one that stands rolls over slowly.
    assert np.mean(rate[np.minimum(at, len(rate) - 1)] < 1.5) > 0.9
    assert recording.reference.surveyed[1:].all() and not recording.reference.surveyed[0]


def test_phones_are_carried_in_the_hand_and_in_the_pocket():
    task = office_signals.task_phone()
    carried = [task.load(walk).mounting for walk in task.split("val")[:2]]
    assert sorted(carried) == ["hand", "pocket"]
    start = task.tell_start(task.load(task.split("val")[0]))
    assert start.heading_rad is None


def test_unknown_walks_are_named(task):
    with pytest.raises(UnknownNameError, match=f"no walk of {task.id}"):
        task.load("train-99")
