from __future__ import annotations

import itertools

import numpy as np
import pytest

from pdrbench.episode import Episode
from pdrbench.errors import UnknownNameError
from pdrbench.localizer import Estimate
from pdrbench_envs import office_stride


@pytest.fixture(scope="module")
def task():
    return office_stride.task()


@pytest.fixture(scope="module")
def recordings(task):
    """Two walks of each split."""
    return {split: [task.load(walk) for walk in task.split(split)[:2]] for split in ("train", "val", "test")}


def estimates_of_strides(task, recording) -> dict[float, np.ndarray]:
    """Position over time of a localizer that integrates every stride."""
    episode = Episode(recording, task)
    start = episode.briefing.start
    xy_m, heading_rad = start.xy_m.copy(), start.heading_rad
    found = {}
    while not episode.done:
        observation = episode.observe()
        for _, length_m, _, turn_rad in observation["stride"]:
            heading_rad += turn_rad
            xy_m = xy_m + length_m * np.array([np.cos(heading_rad), np.sin(heading_rad)])
        episode.submit(Estimate(xy_m, 0))
        found[round(observation.now_s, 6)] = xy_m
    return found


def test_splits_have_the_walks_that_were_promised(task):
    assert {split: len(walks) for split, walks in task.walks.items()} == {"train": 24, "val": 10, "test": 20}
    assert task.split("train")[0] == "train-00"
    assert [spec.name for spec in task.sensors] == ["stride"]
    assert task.period_s == 0.2


def test_test_walks_have_opaque_ids_in_an_order_that_reveals_nothing(task):
    ids = task.split("test")
    assert list(ids) == sorted(ids)
    assert all(len(walk.removeprefix("test-")) == 12 for walk in ids)


def test_an_unknown_walk_is_refused_with_the_nearest_id(task):
    with pytest.raises(UnknownNameError, match=r"no walk of OfficeStride-v2.*did you mean .train-"):
        task.load("train-O3")


def test_buildings_and_people_differ_between_splits(recordings):
    for one, other in itertools.combinations(recordings, 2):
        assert not {r.building.sha256 for r in recordings[one]} & {r.building.sha256 for r in recordings[other]}
    assert all(r.building.levels == (0, 1, 2) for split in recordings.values() for r in split)
    assert all(1.5 < r.subject["height_m"] < 1.9 for split in recordings.values() for r in split)


def test_the_reference_is_where_the_foot_rests_when_the_stride_is_delivered(recordings):
    for recording in itertools.chain(*recordings.values()):
        reference, report_times_s = recording.reference, recording.streams["stride"].t_s
        assert reference.t_s[0] == 0
        np.testing.assert_array_equal(reference.surveyed, np.arange(len(reference)) > 0)
        waited_s = reference.t_s[1:] - report_times_s
        assert (waited_s > -1e-6).all()
        assert (waited_s < 0.2).all()
        on_grid = np.round(reference.t_s / 0.2)
        np.testing.assert_allclose(reference.t_s, on_grid * 0.2, rtol=0, atol=1e-9)
        located = recording.building.contains(reference.xy_m, reference.level)
        assert located.all()


def test_a_localizer_that_integrates_error_free_strides_is_right_at_every_reference(task, monkeypatch):
    monkeypatch.setattr(office_stride, "measure", lambda true_rows, rng, errors: true_rows)
    recording = task.load("val-03")
    found = estimates_of_strides(task, recording)
    scored = recording.reference.scored()
    came = np.array([found[t_s] for t_s in scored.t_s])
    # Rounding: N strides each 0.3 mm and, from there on, 0.03 mrad; of 200 strides a few millimetres.
    np.testing.assert_allclose(came, scored.xy_m, atol=0.05)


def test_with_measured_errors_it_drifts_by_metres(task, recordings):
    for recording in recordings["train"]:
        scored = recording.reference.scored()
        found = estimates_of_strides(task, recording)
        error_m = np.hypot(*(np.array([found[t_s] for t_s in scored.t_s]) - scored.xy_m).T)
        # 1.9 % of 150 m out and back, and a heading that drifts by 0.3 degrees a stride.
        assert 0.3 < error_m.max() < 60


def test_the_start_is_given_with_the_heading_of_the_first_stride(task, recordings):
    for recording in itertools.chain(*recordings.values()):
        start = task.brief(recording).start
        first_m = recording.reference.xy_m[1] - recording.reference.xy_m[0]
        # Places are whole millimetres, and the first stride is half a metre or longer
        assert start.heading_rad == pytest.approx(np.arctan2(first_m[1], first_m[0]), abs=3e-3)
        assert start.radius_m == 0
        np.testing.assert_array_equal(start.xy_m, recording.reference.xy_m[0])


def test_walks_take_three_to_five_minutes_and_use_stairs(task):
    for walk in itertools.chain(*(walks[:1] for walks in task.walks.values())):
        recording = task.load(walk)
        assert 170 < recording.end_s < 320, walk
        assert len(set(recording.reference.level.tolist())) > 1, walk
        assert np.ptp(recording.reference.z_m) > 1.5, walk
        assert 90 < len(recording.streams["stride"].rows) < 320, walk
