"""Scores of claimed uncertainty in closed form."""

from __future__ import annotations

import math
import warnings

import numpy as np
import pytest
from scipy.stats import rayleigh, rice
from tracks import make_answers, make_reference

from pdrbench.metrics import hold_at
from pdrbench.metrics.hold import Held
from pdrbench.metrics.uncertainty import anees, anees_band, coverage, energy_score_m, energy_scores_m, sigma_unusable
from pdrbench.trajectory import Start, Trajectory

METRICS = (energy_score_m, coverage, anees, sigma_unusable)


def make_walk(errors: object, sigma_m: object, level: object = 0.0) -> tuple[Held, Trajectory]:
    errors = np.asarray(errors, dtype=float)
    reference = make_reference(np.zeros((len(errors), 2)))
    estimates = make_answers(reference.t_s, errors[:, None] * [0.6, 0.8], level, sigma_m=sigma_m)
    return hold_at(estimates, reference.t_s, Start(xy_m=np.zeros(2), level=0)), reference


def errors_of_a_normal(sigma_m: float, count: int = 2000) -> np.ndarray:
    """Quantiles of the distances for errors of this standard deviation per axis."""
    return rayleigh.ppf((np.arange(count) + 0.5) / count, scale=sigma_m)


# Energy score ----------------------------------------------------------------------------------------------------


def test_the_energy_score_is_the_difference_of_two_expected_distances() -> None:
    distance_m, sigma_m = (grid.ravel() for grid in np.meshgrid([0.0, 0.1, 1.0, 3.0, 7.0], [0.5, 1.0, 4.0]))
    wanted = rice.mean(distance_m / sigma_m, scale=sigma_m) - rayleigh.mean(scale=math.sqrt(2) * sigma_m) / 2
    assert energy_scores_m(distance_m, sigma_m) == pytest.approx(wanted)
    distance_m = np.array([0.0, 1e-9, 1.0, 1e9])
    for sigma_m in (0.0, 5e-324, 1e-200, 1e-12):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            scores = energy_scores_m(distance_m, np.full(4, sigma_m))
        assert scores == pytest.approx(distance_m, abs=1e-12)
    assert energy_scores_m(np.zeros(1), np.ones(1)) == pytest.approx(math.sqrt(math.pi) * (math.sqrt(0.5) - 0.5))


def test_the_true_spread_has_the_best_energy_score() -> None:
    errors = errors_of_a_normal(2.0)
    scores = {sigma_m: energy_score_m(*make_walk(errors, sigma_m)) for sigma_m in (0.5, 1.0, 1.8, 2.0, 2.2, 4.0)}
    assert min(scores, key=scores.__getitem__) == 2.0
    assert scores[2.0] == pytest.approx(math.sqrt(math.pi), rel=1e-3)  # E|X - X'| / 2 = 2 m sqrt(pi) / 2
    assert scores[2.0] < errors.mean()


# Coverage and consistency ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("fraction", [0.5, 0.9, 0.95])
def test_the_disc_of_the_true_spread_holds_its_fraction(fraction: float) -> None:
    errors = errors_of_a_normal(3.0)
    assert coverage(*make_walk(errors, 3.0), fraction=fraction) == pytest.approx(fraction, abs=1 / 2000)
    assert (
        coverage(*make_walk(errors, 1.0), fraction=fraction)
        < fraction
        < coverage(*make_walk(errors, 6.0), fraction=fraction)
    )


def test_the_disc_ends_at_its_radius_and_lies_on_its_level() -> None:
    held, reference = make_walk([2.447, 2.448], 1.0)  # sqrt(-2 ln 0.05) = 2.44775
    assert coverage(held, reference, fraction=0.95) == 0.5
    held, reference = make_walk([0.0, 0.0], 1.0, level=[0.0, 1.0])
    assert coverage(held, reference, fraction=0.95) == 0.5


def test_anees_is_one_for_a_calibrated_sigma_and_its_band_that_of_an_exponential() -> None:
    assert anees(*make_walk([5.0, 5.0], 5.0 / math.sqrt(2.0))) == pytest.approx(1.0)
    assert anees(*make_walk([5.0, 5.0], 5.0 / math.sqrt(8.0))) == pytest.approx(4.0)
    assert anees(*make_walk(errors_of_a_normal(2.0), 2.0)) == pytest.approx(1.0, abs=0.005)
    assert anees_band(1) == pytest.approx((-math.log(0.975), -math.log(0.025)))
    assert anees_band(1, level=0.5) == pytest.approx((-math.log(0.75), -math.log(0.25)))


# What cannot be scored -------------------------------------------------------------------------------------------


def test_missing_and_invalid_sigmas_are_counted_and_left_out() -> None:
    held, reference = make_walk([4.0, 9.0, 9.0, 9.0, 9.0, 9.0], [2.0, 0.0, -1.0, math.inf, math.nan, -math.inf])
    alone = make_walk([4.0], 2.0)
    assert sigma_unusable(held, reference) == 5.0
    for metric in (energy_score_m, coverage, anees):
        assert metric(held, reference) == metric(*alone)
    assert all(math.isnan(metric(*make_walk([1.0, 2.0], math.nan))) for metric in METRICS)
    held, reference = make_walk([1.0, 2.0], 0.0)
    assert sigma_unusable(held, reference) == 2.0
    assert all(math.isnan(metric(held, reference)) for metric in METRICS[:3])


def test_scores_stay_finite_however_absurd_the_claim() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for error in (0.0, 1.0, 1e300):
            for sigma_m in (5e-324, 1e-150, 1e150, 1.7e308):
                held, reference = make_walk([error, 1.0], sigma_m)
                assert all(math.isfinite(metric(held, reference)) for metric in METRICS)
