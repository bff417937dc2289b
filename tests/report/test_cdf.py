"""Distributions of errors: a step function that jumps where an error lies, and a band that knows about walks."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure

from pdrbench.picture import estimate_style
from pdrbench.report.cdf import Errors, band, draw_cdf, x_limit_m

GRID_M = np.linspace(0.0, 10.0, 101)


def entry(by_walk: dict[str, list[float]], localizer: str = "one", site: str = "here") -> Errors:
    values = {walk: np.array(errors) for walk, errors in by_walk.items()}
    return Errors(localizer, values, dict.fromkeys(by_walk, site))


def test_curve_jumps_at_an_error_and_holds_until_the_next() -> None:
    ax = Figure().add_subplot()
    draw_cdf(ax, [entry({"a": [2.0, 4.0], "b": [4.0, 8.0]})], {"one": estimate_style(0)}, np.random.default_rng(1))
    curve = next(line for line in ax.lines if line.get_label().startswith("one"))
    assert curve.get_drawstyle() == "steps-post"
    x_m, share = curve.get_data()
    at = {x: np.asarray(share)[np.flatnonzero(np.asarray(x_m) <= x)[-1]] for x in (1.9, 2.0, 3.9, 4.0, 7.9, 8.0)}
    assert at == {1.9: 0.0, 2.0: 0.25, 3.9: 0.25, 4.0: 0.75, 7.9: 0.75, 8.0: 1.0}


def test_legend_carries_the_values() -> None:
    ax = Figure().add_subplot()
    draw_cdf(ax, [entry({"a": [3.0] * 9})], {"one": estimate_style(0)}, np.random.default_rng(1))
    assert ax.get_legend().get_texts()[0].get_text() == "one: median 3.00 m, P95 3.00 m"


def test_no_band_below_five_walks() -> None:
    walks = {f"w{i}": [1.0, 2.0] for i in range(4)}
    assert band(entry(walks), GRID_M, np.random.default_rng(1)) is None
    assert band(entry(walks | {"w4": [1.0]}), GRID_M, np.random.default_rng(1)) is not None


def test_band_of_equal_walks_has_no_width_and_of_different_walks_has() -> None:
    equal = band(entry({f"w{i}": [2.0, 5.0] for i in range(8)}), GRID_M, np.random.default_rng(1))
    assert equal is not None
    np.testing.assert_allclose(equal[0], equal[1])
    different = band(entry({f"w{i}": [float(i)] * 50 for i in range(8)}), GRID_M, np.random.default_rng(1))
    assert different is not None
    at_4 = int(np.flatnonzero(GRID_M == 4.0)[0])
    # the share of walks with an error of at most 4 m is binomial(8, 5/8) / 8: its 2.5 % quantile is 2/8, and its
    # 97.5 % quantile lies at the border between 7/8 and 8/8
    assert different[0][at_4] == pytest.approx(0.25)
    assert 0.875 <= different[1][at_4] <= 1.0


def test_band_keeps_the_walks_of_each_site() -> None:
    walks = {f"w{i}": [1.0] for i in range(5)} | {f"v{i}": [9.0] for i in range(5)}
    split = Errors("one", {k: np.array(v) for k, v in walks.items()}, {walk: walk[0] for walk in walks})
    edges = band(split, GRID_M, np.random.default_rng(1))
    assert edges is not None
    np.testing.assert_allclose(edges[0][GRID_M == 5.0], 0.5)
    np.testing.assert_allclose(edges[1][GRID_M == 5.0], 0.5)


def test_band_depends_on_the_generator_state_alone() -> None:
    errors = entry({f"w{i}": [float(i), 3.0] for i in range(9)})
    np.testing.assert_array_equal(
        band(errors, GRID_M, np.random.default_rng(7)), band(errors, GRID_M, np.random.default_rng(7))
    )


def test_axis_is_not_squeezed_by_one_far_tail() -> None:
    assert x_limit_m([4.0, 5.0, 6.0]) == 6.0
    assert x_limit_m([4.0, 5.0, 500.0]) == 10.0
    assert x_limit_m([0.0]) > 0
    assert x_limit_m([]) > 0


def test_localizer_without_errors_is_left_out() -> None:
    ax = Figure().add_subplot()
    draw_cdf(ax, [entry({"a": []})], {"one": estimate_style(0)}, np.random.default_rng(1))
    assert ax.get_legend() is None
