"""Stride errors: known errors are recovered for any yaw offset of the filter, and outliers and gaps do no harm."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from pdrbench.errors import DatasetError, RecordingError, UnknownNameError
from pdrbench.inertial import FootStates, Rest
from pdrbench.registry import make_task, registered_task
from pdrbench.trajectory import Trajectory
from pdrbench_lab.stride_errors import stride_errors as module
from pdrbench_lab.stride_errors.error_file import read_error_file
from pdrbench_lab.stride_errors.stride_errors import (
    WalkErrors,
    at_places,
    components,
    correlation,
    left_of_random_walk,
    measure_errors,
    outlier_fraction,
    robust_sigma,
    stride_errors,
    summarise,
    tails,
)
from pdrbench_sim.units.strides import StrideErrors, measure


def states_at(t_s: np.ndarray, xyz_m: np.ndarray) -> FootStates:
    """The states of a filter with these positions."""
    count = len(t_s)
    x = np.zeros((count, 16))
    x[:, :3] = xyz_m
    still = Rest(*np.zeros((3, count)))
    return FootStates(t_s, x, np.zeros((count, 4, 4)), still, np.zeros(count))


def reference_at(t_s: np.ndarray, xyz_m: np.ndarray, surveyed: np.ndarray | None = None) -> Trajectory:
    """A reference with heights."""
    count = len(t_s)
    known = np.ones(count, dtype=bool) if surveyed is None else surveyed
    return Trajectory(
        t_s=t_s, xy_m=xyz_m[:, :2], level=np.zeros(count, dtype=np.int64), surveyed=known, z_m=xyz_m[:, 2]
    )


def path_of(rows: np.ndarray) -> np.ndarray:
    """(S + 1, 3) places from rows of the sensor `stride`, from the origin along x."""
    heading_rad = np.cumsum(rows[:, 3])
    moved = np.column_stack([rows[:, 1] * np.cos(heading_rad), rows[:, 1] * np.sin(heading_rad), rows[:, 2]])
    return np.concatenate([np.zeros((1, 3)), np.cumsum(moved, axis=0)])


def winding(count: int) -> np.ndarray:
    """(S, 4) true strides along a winding way, up and down."""
    k = np.arange(count)
    rows = np.column_stack([k + 1.0, 1.2 + 0.2 * np.sin(k), 0.1 * np.cos(k), 0.4 * np.sin(k / 3)])
    rows[0, 3] = 0.0
    return rows


def walk_of(true_rows: np.ndarray, measured_rows: np.ndarray, turned_rad: float = 0.0) -> WalkErrors:
    """Errors of a walk whose filter measured these strides in a frame of its own."""
    t_s = np.arange(len(true_rows) + 1.0)
    c, s = math.cos(turned_rad), math.sin(turned_rad)
    measured_m = path_of(measured_rows) @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1.0]]) + [5.0, -7.0, 2.0]
    reference = reference_at(t_s, path_of(true_rows))
    states = states_at(t_s, measured_m)
    return stride_errors(reference, states, *at_places(reference, states))


SIZES = StrideErrors(-0.019, 0.027, 0.026, math.radians(0.10), math.radians(0.29), math.radians(0.65))


def drawn(errors: StrideErrors, num_walks: int, num_strides: int, seed: int) -> list[WalkErrors]:
    """Walks whose strides were drawn from an error model."""
    rng = np.random.default_rng(seed)
    true = winding(num_strides)
    return [walk_of(true, measure(true, rng, errors), rng.uniform(-3, 3)) for _ in range(num_walks)]


def values(walks: list[WalkErrors]) -> dict[str, float]:
    """Statistics by name."""
    return {row.name: math.nan if row.value is None else row.value for row in summarise(walks, draws=10)}


def test_a_known_error_is_found_exactly() -> None:
    true = winding(20)
    reported = true + np.array([0.0, 0.0, 0.01, math.radians(0.2)])
    reported[:, 1] *= 0.98
    walk = walk_of(true, reported, turned_rad=2.5)
    np.testing.assert_allclose(walk.length_error_m, -0.02 * true[:, 1], atol=1e-12)
    np.testing.assert_allclose(walk.rise_error_m, 0.01, atol=1e-12)
    assert walk.length_bias == pytest.approx(-0.02)
    assert walk.drift_rad == pytest.approx(math.radians(0.2))
    np.testing.assert_allclose(walk.residual_rad, 0.0, atol=1e-12)
    assert walk.speed_mps == pytest.approx(np.median(true[:, 1]))


def test_neither_frame_matters() -> None:
    rng = np.random.default_rng(3)
    true = winding(15)
    reported = measure(true, rng, SIZES)
    here, there = walk_of(true, reported), walk_of(true, reported, turned_rad=-1.9)
    np.testing.assert_allclose(here.residual_rad, there.residual_rad, atol=1e-9)
    np.testing.assert_allclose(here.length_error_m, there.length_error_m, atol=1e-12)
    assert here.drift_rad == pytest.approx(there.drift_rad)


def test_strides_that_are_short_or_not_surveyed_are_left_out_and_counted_on() -> None:
    lengths = np.array([1.0, 1.0, 0.3, 1.0, 1.0, 1.0, 1.0])
    t_s, places = np.arange(8.0), np.zeros((8, 3))
    places[1:, 0] = np.cumsum(lengths)
    surveyed = np.ones(8, dtype=bool)
    surveyed[5] = False  # the strides before and after it
    reference, states = reference_at(t_s, places, surveyed), states_at(t_s, places)
    walk = stride_errors(reference, states, *at_places(reference, states))
    np.testing.assert_array_equal(walk.number, [1, 2, 3, 6])
    np.testing.assert_allclose(walk.length_m, 1.0)


def test_between_two_rows_the_reference_is_known_where_both_are() -> None:
    t_s, places = np.arange(5.0), np.zeros((5, 3))
    places[:, 0] = 2 * t_s
    surveyed = np.array([True, True, True, False, True])
    reference, states = reference_at(t_s, places, surveyed), states_at(t_s, places)
    starts, ends = np.array([0.0, 0.5, 1.5, -1.0]), np.array([0.5, 2.0, 2.5, 0.5])
    walk = stride_errors(reference, states, starts, ends)
    np.testing.assert_allclose(walk.length_m, [1.0, 3.0])


def test_one_jump_of_the_reference_is_an_outlier_and_nothing_more() -> None:
    walks = drawn(dataclasses.replace(SIZES, heading_sigma_rad=0.014, turn_sigma_rad=0.0), 8, 40, seed=4)
    before = values(walks)
    bent = [dataclasses.replace(walk, length_error_m=walk.length_error_m.copy()) for walk in walks]
    for walk in bent:
        walk.length_error_m[20] += 50.0
        walk.heading_error_rad[20] += 2.0
    after = values(bent)
    assert after["length_outliers"] == pytest.approx(before["length_outliers"] + 1 / 40, abs=1e-3)
    for name in ("length_sigma", "heading_residual", "heading_sigma"):
        assert after[name] == pytest.approx(before[name], rel=0.1)
    assert after["drift_mean"] == pytest.approx(before["drift_mean"], abs=0.02)


def test_the_drawn_errors_are_measured() -> None:
    """60 walks of 60 strides; of n = 3600 normal errors the MAD is known to 1.17 / sqrt(n) = 2 %: four of these."""
    model = StrideErrors(
        length_bias=-0.02,
        length_sigma_m=0.02,
        height_sigma_m=0.03,
        drift_mean_rad=math.radians(0.1),
        drift_sigma_rad=math.radians(0.3),
        turn_sigma_rad=0.0,
        heading_sigma_rad=math.radians(0.8),
    )
    got = values(drawn(model, 60, 60, seed=5))
    assert got["length_bias"] == pytest.approx(-2.0, abs=4 * 100 * 1.25 * 0.02 / 1.2 / 60)
    assert got["length_sigma"] == pytest.approx(0.02, rel=0.08)
    assert got["height_sigma"] == pytest.approx(0.03, rel=0.08)
    assert got["drift_mean"] == pytest.approx(0.1, abs=4 * 0.3 / math.sqrt(60))
    assert got["drift_sigma"] == pytest.approx(0.3, rel=4 / math.sqrt(120))
    assert got["heading_residual"] == pytest.approx(0.8, rel=0.1)
    assert got["heading_sigma"] == pytest.approx(0.8, rel=0.1)
    assert got["turn_sigma"] < 0.1
    assert got["turn_correlation"] == pytest.approx(-0.5, abs=0.06)


def test_errors_that_are_white_in_the_turn_and_in_the_heading_are_distinguished() -> None:
    """The drift is removed, which takes up to half of a random walk with it: `left_of_random_walk` counts that."""
    model = SIZES
    got = values(drawn(model, 60, 40, seed=6))
    assert got["turn_sigma"] == pytest.approx(0.65, rel=0.15)
    assert got["heading_sigma"] < 0.3
    assert got["turn_correlation"] == pytest.approx(0.0, abs=0.08)


def test_a_fitted_line_removes_the_stated_part_of_a_random_walk() -> None:
    """Against random walks with the line of least squares removed; a variance of 4000 is known to 2.2 %."""
    rng, count = np.random.default_rng(7), 20
    walks = np.cumsum(rng.standard_normal((4000, count)), axis=1)
    k = np.arange(count) - (count - 1) / 2
    slope = walks @ k / (k @ k)
    left = walks - slope[:, None] * k
    first, last = np.array([0, 5, 3, 0]), np.array([1, 12, 4, 19])
    np.testing.assert_allclose(
        np.var(left[:, last] - left[:, first], axis=0), left_of_random_walk(count, first, last), rtol=0.09
    )


def test_components_of_exact_variances() -> None:
    """At each lag values of one size, so that the variance is (1.4826 size)^2; here 2 * 0.5 + 0.25 m."""
    rows = [[m, m, sign * math.sqrt(1.0 + 0.25 * m) / module.NORMAL_MAD] for m in range(1, 6) for sign in (-1.0, 1.0)]
    heading_deg, turn_deg = components(np.array(rows))
    assert heading_deg == pytest.approx(math.sqrt(0.5))
    assert turn_deg == pytest.approx(0.5)
    falling = np.array(rows)
    falling[:, 2] = falling[::-1, 2]
    assert components(falling)[1] == 0.0
    assert all(math.isnan(part) for part in components(np.array(rows[:2])))


def test_robust_numbers_of_known_samples() -> None:
    normal = np.random.default_rng(8).standard_normal(20_000)
    assert robust_sigma(normal) == pytest.approx(1.0, rel=0.04)
    assert tails(normal) == pytest.approx(1.0, rel=0.04)
    assert tails(np.append(normal[:99], 100.0)) > 5
    assert [tails(np.array(row)) for row in ([1.0, 1.0], [1.0, 1.0, 1.0, 2.0])] == [1.0, math.inf]
    assert math.isnan(tails(np.ones(1)))
    assert outlier_fraction(np.array([1.0, -1.0, 1.0, 50.0])) == 0.25
    assert correlation(np.column_stack([np.diff(normal)[:-1], np.diff(normal)[1:]])) == pytest.approx(-0.5, abs=0.02)
    assert math.isnan(robust_sigma(np.zeros(0)))
    assert math.isnan(correlation(np.zeros((0, 2))))


def test_without_heights_there_is_no_height_error_and_few_walks_have_no_interval() -> None:
    walk = drawn(SIZES, 1, 20, seed=9)[0]
    flat = dataclasses.replace(walk, rise_error_m=np.full(len(walk), np.nan))
    rows = {row.name: row for row in summarise([flat, walk])}
    assert (rows["height_sigma"].num_walks, rows["length_sigma"].num_walks) == (1, 2)
    assert rows["length_sigma"].low is None
    only = {row.name: row for row in summarise([flat])}
    assert only["height_sigma"].value is None
    assert module._sizes(list(only.values())).height_sigma_m is None  # which is not 0
    assert only["drift_sigma"].value is None


def test_wrong_names_are_refused() -> None:
    with pytest.raises(UnknownNameError, match="did you mean 'literal'"):
        measure_errors("literally")


def test_without_data_the_error_says_how_to_get_it(tmp_path: object, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("PDRBENCH_DATA", raising=False)
    monkeypatch.setenv("PDRBENCH_CACHE", str(tmp_path))
    registered_task.cache_clear()
    with pytest.raises(DatasetError, match=r"foot_vicon.*PDRBENCH_DATA"):
        measure_errors()


def test_walks_without_information_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """Too few strides, a run, a foot that never rests."""
    good = drawn(SIZES, 1, 20, seed=10)[0]
    few = dataclasses.replace(
        good, **{f.name: getattr(good, f.name)[:7] for f in dataclasses.fields(good) if f.name != "speed_mps"}
    )
    came = {"a": good, "b": few, "c": dataclasses.replace(good, speed_mps=2.4)}

    class Task:
        walks = {"test": ("a", "b", "c", "d")}
        dataset, sha256 = "foot_vicon", "0" * 64

        @staticmethod
        def load(walk: str) -> str:
            return walk

    def errors_of(walk: str, *_: object) -> WalkErrors:
        if walk not in came:
            raise RecordingError("the foot never rests")
        return came[walk]

    monkeypatch.setattr(module, "make_task", lambda name: Task)
    monkeypatch.setattr(module, "walk_errors", errors_of)
    file = measure_errors("literal", ["FootVicon-v1"])
    assert file.sources[0].num_walks == 1
    assert set(file.sources[0].left_out) == {"b", "c", "d"}
    assert file.settings["clipped_rate_radps"] is None  # infinite
    came["a"] = few
    with pytest.raises(RecordingError, match=r"no walk of FootVicon-v1 can be used \(a run.*; fewer.*never rests"):
        measure_errors("literal", ["FootVicon-v1"])


def assert_agree(stated: Mapping[str, Any], now: Mapping[str, Any]) -> None:
    """A filter may have got settings since they were stated, whose effect the values below show, and have lost some."""
    shared = stated.keys() & now.keys()
    assert len(shared) > 0.8 * len(stated)
    for name in shared:
        if isinstance(stated[name], dict):
            assert_agree(stated[name], now[name])
        else:
            assert stated[name] == now[name], name


def test_the_packaged_file_holds_the_measured_values(data_root: object) -> None:
    """To 0.1 %, since other processors sum otherwise."""
    for env in module.SETS:
        task = make_task(env)
        if task.note or not any((data_root / str(task.dataset)).glob("*")):  # type: ignore[operator]
            pytest.skip(f"the registered {task.dataset} is not under PDRBENCH_DATA")
    packaged, measured = read_error_file(), measure_errors()
    assert_agree(packaged.settings, measured.settings)
    for before, now in zip(packaged.statistics, measured.statistics, strict=True):
        assert (before.name, before.num_walks, before.num_strides) == (now.name, now.num_walks, now.num_strides)
        assert now.value == pytest.approx(before.value, rel=1e-3), before.name
    by_name = {row.name: row for row in measured.statistics}
    bias = by_name["length_bias"]
    assert bias.low is not None and bias.high is not None
    assert bias.low <= -1.9 <= bias.high  # note 1
    correlated = by_name["turn_correlation"]
    assert correlated.high is not None and correlated.high < 0  # the errors are not white in the turn
