"""Disturbances of recordings: what they change, and what they leave."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pdrbench.trajectory import Trajectory
from pdrbench_lab.foot_ins.claims import LEFT_OUT
from pdrbench_lab.foot_ins.disturbed import DISTURBED, GAP_S, NUM_GAPS, RANGE_RADPS, SCALE
from pdrbench_lab.foot_ins.experiments import FootWalk


@pytest.fixture
def walk(rng: np.random.Generator) -> FootWalk:
    t_s = np.arange(4000) / 200
    reference = Trajectory(t_s[:2], np.zeros((2, 2)), np.zeros(2, int), np.ones(2, bool))
    return FootWalk(Path("1.csv"), t_s, rng.normal(size=(4000, 3)), rng.normal(0, 5.0, (4000, 3)), reference)


def test_every_disturbance_does_what_it_says(walk: FootWalk) -> None:
    changed = {name: disturb(walk) for name, (_, disturb) in DISTURBED.items()}
    assert np.abs(changed["clipped"].gyro).max() == pytest.approx(RANGE_RADPS)
    assert np.array_equal(changed["clipped"].gyro == walk.gyro, np.abs(walk.gyro) <= RANGE_RADPS)
    assert changed["scaled"].gyro == pytest.approx(SCALE * walk.gyro)
    assert np.diff(changed["thinned"].t_s) == pytest.approx(0.02)
    gaps_s = np.diff(changed["gaps"].t_s)
    assert np.count_nonzero(gaps_s > 0.01) == NUM_GAPS
    assert gaps_s.max() == pytest.approx(GAP_S + 1 / 200, abs=1e-6)
    for other in changed.values():
        assert len(other.t_s) == len(other.accel) == len(other.gyro)


def test_every_claim_reads_what_its_experiment_returns() -> None:
    names = {experiment.name for experiment in LEFT_OUT.experiments}
    assert {claim.experiment for claim in LEFT_OUT.claims} == names == {"left_out", "disturbed"}
