"""The gates of foot-mounted inertial navigation on recordings, and their measures."""

from __future__ import annotations

import importlib
import math
from pathlib import Path

import numpy as np
import pytest

from pdrbench.inertial import LITERAL, Strides, find_strides, navigate
from pdrbench.trajectory import Trajectory
from pdrbench_lab.foot_ins import experiments
from pdrbench_lab.foot_ins.claims import REPRODUCTION
from pdrbench_lab.reproduce.experiments import plain_numbers
from pdrbench_lab.reproduce.reproduction import Numbers
from pdrbench_sim.foot.known_walk import FootMotion, walk

SETS = {
    experiments.VICON: "foot_vicon",
    experiments.WALKS: "foot_stride_gcp",
    experiments.LOOPS: "foot_loops",
    experiments.SHORT: "foot_short",
}

DEAR = {"capture_played", "walks_played", "loops_played", "capture_labels", "left_out"}  # `pdrbench reproduce foot_ins`


@pytest.fixture(scope="module")
def straight() -> FootMotion:
    return walk(10, length_m=1.3)


def measured(name: str) -> Numbers:
    """The numbers of an experiment, in the form that claims read."""
    module = importlib.import_module("pdrbench_lab.foot_ins.experiments")
    found = plain_numbers(getattr(module, name)(0))
    return {key: np.array(value, dtype=float) if isinstance(value, list) else value for key, value in found.items()}


def trajectory(t_s: np.ndarray, xy_m: np.ndarray) -> Trajectory:
    return Trajectory(t_s, xy_m, np.zeros(len(t_s), int), np.ones(len(t_s), bool))


def test_every_claim_is_listed() -> None:
    assert {claim.id for claim in REPRODUCTION.claims} == {"W2", "W3", "F6", "F7", "F8"}


@pytest.mark.parametrize(
    "name", [experiment.name for experiment in REPRODUCTION.experiments if experiment.name not in DEAR]
)
def test_gates_hold_on_recordings(name: str, data_root: Path) -> None:
    (experiment,) = (one for one in REPRODUCTION.experiments if one.name == name)
    if any(not (data_root / SETS[env]).exists() for env in experiment.envs):
        pytest.skip(f"{experiment.envs} are not under PDRBENCH_DATA")
    numbers = measured(name)
    for claim in REPRODUCTION.claims:
        if claim.experiment == name:
            ours = claim.value([numbers]).ours
            assert np.isfinite(ours) or claim.gate is None, f"{claim.id} {claim.what}: {ours}"
            assert claim.gate is None or claim.gate.holds(ours), f"{claim.id} {claim.what}: {ours}"


def test_strides_that_are_surveyed_are_matched_and_others_are_not(straight: FootMotion) -> None:
    strides = find_strides(navigate(straight.t_s, straight.accel, straight.gyro, LITERAL))
    assert len(strides.start_s) == 10
    at_s = np.append(strides.start_s[:1], strides.end_s) + 0.1
    surveyed = trajectory(at_s, np.column_stack([1.3 * np.arange(11), np.zeros(11)]))
    pairs = experiments.matched(strides, surveyed)
    assert len(pairs) == 10
    assert pairs[:, 0] == pytest.approx(np.full(10, 1.3), abs=0.02)
    assert pairs[:, 1] == pytest.approx(np.full(10, 1.3))
    assert np.abs(pairs[:, 2]).max() < math.radians(0.5)
    gap = np.arange(11) != 4  # a stride that the survey left out is twice as long there, and no stride that was found
    assert len(experiments.matched(strides, surveyed.rows(gap))) == 8
    nothing = Strides(*(value[:0] for value in strides))
    assert experiments.matched(nothing, surveyed).shape == (0, 3)
    one = Strides(*(value[:1] for value in strides))
    assert len(experiments.matched(one, surveyed)) == 1


def test_errors_do_not_depend_on_the_frame_of_the_reference(straight: FootMotion) -> None:
    states = navigate(straight.t_s, straight.accel, straight.gyro, LITERAL)
    truth_m, every = straight.position_m[:, :2], slice(0, None, 10)
    c, s = math.cos(2.0), math.sin(2.0)
    moved_m = truth_m @ np.array([[c, s], [-s, c]]) + [30.0, -7.0]
    plain, moved = (trajectory(straight.t_s[every], xy_m[every]) for xy_m in (truth_m, moved_m))
    for measure in (experiments.rmse_m, experiments.per_axis_m):
        assert measure(states, moved) == pytest.approx(measure(states, plain), abs=1e-9)
    assert np.mean(experiments.nees(states, moved)) == pytest.approx(np.mean(experiments.nees(states, plain)), rel=1e-6)
    assert experiments.per_axis_m(states, plain) == pytest.approx(experiments.rmse_m(states, plain) / math.sqrt(2))


def test_linear_growth_is_straight() -> None:
    count = np.arange(1.0, 21.0)
    assert experiments.straightness(0.3 * count) == pytest.approx(1.0)
    assert experiments.straightness(count**3) < 0.9


def test_a_scale_error_has_an_exponent_of_one(straight: FootMotion) -> None:
    """A scale that is wrong by 1 % makes an error of n strides proportional to n."""
    states = navigate(straight.t_s, straight.accel, straight.gyro, LITERAL)
    strides = find_strides(states)
    at_s = np.append(strides.start_s[:1], strides.end_s)
    track_m = experiments.places_m(states, at_s)[:, :2]
    ruler = trajectory(at_s, 1.01 * track_m)
    assert experiments.growth_exponent(states, ruler) == pytest.approx(1.0, abs=0.02)
