"""Rounds of a loop: closing, laying upon each other, and walks of several rounds with a known error."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pdrbench.geometry import FloatArray
from pdrbench_lab.footslam.claims import REPRODUCTION
from pdrbench_lab.footslam.experiments import Round, closed, long_walk, navigated_m, turn_onto_rad

COUNT = 80


def loop(drift_rad: float = 0.0, heading_rad: float = 0.4) -> Round:
    """A regular polygon of 1 m strides; its navigation drifts."""
    true_rad = heading_rad + 2 * np.pi / COUNT * np.arange(COUNT)
    true_m = np.concatenate(
        [np.zeros((1, 2)), np.cumsum(np.column_stack([np.cos(true_rad), np.sin(true_rad)]), axis=0)]
    )
    return Round(np.ones(COUNT), true_rad + drift_rad * np.arange(1, COUNT + 1), true_m)


def test_closing_takes_the_gap_off_in_proportion(rng: np.random.Generator) -> None:
    way_m = loop().true_m
    along = np.linspace(0, 1, COUNT + 1)[:, None]
    assert closed(way_m + along * np.array([0.5, -0.3])) == pytest.approx(way_m, abs=0.02)
    any_m = rng.standard_normal((9, 2)).cumsum(axis=0)
    assert closed(any_m)[[0, -1]] == pytest.approx(any_m[[0, 0]])


def test_a_loop_is_turned_onto_another() -> None:
    assert turn_onto_rad(loop(heading_rad=1.3).true_m, loop(heading_rad=0.4).true_m) == pytest.approx(-0.9)


def test_rounds_without_error_lie_upon_each_other() -> None:
    walk = long_walk([loop(heading_rad=heading) for heading in (0.4, 2.0, -1.0)])
    assert walk.true_m == pytest.approx(np.tile(loop().true_m[1:], (3, 1)), abs=1e-9)
    assert navigated_m(walk) == pytest.approx(walk.true_m, abs=1e-6)
    assert walk.end.tolist() == [COUNT - 1, 2 * COUNT - 1, 3 * COUNT - 1]
    assert walk.true_m[walk.middle[1]] == pytest.approx(walk.true_m[COUNT // 2 - 1], abs=1e-6)


def test_the_heading_error_of_a_round_goes_on_through_the_next() -> None:
    drift_rad = 0.002
    walk = long_walk([loop(drift_rad)] * 3)
    heading_rad = np.cumsum(walk.strides[:, 1])
    expected = np.tile(loop().heading_rad, 3) + drift_rad * np.arange(1, 3 * COUNT + 1)
    # measured over the last 2 m of a round: up to three strides' drift less
    assert np.abs(np.angle(np.exp(1j * (heading_rad - expected)))).max() < 2 * 3 * drift_rad


def test_an_added_drift_turns_every_stride() -> None:
    plain, drifting = (long_walk([loop()] * 2, drift_rad) for drift_rad in (0.0, 0.003))
    assert drifting.strides[:, 1] - plain.strides[:, 1] == pytest.approx(np.full(2 * COUNT, 0.003))
    assert _gap_m(drifting.strides) > 5 * _gap_m(plain.strides)


def test_claims_read_what_the_experiment_returns() -> None:
    assert all(claim.experiment == "rounds" for claim in REPRODUCTION.claims)
    assert sum(claim.gate is not None for claim in REPRODUCTION.claims) == 4


def _gap_m(strides: FloatArray) -> float:
    heading_rad = np.cumsum(strides[:, 1])
    return math.hypot(*(strides[:, :1] * np.column_stack([np.cos(heading_rad), np.sin(heading_rad)])).sum(axis=0))
