"""Windows: known walks, the same numbers for any number of workers, nothing of splits whose truth is not public."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import pdrbench
from pdrbench.errors import PdrbenchError
from pdrbench.recording import Recording, SensorStream
from pdrbench.registry import make_task
from pdrbench.sensors import sensor_spec
from pdrbench.trajectory import Trajectory
from pdrbench_envs import kept, kept_windows

ENV = "CampusPhone-v1"
SPEED_MPS = {"train-00": [0.5, 0.0], "train-01": [0.0, 1.0], "train-02": [0.5, 0.0]}


def walk_of(name: str) -> Recording:
    """Twenty seconds straight ahead, with a phone whose top edge points east and that sways along it."""
    t_s, half = np.arange(0, 20.001, 0.01), np.sqrt(0.5)
    sway = np.sin(2 * np.pi * t_s)
    east = np.column_stack([t_s, 0 * t_s, sway, 9.81 + 0 * t_s])
    rotation = np.column_stack([t_s, np.tile([half, 0, 0, -half], (len(t_s), 1))])
    rows = {"accel": east, "gyro": np.column_stack([t_s, 0 * east[:, 1:]]), "rotation": rotation}
    if name == "train-02":
        rows["gyro"] = rows["gyro"][(t_s < 9.9) | (t_s > 10.4)]
    at_s = np.arange(21.0)
    places = Trajectory(at_s, np.outer(at_s, SPEED_MPS[name]), np.zeros(21, np.int64), np.ones(21, np.bool_))
    streams = {sensor: SensorStream(sensor_spec(sensor), one) for sensor, one in rows.items()}
    return Recording(name, None, streams, places, device="b" if name == "train-01" else "a")


@pytest.fixture
def data(monkeypatch, tmp_path):
    monkeypatch.setenv("PDRBENCH_CACHE", str(tmp_path))
    kept.kept_folder.cache_clear()
    task = dataclasses.replace(make_task(ENV), walks={"train": tuple(SPEED_MPS), "val": ("val-00",)}, load=walk_of)
    monkeypatch.setattr(kept_windows, "make_kept_task", lambda name: task)
    yield lambda **settings: pdrbench.windows(ENV, **settings)
    kept.kept_folder.cache_clear()


def test_inputs_are_level_and_targets_are_how_far_the_walk_went(data) -> None:
    windows = data(stride_s=0.5, length_s=2.0)
    inputs, targets = windows[np.arange(len(windows))]
    names, walk = windows.groups("walk")
    assert inputs.shape == (len(windows), 6, 100)
    assert names == [f"{ENV} {name}" for name in SPEED_MPS]
    np.testing.assert_allclose(targets, 2.0 * np.array(list(SPEED_MPS.values()))[walk], atol=1e-5)
    assert (walk == 0).sum() - (walk == 2).sum() == 5, "those that would hold the gap"
    at_s = 0.01 + np.arange(100) * 0.02  # the middle of each cell, since windows begin with whole periods of 1 s
    np.testing.assert_allclose(inputs[0, 0], np.sin(2 * np.pi * at_s), atol=0.01)
    np.testing.assert_allclose(inputs[0, 1:3].T, np.tile([0.0, 9.81], (100, 1)), atol=1e-4)
    assert data(frame="device")[0][0][1].max() > 0.9, "the sway is along y of the phone"
    np.testing.assert_allclose(data(length_s=2.0, target="velocity")[0][1], [0.5, 0.0], atol=1e-5)
    np.testing.assert_allclose(np.hypot(*data(target="heading")[:5][1].T), 1.0, atol=1e-6)


def test_changes_follow_from_the_seed_and_the_windows_asked_for_together(data, tmp_path) -> None:
    def noisy(inputs, targets, rng, about):
        return inputs + rng.normal(size=inputs.shape) * (np.array(about.device) == "b")[:, None, None], targets

    plain, windows = data(), data().changed(noisy, seed=3)
    batches = plain.batches(32, count=3)
    first, again = [windows[one][0] for one in batches], [windows[one][0] for one in batches[::-1]]
    assert all(np.array_equal(a, b) for a, b in zip(first, again[::-1], strict=True))
    assert not np.array_equal(first[0], windows.changed(noisy, seed=4)[batches[0]][0])
    is_changed = (windows[:][0] != plain[:][0]).all(axis=(1, 2))
    devices, device = plain.groups("device")
    assert [devices[one] == "b" for one in device] == is_changed.tolist()
    assert len(list((tmp_path / "windows").glob("*/*"))) == 1, "one folder, and nothing half made"


def test_groups_are_left_out_and_drawn_evenly(data) -> None:
    windows = data()
    for name, rest, left in windows.leave_one_out("person"):
        assert left.groups("person")[0] == [name]
        assert name not in rest.groups("person")[0]
        assert len(left) + len(rest) == len(windows)
    (batch,) = windows.batches(2000, ("device", "walk"), count=1)
    drawn = windows.groups("walk")[1][batch]
    np.testing.assert_allclose(np.bincount(drawn) / 2000, [0.25, 0.5, 0.25], atol=0.05)  # 4.5 sigma


def test_truth_that_is_not_public_and_what_cannot_be_meant_are_refused(data) -> None:
    for settings, why in (
        ({"split": "test"}, "train and val only"),
        ({"split": "heldout"}, "train and val only"),
        ({"target": "displacment"}, "did you mean 'displacement'"),
        ({"stride_s": 0.015}, "no whole samples"),
        ({"sensors": ("baro",)}, "has no 'baro'"),
    ):
        with pytest.raises(PdrbenchError, match=why):
            data(**settings)
