from __future__ import annotations

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import SyncVectorEnv

from pdrbench.errors import EstimateError, RecordingError, UnknownNameError
from pdrbench.gym.env import LocalizationEnv
from pdrbench.gym.vector import LocalizationVectorEnv

NUM_ENVS = 4


def assert_same(one, two) -> None:
    """Observations of the same bytes."""
    assert one.keys() == two.keys()
    for key in one:
        assert one[key].dtype == two[key].dtype and one[key].shape == two[key].shape
        assert one[key].tobytes() == two[key].tobytes(), key


def result_rows(infos, env):
    estimates = infos["result"][env].estimates
    return np.column_stack([estimates.t_s, estimates.xy_m, estimates.level, estimates.sigma_m, estimates.converged])


@pytest.mark.skipif(
    not hasattr(gymnasium.vector, "AutoresetMode"), reason="SyncVectorEnv has autoreset modes since gymnasium 1.1"
)
@pytest.mark.parametrize(("mode", "split"), [("NextStep", "train"), ("SameStep", "test")])
def test_is_sync_vector_env_step_by_step(phone_task, mode, split) -> None:
    settings = {"task": phone_task, "split": split, "claims": ("sigma", "converged")}
    sync = SyncVectorEnv([lambda: LocalizationEnv(**settings)] * NUM_ENVS, autoreset_mode=mode)
    native = LocalizationVectorEnv(NUM_ENVS, autoreset_mode=mode, **settings)
    assert native.observation_space == sync.observation_space
    assert native.action_space == sync.action_space
    assert native.metadata["autoreset_mode"] == sync.metadata["autoreset_mode"]
    expected, expected_infos = sync.reset(seed=11)
    found, infos = native.reset(seed=11)
    rng = np.random.default_rng(0)
    num_ended = 0
    for _ in range(250):
        assert_same(expected, found)
        assert infos.keys() == expected_infos.keys()
        actions = rng.normal(size=(NUM_ENVS, 5))
        actions[rng.random(NUM_ENVS) < 0.2, 0] = np.nan
        expected, *expected_signals, expected_infos = sync.step(actions)
        found, *signals, infos = native.step(actions)
        for signal, expected_signal in zip(signals, expected_signals, strict=True):
            assert signal.dtype == expected_signal.dtype and np.array_equal(signal, expected_signal)
        for env in np.flatnonzero(signals[1]):
            last, expected_last = (i["final_info"] if mode == "SameStep" else i for i in (infos, expected_infos))
            assert last["_result"][env] and expected_last["_result"][env]
            assert last["result"][env].walk == expected_last["result"][env].walk
            assert result_rows(last, env).tobytes() == result_rows(expected_last, env).tobytes()
            num_ended += 1
            if mode == "SameStep":
                assert_same(infos["final_obs"][env], expected_infos["final_obs"][env])
    assert num_ended > NUM_ENVS


def test_disabled_autoreset_waits_for_a_masked_reset(phone_task) -> None:
    env = LocalizationVectorEnv(2, phone_task, autoreset_mode="Disabled")
    env.reset(seed=0)
    ended = np.zeros(2, dtype=np.bool_)
    while not ended.any():
        _, _, ended, _, _ = env.step(np.zeros((2, 3)))
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(np.zeros((2, 3)))
    observation, infos = env.reset(options={"reset_mask": ended})
    assert (observation["now_s"][ended] == 0.0).all() and (observation["now_s"][~ended] > 0.0).all()
    assert infos["_briefing"].tolist() == ended.tolist()
    env.step(np.zeros((2, 3)))


def test_returned_arrays_have_their_own_memory(phone_task) -> None:
    env = LocalizationVectorEnv(2, phone_task)
    first, _ = env.reset(seed=0)
    kept = {key: array.copy() for key, array in first.items()}
    second, rewards, terminations, _, _ = env.step(np.zeros((2, 3)))
    for key, array in second.items():
        assert not np.shares_memory(array, first[key])
        array[:] = 7.0
    rewards[:] = 7.0
    terminations[:] = True
    assert all(np.array_equal(first[key], kept[key]) for key in kept)
    again = LocalizationVectorEnv(2, phone_task)
    again.reset(seed=0)
    again.step(np.zeros((2, 3)))
    for _ in range(5):
        expected, *expected_signals, _ = again.step(np.ones((2, 3)))
        found, *signals, _ = env.step(np.ones((2, 3)))
        assert_same(expected, found)
        assert all(np.array_equal(a, b) for a, b in zip(signals, expected_signals, strict=True))


def test_seeds_can_be_listed_and_walks_chosen(phone_task) -> None:
    one, two = LocalizationVectorEnv(2, phone_task), LocalizationVectorEnv(2, phone_task)
    assert_same(one.reset(seed=[7, 8])[0], two.reset(seed=7)[0])
    observation, _ = one.reset(options={"walk": "walk-b"})
    alone, _ = LocalizationEnv(phone_task).reset(options={"walk": "walk-b"})
    for key in alone:
        assert np.array_equal(observation[key][0], alone[key]) and np.array_equal(observation[key][1], alone[key])


def test_bad_use_is_refused(phone_task) -> None:
    with pytest.raises(UnknownNameError, match="did you mean 'SameStep'"):
        LocalizationVectorEnv(2, phone_task, autoreset_mode="Same_Step")
    with pytest.raises(UnknownNameError, match="split"):
        LocalizationVectorEnv(2, phone_task, split="tests")
    with pytest.raises(RecordingError, match="num_envs=0"):
        LocalizationVectorEnv(0, phone_task)
    with pytest.raises(UnknownNameError, match="render mode"):
        LocalizationVectorEnv(2, phone_task, render_mode="human")
    env = LocalizationVectorEnv(2, phone_task)
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(np.zeros((2, 3)))
    with pytest.raises(RecordingError, match="one seed per environment, 2; got 3"):
        env.reset(seed=[1, 2, 3])
    with pytest.raises(RecordingError, match="reset_mask"):
        env.reset(options={"reset_mask": [True, False]})
    env.reset(seed=0)
    with pytest.raises(EstimateError, match=r"\(2, 3\)"):
        env.step(np.zeros(3))
