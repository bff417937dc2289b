from __future__ import annotations

import pickle  # noqa: TID251  as between the processes of AsyncVectorEnv

import gymnasium
import numpy as np
import pytest

from pdrbench.episode import Episode, play
from pdrbench.errors import EstimateError, RecordingError, UnknownNameError
from pdrbench.gym.env import LocalizationEnv, drive
from pdrbench.localizer import Estimate


def steps(env, action=(0.0, 0.0, 0.0)):
    """Plays the walk that was begun with one action; yields what each step returns."""
    while True:
        result = env.step(np.array(action))
        yield result
        if result[2]:
            return


class Wanderer:
    """Random estimates that depend on the observations; some are missing."""

    def reset(self, briefing, rng) -> None:
        self._rng, self._sum = rng, 0.0

    def step(self, observation):
        self._sum += sum(float(rows.sum()) for rows in observation.rows.values())
        if self._rng.random() < 0.2:
            return None
        sigma_m = [None, 0.0, -1.0, np.inf, 2.5][self._rng.integers(5)]
        return Estimate(
            xy_m=self._rng.normal(self._sum, 1.0, 2),
            level=int(self._rng.integers(-2, 3)),
            heading_rad=float(self._rng.uniform(-9, 9)),
            sigma_m=sigma_m,
            converged=[None, False, True][int(self._sum) % 3],
        )


def test_an_episode_has_one_answer_per_observation_and_ends_with_the_recording(phone_task) -> None:
    env = LocalizationEnv(phone_task)
    first, info = env.reset(options={"walk": "walk-b"})
    assert set(info) == {"briefing"}
    played = list(steps(env))
    recording = phone_task.load("walk-b")
    assert len(played) == len(Episode(recording, phone_task))
    assert [result[3] for result in played] == [False] * len(played)
    assert [result[2] for result in played] == [False] * (len(played) - 1) + [True]
    assert all(result[4] == {} for result in played[:-1])
    times_s = [float(first["now_s"][0]), *(float(result[0]["now_s"][0]) for result in played)]
    assert np.allclose(times_s[:-1], 0.2 * np.arange(len(played)))
    assert times_s[-1] == times_s[-2]
    assert all((array == 0).all() for key, array in played[-1][0].items() if key != "now_s")


def test_every_row_arrives_once_and_in_time(phone_task) -> None:
    recording = phone_task.load("walk-b")
    env = LocalizationEnv(phone_task)
    observations = [env.reset(options={"walk": "walk-b"})[0], *(result[0] for result in steps(env))]
    for name, stream in recording.streams.items():
        rows = [seen[name][: int(seen[f"{name}_count"][0])] for seen in observations]
        assert np.array_equal(np.concatenate(rows), stream.rows)
        assert all((seen[name][len(new) :] == 0).all() for seen, new in zip(observations, rows, strict=True))
        assert all(
            len(new) == 0 or new[-1, 0] <= seen["now_s"][0] + 1e-6 for seen, new in zip(observations, rows, strict=True)
        )


def test_result_has_the_answers_and_no_truth(phone_task) -> None:
    env = LocalizationEnv(phone_task, claims=("sigma",))
    env.reset(options={"walk": "walk-a"})
    result = list(steps(env, (1.0, 2.0, 0.6, 3.0)))[-1][4]["result"]
    assert (result.env, result.split, result.walk, result.localizer) == ("MadeUp-v0", "train", "walk-a", "env.step")
    assert (result.estimates.xy_m == [1.0, 2.0]).all()
    assert (result.estimates.level == 1.0).all()  # the nearest level
    assert (result.estimates.sigma_m == 3.0).all()
    assert np.isnan(result.estimates.heading_rad).all()
    assert (result.step_s >= 0).all() and len(result.step_s) == len(result.estimates)
    assert result.missing == {}
    assert pickle.loads(pickle.dumps(result)).estimates.xy_m.tobytes() == result.estimates.xy_m.tobytes()  # noqa: S301


def test_convergence_is_claimed_from_one_half_on(phone_task) -> None:
    env = LocalizationEnv(phone_task, claims=("converged",))
    env.reset(options={"walk": "walk-a"})
    claims = [0.0, 0.49, 0.5, 1.0, np.nan]
    for claim in claims:
        env.step(np.array([0.0, 0.0, 0.0, claim]))
    result = list(steps(env, (np.nan, 0.0, 0.0, 1.0)))[-1][4]["result"]
    assert np.array_equal(result.estimates.converged[:5], [0.0, 0.0, 1.0, 1.0, np.nan], equal_nan=True)
    assert np.isnan(result.estimates.converged[5:]).all(), "where nothing is answered nothing is claimed"


def test_reward_is_minus_the_error_with_15_m_per_level(phone_task) -> None:
    env = LocalizationEnv(phone_task)
    env.reset(options={"walk": "walk-a"})
    reference = phone_task.load("walk-a").reference
    for k, (_, reward, *_) in enumerate(steps(env, (1.0, 2.0, 3.0))):
        x_m, y_m = (np.interp(0.2 * k, reference.t_s, reference.xy_m[:, axis]) for axis in (0, 1))
        level = reference.level[np.abs(reference.t_s - 0.2 * k).argmin()]
        assert reward == pytest.approx(-(np.hypot(1.0 - x_m, 2.0 - y_m) + 15.0 * abs(3 - level)))


def test_a_missing_answer_is_rewarded_as_the_one_before(phone_task) -> None:
    silent, repeating = LocalizationEnv(phone_task), LocalizationEnv(phone_task)
    for env in (silent, repeating):
        env.reset(options={"walk": "walk-a"})
    start = phone_task.load("walk-a").reference
    nothing = np.full(3, np.nan)
    assert silent.step(nothing)[1] == repeating.step(np.array([*start.xy_m[0], start.level[0]]))[1]
    for answer in (np.array([4.0, 5.0, 1.0]), np.array([-3.0, 2.0, 0.0])):
        assert silent.step(answer)[1] == repeating.step(answer)[1]
        assert silent.step(nothing)[1] == repeating.step(answer)[1]


def test_val_is_rewarded_and_test_is_not(phone_task) -> None:
    rewards = {}
    for split in ("val", "test"):
        env = LocalizationEnv(phone_task, split=split)
        env.reset(seed=0)
        rewards[split] = [result[1] for result in steps(env, (100.0, 0.0, 0.0))]
    assert max(rewards["val"]) < 0.0
    assert set(rewards["test"]) == {0.0}


def test_the_order_of_walks_follows_from_the_seed_and_visits_all(phone_task) -> None:
    def play_all(seed):
        env = LocalizationEnv(phone_task)
        env.reset(seed=seed)
        walks = []
        for _ in range(6):
            walks.append(list(steps(env))[-1][4]["result"].walk)
            env.reset()
        return walks

    first = play_all(3)
    assert first == play_all(3)
    assert set(first[:3]) == set(first[3:]) == set(phone_task.split("train"))
    assert len({tuple(play_all(seed)) for seed in range(8)}) > 1


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({"walks": 0}, UnknownNameError, "did you mean 'walk'"),
        ({"walk": "walk-x"}, UnknownNameError, "MadeUp-v0 train.*did you mean 'walk-"),
        ({"walk": 3}, UnknownNameError, "0 to 2"),
        ({"walk": -1}, UnknownNameError, "0 to 2"),
        ({"walk": 1.0}, RecordingError, "float 1.0"),
        ({"walk": "sealed-1"}, UnknownNameError, "walk"),
    ],
)
def test_bad_options_are_refused(phone_task, options, error, words) -> None:
    with pytest.raises(error, match=words):
        LocalizationEnv(phone_task).reset(options=options)


def test_bad_construction_is_refused(phone_task) -> None:
    with pytest.raises(UnknownNameError, match="split"):
        LocalizationEnv(phone_task, split="trian")
    with pytest.raises(UnknownNameError, match="claim"):
        LocalizationEnv(phone_task, claims=("heading_rad",))
    with pytest.raises(UnknownNameError, match="rgb_array"):
        LocalizationEnv(phone_task, render_mode="rgb")


@pytest.mark.parametrize("action", [np.zeros(2), np.zeros((1, 3)), np.zeros(5), 0.0])
def test_an_action_of_another_shape_is_refused(phone_task, action) -> None:
    env = LocalizationEnv(phone_task)
    env.reset()
    with pytest.raises(EstimateError, match=r"\(3,\) \(x_m, y_m, level\)"):
        env.step(action)


def test_step_needs_a_walk(phone_task) -> None:
    env = LocalizationEnv(phone_task)
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(np.zeros(3))
    env.reset(options={"walk": 0})
    list(steps(env))
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(np.zeros(3))
    env.reset()
    env.step(np.zeros(3))


def test_env_step_and_evaluate_give_the_same_estimates(phone_task) -> None:
    for walk in phone_task.split("test"):
        played = play(
            Wanderer(), Episode(phone_task.load(walk), phone_task), np.random.default_rng(1), name="wanderer", seed=1
        )
        env = LocalizationEnv(phone_task, split="test", claims=("sigma", "converged", "heading"))
        driven = drive(Wanderer(), env, np.random.default_rng(1), options={"walk": walk})
        assert played.status == "complete" and 0 < played.estimates.given.sum() < len(played.estimates)
        for name in ("t_s", "xy_m", "level", "heading_rad", "sigma_m", "converged"):
            assert getattr(played.estimates, name).tobytes() == getattr(driven.estimates, name).tobytes()
        assert sum(played.missing.values()) == sum(driven.missing.values())


def test_a_sensor_that_a_recording_lacks_has_no_rows(task_maker) -> None:
    task = task_maker({"accel": 24, "ble": 8})
    lacking = task_maker({"accel": 24})
    env = LocalizationEnv(task_maker({"accel": 24, "ble": 8}, load=lacking.load))
    env.reset(seed=0)
    assert all(result[0]["ble_count"][0] == 0 and not result[0]["ble"].any() for result in steps(env))
    assert set(task.capacity) == {"accel", "ble"}


def test_rows_beyond_the_capacity_come_late_and_none_is_lost(task_maker) -> None:
    task = task_maker({"accel": 24, "wifi": 200})
    env = LocalizationEnv(task)
    observation, _ = env.reset(options={"walk": "walk-a"})
    counts = [observation["wifi_count"][0], *(result[0]["wifi_count"][0] for result in steps(env))]
    assert max(counts) == 200 and sum(counts) == len(task.load("walk-a").streams["wifi"].rows)


def test_render_shows_the_answers(phone_task) -> None:
    env = LocalizationEnv(phone_task, render_mode="rgb_array", claims=("heading", "sigma"))
    env.reset(options={"walk": "walk-a"})
    empty = env.render()
    assert empty.dtype == np.uint8 and empty.ndim == 3 and empty.shape[2] == 3
    env.step(np.array([np.nan, 0.0, 0.0, 0.0, 0.0]))
    env.step(np.array([1.0, 1.0, 0.0, np.nan, 1.0]))
    env.step(np.array([3.0, 4.0, 0.0, 0.5, 1.0]))
    shown = env.render()
    assert shown.shape == empty.shape and (shown != empty).any()
    env.close()
    assert LocalizationEnv(phone_task).render() is None


def test_without_a_display_human_warns_once_and_goes_on(phone_task, monkeypatch) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    env = LocalizationEnv(phone_task, render_mode="human")
    with pytest.warns(UserWarning, match="needs a display") as caught:
        env.reset(seed=0)
        env.step(np.zeros(3))
    assert len(caught) == 1
    assert env.render() is None
    env.close()
