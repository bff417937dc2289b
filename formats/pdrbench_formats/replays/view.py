"""From the building to the paper: a plan, or levels drawn apart one above the other."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from pdrbench.building import Building
from pdrbench.geometry import FloatArray

STRETCH: Final = 10.0  # Woodman & Harle 2008, Fig. 4: "diagrams are exploded 10x in the z-axis"
AZIMUTH_RAD: Final = math.radians(-14.0)  # enough for a corridor along y not to stand upright in the picture
STEEPEST_RAD: Final = math.radians(50.0)
FLATTEST_RAD: Final = math.radians(18.0)
CLEARANCE: Final = 1.2  # height between two levels in the picture over the depth of a level


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


def exploded_view(building: Building, stretch: float = STRETCH, azimuth_rad: float = AZIMUTH_RAD) -> View:
    """The view from as high as possible without one level hiding another, between 18 and 50 degrees.

    `stretch` and `azimuth_rad` as in `View`.
    """
    heights = [level_height_m(building, level) for level in building.levels]
    if len(heights) < 2:
        return View(azimuth_rad, STEEPEST_RAD, stretch)
    _, ymin, _, ymax = building.bounds_m()
    depth_m = (ymax - ymin) / max(math.cos(azimuth_rad), 0.1)  # of a level, straight up in the picture
    elevation_rad = math.atan(stretch * float(np.diff(sorted(heights)).min()) / (CLEARANCE * depth_m))
    return View(azimuth_rad, min(max(elevation_rad, FLATTEST_RAD), STEEPEST_RAD), stretch)


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
