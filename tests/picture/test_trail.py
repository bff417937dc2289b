"""Trails stay apart without colour and are interrupted where they leave the level."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pdrbench.picture import REFERENCE, draw_trail, estimate_style, styles_of


@pytest.fixture
def ax() -> Axes:
    return Figure().add_subplot()


def test_styles_belong_to_names_and_neighbours_differ_in_colour_dash_and_marker() -> None:
    styles = [REFERENCE, *(estimate_style(i) for i in range(8))]
    for one, other in itertools.pairwise(styles):
        assert one.colour != other.colour
        assert one.marker != other.marker
    assert len({(str(s.dash), s.marker) for s in styles}) == len(styles)
    assert len({estimate_style(i) for i in range(210)}) == 210
    names = [f"mine_{i}-v0" for i in range(12)]
    every = styles_of(names)
    assert every == styles_of(reversed(names)) and len({style.colour for style in every.values()}) == 12
    few = styles_of(names[:6])
    assert styles_of([*names[:6], "zz-v0"]).items() >= few.items(), "who comes later by name changes nothing"
    assert len(set(styles_of([f"mine_{i}-v0" for i in range(30)]).values())) == 30


def test_line_is_interrupted_off_the_level(ax: Axes) -> None:
    xy_m = np.array([[0.0, 0], [1, 0], [2, 0], [3, 0]])
    line = draw_trail(ax, xy_m, on_level=np.array([True, True, False, True]))
    np.testing.assert_array_equal(np.isfinite(line.get_xdata()), [True, True, False, True])
    assert xy_m[2, 0] == 2.0  # the argument is left alone


def test_markers_stand_on_finite_rows_of_which_there_may_be_none(ax: Axes) -> None:
    xy_m = np.column_stack([np.arange(100.0), np.zeros(100)])
    xy_m[::3] = np.nan
    marked = draw_trail(ax, xy_m, estimate_style(0)).get_markevery()
    assert 2 <= len(marked) <= 12
    assert np.isfinite(xy_m[marked]).all()
    assert draw_trail(ax, np.zeros((0, 2)), estimate_style(1), label="silent").get_label() == "silent"


def simulated_lab(colour: str, matrix: list[list[float]]) -> np.ndarray:
    """CIELAB of a colour as it is seen with a matrix of Machado et al. 2009 (IEEE TVCG 15(6)) on linear sRGB."""
    srgb = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    to_xyz = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    x, y, z = np.cbrt(np.array(to_xyz) @ np.clip(np.array(matrix) @ linear, 0, 1) / [0.95047, 1.0, 1.08883])
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


SIGHTS = {
    "usual": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "protan": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deutan": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "tritan": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}


@pytest.mark.parametrize("sight", SIGHTS)
def test_twelve_styles_stay_apart_for_every_sight_and_in_grey(sight: str) -> None:
    styles = [estimate_style(i) for i in range(12)]
    seen = [simulated_lab(style.colour, SIGHTS[sight]) for style in styles]
    for (one, here), (other, there) in itertools.combinations(zip(styles, seen, strict=True), 2):
        assert np.linalg.norm(here - there) > (24 if one.dash == other.dash else 13), (one, other)
        assert (one.dash, one.marker) != (other.dash, other.marker)
    assert all(12 < lab[0] < 80 for lab in seen), "neither the black of the reference nor lost on paper"
