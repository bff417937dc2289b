from __future__ import annotations

import copy
import dataclasses
import warnings

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.wrappers import FlattenObservation, TimeLimit

from pdrbench.errors import PdrbenchError, UnsuitableError
from pdrbench.gym.env import LocalizationEnv, drive
from pdrbench.gym.wrappers import UNHEARD_DBM, DenseWifi, RelativeAction, StartInObservation
from pdrbench.registry import make_localizer
from pdrbench.trajectory import Start


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


def test_dense_wifi_needs_wifi_and_a_survey(task_maker) -> None:
    with pytest.raises(UnsuitableError, match="'wifi'"):
        DenseWifi(LocalizationEnv(task_maker({"accel": 24})))
    with pytest.raises(UnsuitableError, match="access_points"):
        DenseWifi(LocalizationEnv(task_maker({"wifi": 512}, radio_map=lambda recording: None)))


def test_relative_actions_add_up_and_turn_before_they_move(task_maker) -> None:
    env = RelativeAction(LocalizationEnv(task_maker({"accel": 24})), max_move_m=4.0)
    env.reset(seed=0)
    x_m, y_m, level = env.unwrapped.position
    for action in ([0.25, -0.5, 0.4], [0.0, 0.0, 0.5], [np.nan, 0.0, 1.0], [0.25, -9.0, -0.6]):
        env.step(np.array(action, dtype=np.float32))
    assert env.unwrapped.position == pytest.approx((x_m + 2.0, y_m - 2.0 - 4.0, level))
    env = RelativeAction(LocalizationEnv(task_maker({"accel": 24})), frame="heading", max_move_m=2.0)
    env.reset(seed=0)
    x_m, y_m, level = env.unwrapped.position
    for action in ([0.5, 0.5, 0.0], [0.0, -0.5, 0.0], [1.0, 0.0, 0.0]):  # the start heads for +x
        env.step(np.array(action))
    assert env.unwrapped.position == pytest.approx((x_m + 2.0, y_m + 1.0, level))


def test_relative_actions_refuse_what_they_cannot_do(task_maker) -> None:
    task = task_maker({"accel": 24})
    with pytest.raises(UnsuitableError, match="claims"):
        RelativeAction(LocalizationEnv(task, claims=("sigma",)))
    with pytest.raises(PdrbenchError, match="'heading'"):
        RelativeAction(LocalizationEnv(task), frame="headings")
    with pytest.raises(PdrbenchError, match="positive"):
        RelativeAction(LocalizationEnv(task), max_move_m=0.0)
    env = RelativeAction(LocalizationEnv(task))
    env.reset(seed=0)
    with pytest.raises(PdrbenchError, match="shape"):
        env.step(np.zeros(2))


def test_the_start_is_observed(task_maker) -> None:
    env = StartInObservation(LocalizationEnv(task_maker({"accel": 24})))
    observation, info = env.reset(seed=0)
    start = info["briefing"].start
    expected = [*start.xy_m, start.level, np.cos(start.heading_rad), np.sin(start.heading_rad), 0.0]
    assert observation["start"].tolist() == pytest.approx(expected)
    assert env.step(np.zeros(3))[0]["start"].tolist() == pytest.approx(expected)
    lost = StartInObservation(LocalizationEnv(task_maker({"accel": 24}, start="unknown")))
    observation, info = lost.reset(seed=0)
    middle = info["briefing"].radio_map.middle()
    radius_m = np.hypot(*np.ptp(info["briefing"].radio_map.xy_m, axis=0))
    assert observation["start"].tolist() == [*middle.xy_m, middle.level, 0.0, 0.0, radius_m]


@pytest.fixture
def office_task(task_maker, office):
    """The made-up walks, in an office, from a place on its floor."""
    task = task_maker({"accel": 24})
    place = office.centre()
    return dataclasses.replace(
        task,
        load=lambda walk: dataclasses.replace(task.load(walk), building=office),
        tell_start=lambda recording: Start(place.xy_m, place.level),
    )


def test_a_start_needs_a_dict(phone_task) -> None:
    with pytest.raises(UnsuitableError, match="flatten"):
        StartInObservation(FlattenObservation(LocalizationEnv(phone_task)))


def test_wrappers_combine_in_any_order_and_pass_the_checker(office_task) -> None:
    inside = StartInObservation(RelativeAction(LocalizationEnv(office_task)))
    outside = RelativeAction(StartInObservation(LocalizationEnv(office_task)))
    action = np.array([0.5, 0.25, 0.0], dtype=np.float32)
    for env in (inside, outside):
        env.reset(seed=3)
    first, second = inside.step(action), outside.step(action)
    assert all(np.array_equal(first[0][key], second[0][key]) for key in first[0]) and first[1] == second[1]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        check_env(inside)


def test_whatever_truncates_leaves_a_result_to_ask_for(phone_task) -> None:
    env = TimeLimit(LocalizationEnv(phone_task), 7)
    env.reset(options={"walk": "walk-a"})
    truncated = False
    while not truncated:
        *_, truncated, info = env.step(np.array([1.0, 2.0, 0.0]))
    env.reset()  # as a vector environment does before anybody looks
    result = info["result"]
    assert len(result.estimates) == 7 and result.provenance["truncated"] and info["result"] is result
    assert result.walk == "walk-a"
    with pytest.raises(KeyError, match="elsewhere"):
        info["elsewhere"]
    assert type(copy.copy(env.step(np.zeros(3))[-1])) is dict, "what travels to another process holds no environment"
    driven = drive(make_localizer("stay"), TimeLimit(LocalizationEnv(phone_task), 7), np.random.default_rng(0))
    assert len(driven.estimates) == 7


def test_the_walk_is_named_on_train_and_not_on_test(phone_task) -> None:
    env = LocalizationEnv(phone_task, split="train")
    assert env.walk is None
    env.reset(options={"walk": "walk-c"})
    assert env.walk == "walk-c"
    hidden = LocalizationEnv(phone_task, split="test")
    hidden.reset(seed=0)
    assert hidden.walk is None
