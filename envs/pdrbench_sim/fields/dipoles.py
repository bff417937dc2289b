"""Magnetic dipoles under a floor, for single pieces of steel: lifts, escalators, doors, tills (sources.md 1.7)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numba import njit

from pdrbench.building import FloorRegion
from pdrbench.errors import MapError
from pdrbench.geometry import FloatArray, read_only

DIPOLE: Final = 0.1  # mu0 / (4 pi) in uT m3 per A m2


@dataclass(frozen=True, slots=True)
class DipoleParams:
    """How many there are, and how strong.

    Each is an evenly magnetised sphere that lies wholly under the floor: the field above is that of a dipole, never
    more than that on the surface of the sphere, with neither curl nor divergence wherever a person can be. People walk
    around a lift, not through it, so that spheres below stand for steel beside the way, too: 2 m off is 2 m off.
    """

    # Number on each square metre of floor.
    per_m2: float = 1 / 1000  # ours: about one lift or escalator for so much floor
    # Median of the moments. The law is log-normal; directions are anywhere.
    moment_am2: float = 3000.0  # some tons of iron, at 100 to 1000 A m2 each [R]
    log_spread: float = 0.8  # standard deviation of the logarithm; ours
    # Field at the poles of a sphere, which gives its radius: (mu0 / (2 pi) moment / surface)^(1/3).
    surface_ut: float = 200.0  # ours: iron balls in the field of the Earth have 130
    cover_m: float = 2.0  # floor over the top of a sphere, at most; evenly from nothing; ours

    def __post_init__(self) -> None:
        sizes = (self.per_m2, self.moment_am2, self.log_spread, self.cover_m)
        if not (all(0 <= size < math.inf for size in sizes) and 0 < self.surface_ut < math.inf):
            raise MapError(f"magnetic dipoles have no negative number, moment or cover, and some field; got {self}")


@dataclass(frozen=True, slots=True, eq=False)
class Dipoles:
    """Those of one level."""

    centre_m: FloatArray  # (M, 3), heights from the floor, negative
    moment_am2: FloatArray  # (M, 3)

    def at(self, xy_m: FloatArray, above_m: FloatArray) -> FloatArray:
        """(n, 3) uT at places (n, 2), so high above the floor (n,)."""
        field_ut = np.zeros((len(xy_m), 3))
        if len(self.centre_m):
            place_m = np.column_stack([xy_m, above_m])
            _add_dipoles(place_m, self.centre_m, DIPOLE * self.moment_am2, field_ut)
        return field_ut


def draw_dipoles(rng: np.random.Generator, floor: FloorRegion, params: DipoleParams) -> Dipoles:
    """As many as a Poisson law gives a floor of that size, spread evenly over it."""
    number, where, how = rng.spawn(3)
    count = int(number.poisson(params.per_m2 * floor.area_m2))
    _, xy_m = floor.sample(where, count)
    size_am2 = params.moment_am2 * np.exp(params.log_spread * how.standard_normal(count))
    radius_m = np.cbrt(2 * DIPOLE * size_am2 / params.surface_ut)
    centre_m = np.column_stack([xy_m, -radius_m - params.cover_m * how.random(count)])
    direction = how.standard_normal((count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return Dipoles(read_only(centre_m), read_only(size_am2[:, None] * direction))


@njit(cache=True)
def _add_dipoles(place_m: FloatArray, centre_m: FloatArray, strength: FloatArray, field_ut: FloatArray) -> None:
    """Adds (3 (s r) r - s r^2) / r^5 of every dipole at every place, always in the same order."""
    for i in range(len(place_m)):
        for k in range(len(centre_m)):
            x, y, z = place_m[i, 0] - centre_m[k, 0], place_m[i, 1] - centre_m[k, 1], place_m[i, 2] - centre_m[k, 2]
            square = x * x + y * y + z * z
            near = 1.0 / (square * math.sqrt(square))
            along = 3 * near / square * (x * strength[k, 0] + y * strength[k, 1] + z * strength[k, 2])
            field_ut[i, 0] += along * x - near * strength[k, 0]
            field_ut[i, 1] += along * y - near * strength[k, 1]
            field_ut[i, 2] += along * z - near * strength[k, 2]
