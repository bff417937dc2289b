"""Trails stay apart without colour and are interrupted where they leave the level."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pdrbench.picture import REFERENCE, draw_trail, estimate_style


@pytest.fixture
def ax() -> Axes:
    return Figure().add_subplot()


def test_neighbouring_styles_differ_in_colour_dash_and_marker() -> None:
    styles = [REFERENCE, *(estimate_style(i) for i in range(8))]
    for one, other in itertools.pairwise(styles):
        assert one.colour != other.colour
        assert one.marker != other.marker
    assert len({(str(s.dash), s.marker) for s in styles}) == len(styles)
    assert len({estimate_style(i) for i in range(210)}) == 210


def test_line_is_interrupted_off_the_level(ax: Axes) -> None:
    xy_m = np.array([[0.0, 0], [1, 0], [2, 0], [3, 0]])
    line = draw_trail(ax, xy_m, on_level=np.array([True, True, False, True]))
    np.testing.assert_array_equal(np.isfinite(line.get_xdata()), [True, True, False, True])
    assert xy_m[2, 0] == 2.0  # the argument is left alone


def test_markers_stand_on_finite_rows(ax: Axes) -> None:
    xy_m = np.column_stack([np.arange(100.0), np.zeros(100)])
    xy_m[::3] = np.nan
    marked = draw_trail(ax, xy_m, estimate_style(0)).get_markevery()
    assert 2 <= len(marked) <= 12
    assert np.isfinite(xy_m[marked]).all()


def test_nothing_to_draw_is_fine(ax: Axes) -> None:
    assert draw_trail(ax, np.zeros((0, 2)), estimate_style(1), label="silent").get_label() == "silent"
