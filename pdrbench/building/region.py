"""Part of the floor as triangles: what a prior is uniform over."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import ArrayLike

from pdrbench.errors import MapError
from pdrbench.geometry import BoolArray, FloatArray, IntArray, read_only

if TYPE_CHECKING:
    from pdrbench.building.building import Building

BOUNDARY_M: Final = 1e-9  # a place drawn from a triangle lies outside it by rounding at most


@dataclass(frozen=True, slots=True, eq=False)
class FloorRegion:
    """Part of the floor as triangles, each with the floor polygon it belongs to.

    Attributes:
        corners_xy_m: (T, 3, 2), either way round; triangles do not overlap within a polygon.
        polygon: (T,) int, index into the polygons of a building.
    """

    corners_xy_m: FloatArray
    polygon: IntArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "corners_xy_m", read_only(self.corners_xy_m))
        object.__setattr__(self, "polygon", read_only(self.polygon, np.int64))
        if self.polygon.ndim != 1 or self.corners_xy_m.shape != (len(self.polygon), 3, 2):
            raise MapError(
                f"a floor region needs corners (T, 3, 2) and polygons (T,); got {self.corners_xy_m.shape} "
                f"and {self.polygon.shape}"
            )
        if not np.isfinite(self.corners_xy_m).all():
            raise MapError("a floor region needs finite corners")

    @classmethod
    def whole(cls, building: Building) -> FloorRegion:
        """All floor of a building."""
        return cls(*building.triangles())

    def __len__(self) -> int:
        return len(self.polygon)

    def __repr__(self) -> str:
        return f"FloorRegion({len(self)} triangles, {self.area_m2:.1f} m²)"

    @property
    def area_m2(self) -> float:
        """Area of all triangles."""
        return float(self.triangle_area_m2().sum())

    def triangle_area_m2(self) -> FloatArray:
        """(T,) area of each triangle."""
        a, b, c = self.corners_xy_m.swapaxes(0, 1)
        area_m2: FloatArray = 0.5 * np.abs((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
        return area_m2

    def restricted(self, keep: ArrayLike) -> FloorRegion:
        """The triangles that `keep` (T,) marks."""
        mask = np.asarray(keep)
        if mask.shape != (len(self),) or mask.dtype != np.bool_:
            raise MapError(f"restricted: give {len(self)} booleans, one per triangle; got {mask.dtype} {mask.shape}")
        return FloorRegion(self.corners_xy_m[mask], self.polygon[mask])

    def sample(self, rng: np.random.Generator, count: int) -> tuple[IntArray, FloatArray]:
        """Places drawn uniformly over the area.

        Returns:
            polygon: (count,) int.
            xy_m: (count, 2) inside it.

        Raises:
            MapError: The region has no area.
        """
        area_m2 = self.triangle_area_m2()
        if not area_m2.sum() > 0:
            raise MapError("a floor region without area has no place to draw from; widen the region")
        triangle = np.searchsorted(np.cumsum(area_m2), rng.random(count) * area_m2.sum(), side="right")
        return self.sample_triangles(rng, np.minimum(triangle, len(area_m2) - 1))

    def sample_triangles(self, rng: np.random.Generator, triangle: IntArray) -> tuple[IntArray, FloatArray]:
        """A place drawn uniformly from each of the triangles (N,); returns as `sample` does."""
        u, v = rng.random((2, len(triangle), 1))
        flip = u + v > 1
        u, v = np.where(flip, 1 - u, u), np.where(flip, 1 - v, v)
        a, b, c = self.corners_xy_m[triangle].swapaxes(0, 1)
        return self.polygon[triangle], a + u * (b - a) + v * (c - a)

    def contains(self, polygon: ArrayLike, xy_m: ArrayLike) -> BoolArray:
        """Whether places lie in the region; its boundary counts as inside.

        Args:
            polygon: (N,) int, floor polygon of each place.
            xy_m: (N, 2).

        Returns:
            (N,) True where a triangle of that polygon holds the place.
        """
        points = np.asarray(xy_m, dtype=np.float64).reshape(-1, 2)
        owner = np.broadcast_to(np.asarray(polygon), len(points))
        place, triangle = self.triangles_at(points)
        inside = np.zeros(len(points), dtype=np.bool_)
        inside[place[self.polygon[triangle] == owner[place]]] = True
        return inside

    def triangles_at(self, xy_m: FloatArray) -> tuple[IntArray, IntArray]:
        """Every triangle that holds each place (N, 2), whatever its polygon; boundaries count as inside.

        Returns:
            place: (K,) int, index of the place.
            triangle: (K,) int, index of the triangle.
        """
        import shapely

        usable = np.flatnonzero(np.isfinite(xy_m).all(axis=1))
        if not len(usable) or not len(self):
            return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
        tree = shapely.STRtree(shapely.polygons(self.corners_xy_m))
        place, triangle = tree.query(shapely.points(xy_m[usable]), predicate="dwithin", distance=BOUNDARY_M)
        return usable[place], triangle
