from __future__ import annotations

import warnings

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.wrappers import FlattenObservation

from pdrbench.errors import UnsuitableError
from pdrbench.gym.env import LocalizationEnv
from pdrbench.gym.wrappers import UNHEARD_DBM, DenseWifi


def test_dense_wifi_has_one_value_per_surveyed_access_point(phone_task) -> None:
    env = DenseWifi(LocalizationEnv(phone_task))
    by_walk = [100 + ord(walk[-1]) for walk in phone_task.split("train")]
    assert env.access_points.tolist() == [7, 8, 9, *by_walk]
    assert env.observation_space["wifi_rssi_dbm"].shape == (6,)
    assert "wifi" not in env.observation_space.spaces and "wifi_count" not in env.observation_space.spaces


def test_dense_wifi_agrees_with_the_rows(phone_task) -> None:
    plain, dense = LocalizationEnv(phone_task), DenseWifi(LocalizationEnv(phone_task), access_points=[20, 10, 9999])
    rows, _ = plain.reset(options={"walk": "walk-a"})
    vector, _ = dense.reset(options={"walk": "walk-a"})
    num_received, terminated = 0, False
    while not terminated:
        assert vector in dense.observation_space
        received = rows["wifi"][: int(rows["wifi_count"][0])]
        for place, access_point in enumerate([10, 20, 9999]):
            values = received[received[:, 1] == access_point, 2]
            expected = values[-1] if len(values) else UNHEARD_DBM
            assert vector["wifi_rssi_dbm"][place] == expected
            num_received += len(values) > 0
        assert np.array_equal(vector["accel"], rows["accel"])
        rows, _, terminated, _, _ = plain.step(np.zeros(3))
        vector, *_ = dense.step(np.zeros(3))
    assert num_received > 0


def test_dense_wifi_passes_check_env_and_flattens(phone_task) -> None:
    env = DenseWifi(LocalizationEnv(phone_task), access_points=range(50))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        check_env(env)
    flat = FlattenObservation(env)
    observation, _ = flat.reset(seed=0)
    assert observation.ndim == 1 and observation in flat.observation_space


def test_dense_wifi_needs_wifi_and_a_survey(task_maker) -> None:
    with pytest.raises(UnsuitableError, match="'wifi'"):
        DenseWifi(LocalizationEnv(task_maker({"accel": 24})))
    with pytest.raises(UnsuitableError, match="access_points"):
        DenseWifi(LocalizationEnv(task_maker({"wifi": 512}, radio_map=lambda recording: None)))
