from __future__ import annotations

import numpy as np
import pytest
from numba import njit
from scipy.stats import chi2

from pdrbench.filters.kld import kld_bound, normal_quantile


@pytest.mark.parametrize("epsilon", [0.01, 0.15])
@pytest.mark.parametrize("delta", [0.001, 0.05])
def test_is_the_chi_square_quantile(epsilon: float, delta: float) -> None:
    # n = chi2(k - 1, 1 - delta) / (2 epsilon), Fox 2001. Wilson and Hilferty's approximation is off by 6 % at one
    # degree of freedom and this smallest delta, by 2 % at three, and by ever less; rounding up adds one at most.
    num_bins = np.array([2, 4, 8, 31, 1000, 452_000])
    off_by = np.array([0.06, 0.02, 0.02, 0.005, 0.005, 0.005])
    ours = np.array([kld_bound(int(k), epsilon, normal_quantile(delta)) for k in num_bins])
    exact = chi2.ppf(1 - delta, num_bins - 1) / (2 * epsilon)
    assert (np.abs(ours - exact) <= off_by * exact + 1).all()


def test_paper_counts() -> None:
    # sources.md note 2: 170 particles on average are 8 bins, 500 at most 31; 4.53 million are 1.44 bins on a m2
    z = normal_quantile(0.01)
    assert kld_bound(8, 0.05, z) == pytest.approx(170, rel=0.1)
    assert kld_bound(31, 0.05, z) == pytest.approx(500, rel=0.03)
    assert kld_bound(round(8725 * 1.44 * 36), 0.05, z) == pytest.approx(4_530_000, rel=0.01)


@pytest.mark.parametrize("num_bins", [0, 1])
def test_one_bin_needs_one_particle(num_bins: int) -> None:
    assert kld_bound(num_bins, 0.05, 2.33) == 1


def test_the_bound_is_at_least_one_and_never_decreases() -> None:
    assert kld_bound(2, 1e9, -3.0) == 1  # an epsilon and a delta that ask for nothing
    bounds = [kld_bound(k, 0.05, 2.33) for k in range(500)]
    assert (np.diff(bounds) >= 0).all()


def test_compiled_is_the_same_function() -> None:
    compiled = njit(kld_bound)
    for num_bins in (*range(50), 12_345, 9_999_999):
        assert compiled(num_bins, 0.05, 2.3263478740408408) == kld_bound(num_bins, 0.05, 2.3263478740408408)
