"""Everything that the product registers follows the rules: no plug-in needs its own tests for them.

One walk of every environment, and every localizer on the beginning of a walk.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import pytest

from pdrbench.errors import DatasetError
from pdrbench.gym import check_localizer, check_task, localizer_checks
from pdrbench.gym.checking import Check
from pdrbench.recording import RadioMap, Recording, SensorStream
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
from pdrbench.sensors import sensor_spec
from pdrbench.settings import SettingsError, default_params
from pdrbench.task import SURVEYS, Task

OURS = "pdrbench"  # the distribution; the laboratory tests its own
ENVIRONMENTS = sorted(name for name, entry in environments().items() if entry.package == OURS)
LOCALIZERS = sorted(name for name, entry in localizers().items() if entry.package == OURS)
OF_POSITIONS = ("koeping2012",)
SMALL = "CampusStride-v1"  # the environment of the default run where one is enough
BEGIN_S = 12.0  # of a walk: it has steps, scans and all first looks
SCANS_LEFT_OUT = 6  # for each that is kept: what is fitted to a survey takes as long as it is large


def made_once(survey: Callable[[Recording], Any]) -> Callable[[Recording], Any]:
    """A small survey, made once for each beginning of a walk; building one takes longer than most localizers play."""
    made: dict[tuple[str, float], Any] = {}

    def of(recording: Recording) -> Any:
        key = recording.id, recording.end_s
        if key not in made:
            whole = survey(recording)
            made[key] = thinned(whole) if isinstance(whole, RadioMap) else whole
        return made[key]

    return of


def thinned(survey: RadioMap) -> RadioMap:
    """A few scans of a survey, of every part of it."""
    scans = np.arange(0, len(survey), 1 + SCANS_LEFT_OUT)
    counts = np.diff(survey.first)
    readings = np.isin(np.repeat(np.arange(len(survey)), counts), scans)
    return RadioMap(
        survey.xy_m[scans],
        survey.level[scans],
        survey.walk[scans],
        np.concatenate([[0], np.cumsum(counts[scans])]),
        survey.access_point[readings],
        survey.rssi_dbm[readings],
        survey.age_s[readings],
        survey.surveyed,
    )


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


def of_positions() -> Task:
    """Walks of the small environment as positions once a second, which no environment of the product hands out."""
    task, spec = first_walks(SMALL), sensor_spec("position")

    def load(walk: str) -> Recording:
        recording = task.load(walk)
        t_s = np.arange(1.0, recording.end_s)
        xy_m = [np.interp(t_s, recording.reference.t_s, of) for of in recording.reference.xy_m.T]
        return dataclasses.replace(recording, streams={spec.name: SensorStream(spec, np.column_stack([t_s, *xy_m]))})

    return dataclasses.replace(task, sensors=(spec,), capacity={spec.name: 8}, load=load)


def assert_passed(checks: list[Check]) -> None:
    failed = [f"{check.name}: {check.why}" for check in checks if not check.passed]
    assert checks and not failed, "\n".join(failed)


def test_nothing_registered_is_broken() -> None:
    assert dict(broken(ENVIRONMENTS_GROUP)) == {}
    assert dict(broken(LOCALIZERS_GROUP)) == {}
    assert ENVIRONMENTS and LOCALIZERS


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_environment_conforms(name: str) -> None:
    task = task_or_skip(name)
    assert_passed(check_task(dataclasses.replace(task, walks={"test": task.split("test")[:1]})))


@pytest.mark.parametrize("name", LOCALIZERS)
def test_localizer_conforms(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(localizer_checks, "make_task", first_walks)
    checks = check_localizer(name, of_positions() if name in OF_POSITIONS else None, seconds=BEGIN_S)
    missing = [check for check in checks if not check.passed and check.name == "an environment suits it"]
    if missing and "DatasetError" in missing[0].why:
        pytest.skip(f"{name}: {missing[0].why}")
    assert_passed(checks)


@pytest.mark.parametrize("mode", ["sync", "async"])
def test_make_vec_works_in_every_mode(mode: str) -> None:
    task = make_task(SMALL)
    envs = gymnasium.make_vec(f"pdrbench/{SMALL}", num_envs=2, vectorization_mode=mode)
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
    settable = [name for name in LOCALIZERS if default_params(load_localizer(name)) is not None]
    for name in settable:
        with pytest.raises(SettingsError, match="has no setting 'no_such_setting'"):
            make_localizer(f"{name}?no_such_setting=1")
