"""Everything that the product registers follows the rules: no plug-in needs its own tests for them.

The default run tests one walk of every environment and the newest version of every localizer, of networks that differ
in their layers only one; the long run (`-m long`) every walk of every split, and every localizer on a minute of a walk.
"""

from __future__ import annotations

import dataclasses
import functools
import inspect
import warnings
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import pytest

from pdrbench.cli.ready import newest_versions
from pdrbench.errors import DatasetError, UnknownNameError
from pdrbench.gym import check_localizer, check_task, localizer_checks
from pdrbench.gym.checking import Check, only
from pdrbench.recording import Recording
from pdrbench.registry import (
    ENVIRONMENTS_GROUP,
    LOCALIZERS_GROUP,
    broken,
    environments,
    load_localizer,
    localizers,
    make_localizer,
    make_task,
)
from pdrbench.task import SURVEYS, Task

OURS = "pdrbench"  # the distribution; the laboratory tests its own
ENVIRONMENTS = sorted(name for name, entry in environments().items() if entry.package == OURS)
LOCALIZERS = sorted(name for name, entry in localizers().items() if entry.package == OURS)
SMALL = "OfficeStride-v2"  # the environment of the default run where one is enough
BEGIN_S, WHOLE_S = 12.0, 60.0  # of a walk: the first has steps, scans and all first looks, the second also what lags
LONG_S = {
    "MallPhone-v2": 40.0,
    "MallPhoneLost-v2": 40.0,
    "OfficeFoot-v2": 40.0,
}  # for all walks of a split
# Environments with the walks of `MallPhone` and another start or another map: every third walk shows what differs.
SAME_WALKS = ("MallPhoneLost-v2",)


# Recorded train walks with one of nine and four of ten places outside the published plan, see lab/notebook/malls.md.
OUTSIDE_PLANS = {"site1-F2-76fb4573", "site1-B1-fc29598b"}


@functools.cache
def one_walk(name: str) -> Task:
    """The task with one test walk, which is loaded and briefed once."""
    task = make_task(name)
    return only(task, task.load(task.split("test")[0]))


def made_once(survey: Callable[[Recording], Any]) -> Callable[[Recording], Any]:
    """A survey that is made once for each beginning of a walk; building one takes longer than most localizers play."""
    made: dict[tuple[str, float], Any] = {}

    def of(recording: Recording) -> Any:
        key = recording.id, recording.end_s
        if key not in made:
            made[key] = survey(recording)
        return made[key]

    return of


@functools.cache
def first_walks(name: str) -> Task:
    """The task; each of its walks is loaded once, for all localizers that are tried on it."""
    task = make_task(name)
    surveys: dict[str, Any] = {kind: made_once(getattr(task, kind)) for kind in SURVEYS}
    return dataclasses.replace(task, load=functools.cache(task.load), **surveys)


@functools.cache
def task_or_skip(name: str) -> Task:
    """The task, or a skip where its recorded data is not available; its first walk is loaded to find out."""
    try:
        task = make_task(name)
        first_walks(name).load(task.split(task.default_split)[0])
    except DatasetError as error:
        pytest.skip(f"{name}: {str(error).splitlines()[0]}")
    return task


def assert_passed(checks: list[Check]) -> None:
    failed = [f"{check.name}: {check.why}" for check in checks if not check.passed]
    assert checks and not failed, "\n".join(failed)


def test_nothing_registered_is_broken() -> None:
    assert dict(broken(ENVIRONMENTS_GROUP)) == {}
    assert dict(broken(LOCALIZERS_GROUP)) == {}
    assert ENVIRONMENTS and LOCALIZERS


SLOW = ("WestportFoot-v2",)  # to make; OfficeFoot-v2 has its sensors, WestportPhone-v1 its building
DEFAULT = [pytest.param(name, marks=pytest.mark.long(seconds=6) if name in SLOW else ()) for name in ENVIRONMENTS]


@pytest.mark.parametrize("name", DEFAULT)
@pytest.mark.slow
def test_environment_conforms(name: str) -> None:
    task = task_or_skip(name)
    assert_passed(check_task(dataclasses.replace(task, walks={"test": task.split("test")[:1]})))


@pytest.mark.timeout(900)
@pytest.mark.parametrize("split", ["train", "val", "test"])
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.long(seconds=LONG_S.get(name, 20.0))) for name in ENVIRONMENTS]
)
def test_environment_conforms_on_every_walk(name: str, split: str) -> None:
    task = task_or_skip(name)
    walks = [walk for walk in task.walks.get(split, ()) if walk not in OUTSIDE_PLANS]
    walks = walks[:: 3 if name in SAME_WALKS else 1]
    if not walks:
        pytest.skip(f"{name} has no {split} split")
    checks = check_task(dataclasses.replace(task, walks={split: tuple(walks)}), walks=len(walks))
    assert_passed([check for check in checks if split == "test" or check.name != "splits are there"])


BEGINNING = [name for name in LOCALIZERS if name not in {*newest_versions(LOCALIZERS)}]


@pytest.mark.parametrize(
    ("name", "seconds"),
    [pytest.param(name, BEGIN_S, id=name) for name in BEGINNING]
    + [pytest.param(name, WHOLE_S, id=f"{name}, a minute", marks=pytest.mark.long(seconds=12)) for name in LOCALIZERS],
)
@pytest.mark.slow
def test_localizer_conforms(name: str, seconds: float, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(localizer_checks, "make_task", first_walks)
    checks = check_localizer(name, seconds=seconds)
    missing = [check for check in checks if not check.passed and check.name == "an environment suits it"]
    if missing and "DatasetError" in missing[0].why:
        pytest.skip(f"{name}: {missing[0].why}")
    assert_passed(checks)


def check_by_gymnasium_and_stable_baselines(name: str, split: str) -> None:
    sb3_checker = pytest.importorskip("stable_baselines3.common.env_checker")
    env = gymnasium.make(f"pdrbench/{name}", split=split, claims=("heading", "sigma", "converged")).unwrapped
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # no display; both wish for actions normalised to [-1, 1], ours are metres
        gymnasium.utils.env_checker.check_env(env)
        sb3_checker.check_env(env)


@pytest.mark.parametrize("name", DEFAULT)
@pytest.mark.slow
def test_checkers_pass_through_gymnasium_make(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    task_or_skip(name)
    monkeypatch.setattr("pdrbench.gym.env.make_task", one_walk)
    check_by_gymnasium_and_stable_baselines(name, "test")


@pytest.mark.long(seconds=8)
@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_checkers_pass_where_steps_are_rewarded(name: str) -> None:
    if not task_or_skip(name).walks.get("train"):
        pytest.skip(f"{name} has no train split")
    check_by_gymnasium_and_stable_baselines(name, "train")


@pytest.mark.parametrize("mode", ["sync", "async", "vector_entry_point"])
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[] if name == SMALL else pytest.mark.long(seconds=6)) for name in ENVIRONMENTS]
)
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


def test_settings_of_localizers_go_by_name() -> None:
    settable = [name for name in LOCALIZERS if "params" in inspect.signature(load_localizer(name)).parameters]
    assert "dead_reckoning" in settable
    for name in settable:
        make_localizer(name, params={})
        with pytest.raises(UnknownNameError, match="no_such_setting"):
            make_localizer(name, params={"no_such_setting": 1})
