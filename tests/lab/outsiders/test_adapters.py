"""Adapters around packages from outside: short, and each plays the beginning of a walk within a loose bound."""

from __future__ import annotations

import functools
import importlib.util
from pathlib import Path

import numpy as np
import pytest

import pdrbench_lab.outsiders
from pdrbench.episode import Episode, play
from pdrbench.errors import UnsuitableError
from pdrbench.localizer import Briefing
from pdrbench.registry import make_localizer, make_task
from pdrbench.result import COMPLETE
from pdrbench_lab.outsiders.packages import outside
from pdrbench_lab.outsiders.weinberg import WeinbergSteps

MAX_LINES = 80
PLAYS = [  # id, package, environment, seconds, bound in metres on the mean error; standing still has 5 m to 20 m
    ("ahrs_madgwick", "ahrs", "OfficePhone-v1", 20.0, 5.0),
    ("gaitmap_rts", "gaitmap", "OfficeFoot-v2", 12.0, 2.0),
    ("imufusion_gait", "imufusion", "OfficeFoot-v2", 20.0, 4.0),
    ("indoorloc_wknn", "indoorloc", "OfficePhone-v1", 20.0, 10.0),
    ("sklearn_knn", "sklearn", "OfficePhone-v1", 20.0, 10.0),
    ("stonesoup_particles", "stonesoup", "OfficeStride-v2", 30.0, 2.0),
    ("vqf_steps", "vqf", "OfficePhone-v1", 20.0, 5.0),
]


@functools.cache
def first_walk(env: str) -> Episode:
    task = make_task(env)
    return Episode(task.load(task.split("val")[0]), task)


@pytest.mark.parametrize(
    "path", sorted(Path(pdrbench_lab.outsiders.__file__).parent.glob("*.py")), ids=lambda p: p.stem
)
def test_every_module_is_short(path: Path) -> None:
    assert len(path.read_text(encoding="utf-8").splitlines()) <= MAX_LINES


@pytest.mark.parametrize(("name", "package", "env", "seconds", "bound_m"), PLAYS, ids=lambda value: str(value))
def test_the_beginning_of_a_walk(name: str, package: str, env: str, seconds: float, bound_m: float) -> None:
    if importlib.util.find_spec(package) is None:
        pytest.skip(f"the package {package} is not installed: see lab/outsiders-constraints.txt")
    episode = first_walk(env).prefix(round(seconds / make_task(env).period_s))
    result = play(make_localizer(name), episode, np.random.default_rng(0), name=name, seed=0)
    assert result.status == COMPLETE, result.failure
    t_s, reference = result.estimates.t_s, episode.recording.reference
    true_m = np.column_stack([np.interp(t_s, reference.t_s, axis) for axis in reference.xy_m.T])
    assert np.linalg.norm(result.estimates.xy_m - true_m, axis=1).mean() < bound_m


@pytest.mark.parametrize(("name", "package"), [play[:2] for play in PLAYS])
def test_what_lacks_every_sensor_is_declined(name: str, package: str) -> None:
    if importlib.util.find_spec(package) is None:
        with pytest.raises(UnsuitableError, match="outsiders-constraints"):
            make_localizer(name)
    elif package != "gaitmap":  # which compiles for long, and declines as imufusion does
        with pytest.raises(UnsuitableError, match="needs the sensor"):
            make_localizer(name).reset(Briefing(None, {}, 0.2), np.random.default_rng(0))


def test_a_missing_package_is_named() -> None:
    with pytest.raises(UnsuitableError, match="needs the package no_such_package"):
        outside("no_such_package")


def test_steps_of_a_plain_swing_are_counted() -> None:
    rate_hz, steps_hz, swing_mps2 = 100.0, 1.8, 4.0
    t_s = np.arange(0.0, 20.0, 1.0 / rate_hz)
    finder = WeinbergSteps(rate_hz)
    lengths = [finder.update(t, 9.81 + swing_mps2 / 2 * np.sin(2 * np.pi * steps_hz * t)) for t in t_s.tolist()]
    found = np.array([one for one in lengths if one])
    assert abs(len(found) - 36) <= 1
    assert 0.4 < np.median(found) < 0.7
