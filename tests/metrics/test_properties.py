"""Properties of every metric on every walk, including the rules of sources.md."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pdrbench.building import Building, FloorPolygon
from pdrbench.geometry import wrap_rad
from pdrbench.metrics import METRICS, hold_at, score
from pdrbench.trajectory import Estimates, Start, Trajectory

SEEDS = st.integers(0, 2**32 - 1)
# Functions of the error e and the level difference of every row that rise with each of them: no change that makes an
# estimate worse may lower one. Not among them: what is aligned, along the path, a bias, a length or a delay.
RISE_WITH_ERROR = (
    *("mean_m", "rmse_m", "p50_m", "p75_m", "p90_m", "p95_m", "max_m", "ate_m", "drift_pct"),
    *("p75_level_penalised_m", "mean_level_penalised_m", "etri_level_penalised_m", "ce50_m", "ce95_m"),
    *("eag_mps", "eag_distance_pct", "eag_turn_mprad"),
    *("convergence_s", "converged_mean_m", "converged_p75_m", "converged_p95_m", "energy_score_m", "anees"),
)
FALL_WITH_ERROR = (
    *("success_1m", "success_2m", "success_3m", "success_5m", "success_10m", "level_hit_rate"),
    *("converged_30s", "converged_60s", "converged_120s", "claimed_correct"),
    *("coverage_50", "coverage_90", "coverage_95"),
)
SQUARE = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])


def make_building(yaw_rad: float = 0.0, shift_m: object = (0.0, 0.0)) -> Building:
    outline = rigid(60.0 * SQUARE, yaw_rad, shift_m)
    rooms = [FloorPolygon(f"room-{i}", outline, np.full(4, -1), height_m=3.5 * i, level=i) for i in range(3)]
    return Building("three levels", tuple(rooms))


def rigid(xy_m: np.ndarray, yaw_rad: float, shift_m: object) -> np.ndarray:
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    return xy_m @ np.array([[cos, sin], [-sin, cos]]) + np.asarray(shift_m)


def make_walk(seed: int) -> tuple[Estimates, Trajectory]:
    """A random walk over three levels, partly surveyed, and answers of another rhythm, a few of them missing."""
    rng = np.random.default_rng(seed)
    count, answered = int(rng.integers(1, 60)), int(rng.integers(0, 60))
    level = np.clip(np.cumsum(rng.random(count) < 0.1), 0, 2)
    reference = Trajectory(
        t_s=np.cumsum(rng.uniform(0.2, 4.0, count)),
        xy_m=np.cumsum(rng.normal(size=(count, 2)), axis=0),
        level=level,
        surveyed=rng.random(count) < 0.8,
        z_m=3.5 * level,
    )
    xy_m = np.cumsum(rng.normal(size=(answered, 2)), axis=0)
    xy_m[rng.random(answered) < 0.1] = math.nan
    t_s = np.sort(rng.uniform(0, reference.t_s[-1], answered))
    level = rng.integers(0, 3, answered).astype(float)
    sigma_m, converged = make_claims(rng, answered)
    heading_rad = rng.uniform(-math.pi, math.pi, answered)
    heading_rad[rng.random(answered) < 0.1] = math.nan
    reference = dataclasses.replace(reference, heading_rad=rng.uniform(-math.pi, math.pi, count))
    return Estimates(t_s, xy_m, level, heading_rad, sigma_m, converged), reference


def make_claims(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    """(count,) sigma and (count,) convergence as claimed at random, some of it missing or nonsense."""
    sigma_m = rng.gamma(2.0, size=count)
    sigma_m[rng.random(count) < 0.1] = rng.choice([0.0, -1.0, math.inf, math.nan])
    return sigma_m, rng.choice([0.0, 1.0, math.nan], count)


def start(xy_m: object = (0.3, -0.2)) -> Start:
    return Start(xy_m=np.asarray(xy_m), level=0)


def assert_same(found: dict[str, float], wanted: dict[str, float], abs_tolerance: float = 1e-9) -> None:
    for name, value in wanted.items():
        assert found[name] == pytest.approx(value, rel=1e-6, abs=abs_tolerance, nan_ok=True), name


@settings(max_examples=20, deadline=None, derandomize=True)
@given(seed=SEEDS, yaw_deg=st.integers(-180, 180), east_m=st.integers(-500, 500), north_m=st.integers(-500, 500))
def test_rotating_and_shifting_everything_changes_nothing(seed: int, yaw_deg: int, east_m: int, north_m: int) -> None:
    estimates, reference = make_walk(seed)
    motion = (math.radians(yaw_deg), (float(east_m), float(north_m)))
    moved, moved_reference = (
        dataclasses.replace(track, xy_m=rigid(track.xy_m, *motion), heading_rad=wrap_rad(track.heading_rad + motion[0]))
        for track in (estimates, reference)
    )
    wanted = score(estimates, reference, make_building(), start(), period_s=1.0)
    moved_start = start(rigid(start().xy_m[None], *motion)[0])
    found = score(moved, moved_reference, make_building(*motion), moved_start, period_s=1.0)
    assert_same(found, wanted)


@settings(max_examples=30, deadline=None, derandomize=True)
@given(seed=SEEDS, data=st.data())
def test_making_an_estimate_worse_never_improves_an_error(seed: int, data: st.DataObject) -> None:
    # one answer is pushed straight away from the truth at every row it is in force at, or its level is moved away
    estimates, reference = make_walk(seed)
    rng = np.random.default_rng(seed + 1)
    track = hold_at(estimates, reference.t_s, start())
    away = track.xy_m - reference.xy_m
    rows = rng.random(len(reference)) < data.draw(st.sampled_from([0.05, 0.5, 1.0]))
    push = np.where(rows, rng.exponential(3.0, len(reference)), 0.0)[:, None]
    direction = away / np.maximum(np.hypot(*away.T), 1e-9)[:, None]
    level_away = np.where(track.level >= reference.level, 1, -1) * rng.integers(0, 3, len(reference)) * rows
    claims = (np.full(len(reference), math.nan), *make_claims(rng, len(reference)))
    answered = Estimates(reference.t_s, track.xy_m, track.level, *claims)
    worsened = Estimates(reference.t_s, track.xy_m + push * direction, track.level + level_away, *claims)
    better = score(answered, reference, None, start())
    worse = score(worsened, reference, None, start())
    assert worse["n"] == better["n"]
    for name in RISE_WITH_ERROR:
        assert math.isnan(better[name]) or worse[name] >= better[name] - 1e-9, name
    for name in FALL_WITH_ERROR:
        assert math.isnan(better[name]) or worse[name] <= better[name], name


@settings(max_examples=30, deadline=None, derandomize=True)
@given(seed=SEEDS)
def test_scores_of_one_walk_are_in_order(seed: int) -> None:
    estimates, reference = make_walk(seed)
    scores = score(estimates, reference, make_building(), start())
    if not scores["n"]:
        return
    ordered = [scores[name] for name in ("p50_m", "p75_m", "p90_m", "p95_m", "max_m")]
    assert ordered == sorted(ordered)
    slack = 1e-9 * (1 + scores["max_m"])
    assert scores["bias_m"] <= scores["mean_m"] + slack
    assert scores["mean_m"] <= scores["rmse_m"] + slack
    assert scores["rmse_m"] <= scores["max_m"] + slack
    assert scores["rmse_m"] == scores["ate_m"]
    assert scores["ate_se2_aligned_m"] <= scores["ate_m"] + slack
    assert scores["ate_se2_aligned_m"] <= scores["ate_start_aligned_m"] + slack or scores["ate_se2_translation_only"]
    fractions = [scores[f"success_{limit}m"] for limit in (1, 2, 3, 5, 10)]
    assert fractions == sorted(fractions)
    assert scores["mean_m"] <= scores["etri_level_penalised_m"] + slack
    assert scores["etri_level_penalised_m"] <= scores["mean_level_penalised_m"] + slack
    assert scores["se50_m"] >= max(scores["ce50_m"], scores["ve50_m"]) - slack


@settings(max_examples=20, deadline=None, derandomize=True)
@given(seed=SEEDS)
def test_the_oracle_scores_zero(seed: int) -> None:
    _, reference = make_walk(seed)
    unclaimed = np.full(len(reference), math.nan)
    oracle = Estimates(
        reference.t_s, reference.xy_m, reference.level.astype(float), reference.heading_rad, unclaimed, unclaimed
    )
    scores = score(oracle, reference, make_building(), start(), period_s=10.0)
    for name, metric in METRICS.items():
        if name in ("n", "availability", "heading_share") or name.endswith(("_only", "_whole_walk")):
            continue
        best = 1.0 if metric.better == "higher" else 0.0
        assert math.isnan(scores[name]) or scores[name] == pytest.approx(best, abs=1e-6), name
    if scores["n"]:
        assert all(scores[name] == 0.0 for name in ("mean_m", "rmse_m", "max_m", "p75_level_penalised_m", "ve95_m"))
        assert scores["availability"] == 1.0
        assert scores["heading_share"] == 1.0 or math.isnan(scores["heading_share"])


@settings(max_examples=20, deadline=None, derandomize=True)
@given(seed=SEEDS)
def test_a_wrong_level_is_never_dropped(seed: int) -> None:
    # the same positions, every level wrong: every row is still scored, and costs at least its penalty
    estimates, reference = make_walk(seed)
    wrong = dataclasses.replace(estimates, level=np.full(len(estimates), 9.0))
    scores = score(wrong, reference, None, Start(xy_m=start().xy_m, level=9))
    plain = score(estimates, reference, None, start())
    assert scores["n"] == plain["n"]
    if plain["n"]:
        assert scores["mean_m"] == plain["mean_m"]
        assert scores["level_hit_rate"] == 0.0
        assert scores["p75_level_penalised_m"] >= 15.0 * 7
        assert scores["p75_level_penalised_m"] >= plain["p75_level_penalised_m"]
