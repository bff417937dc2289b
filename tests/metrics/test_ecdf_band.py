"""The band of a distribution of errors counts units."""

from __future__ import annotations

import numpy as np
import pytest

from pdrbench.geometry import FloatArray
from pdrbench.metrics.ecdf_band import ecdf_band
from pdrbench.metrics.statistics import mean_interval

GRID_M = np.linspace(0.0, 10.0, 101)


def band(by_walk: dict[str, list[float]], unit: dict[str, str] | None = None) -> tuple[FloatArray, FloatArray] | None:
    values = {walk: np.array(errors) for walk, errors in by_walk.items()}
    return ecdf_band(values, unit or {walk: walk for walk in by_walk}, GRID_M)


def test_no_band_below_four_units() -> None:
    walks = {f"w{i}": [1.0, 2.0] for i in range(4)}
    assert band(walks) is not None
    assert band(walks, unit={walk: str(int(walk == "w0")) for walk in walks}) is None
    assert band({}) is None


def test_band_of_equal_walks_has_no_width_and_of_different_walks_has() -> None:
    equal = band({f"w{i}": [2.0, 5.0] for i in range(8)})
    assert equal is not None
    np.testing.assert_allclose(equal[0], equal[1])
    different = band({f"w{i}": [float(i)] * 50 for i in range(8)})
    assert different is not None
    at_4 = int(np.flatnonzero(GRID_M == 4.0)[0])
    # five of eight walks have an error of at most 4 m, all of their places: the interval of that fraction of walks
    low, high = mean_interval([1.0] * 5 + [0.0] * 3, scale="fraction")
    assert (different[0][at_4], different[1][at_4]) == pytest.approx((low, high))
    assert (different[0] >= 0).all() and (different[1] <= 1).all()
