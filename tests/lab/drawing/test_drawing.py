"""Exploded buildings and drawings on them: at their heights, to scale, fast."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgb, to_rgba
from matplotlib.figure import Figure

from pdrbench.building import WALL, Building, FloorRegion, Zone
from pdrbench.picture.plan import FLOOR_COLOURS, TREAD_COLOUR, WALL_COLOUR
from pdrbench_formats.replays.view import LEVEL_COLOURS, PLAN, Dots, dots_of, level_height_m
from pdrbench_lab.drawing import (
    draw_arrow,
    draw_dots,
    draw_exploded,
    draw_pairs,
    draw_region,
    draw_zone,
    exploded_figure,
    level_panels,
)
from pdrbench_lab.drawing.exploded import CONNECTION_COLOUR
from pdrbench_lab.drawing.marks import PAIR_COLOUR, REGION_COLOUR, REGION_OPACITY
from pdrbench_sim.buildings.office import make_office

SHADED = REGION_OPACITY * np.array(to_rgb(REGION_COLOUR)) + (1 - REGION_OPACITY) * np.array(
    to_rgb(FLOOR_COLOURS["floor"])
)


@pytest.fixture(scope="module")
def office() -> Building:
    return make_office(np.random.default_rng(4), num_levels=3, area_m2=8725.0)


@pytest.fixture
def ax() -> Axes:
    figure = Figure(figsize=(8, 8), dpi=100)
    FigureCanvasAgg(figure)
    return figure.add_axes((0, 0, 1, 1))


def colour_at(ax: Axes, place: np.ndarray) -> np.ndarray:
    """Colour (3,), 0 to 1, of the pixel at a place of the picture."""
    ax.figure.canvas.draw()
    image = np.asarray(ax.figure.canvas.buffer_rgba())[:, :, :3] / 255
    column, row = ax.transData.transform(place)
    return image[image.shape[0] - 1 - int(row), int(column)]


def lines(ax: Axes, colour: str) -> list[np.ndarray]:
    found = [c for c in ax.collections if isinstance(c, LineCollection)]
    return [s for c in found if np.allclose(c.get_edgecolor()[:1], to_rgba(colour)) for s in c.get_segments()]


def some_dots(building: Building, count: int, no_weight: float = 0.0) -> Dots:
    rng = np.random.default_rng(5)
    polygon, xy_m = building.sample_uniform(rng, count)
    weight = np.where(rng.random(count) < no_weight, 0.0, 1.0)
    found = dots_of({"particles_xy_m": xy_m, "particles_polygon": polygon, "particles_weight": weight}, building)
    assert found is not None
    return found


def test_every_edge_is_drawn_at_the_height_of_its_polygon(ax: Axes, building: Building) -> None:
    view = draw_exploded(ax, building)
    is_wall = building.edge_neighbour == WALL
    height_m = building.height(building.edge_polygon)
    wanted = view.project(building.edge_start_xy_m[is_wall], height_m[is_wall])
    found = {tuple(segment[0].round(6)) for segment in lines(ax, WALL_COLOUR)}
    assert found == {tuple(place) for place in wanted.round(6)}
    doors = lines(ax, CONNECTION_COLOUR)  # between room and corridor, once
    assert len(doors) == 1
    np.testing.assert_allclose(sorted(doors[0][:, 0]), sorted(view.project([[4.0, 2.0], [5.0, 2.0]], 0.0)[:, 0]))
    assert len(lines(ax, TREAD_COLOUR)) == 22  # eleven risers, each with a lower and an upper edge


def test_floors_are_light_and_all_levels_are_seen(ax: Axes, building: Building) -> None:
    view = draw_exploded(ax, building, grid_m=0.0)
    for xy_m, height_m in (([6.0, 4.5], 0.0), ([18.0, 3.5], level_height_m(building, 1))):
        found = colour_at(ax, view.project(np.array(xy_m), height_m))
        np.testing.assert_allclose(found, to_rgb(FLOOR_COLOURS["floor"]), atol=0.01)
    np.testing.assert_allclose(colour_at(ax, view.project(np.array([2.5, 0.85]), 0.0)), 1.0, atol=0.01)  # the column
    assert {text.get_text() for text in ax.texts} == {"level 0", "level 1"}


def test_dots_have_the_colour_of_their_level_or_black_without_weight(ax: Axes, building: Building) -> None:
    view = draw_exploded(ax, building)
    hall_m = level_height_m(building, 1)
    dots = Dots(
        np.array([[6.0, 4.0], [18.0, 3.0], [2.0, 5.0]]),
        np.array([0, 1, 0]),
        np.array([0.0, hall_m, 0.0]),
        np.array([1.0, 0.3, 0.0]),
    )
    draw_dots(ax, dots, view, area_pt2=60.0)
    for xy_m, height_m, colour in zip(
        dots.xy_m, dots.height_m, (LEVEL_COLOURS[0], LEVEL_COLOURS[1], "black"), strict=True
    ):
        np.testing.assert_allclose(colour_at(ax, view.project(xy_m, height_m)), to_rgb(colour), atol=0.02)


def test_heavier_dots_are_darker(ax: Axes, building: Building) -> None:
    draw_exploded(ax, building, PLAN)
    xy_m = np.array([[1.0, 4.0], [4.0, 4.0], [7.0, 4.0]])
    dots = Dots(xy_m, np.zeros(3, int), np.zeros(3), np.array([0.1, 0.5, 1.0]))
    draw_dots(ax, dots, shading="weight", area_pt2=60.0)
    brightness = [colour_at(ax, place).sum() for place in xy_m]
    assert brightness == sorted(brightness, reverse=True) and brightness[0] - brightness[2] > 0.5


def test_many_dots_become_an_image_of_their_density(ax: Axes, building: Building) -> None:
    draw_exploded(ax, building, PLAN, grid_m=0.0)
    limits = ax.get_xlim(), ax.get_ylim()
    rng = np.random.default_rng(6)
    dense, sparse = np.array([6.0, 4.0]), np.array([18.0, 3.0])
    xy_m = np.concatenate([dense + 0.02 * rng.standard_normal((4000, 2)), sparse[None]])
    level = np.append(np.zeros(4000, int), 1)
    draw_dots(ax, Dots(xy_m, level, np.zeros(4001), np.ones(4001)), max_dots=100)
    (image,) = ax.images
    colours = np.asarray(image.get_array())
    assert (ax.get_xlim(), ax.get_ylim()) == limits
    np.testing.assert_allclose(colours[:, :, 3].max(), 1.0)
    shown = colours[colours[:, :, 3] > 0]
    of_second = np.abs(shown[:, :3] - to_rgb(LEVEL_COLOURS[1])).max(axis=1) < 1e-6
    assert of_second.sum() == 1 and shown[of_second, 3] < 0.5
    np.testing.assert_allclose(colour_at(ax, dense), to_rgb(LEVEL_COLOURS[0]), atol=0.1)


@pytest.mark.parametrize("is_flat", [True, False])
def test_a_region_is_shaded_where_it_is_and_nowhere_else(ax: Axes, building: Building, is_flat: bool) -> None:
    view = draw_exploded(ax, building, PLAN if is_flat else None, grid_m=0.0)
    whole = FloorRegion.whole(building)
    room = FloorRegion(whole.corners_xy_m[whole.polygon == 0], whole.polygon[whole.polygon == 0])
    draw_region(ax, building, room, view)
    shaded, beside = view.project(np.array([[6.0, 4.5], [6.0, 1.0]]), 0.0)
    np.testing.assert_allclose(colour_at(ax, shaded), SHADED, atol=0.01)
    np.testing.assert_allclose(colour_at(ax, beside), to_rgb(FLOOR_COLOURS["floor"]), atol=0.01)


def test_a_zone_is_shaded_on_its_level(ax: Axes, building: Building) -> None:
    view = draw_exploded(ax, building, grid_m=0.0)
    outline = np.array([[14.0, 1.0], [20.0, 1.0], [20.0, 5.0], [14.0, 5.0]])
    draw_zone(ax, building, Zone("tracked", "tracked", outline, 1), view)
    middle = view.project(np.array([17.0, 3.0]), level_height_m(building, 1))
    np.testing.assert_allclose(colour_at(ax, middle), SHADED, atol=0.01)


def test_pairs_join_each_reference_to_its_estimate(ax: Axes, building: Building) -> None:
    draw_exploded(ax, building, PLAN)
    reference = np.array([[1.0, 3.0], [2.0, 3.0], [3.0, 3.0]])
    estimate = np.array([[1.0, 3.5], [np.nan, np.nan], [3.0, 3.2]])
    draw_pairs(ax, reference, estimate)
    np.testing.assert_allclose(lines(ax, PAIR_COLOUR), [[[1.0, 3.0], [1.0, 3.5]], [[3.0, 3.0], [3.0, 3.2]]])
    np.testing.assert_allclose(ax.collections[-1].get_offsets(), reference)


def test_the_arrow_ends_at_the_place(ax: Axes, building: Building) -> None:
    view = draw_exploded(ax, building)
    draw_arrow(ax, [18.0, 3.0], level_height_m(building, 1), view)
    np.testing.assert_allclose(ax.texts[-1].xy, view.project(np.array([18.0, 3.0]), level_height_m(building, 1)))


def test_panels_have_the_same_limits_and_a_title(building: Building) -> None:
    figure, panels = level_panels(building, title="two levels")
    assert list(panels) == [0, 1]
    assert len({(ax.get_xlim(), ax.get_ylim()) for ax in panels.values()}) == 1
    assert figure.get_suptitle() == "two levels"


@pytest.mark.parametrize("title", ["", "a walk"])
def test_a_figure_holds_the_whole_building_and_a_metre_across_is_one_up(office: Building, title: str) -> None:
    figure, ax, view = exploded_figure(office, title=title)
    figure.canvas.draw()
    places = view.project(office.edge_start_xy_m, office.height(office.edge_polygon))
    pixels = ax.transData.transform(places)
    width, height = figure.get_size_inches() * figure.dpi
    assert (pixels > 0).all() and (pixels < [width, height]).all()
    origin, right, up = ax.transData.transform([[0, 0], [1, 0], [0, 1]])
    assert right[0] - origin[0] == pytest.approx(up[1] - origin[1])
    assert np.ptp(pixels[:, 0]) > 0.8 * width
