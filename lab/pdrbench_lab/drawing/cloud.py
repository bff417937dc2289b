"""Clouds of particles on a drawing: dots while they are few, an image of their density once they are many."""

from __future__ import annotations

from typing import Final, Literal

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb

from pdrbench.geometry import BoolArray, FloatArray, IntArray
from pdrbench_formats.replays.view import LEVEL_COLOURS, PLAN, ZERO_WEIGHT_COLOUR, Dots, View

ON_TOP: Final = 1000.0  # drawing order of what lies on the building: above every level of it
WEIGHT_COLOURS: Final = "plasma_r"
MAX_DOTS: Final = 120_000  # above, an image: dots take matplotlib some three seconds a million
DENSITY_PX: Final = 1400  # of the longer side of that image, at most
DOT_AREA_PT2: Final = 2.0
DENSE: Final = 10_000  # dots beyond which they become smaller
MIN_OPACITY: Final = 0.35  # opacity of a pixel with one particle, where others hold hundreds

Shading = Literal["level", "weight"]


def draw_dots(
    ax: Axes,
    dots: Dots,
    view: View = PLAN,
    *,
    shading: Shading = "level",
    max_dots: int = MAX_DOTS,
    area_pt2: float | None = None,
) -> None:
    """Draws particles: those of weight 0 black, the others above them in the colour of their level or weight.

    Args:
        ax: With its limits set.
        dots: Particles; for the plan of one level take `dots.only(dots.level == level)`.
        view: As returned by `draw_exploded`, or `PLAN`.
        shading: "level": a colour for each level. "weight": from yellow to blue as the weight rises to the largest.
        max_dots: More particles than that are drawn as an image: each pixel has the mean colour of its particles, the
            more opaque the more they are.
        area_pt2: Of a dot, in square points; None: 2, less where there are more than 10000.
    """
    if not len(dots):
        return
    drawn = view.project(dots.xy_m, dots.height_m)
    shade, palette = _shades(dots, shading)
    if len(dots) > max_dots:
        _draw_density(ax, drawn, dots.alive, shade, palette)
        return
    if area_pt2 is None:
        area_pt2 = DOT_AREA_PT2 * max(0.25, min(1.0, (DENSE / len(dots)) ** 0.5))
    for chosen, colours, zorder in (
        (~dots.alive, ZERO_WEIGHT_COLOUR, ON_TOP),
        (dots.alive, palette[shade[dots.alive]], ON_TOP + 1),
    ):
        ax.scatter(drawn[chosen, 0], drawn[chosen, 1], s=area_pt2, c=colours, linewidths=0, zorder=zorder)


def _shades(dots: Dots, shading: Shading) -> tuple[IntArray, FloatArray]:
    """Row of a palette for each particle (N,), and the palette (K, 3)."""
    if shading == "level":
        palette = np.array([to_rgb(colour) for colour in LEVEL_COLOURS])
        return dots.level % len(palette), palette
    palette = np.asarray(colormaps[WEIGHT_COLOURS](np.linspace(0.1, 1.0, 256)))[:, :3]
    largest = float(dots.weight.max(initial=0.0)) or 1.0
    return (255 * (dots.weight / largest)).astype(np.int64), palette


def _draw_density(ax: Axes, drawn: FloatArray, alive: BoolArray, shade: IntArray, palette: FloatArray) -> None:
    (left, right), (low, high) = ax.get_xlim(), ax.get_ylim()
    size_m = max(right - left, high - low) / min(DENSITY_PX, 2 * len(drawn) ** 0.5)
    columns, rows = max(1, round((right - left) / size_m)), max(1, round((high - low) / size_m))
    column = np.floor((drawn[:, 0] - left) / size_m).astype(np.int64)
    row = np.floor((drawn[:, 1] - low) / size_m).astype(np.int64)
    inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
    pixel = row * columns + column
    image = np.zeros((rows * columns, 4))
    _colour(image, pixel[inside & ~alive], None, palette)
    _colour(image, pixel[inside & alive], shade[inside & alive], palette)
    extent = (left, left + columns * size_m, low, low + rows * size_m)
    ax.imshow(
        image.reshape(rows, columns, 4), origin="lower", extent=extent, interpolation="antialiased", zorder=ON_TOP
    )


def _colour(image: FloatArray, pixel: IntArray, shade: IntArray | None, palette: FloatArray) -> None:
    """Writes the mean colour of the particles of each pixel (n,) into `image` (R, 4); `shade` None: all black."""
    count = np.bincount(pixel, minlength=len(image))
    hit = count > 0
    if not hit.any():
        return
    for channel in range(3):
        if shade is None:
            image[hit, channel] = to_rgb(ZERO_WEIGHT_COLOUR)[channel]
        else:
            summed = np.bincount(pixel, weights=palette[:, channel][shade], minlength=len(image))
            image[hit, channel] = summed[hit] / count[hit]
    many = max(2.0, float(np.percentile(count[hit], 99)))
    strength = MIN_OPACITY + (1 - MIN_OPACITY) * np.minimum(np.log(count[hit]) / np.log(many), 1.0)
    image[hit, 3] = np.maximum(image[hit, 3], strength)
