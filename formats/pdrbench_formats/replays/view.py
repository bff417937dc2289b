"""From the building to the paper: a plan, or levels drawn apart one above the other; and clouds of particles."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pdrbench.building import Building
from pdrbench.geometry import BoolArray, FloatArray, IntArray

STRETCH: Final = 10.0  # Woodman & Harle 2008, Fig. 4: "diagrams are exploded 10x in the z-axis"
AZIMUTH_RAD: Final = math.radians(-14.0)  # enough for a corridor along y not to stand upright in the picture
STEEPEST_RAD: Final = math.radians(50.0)
FLATTEST_RAD: Final = math.radians(18.0)
CLEARANCE: Final = 1.2  # height between two levels in the picture over the depth of a level
ZERO_WEIGHT_COLOUR: Final = "#000000"  # Woodman & Harle 2008, Fig. 4: black where w = 0
LEVEL_COLOURS: Final = ("#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")  # Okabe & Ito 2008, estimates are blue


@dataclass(frozen=True, slots=True)
class View:
    """Parallel projection: the building turned about the vertical, then seen from above at an angle.

    With azimuth a, elevation e and stretch s, a place (x, y, z) is drawn at
    u = x cos a - y sin a and v = (x sin a + y cos a) sin e + s z cos e. Lengths along u are to scale.

    Attributes:
        azimuth_rad: Turn of the building, counter-clockwise.
        elevation_rad: pi/2 looks straight down, 0 from the side.
        stretch: Heights are drawn so many times as large.
    """

    azimuth_rad: float = AZIMUTH_RAD
    elevation_rad: float = math.radians(30.0)
    stretch: float = STRETCH

    @property
    def matrix(self) -> FloatArray:
        """(2, 3) that maps x, y and height to the picture."""
        cos_a, sin_a = math.cos(self.azimuth_rad), math.sin(self.azimuth_rad)
        sin_e, cos_e = math.sin(self.elevation_rad), math.cos(self.elevation_rad)
        cos_e = 0.0 if self.elevation_rad == math.pi / 2 else cos_e  # a plan is exact
        return np.array([[cos_a, -sin_a, 0.0], [sin_a * sin_e, cos_a * sin_e, self.stretch * cos_e]])

    def project(self, xy_m: ArrayLike, height_m: ArrayLike) -> FloatArray:
        """Where places are drawn.

        Args:
            xy_m: (..., 2).
            height_m: (...) or one for all.

        Returns:
            (..., 2) in metres of the picture.
        """
        places = np.asarray(xy_m, dtype=np.float64)
        heights = np.broadcast_to(np.asarray(height_m, dtype=np.float64), places.shape[:-1])
        matrix = self.matrix
        drawn: FloatArray = places @ matrix[:, :2].T
        drawn += heights[..., None] * matrix[:, 2]
        return drawn


PLAN: Final = View(azimuth_rad=0.0, elevation_rad=math.pi / 2)


def exploded_view(building: Building) -> View:
    """The view from as high as possible without one level hiding another, between 18 and 50 degrees."""
    heights = [level_height_m(building, level) for level in building.levels]
    if len(heights) < 2:
        return View(elevation_rad=STEEPEST_RAD)
    _, ymin, _, ymax = building.bounds_m()
    depth_m = (ymax - ymin) / math.cos(AZIMUTH_RAD)  # of a level, straight up in the picture
    elevation_rad = math.atan(STRETCH * float(np.diff(sorted(heights)).min()) / (CLEARANCE * depth_m))
    return View(elevation_rad=min(max(elevation_rad, FLATTEST_RAD), STEEPEST_RAD))


def level_height_m(building: Building, level: int) -> float:
    """Height at which most of the floor of a level lies."""
    area_m2: dict[float, float] = {}
    for polygon in building.polygons:
        if polygon.level == level:
            area_m2[polygon.height_m] = area_m2.get(polygon.height_m, 0.0) + polygon.area_m2
    return max(area_m2, key=lambda height_m: area_m2[height_m])


def floor_height_m(building: Building, xy_m: ArrayLike, level: ArrayLike) -> FloatArray:
    """(N,) height of the floor below places.

    Args:
        building: The map.
        xy_m: (N, 2).
        level: (N,) or one for all; beside the floor the height of the level counts, NaN where there is no such level.
    """
    places = np.asarray(xy_m, dtype=np.float64).reshape(-1, 2)
    levels = np.broadcast_to(np.asarray(level, dtype=np.float64), len(places))
    height_m = np.full(len(places), np.nan)
    for known in building.levels:
        height_m[levels == known] = level_height_m(building, known)
    polygon = building.locate(places, levels)
    height_m[polygon >= 0] = building.height(polygon[polygon >= 0])
    return height_m


@dataclass(frozen=True, slots=True)
class Dots:
    """Particles as pictures need them.

    Attributes:
        xy_m: (N, 2).
        level: (N,) int.
        height_m: (N,) above level 0.
        weight: (N,) not negative; 0 where a particle hit a wall.
    """

    xy_m: FloatArray
    level: IntArray
    height_m: FloatArray
    weight: FloatArray

    def __len__(self) -> int:
        return len(self.weight)

    @property
    def alive(self) -> BoolArray:
        """(N,) True where the weight is positive."""
        alive: BoolArray = self.weight > 0
        return alive

    def only(self, keep: BoolArray | IntArray) -> Dots:
        """Some of the particles."""
        return Dots(self.xy_m[keep], self.level[keep], self.height_m[keep], self.weight[keep])

    def thinned(self, max_count: int) -> Dots:
        """At most `max_count` particles, evenly chosen from their order."""
        if len(self) <= max_count:
            return self
        return self.only(np.linspace(0, len(self) - 1, max_count).round().astype(np.int64))


def dots_of(debug: Mapping[str, NDArray[Any]], building: Building | None = None) -> Dots | None:
    """The particles in what a localizer's `debug()` returns; None where it has none.

    `particles_xy_m` (N, 2) must be there; `particles_level`, `particles_polygon` and `particles_weight` (N,) may be.
    Heights are those of the polygons, else of the floor found below; 0 without a map. Arrays are copied.
    """
    if "particles_xy_m" not in debug:
        return None
    xy_m = np.array(debug["particles_xy_m"], dtype=np.float64).reshape(-1, 2)
    weight = np.array(debug.get("particles_weight", np.ones(len(xy_m))), dtype=np.float64)
    polygon = None if building is None else debug.get("particles_polygon")
    if building is not None and polygon is not None and (np.asarray(polygon) >= 0).all():
        level, height_m = building.level(polygon), building.height(polygon)
    else:
        level = np.array(debug.get("particles_level", np.zeros(len(xy_m))), dtype=np.int64)
        height_m = np.zeros(len(xy_m)) if building is None else floor_height_m(building, xy_m, level)
    shown = np.isfinite(xy_m).all(axis=1) & np.isfinite(height_m)
    return Dots(xy_m, np.array(level), np.array(height_m), weight).only(shown)
