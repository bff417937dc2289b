"""Floor plans: to scale, walls where walls are, gaps where doors are."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from pdrbench.building import Building
from pdrbench.picture import draw_level
from pdrbench.picture.plan import FLOOR_COLOURS, TREAD_COLOUR, WALL_COLOUR, scale_length_m


@pytest.fixture
def ax() -> Axes:
    figure = Figure(figsize=(8, 4), dpi=100)
    FigureCanvasAgg(figure)
    return figure.add_axes((0, 0, 1, 1))


def paint(ax: Axes) -> np.ndarray:
    ax.figure.canvas.draw()
    return np.asarray(ax.figure.canvas.buffer_rgba())[:, :, :3].astype(int)


def colour_at(ax: Axes, x_m: float, y_m: float) -> np.ndarray:
    image = paint(ax)
    column, row = ax.transData.transform((x_m, y_m))
    return image[image.shape[0] - 1 - int(row), int(column)]


def rgb(colour: str) -> np.ndarray:
    return np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)])


def segments(ax: Axes, colour: str) -> np.ndarray:
    from matplotlib.colors import to_rgba

    found = [c for c in ax.collections if np.allclose(c.get_edgecolor()[:1], to_rgba(colour))]
    return np.array([segment for c in found for segment in c.get_segments()])


def test_floor_is_light_and_a_hole_is_not_floor(ax: Axes, building: Building) -> None:
    draw_level(ax, building, 0)
    np.testing.assert_allclose(colour_at(ax, 6.0, 4.5), rgb(FLOOR_COLOURS["floor"]), atol=2)
    np.testing.assert_allclose(colour_at(ax, 2.5, 0.85), 255, atol=2)


def test_no_seam_between_neighbours(ax: Axes, building: Building) -> None:
    draw_level(ax, building, 0)
    np.testing.assert_allclose(colour_at(ax, 4.5, 2.0), rgb(FLOOR_COLOURS["floor"]), atol=3)


def test_walls_are_dark_and_doors_are_gaps(ax: Axes, building: Building) -> None:
    draw_level(ax, building, 0)
    walls = segments(ax, WALL_COLOUR)
    on_door_line = walls[(walls[:, :, 1] == 2.0).all(axis=1)]
    middle_m = on_door_line[:, :, 0].mean(axis=1)
    assert not ((middle_m > 4) & (middle_m < 5)).any()
    assert ((middle_m > 0) & (middle_m < 4)).any()
    assert colour_at(ax, 0.0, 5.0).mean() < 128


def test_every_tread_of_the_level_is_outlined(ax: Axes, building: Building) -> None:
    draw_level(ax, building, 0)
    treads = segments(ax, TREAD_COLOUR)
    assert len(np.unique(treads[:, :, 0].mean(axis=1).round(6))) == 6  # five treads have six edges across


def test_level_without_polygons_keeps_the_limits_of_the_building(ax: Axes, building: Building) -> None:
    draw_level(ax, building, 7)
    assert ax.get_xlim() == (-2.0, 24.0)
    assert not len(segments(ax, WALL_COLOUR))


def test_a_metre_is_as_long_across_as_up(ax: Axes, building: Building) -> None:
    draw_level(ax, building, 0)
    paint(ax)
    origin, right, up = ax.transData.transform([[0, 0], [1, 0], [0, 1]])
    assert right[0] - origin[0] == pytest.approx(up[1] - origin[1])
    assert ax.get_xlabel() == "x in m"


@pytest.mark.parametrize("width_m", [0.5, 3.0, 19.9, 20.0, 333.0, 4000.0])
def test_scale_bar_is_round_and_fits(width_m: float) -> None:
    length_m = scale_length_m(width_m)
    assert width_m / 10.1 <= length_m <= width_m / 4 * (1 + 1e-9)
    assert f"{length_m:e}"[0] in "125"
