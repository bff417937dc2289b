from __future__ import annotations

import numpy as np
import pytest

from pdrbench_baselines.woodman2008.drift import TurnDrift


def test_equals_the_mean_of_the_observed_values() -> None:
    """With a flat prior, the Kalman filter is the running mean, and its sigma falls with the root of n."""
    rng = np.random.default_rng(0)
    turns = rng.normal(0, 0.3, 500)
    seen = 0.01 + rng.normal(0, 0.02, 500)
    drift = TurnDrift(mean_rad=0.0, sigma_rad=1e3, turn_sigma_rad=0.02)
    for turned, more in zip(turns, seen, strict=True):
        drift = drift.observed(reported_rad=float(turned + more), turned_rad=float(turned))
    assert drift.mean_rad == pytest.approx(seen.mean(), abs=1e-9)
    assert drift.sigma_rad == pytest.approx(0.02 / np.sqrt(500), rel=1e-6)


def test_turns_are_compared_the_short_way_round() -> None:
    drift = TurnDrift(0.0, 0.1, 0.1).observed(reported_rad=np.pi - 0.01, turned_rad=-np.pi + 0.01)
    assert drift.mean_rad == pytest.approx(-0.01)


def test_an_exactly_known_drift_is_not_estimated() -> None:
    drift = TurnDrift(0.002, 0.0, 0.01)
    assert drift.observed(1.0, 0.5) is drift
