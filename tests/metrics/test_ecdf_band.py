"""The band of a distribution of errors resamples walks."""

from __future__ import annotations

import numpy as np
import pytest

from pdrbench.geometry import FloatArray
from pdrbench.metrics.ecdf_band import ecdf_band

GRID_M = np.linspace(0.0, 10.0, 101)


def band(by_walk: dict[str, list[float]], site: dict[str, str] | None = None) -> tuple[FloatArray, FloatArray] | None:
    values = {walk: np.array(errors) for walk, errors in by_walk.items()}
    return ecdf_band(values, site or dict.fromkeys(by_walk, "here"), GRID_M, np.random.default_rng(1))


def test_no_band_below_five_walks() -> None:
    walks = {f"w{i}": [1.0, 2.0] for i in range(4)}
    assert band(walks) is None
    assert band(walks | {"w4": [1.0]}) is not None


def test_band_of_equal_walks_has_no_width_and_of_different_walks_has() -> None:
    equal = band({f"w{i}": [2.0, 5.0] for i in range(8)})
    assert equal is not None
    np.testing.assert_allclose(equal[0], equal[1])
    different = band({f"w{i}": [float(i)] * 50 for i in range(8)})
    assert different is not None
    at_4 = int(np.flatnonzero(GRID_M == 4.0)[0])
    # the fraction of walks with an error of at most 4 m is binomial(8, 5/8) / 8: its 2.5 % quantile is 2/8, and its
    # 97.5 % quantile lies at the border between 7/8 and 8/8
    assert different[0][at_4] == pytest.approx(0.25)
    assert 0.875 <= different[1][at_4] <= 1.0


def test_band_keeps_the_walks_of_each_site() -> None:
    walks = {f"w{i}": [1.0] for i in range(5)} | {f"v{i}": [9.0] for i in range(5)}
    edges = band(walks, site={walk: walk[0] for walk in walks})
    assert edges is not None
    np.testing.assert_allclose(edges[0][GRID_M == 5.0], 0.5)
    np.testing.assert_allclose(edges[1][GRID_M == 5.0], 0.5)
