"""Frames of a running episode: the plan is drawn once per level, a frame adds only what moves."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from numpy.typing import NDArray

from pdrbench.building import Building
from pdrbench.geometry import BoolArray, FloatArray
from pdrbench.localizer import Estimate
from pdrbench.picture.canvas import Pixels, new_canvas, painted
from pdrbench.picture.plan import MARGIN_M, Bounds, draw_level
from pdrbench.picture.trail import estimate_style

LONG_SIDE_PX: Final = 800
SHORT_SIDE_PX: Final = 400  # at least, so that a long corridor leaves room for the title
DPI: Final = 100
MARGINS_PX: Final = (78, 54, 18, 36)  # left and bottom hold ticks and labels, top the title
HEADING_M: Final = 3.0  # length of the arrow that shows the heading
FIRST_HALF_M: Final = 16.0  # half the side of the square shown where there is no map; doubles when left


class Renderer:
    """Pictures of one episode.

    >>> import numpy as np
    >>> Renderer(None).frame(0, np.zeros((1, 2)), None).shape
    (800, 800, 3)
    """

    def __init__(self, building: Building | None) -> None:
        self._building = building
        self._size_px = _frame_size_px(building)
        self._scenes: dict[tuple[int, Bounds], _Scene] = {}

    def __repr__(self) -> str:
        return f"Renderer({self._size_px[0]} x {self._size_px[1]} px)"

    def frame(
        self,
        level: int,
        trail_xy_m: FloatArray,
        estimate: Estimate | None,
        particles_xy_m: FloatArray | None = None,
        particles_level: NDArray[Any] | None = None,
        now_s: float | None = None,
        *,
        trail_level: NDArray[Any] | None = None,
    ) -> Pixels:
        """One picture.

        Args:
            level: Level to show.
            trail_xy_m: (N, 2) estimates so far; rows that are not finite are left out.
            estimate: The last one, or None; off the level shown it is drawn hollow.
            particles_xy_m: (M, 2) of a localizer that offers them.
            particles_level: (M,); those of other levels are left out.
            now_s: Seconds from the start of the walk, for the title.
            trail_level: (N,); the trail on other levels is left out. None: all of it is shown.

        Returns:
            (H, W, 3) uint8, the same H and W for every frame of a renderer.
        """
        trail_xy_m = np.asarray(trail_xy_m, dtype=np.float64).reshape(-1, 2)
        scene = self._scene(level, trail_xy_m, estimate)
        scene.trail.set_data(*_only(trail_xy_m, trail_level, level).T)
        particles = np.zeros((0, 2)) if particles_xy_m is None else np.asarray(particles_xy_m, dtype=np.float64)
        scene.particles.set_data(*_only(particles.reshape(-1, 2), particles_level, level).T)
        scene.place_estimate(estimate, level)
        scene.title.set_text(f"level {level}" if now_s is None else f"level {level}   {now_s:.1f} s")
        return scene.paint()

    def _scene(self, level: int, trail_xy_m: FloatArray, estimate: Estimate | None) -> _Scene:
        """The plan of a level, drawn when it is first shown."""
        bounds_m = _square_around(trail_xy_m, estimate) if self._building is None else self._building.bounds_m()
        key = (level, bounds_m)
        if key not in self._scenes:
            if self._building is None:
                self._scenes.clear()  # the square of an episode without map only grows
            self._scenes[key] = _Scene(self._building, level, self._size_px, bounds_m)
        return self._scenes[key]


class _Scene:
    """A figure with its static part painted, and the artists that move."""

    def __init__(self, building: Building | None, level: int, size_px: tuple[int, int], bounds_m: Bounds) -> None:
        figure, self.canvas = new_canvas(size_px, DPI)
        self.ax = ax = figure.add_axes(_axes_place(size_px))
        if building is None:
            ax.grid(True, linewidth=0.3)
        draw_level(ax, building, level, bounds_m=bounds_m)
        colour = estimate_style(0).colour
        self.trail = Line2D([], [], color=colour, linewidth=1.6)
        self.particles = Line2D(
            [], [], color="#d55e00", linestyle="none", marker=".", markersize=2.5, markeredgewidth=0
        )
        self.here = Line2D([], [], marker="o", markersize=9, color=colour, markeredgecolor="black")
        self.heading = Line2D([], [], color="black", linewidth=2.0)
        self.spread = Circle((0, 0), 0.0, facecolor=colour, alpha=0.2, edgecolor=colour)
        self.title = ax.text(0.5, 1.02, "", transform=ax.transAxes, ha="center", va="bottom", fontsize=11)
        self._moving = (self.particles, self.spread, self.trail, self.heading, self.here, self.title)
        for drawn in self._moving[:-1]:
            ax.add_artist(drawn)
        for artist in self._moving:
            artist.set_animated(True)
        self.canvas.draw()
        self.background = self.canvas.copy_from_bbox(figure.bbox)

    def place_estimate(self, estimate: Estimate | None, level: int) -> None:
        """Marker, heading and one-sigma disc of the last estimate; none of them where it is not finite."""
        if estimate is None or estimate.xy_m.shape != (2,) or not np.isfinite(estimate.xy_m).all():
            estimate = Estimate(xy_m=np.full(2, np.nan), level=level)
        x_m, y_m = estimate.xy_m
        self.here.set_data([x_m], [y_m])
        self.here.set_markerfacecolor(self.trail.get_color() if estimate.level == level else "white")
        heading_rad = np.nan if estimate.heading_rad is None else estimate.heading_rad
        ahead_m = HEADING_M * np.cos(heading_rad), HEADING_M * np.sin(heading_rad)
        self.heading.set_data([x_m, x_m + ahead_m[0]], [y_m, y_m + ahead_m[1]])
        sigma_m = 0.0 if estimate.sigma_m is None else estimate.sigma_m
        self.spread.set_visible(0 < sigma_m < np.inf)
        if self.spread.get_visible():
            self.spread.set_center((float(x_m), float(y_m)))
            self.spread.set_radius(sigma_m)

    def paint(self) -> Pixels:
        self.canvas.restore_region(self.background)
        for artist in self._moving:
            self.ax.draw_artist(artist)
        return painted(self.canvas)


def _axes_place(size_px: tuple[int, int]) -> tuple[float, float, float, float]:
    """Left, bottom, width and height of the axes as fractions of the picture."""
    (width_px, height_px), (left, bottom, right, top) = size_px, MARGINS_PX
    return left / width_px, bottom / height_px, 1 - (left + right) / width_px, 1 - (bottom + top) / height_px


def _frame_size_px(building: Building | None) -> tuple[int, int]:
    """Width and height that suit the building; even, since video encoders want that."""
    if building is None:
        return LONG_SIDE_PX, LONG_SIDE_PX
    xmin, ymin, xmax, ymax = building.bounds_m()
    width_m, height_m = xmax - xmin + 2 * MARGIN_M, ymax - ymin + 2 * MARGIN_M
    scale = LONG_SIDE_PX / max(width_m, height_m)
    width_px, height_px = (max(SHORT_SIDE_PX, 2 * round(side * scale / 2)) for side in (width_m, height_m))
    return width_px, height_px


def _only(xy_m: FloatArray, levels: NDArray[Any] | None, level: int) -> FloatArray:
    """`xy_m` (N, 2) with NaN where a row belongs to another level."""
    if levels is None:
        return xy_m
    on_level: BoolArray = np.asarray(levels) == level
    return np.where(on_level[:, None], xy_m, np.nan)


def _square_around(trail_xy_m: FloatArray, estimate: Estimate | None) -> Bounds:
    """Bounds of a square that holds the walk so far: around its first place, half a side of 16 m doubled as needed."""
    places = trail_xy_m if estimate is None else np.vstack([trail_xy_m, np.reshape(estimate.xy_m, (-1, 2))])
    places = places[np.isfinite(places).all(axis=1)]
    if not len(places):
        return -FIRST_HALF_M, -FIRST_HALF_M, FIRST_HALF_M, FIRST_HALF_M
    x_m, y_m = (float(value) for value in places[0])
    reach_m = float(np.abs(places - places[0]).max())
    half_m = FIRST_HALF_M * 2.0 ** int(np.ceil(np.log2(max(reach_m / FIRST_HALF_M, 1.0))))
    return x_m - half_m, y_m - half_m, x_m + half_m, y_m + half_m
