"""Magnetic fields without a building: what statistics of fields are taken in."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from pdrbench.building import FloorRegion
from pdrbench_sim.fields.magnetic import MagneticField, MagneticParams, draw_field


def draw_magnetic_field(
    rng: np.random.Generator,
    floor_m: ArrayLike,
    params: MagneticParams | None = None,
    dipole_bounds_m: tuple[float, float, float, float] = (0.0, 0.0, 100.0, 100.0),
) -> MagneticField:
    """Draws a field that is independent on each level; a level more does not change those below it.

    Args:
        rng: Two fields from generators in the same state are equal byte for byte.
        floor_m: (L,) heights of the levels, increasing.
        params: None for the defaults.
        dipole_bounds_m: Least x and y, greatest x and y of the rectangle in which dipoles lie, on each level.

    Raises:
        MapError: No level, or heights that do not increase.
    """
    west, south, east, north = dipole_bounds_m
    corners = np.array([[[west, south], [east, south], [east, north]], [[west, south], [east, north], [west, north]]])
    region = FloorRegion(corners, np.zeros(2, dtype=np.int64))
    return draw_field(rng, floor_m, [region] * np.size(floor_m), params)
