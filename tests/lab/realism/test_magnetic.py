"""The realism of the magnetic field: its statistics on made-up walks, on synthetic and on recorded ones."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pdrbench.recording import Recording, SensorStream
from pdrbench.sensors import sensor_spec
from pdrbench.trajectory import Trajectory
from pdrbench_lab.realism.magnetic import (
    LAGS_M,
    MAGNETIC,
    SPACING_M,
    compass_errors_deg,
    pooled_correlation,
    walk_field,
)

COUNT = 24


@pytest.fixture(scope="module")
def synthetic() -> dict[str, np.ndarray]:
    return dict(MAGNETIC.synthetic(1, COUNT))


def walk_over(strength_ut: np.ndarray, angle_rad: np.ndarray) -> Recording:
    """A phone that lies still to itself, carried 20 m in 20 s; its attitude is reported as none."""
    t_s = np.linspace(0.0, 22.0, len(strength_ut))
    mag = np.column_stack([t_s, -strength_ut * np.sin(angle_rad), strength_ut * np.cos(angle_rad), np.zeros(len(t_s))])
    rotation = np.column_stack([t_s, np.tile([1.0, 0, 0, 0], (len(t_s), 1))])
    rows = {"mag": mag, "rotation": rotation}
    return Recording(
        "made up",
        None,
        {name: SensorStream(sensor_spec(name), values) for name, values in rows.items()},
        Trajectory(
            t_s=np.array([1.0, 11.0, 21.0]),
            xy_m=np.array([[0.0, 0], [10, 0], [10, 10]]),
            level=np.zeros(3, dtype=int),
            surveyed=np.ones(3, dtype=bool),
        ),
    )


def test_strength_is_taken_along_the_way_and_direction_about_its_mean():
    t_s = np.linspace(0.0, 22.0, 1101)
    strength_ut, anomaly_rad = walk_field(
        walk_over(40 + t_s - 1, math.pi - 0.05 + 0.1 * np.sin(2 * np.pi * (t_s - 1) / 20))
    )
    np.testing.assert_allclose(strength_ut, 40 + np.arange(0, 20, SPACING_M), atol=1e-6)  # 1 m each second
    assert anomaly_rad.std() == pytest.approx(0.1 / math.sqrt(2), rel=1e-3)  # though it passes half a turn
    assert abs(anomaly_rad.mean()) < 1e-3


def test_correlation_of_a_wave_is_a_cosine():
    """Whole waves: cos(2 pi lag / length); the products over a cut-off wave differ by lag / walk."""
    way_m = np.arange(0, 400, SPACING_M)
    walks = [50 + np.sin(2 * np.pi * way_m / 20 + phase) for phase in np.linspace(0, 2 * np.pi, 9)[:-1]]
    np.testing.assert_allclose(pooled_correlation(walks), np.cos(2 * np.pi * np.array(LAGS_M) / 20), atol=1e-3)


def test_synthetic_walks_are_within_reach_of_the_published_figures(synthetic):
    """sources.md 1.7; 24 walks on 3 floors give a median to a fifth."""
    assert 3.0 < np.median(synthetic["spread"]) < 5.5
    assert 3.5 < np.median(synthetic["anomaly"]) < 7.0
    assert 40 < np.median(synthetic["strength"]) < 48
    for lag_m, published in {0.75: 0.91, 2.5: 0.64, 3.5: 0.49, 5.0: 0.30}.items():
        assert np.median(synthetic[f"correlation_{lag_m:g}"]) == pytest.approx(published, abs=0.15)


def test_a_compass_is_useless_on_the_shoe_and_not_at_the_hip(synthetic):
    """W19. At random a direction is off by 90 degrees in the median."""
    assert np.median(synthetic["compass_0.1"]) > 45
    assert np.median(synthetic["compass_0.3"]) > 2.5 * np.median(synthetic["compass_1"])
    assert np.median(synthetic["compass_1"]) < 10
    np.testing.assert_array_equal(compass_errors_deg(1, 3)["compass_1"], synthetic["compass_1"][:3])


def test_shuffled_strengths_lose_their_correlation(synthetic):
    control = MAGNETIC.controls["shuffled field"]
    shuffled = control.synthetic(1, COUNT)
    assert np.abs(np.median(shuffled[control.statistic])) < 0.1 < np.percentile(synthetic[control.statistic], 10)
    np.testing.assert_allclose(shuffled["spread"], synthetic["spread"])


def test_same_seed_same_values_and_features_are_per_walk(synthetic):
    again = MAGNETIC.synthetic(1, COUNT)
    assert {s.name for s in MAGNETIC.statistics} <= set(synthetic)
    for name, values in synthetic.items():
        np.testing.assert_array_equal(values, again[name])
    assert {len(synthetic[name]) for name in MAGNETIC.features} == {COUNT}


def test_recorded_walks_have_the_figures_they_were_fitted_to(data_root):
    """15 walks of the first site, of which parameters were taken."""
    real = MAGNETIC.real("fit")
    assert len(real["spread"]) == 15
    assert np.median(real["spread"]) == pytest.approx(2.4, abs=0.1)
    assert np.median(real["anomaly"]) == pytest.approx(3.5, abs=0.1)
    assert real["correlation_2.5"][0] == pytest.approx(0.68, abs=0.02)
    assert len(MAGNETIC.real("judge")["spread"]) == 46
