"""Distributions of errors: a step function that jumps where an error lies."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from pdrbench.picture import estimate_style
from pdrbench.report.cdf import LocalizerErrors, draw_cdf, x_limit_m


def entry(by_walk: dict[str, list[float]], localizer: str = "one") -> LocalizerErrors:
    values = {walk: np.array(errors) for walk, errors in by_walk.items()}
    return LocalizerErrors(localizer, values, {walk: walk for walk in by_walk})


def test_curve_jumps_at_an_error_and_holds_until_the_next() -> None:
    ax = Figure().add_subplot()
    draw_cdf(ax, [entry({"a": [2.0, 4.0], "b": [4.0, 8.0]})], {"one": estimate_style(0)})
    curve = next(line for line in ax.lines if line.get_label().startswith("one"))
    assert curve.get_drawstyle() == "steps-post"
    x_m, fraction = curve.get_data()
    at = {x: np.asarray(fraction)[np.flatnonzero(np.asarray(x_m) <= x)[-1]] for x in (1.9, 2.0, 3.9, 4.0, 7.9, 8.0)}
    assert at == {1.9: 0.0, 2.0: 0.25, 3.9: 0.25, 4.0: 0.75, 7.9: 0.75, 8.0: 1.0}


def test_legend_carries_the_values_of_those_that_have_errors() -> None:
    ax = Figure().add_subplot()
    draw_cdf(ax, [entry({"a": [3.0] * 9})], {"one": estimate_style(0)})
    assert ax.get_legend().get_texts()[0].get_text() == "one: median 3.00 m, P95 3.00 m"
    ax = Figure().add_subplot()
    draw_cdf(ax, [entry({"a": []})], {"one": estimate_style(0)})
    assert ax.get_legend() is None


def test_axis_is_not_squeezed_by_one_far_tail() -> None:
    assert x_limit_m([4.0, 5.0, 6.0]) == 6.0
    assert x_limit_m([4.0, 5.0, 500.0]) == 10.0
    assert x_limit_m([0.0]) > 0
    assert x_limit_m([]) > 0
