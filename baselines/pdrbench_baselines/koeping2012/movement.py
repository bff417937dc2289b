"""The movement table of Köping et al. 2012: where a walker can be one update later, and how probably (K4).

It is made offline from the floor of a building and a Gaussian walking speed. Online a particle draws one of its entries
in constant time.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from pdrbench.building import Building
from pdrbench.errors import MapError
from pdrbench.geometry import FloatArray, IntArray, read_only
from pdrbench_baselines.koeping2012 import movement_kernels as kernels
from pdrbench_baselines.koeping2012.movement_cells import GridCells, cut_floor

TILE_CELLS: Final = 32  # ways are searched from a square of so many cells at a time, through what is in reach of it
FASTEST_SIGMA: Final = 5.0  # beyond so many standard deviations of the speed nothing is left above any threshold
MAX_CELLS: Final = 4_000_000  # more are a mistake in cell_m


@dataclass(frozen=True, slots=True)
class MovementParams:
    """How the table is made.

    Attributes:
        cell_m: Edge of a cell.
        speed_mps: Mean and standard deviation of the walking speed.
        prune: Entries of a smaller probability are left out, the others scaled up.
        update_s: Time between updates.
    """

    cell_m: float = 0.5  # K4; the paper gives none
    speed_mps: tuple[float, float] = (1.34, 0.26)  # K4 [R] Weidmann 1993; the paper gives none
    prune: float = 1e-4  # K4; the paper gives none
    update_s: float = 1.0  # [P] K6

    def __post_init__(self) -> None:
        object.__setattr__(self, "speed_mps", tuple(float(value) for value in self.speed_mps))
        if len(self.speed_mps) != 2:
            raise MapError(f"movement table: speed_mps is mean and standard deviation; got {self.speed_mps}")
        sigma = "the standard deviation in speed_mps"
        for name, value in (("cell_m", self.cell_m), ("update_s", self.update_s), (sigma, self.speed_mps[1])):
            if not 0 < value < np.inf:
                raise MapError(f"movement table: {name} must be positive and finite; got {value:g}")
        if not 0 <= self.speed_mps[0] < np.inf:
            raise MapError(f"movement table: a mean speed is at least 0 and finite; got {self.speed_mps[0]:g}")
        if not 0 <= self.prune < 1:
            raise MapError(f"movement table: prune is a probability below 1; got {self.prune:g}")

    @property
    def farthest_m(self) -> float:
        """The farthest walk in one update."""
        mean_mps, sigma_mps = self.speed_mps
        return self.update_s * (mean_mps + FASTEST_SIGMA * sigma_mps)


@dataclass(frozen=True, slots=True, eq=False)
class MovementTable:
    """All possible movements in one update, with their probabilities, as alias tables cell by cell.

    From a cell, what the speed gives to a length is divided among its ways: p is N(d; v dt, s dt) over the number
    of cells at that distance, with distances counted in cells and a cell counted by the floor that it has. Distances
    are walks past walls and through doors from cell to cell: in 16 directions they come out up to 2.75 % too long, and
    up to two cells where they lead round the end of a wall.

    Parts of a building that nothing connects are in one table; no particle moves between them. The paper's law gives
    standing still about 1e-6 in the open: it is pruned, and particles always walk.

    Attributes:
        cells: Where particles can be.
        params: How it was made.
        first: (C + 1,) int64, entries `first[c]:first[c + 1]` lead away from cell c; every cell has one at least.
        to: (M,) int32, cell at the end of each entry.
        threshold: (M,) float32, fraction of the slot of an entry that leads to `to`.
        alias: (M,) int32, cell that the rest of the slot leads to.
    """

    cells: GridCells
    params: MovementParams
    first: IntArray
    to: IntArray
    threshold: FloatArray
    alias: IntArray

    @property
    def num_cells(self) -> int:
        """Cells of the floor."""
        return len(self.cells)

    @property
    def nbytes(self) -> int:
        """Of the arrays that particles move by."""
        return self.first.nbytes + self.to.nbytes + self.threshold.nbytes + self.alias.nbytes

    def start(self, rng: np.random.Generator, count: int) -> IntArray:
        """(count,) cells drawn uniformly over the floor: in proportion to their area (K2)."""
        return kernels.draw_sorted(self.cells.area_m2.copy(), rng.standard_exponential(count + 1))

    def move(self, cell: IntArray, rng: np.random.Generator) -> IntArray:
        """(N,) cells one update after cells (N,)."""
        return kernels.move(cell, rng.random(len(cell)), self.first, self.to, self.threshold, self.alias)

    def row(self, cell: int) -> tuple[IntArray, FloatArray]:
        """Cells that one update leads to from a cell, and the probability of each, read back from the alias table."""
        part = slice(int(self.first[cell]), int(self.first[cell + 1]))
        own = self.threshold[part].astype(np.float64)
        to, which = np.unique(np.concatenate([self.to[part], self.alias[part]]), return_inverse=True)
        return to.astype(np.int64), np.bincount(which, weights=np.concatenate([own, 1 - own])) / len(own)


def build_table(building: Building, params: MovementParams | None = None) -> MovementTable:
    """Makes the table of a building: of several levels, with stairs and doors, of connected parts or not.

    Raises:
        MapError: The cells are so small that there are more than `MAX_CELLS`.
    """
    params = params or MovementParams()
    if building.area_m2 > MAX_CELLS * params.cell_m**2:
        raise MapError(
            f"building {building.name!r} of {building.area_m2:.0f} m2 has more than {MAX_CELLS} cells of "
            f"{params.cell_m:g} m; make cell_m larger"
        )
    cells = cut_floor(building, params.cell_m)
    first, to, probability = _movements(cells, params)
    to = to.astype(np.int32)
    threshold, alias = np.empty(len(to), dtype=np.float32), np.empty(len(to), dtype=np.int32)
    kernels.alias_rows(first, to, probability, threshold, alias)
    return MovementTable(
        cells,
        params,
        read_only(first, np.int64),
        read_only(to, np.int32),
        read_only(threshold, np.float32),
        read_only(alias, np.int32),
    )


@functools.lru_cache(maxsize=8)
def movement_table(building: Building, params: MovementParams) -> MovementTable:
    """`build_table`, made once for each building: buildings are equal where their content is."""
    return build_table(building, params)


def _movements(cells: GridCells, params: MovementParams) -> tuple[IntArray, IntArray, FloatArray]:
    """Where entries of each cell begin (C + 1,), where they lead (M,) and how probably (M,)."""
    joined = cells.pair.T.ravel(), cells.pair[:, ::-1].T.ravel()
    graph = csr_array((np.tile(cells.way_m, 2), joined), shape=(len(cells), len(cells)))
    mean_m, sigma_m = (params.update_s * value for value in params.speed_mps)
    lengths, ends, rows = [], [], []
    for sources, near in _tiles(cells, params):
        way_m = dijkstra(graph[near][:, near], indices=sources, limit=params.farthest_m)
        source, end = np.nonzero(np.isfinite(way_m))
        lengths.append(way_m[source, end])
        ends.append(near[end])
        rows.append(near[sources][source])
    way_m, to, row = np.concatenate(lengths), np.concatenate(ends), np.concatenate(rows)
    order = np.argsort(row, kind="stable")
    way_m, to = way_m[order], to[order]
    first = np.concatenate([[0], np.cumsum(np.bincount(row, minlength=len(cells)))])
    ring = np.rint(way_m / params.cell_m).astype(np.int64)
    fraction = cells.area_m2[to] / params.cell_m**2
    log_density = -0.5 * ((way_m - mean_m) / sigma_m) ** 2
    probability = kernels.probabilities(first, ring, fraction, log_density, params.prune)
    kept = probability > 0
    counts = np.bincount(row[order][kept], minlength=len(cells))
    return np.concatenate([[0], np.cumsum(counts)]), to[kept], probability[kept]


def _tiles(cells: GridCells, params: MovementParams) -> list[tuple[IntArray, IntArray]]:
    """Cells by tiles of the plan: which of the near ones are in the tile, and all that a walk from there can meet."""
    tile_m = max(TILE_CELLS * params.cell_m, params.farthest_m)
    tile = np.floor((cells.xy_m - cells.xy_m.min(axis=0)) / tile_m).astype(np.int64)
    found = []
    by_x = np.argsort(cells.xy_m[:, 0], kind="stable")
    x_m = cells.xy_m[by_x, 0]
    low_m = cells.xy_m.min(axis=0)
    for number in np.unique(tile, axis=0):
        corner_m = low_m + tile_m * number
        (left_m, bottom_m), (right_m, top_m) = corner_m - params.farthest_m, corner_m + tile_m + params.farthest_m
        near = by_x[slice(*np.searchsorted(x_m, [left_m, right_m]))]
        y_m = cells.xy_m[near, 1]
        near = np.sort(near[(y_m >= bottom_m) & (y_m <= top_m)])
        found.append((np.flatnonzero((tile[near] == number).all(axis=1)), near))
    return found
