"""Squares over the floor of a map, and the convex cell that each lies in."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pdrbench.building import Building
from pdrbench.building.convex import ConvexMap
from pdrbench.filters import level_map
from pdrbench.geometry import FloatArray, IntArray


@dataclass(frozen=True, slots=True)
class Lattice:
    """Squares of one size over every level of a compiled map.

    Attributes:
        convex: The map.
        square_m: Side of a square.
        low_m: (2,) corner of the first square, in coordinates of the map.
        levels: (L,) ascending.
        cell: (L, X, Y) cell of the middle of each square; -1 off the floor.
    """

    convex: ConvexMap
    square_m: float
    low_m: FloatArray
    levels: IntArray
    cell: NDArray[np.int32]

    def key(self, local_m: FloatArray, cell: NDArray[np.int32]) -> IntArray:
        """(N,) number of the square of each place (N, 2) in its cell (N,)."""
        x, y = self._square(local_m)
        level = np.searchsorted(self.levels, self.convex.level[cell])
        key: IntArray = (level * self.cell.shape[1] + x) * self.cell.shape[2] + y
        return key

    def put(self, local_m: FloatArray, cell: NDArray[np.int32]) -> tuple[FloatArray, NDArray[np.int32]]:
        """Places (N, 2) on the level of their former cells (N,), whatever lies between.

        Returns:
            local_m: (N, 2) the same places, or the middles of their squares where a wall cuts the square.
            cell: (N,) of them; -1 where there is no floor.
        """
        x, y = self._square(local_m)
        found = self.cell[np.searchsorted(self.levels, self.convex.level[cell]), x, y]
        is_outside = self.convex.outside_m(np.maximum(found, 0), local_m.astype(np.float32)) > 0
        middle_m = self.low_m + self.square_m * (np.column_stack([x, y]) + 0.5)
        return np.where(is_outside[:, None], middle_m, local_m), found

    def _square(self, local_m: FloatArray) -> tuple[IntArray, IntArray]:
        square = np.floor((local_m - self.low_m) / self.square_m).astype(np.int64)
        return np.clip(square[:, 0], 0, self.cell.shape[1] - 1), np.clip(square[:, 1], 0, self.cell.shape[2] - 1)


@functools.lru_cache(maxsize=8)
def lattice_of(building: Building, level: int, square_m: float) -> Lattice:
    """Squares over the map that a walk from this level is on, see `level_map`; kept for the last few buildings."""
    convex = level_map(building, level)
    levels = np.unique(convex.level)
    low_m = convex.corner_xy_m.min(axis=0) - square_m
    shape = np.ceil((convex.corner_xy_m.max(axis=0) + square_m - low_m) / square_m).astype(np.int64)
    found = np.full((len(levels), *shape), -1, dtype=np.int32)
    for cell in range(len(convex)):
        ring_m = convex.corner_xy_m[convex.first_corner[cell] : convex.first_corner[cell + 1]]
        first = np.maximum(np.floor((ring_m.min(axis=0) - low_m) / square_m).astype(np.int64), 0)
        last = np.ceil((ring_m.max(axis=0) - low_m) / square_m).astype(np.int64)
        x, y = (part.ravel() for part in np.meshgrid(np.arange(first[0], last[0]), np.arange(first[1], last[1])))
        middle_m = low_m + square_m * (np.column_stack([x, y]) + 0.5)
        inside = convex.outside_m(np.full(len(x), cell), middle_m.astype(np.float32)) <= 0
        found[np.searchsorted(levels, convex.level[cell]), x[inside], y[inside]] = cell
    return Lattice(convex, square_m, low_m, levels, found)
