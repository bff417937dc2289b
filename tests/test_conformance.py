"""Everything registered, ours and a stranger's, keeps to the rules: no plug-in needs tests of its own for them."""

from __future__ import annotations

import warnings

import gymnasium
import numpy as np
import pytest

from pdrbench.errors import DatasetError
from pdrbench.gym.checks import check_localizer, check_task
from pdrbench.registry import (
    ENVIRONMENTS_GROUP,
    LOCALIZERS_GROUP,
    broken,
    environments,
    localizers,
    make_task,
)
from pdrbench.task import Task

ENVIRONMENTS = sorted(environments())
LOCALIZERS = sorted(localizers())


def task_or_skip(name: str) -> Task:
    """The task, or a skip where its recorded data is not at hand."""
    try:
        task = make_task(name)
        task.load(task.split(task.default_split)[0])
    except DatasetError as error:
        pytest.skip(f"{name}: {str(error).splitlines()[0]}")
    return task


def explain(checks) -> str:
    return "\n".join(f"{check.name}: {check.why}" for check in checks if not check.passed)


def test_nothing_registered_is_broken() -> None:
    assert dict(broken(ENVIRONMENTS_GROUP)) == {}
    assert dict(broken(LOCALIZERS_GROUP)) == {}
    assert ENVIRONMENTS and LOCALIZERS


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_environment_conforms(name: str) -> None:
    task_or_skip(name)
    checks = check_task(name, walks=1)
    assert all(check.passed for check in checks), explain(checks)


@pytest.mark.parametrize("name", LOCALIZERS)
def test_localizer_conforms(name: str) -> None:
    checks = check_localizer(name, seconds=30.0)
    missing = [check for check in checks if not check.passed and check.name == "an environment suits it"]
    if missing and "DatasetError" in missing[0].why:
        pytest.skip(f"{name}: {missing[0].why}")
    assert all(check.passed for check in checks), explain(checks)


@pytest.mark.parametrize("name", ENVIRONMENTS)
@pytest.mark.parametrize("split", ["train", "test"])
def test_checkers_pass_through_gymnasium_make(name: str, split: str) -> None:
    if not task_or_skip(name).walks.get(split):
        pytest.skip(f"{name} has no {split} split")
    sb3_checker = pytest.importorskip("stable_baselines3.common.env_checker")
    env = gymnasium.make(f"pdrbench/{name}", split=split, claims=("heading", "sigma", "converged")).unwrapped
    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore"
        )  # no display here; and both wish for actions normalised to [-1, 1]; ours are metres
        gymnasium.utils.env_checker.check_env(env)
        sb3_checker.check_env(env)


@pytest.mark.parametrize("name", ENVIRONMENTS)
@pytest.mark.parametrize("mode", ["sync", "async", "vector_entry_point"])
def test_make_vec_works_in_every_mode(name: str, mode: str) -> None:
    task = task_or_skip(name)
    envs = gymnasium.make_vec(f"pdrbench/{name}", num_envs=2, vectorization_mode=mode)
    try:
        observation, infos = envs.reset(seed=0)
        assert observation["now_s"].shape == (2, 1)
        assert len(infos["briefing"]) == 2
        _, rewards, terminations, truncations, _ = envs.step(np.zeros((2, 3)))
        assert rewards.shape == (2,) and ((rewards < 0) | (task.default_split == "test")).all()
        assert not terminations.any() and not truncations.any()
    finally:
        envs.close()
