"""The law of stride errors: what was drawn is found again, what a set says of the others, what a loop says."""

from __future__ import annotations

import dataclasses
import math

import msgspec
import numpy as np
import pytest
from scipy.stats import t as student

from pdrbench.errors import DatasetError, RecordingError
from pdrbench_lab.stride_errors import stride_fit as module
from pdrbench_lab.stride_errors.error_file import read_error_file, read_errors
from pdrbench_lab.stride_errors.stride_errors import WalkErrors
from pdrbench_lab.stride_errors.stride_fit import (
    FITTED,
    FootWalk,
    StrideLaw,
    closed_walk,
    drift_log_density,
    drift_quantile,
    fit,
    left_out,
    surveyed_walk,
)
from pdrbench_sim.units.strides import StrideErrors, fitted, measure

LAW = StrideLaw(
    offset_m=-0.02,
    offset_sigma_m=0.006,
    sigma=np.array([0.01, 0.012, 0.7]),
    coarse_fraction=0.3,
    coarse_factor=4.0,
    stray_fraction=0.01,
    turn_sigma_deg=0.0,
    drift_scale_deg=0.15,
    drift_freedom=4.0,
)


def drawn(law: StrideLaw, count: int, seed: int, name: str = "a", strides: int = 40) -> list[FootWalk]:
    """Walks along x whose strides were drawn as environments draw them."""
    errors = StrideErrors(**msgspec.structs.asdict(law.sizes()))
    rng, true = np.random.default_rng(seed), np.zeros((strides, 4))
    true[:, 0], true[:, 1] = np.arange(strides), 1.3
    rows = [measure(true, rng, errors) for _ in range(count)]
    return [
        surveyed_walk(
            name,
            WalkErrors(
                number=np.arange(strides),
                length_m=true[:, 1],
                length_error_m=row[:, 1] - 1.3,
                rise_error_m=row[:, 2],
                heading_error_rad=np.cumsum(row[:, 3]),
                speed_mps=1.2,
            ),
        )
        for row in rows
    ]


@pytest.fixture(scope="module")
def walks() -> list[FootWalk]:
    return drawn(LAW, 60, seed=1)


def test_the_drawn_law_is_found(walks: list[FootWalk]) -> None:
    """Of 2400 strides; 60 walks know a mean to sigma / sqrt(60) and a spread to about a tenth, here three of those."""
    law = fit(walks)
    assert law.offset_m == pytest.approx(-0.02, abs=3 * 0.006 / math.sqrt(60))
    assert law.offset_sigma_m == pytest.approx(0.006, rel=0.3)
    np.testing.assert_allclose(law.sigma, LAW.sigma, rtol=0.1)
    assert law.coarse_fraction == pytest.approx(0.3, abs=0.05)
    assert law.coarse_factor == pytest.approx(4.0, rel=0.1)
    assert law.turn_sigma_deg < 0.35  # none was drawn; half of the heading's 0.7
    median_deg = law.drift_scale_deg * student.ppf(0.75, law.drift_freedom)  # scale and freedom trade for each other
    assert median_deg == pytest.approx(0.15 * student.ppf(0.75, 4.0), rel=0.4)


def test_drifts_that_the_estimator_made_are_none() -> None:
    """Short walks without a drift show one; the fitted law has less than half of it."""
    walks = drawn(dataclasses.replace(LAW, drift_scale_deg=1e-6), 40, seed=2, strides=24)
    seen_deg = float(np.std([walk.drift_deg for walk in walks]))
    assert seen_deg > 0.02
    assert fit(walks).drift_scale_deg < 0.5 * seen_deg


def test_a_walk_that_closes_shows_its_drift() -> None:
    """A circle of 50 strides turned by k d; the error of the linear estimate is of the second order in d."""
    turn_rad = 2 * math.pi / 50 * np.arange(50) + math.radians(0.05) * np.arange(50)
    walk = closed_walk("loop", np.column_stack([np.cos(turn_rad), np.sin(turn_rad)]))
    assert walk.drift_deg == pytest.approx(0.05, rel=0.05)
    assert walk.errors is None and math.isnan(walk.offset_m) and len(walk.residuals()) == 0
    bent = closed_walk("loop", np.column_stack([np.cos(turn_rad), np.sin(turn_rad)]) @ [[0.0, 1.0], [-1.0, 0.0]])
    assert bent.drift_deg == pytest.approx(walk.drift_deg)  # whatever its north
    # One heading that is off by e changes the drift by its weight times e.
    turn_rad[20] += 1e-6
    nudged = closed_walk("loop", np.column_stack([np.cos(turn_rad), np.sin(turn_rad)]))
    assert (nudged.drift_deg - walk.drift_deg) / math.degrees(1e-6) == pytest.approx(walk.weight[20], rel=0.1)


def test_the_law_of_a_drift_is_a_probability() -> None:
    grid = np.linspace(-20, 20, 20_001)
    error = np.full(len(grid), 0.1)
    density = np.exp(drift_log_density(grid, error, 0.15, 4.0))
    assert np.trapezoid(density, grid) == pytest.approx(1.0, abs=1e-3)
    quantile = drift_quantile(grid, error, LAW)
    np.testing.assert_allclose(np.gradient(quantile, grid)[1:-1], density[1:-1], atol=1e-3)
    assert quantile[10_000] == pytest.approx(0.5)


def test_a_set_like_the_others_is_foretold_and_another_is_not(walks: list[FootWalk]) -> None:
    other = dataclasses.replace(LAW, drift_scale_deg=3.0, offset_m=0.05)
    strange = [dataclasses.replace(walk, set="b") for walk in drawn(other, 12, seed=3, strides=20)]
    alike = [dataclasses.replace(walk, set="c") for walk in drawn(LAW, 12, seed=4, strides=20)]
    found = {row.set: row for row in left_out([*walks[:12], *strange, *alike])}
    assert found["b"].inside_90 < 0.6 and found["b"].offset_error_m == pytest.approx(0.07, abs=0.01)
    assert found["c"].inside_90 >= 0.8
    assert found["c"].outliers == pytest.approx(found["c"].outliers_expected, abs=0.05)
    assert found["c"].stride_gain > 0


def test_walks_that_say_nothing_are_refused(walks: list[FootWalk]) -> None:
    errors = walks[0].errors
    assert errors is not None
    with pytest.raises(RecordingError, match="a run"):
        surveyed_walk("a", dataclasses.replace(errors, speed_mps=2.0))
    scattered = errors.heading_error_rad + np.random.default_rng(5).normal(0, 0.5, len(errors))
    with pytest.raises(RecordingError, match="diverged: headings scatter by"):
        surveyed_walk("a", dataclasses.replace(errors, heading_error_rad=scattered))


def test_a_set_that_is_not_there_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PDRBENCH_DATA", "/nowhere")
    with pytest.raises(DatasetError, match="foot_vicon_2"):
        module.foot_walks(["foot_vicon_2"])


def test_localizers_and_environments_use_different_sets() -> None:
    """Of what comes with pdrbench: the prior of drifts in `woodman2008` is that of a set that is not in the law."""
    from pdrbench_baselines.woodman2008.drift import DriftParams

    file = read_error_file(FITTED)
    by_name = {row.name: row.value for row in file.statistics}
    prior = DriftParams()
    assert by_name["foot_dual: length_bias"] == pytest.approx(1.0 / prior.length_scale - 1.0)
    assert by_name["foot_dual: drift_deg_rms"] == pytest.approx(np.degrees(prior.sigma_rad))
    assert module.PRIOR_SET not in module.SETS
    assert fitted() == read_errors(FITTED)
    assert [source.dataset for source in file.sources] == [*module.SETS, module.PRIOR_SET]
