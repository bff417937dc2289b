"""The particle filter of Woodman & Harle 2008 for millions of particles."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numba
import numpy as np

from pdrbench.building import Building, FloorRegion
from pdrbench.building.convex import ConvexMap, compile_map
from pdrbench.filters import kernels
from pdrbench.filters.kld import kld_bound, normal_quantile
from pdrbench.filters.params import Cloud, FilterError, HeadingPrior, MapFilterParams
from pdrbench.geometry import FloatArray

FEW: Final = 20_000  # particles that one thread handles in one call
FIRST_SHARE: Final = 0.85  # of the many particles that a generation is expected to need come in its first batch
SMALLEST_BATCH: Final = 64  # a batch is no smaller than this part of what is there; particles too many, at most
PRIOR_SHARE: Final = 0.5  # of the particles that a prior needs, if its region fills its bins, come in its first batch
MARGIN_BINS: Final = 4  # around the building, for particles that died outside
MOST_CELLS: Final = 2**30  # bins that fit into memory as one byte each


class MapFilter:
    """Tracks a walker through a building by strides: resample, propagate, correct (eq. 3-16; claims W4 to W10).

    The same algorithm as `LiteralMapFilter` with two differences that keep the distribution: the draw is systematic
    instead of multinomial, and KLD sampling looks at its bins after batches instead of after every particle.
    Coordinates are float32 relative to the middle of the building. Same generator, same bytes, whatever the number of
    threads.

    Args:
        building: The map; compiled once per building.
        rng: Draws the key of all random numbers of this filter.
        params: None for the paper's.
    """

    def __init__(self, building: Building, rng: np.random.Generator, params: MapFilterParams | None = None) -> None:
        self._params = params or MapFilterParams()
        self._map = compile_map(building)
        self._keys = np.array([*rng.integers(2**32, size=2), 0], dtype=np.uint64)
        self._z = normal_quantile(self._params.kld_delta)
        self._grid, bin_base, self._num_cells = _bins(building, self._map, self._params)
        m = self._map
        self._world = kernels.World(
            m.line, m.first_line, m.first_gate, m.gate, m.gate_to, m.box_m, m.height_m, bin_base
        )
        self._now, self._next = _Buffer.of(0), _Buffer.of(0)
        self._excess = 1.0  # of the need of the last generation over what was expected
        self._stamps: Any = None
        self._scratch: Any = None
        self.num_particles = 0
        self.num_bins = 0
        self.overshoot = 0

    @property
    def is_dead(self) -> bool:
        """True where every particle of the last generation hit a wall."""
        return not self._now.particles[3, : self.num_particles].any()

    @property
    def nbytes(self) -> int:
        """Memory of the particles, both generations."""
        return self._now.nbytes + self._next.nbytes

    def start(self, region: FloorRegion, heading: HeadingPrior | None = None) -> None:
        """Draws the prior: uniform over a region and over headings, as many particles as KLD sampling asks for.

        Args:
            region: Of the building's floor.
            heading: None for all directions.

        Raises:
            FilterError: The region covers no floor.
        """
        p = self._params
        triangles = self._triangles(region)
        heading = heading or HeadingPrior()
        turns = np.array([heading.centre_rad - heading.half_width_rad, 2 * heading.half_width_rad]) / (2 * math.pi)
        self._begin()

        def fill(first: int, count: int, offset: float, into: _Buffer, marks: Any) -> None:
            kernels.draw_prior(
                triangles, turns.astype(np.float32), offset, self._keys, self._grid, self._world.bin_base, first, count,
                into.particles, into.pieces, marks,
            )  # fmt: skip

        filled_bins = triangles[2][-1] / p.bin_m**2 * abs(turns[1]) * p.heading_bins
        self._generate(fill, int(PRIOR_SHARE * kld_bound(int(filled_bins), p.kld_epsilon, self._z)))

    def update(self, length_m: float, height_m: float, turn_rad: float) -> None:
        """One stride event u = (l, dz, dtheta): a new generation, Algorithm 1 for each of its particles.

        Args:
            length_m: Horizontal length; zero and negative lengths are walked as they are.
            height_m: Change of height.
            turn_rad: Change of heading, made before the length is walked.

        Raises:
            FilterError: There is no live particle to draw from, or a number is not finite.
        """
        motion = self._motion(length_m, height_m, turn_rad)
        self._begin()
        if self.num_particles > FEW or not self._step_few(motion):
            self._step_many(motion)

    def propagate(self, length_m: float, height_m: float, turn_rad: float) -> None:
        """Moves and weighs the particles where they are, without drawing anew: `update` without its first part.

        Weights of before are lost; arguments and errors as in `update`.
        """
        motion = self._motion(length_m, height_m, turn_rad)
        self._begin()
        p, now, marks = self._params, self._now, self._marks()
        kernels.advance(
            self._world, motion, self._keys, self._grid, p.live_only, 0, self.num_particles, now.particles,
            now.pieces[:0], now.particles, now.pieces, marks,
        )  # fmt: skip
        self.num_bins, self.overshoot = int(kernels.count_marks(marks)), 0

    def _motion(self, length_m: float, height_m: float, turn_rad: float) -> kernels.Motion:
        if not (math.isfinite(length_m) and math.isfinite(height_m) and math.isfinite(turn_rad)):
            raise FilterError(f"a stride of {length_m} m, {height_m} m up, {turn_rad} rad: give finite numbers")
        p, f, turn = self._params, np.float32, 2 * math.pi
        return kernels.Motion(
            length=f(length_m),
            length_sigma=f(p.length_sigma_m),
            turn=f(turn_rad / turn),
            turn_sigma=f(p.heading_sigma_rad / turn),
            least_length=f(0.0 if p.clip_length else -math.inf),
            rise=float(height_m),
            rise_sigma=p.height_sigma_m,
        )

    def _marks(self) -> Any:
        """(threads, bins) none of which is occupied."""
        return np.zeros((numba.get_num_threads(), self._num_cells), dtype=np.uint8)

    def adjust(self, params: MapFilterParams) -> None:
        """Other settings from the next stride on.

        Raises:
            FilterError: They ask for other bins.
        """
        if (params.bin_m, params.bin_rad) != (self._params.bin_m, self._params.bin_rad):
            raise FilterError("a filter keeps its bins; make a new one")
        self._params, self._z = params, normal_quantile(params.kld_delta)

    def cloud(self, most: int | None = None) -> Cloud:
        """The particles of the last generation, thinned evenly to at most `most`."""
        count = self.num_particles
        chosen = slice(0, count, 1 if most is None else max(1, math.ceil(count / most)))
        x, y, turns, weight = self._now.particles[:, chosen].astype(np.float64)
        return Cloud(
            xy_m=np.column_stack([x, y]) + self._map.origin_xy_m,
            heading_rad=turns * (2 * math.pi),
            polygon=self._map.polygon[self._now.pieces[chosen]],
            weight=weight,
        )

    def _triangles(self, region: FloorRegion) -> tuple[Any, Any, FloatArray]:
        """Corners, pieces and running sum of the areas of a region."""
        corners, piece = self._map.pieces_of(region)
        side = np.diff(corners.astype(np.float64), axis=1)
        area_m2 = np.abs(side[:, 0, 0] * side[:, 1, 1] - side[:, 0, 1] * side[:, 1, 0]) / 2
        if not area_m2.sum() > 0:
            raise FilterError("the region to start in covers no floor; check its polygons, or start on the whole floor")
        return corners, piece, np.cumsum(area_m2)

    def _begin(self) -> None:
        """Random numbers of the next generation differ from all before."""
        self._keys[2] += np.uint64(1)

    def _step_few(self, motion: kernels.Motion) -> bool:
        """A generation by one thread in one call; False where it grows too large for that."""
        if self._stamps is None:
            self._stamps, self._scratch = np.zeros(self._num_cells, dtype=np.int32), kernels.new_scratch()
        p = self._params
        if not FEW <= self._next.capacity <= 2 * FEW:
            self._next = _Buffer.of(FEW)
        bound = np.array([p.kld_epsilon, self._z, p.min_particles, p.max_particles, self.num_bins])
        filled, num_bins, enough = kernels.step_few(
            self._world, motion, self._keys, self._grid, p.live_only, bound, self._now.particles,
            self._now.pieces, self.num_particles, self._next.particles, self._next.pieces, self._stamps,
            int(self._keys[2]), self._scratch,
        )  # fmt: skip
        if filled > self._next.capacity:
            return False
        if not filled:
            raise _no_particle()
        self._now, self._next = self._next, self._now
        self.num_particles, self.num_bins, self.overshoot = filled, num_bins, filled - enough
        return True

    def _step_many(self, motion: kernels.Motion) -> None:
        """A generation in parallel: every batch is drawn from the whole of the old generation, sorted by piece."""
        p, old, count = self._params, self._now, self.num_particles
        sums = kernels.sum_weights(old.particles[3], count)
        before = np.concatenate([[0.0], np.cumsum(sums[:, 0])])
        total, squares = float(before[-1]), float(sums[:, 1].sum())
        if not total > 0:
            raise _no_particle()
        offspring = np.empty((len(sums), len(self._map)), dtype=np.int32)

        def fill(first: int, number: int, offset: float, into: _Buffer, marks: Any) -> None:
            scale = number / total
            offspring[:] = 0
            kernels.count_offspring(old.particles[3], old.pieces, count, before, scale, offset, offspring)
            kernels.place_offspring(offspring, first)
            kernels.choose_ancestors(old.particles[3], old.pieces, count, before, scale, offset, offspring, into.pieces)
            kernels.advance(
                self._world, motion, self._keys, self._grid, p.live_only, first, number, old.particles, old.pieces,
                into.particles, into.pieces, marks,
            )  # fmt: skip

        expected = kernels.expected_need(self.num_bins, count, total, squares, p.kld_epsilon, self._z)
        self._generate(fill, int(FIRST_SHARE * self._excess * expected))
        self._excess = min(max((self.num_particles - self.overshoot) / expected, 0.5), 1.2)

    def _generate(self, fill: Callable[[int, int, float, _Buffer, Any], None], first_batch: int) -> None:
        """Fills a generation batch by batch until it has enough particles for its bins (KLD sampling, W10)."""
        p = self._params
        key0, key1, generation = (int(key) for key in self._keys)
        threads, marks, into = numba.get_num_threads(), self._marks(), self._next
        filled, batch, num_bins, enough = 0, 0, 0, p.min_particles
        wanted = min(max(first_batch, p.min_particles), p.max_particles)
        while filled < wanted:
            into = into.grown(filled, wanted)
            self._next = into
            offset = kernels.random_offset(generation, batch, key0, key1)
            numba.set_num_threads(threads if max(wanted - filled, self.num_particles) > FEW else 1)
            try:
                fill(filled, wanted - filled, offset, into, marks)
            finally:
                numba.set_num_threads(threads)
            num_bins = int(kernels.count_marks(marks))
            enough = min(max(kld_bound(num_bins, p.kld_epsilon, self._z), p.min_particles), p.max_particles)
            filled, batch = wanted, batch + 1
            if enough > filled:
                wanted = min(max(enough, filled + filled // SMALLEST_BATCH), p.max_particles)
        self._now, self._next = into, self._now
        self.num_particles, self.num_bins, self.overshoot = filled, num_bins, filled - enough


@dataclass(frozen=True, slots=True)
class _Buffer:
    """Room for one generation.

    Attributes:
        particles: (4, capacity) float32: x, y, turns, weight.
        pieces: (capacity,) int32.
    """

    particles: Any
    pieces: Any

    @classmethod
    def of(cls, capacity: int) -> _Buffer:
        return cls(np.empty((4, capacity), dtype=np.float32), np.empty(capacity, dtype=np.int32))

    @property
    def capacity(self) -> int:
        return len(self.pieces)

    @property
    def nbytes(self) -> int:
        return int(self.particles.nbytes + self.pieces.nbytes)

    def grown(self, filled: int, wanted: int) -> _Buffer:
        """A buffer with room for `wanted` particles that holds the first `filled`; this one, where it fits well."""
        if wanted <= self.capacity and (filled or self.capacity <= 2 * max(wanted, FEW)):
            return self
        larger = _Buffer.of(wanted)
        larger.particles[:, :filled] = self.particles[:, :filled]
        larger.pieces[:filled] = self.pieces[:filled]
        return larger


def _no_particle() -> FilterError:
    return FilterError("no particle is alive to draw from; start() again")


def _bins(building: Building, world: ConvexMap, params: MapFilterParams) -> tuple[kernels.Grid, Any, int]:
    """Bins over x, y, floor height and heading (W10), laid out around the building.

    Returns:
        grid: `Grid`.
        base: (K,) int32 first bin of each piece's height.
        num_cells: Of all heights together.
    """
    x0, y0, x1, y1 = building.bounds_m()
    column0, row0 = (math.floor(low / params.bin_m) - MARGIN_BINS for low in (x0, y0))
    columns = math.floor(x1 / params.bin_m) + MARGIN_BINS + 1 - column0
    rows = math.floor(y1 / params.bin_m) + MARGIN_BINS + 1 - row0
    height = np.floor(building.height(world.polygon) / params.bin_m).astype(np.int64)
    heights, which = np.unique(height, return_inverse=True)
    of_height = rows * columns * params.heading_bins
    if of_height * len(heights) > MOST_CELLS:
        raise FilterError(
            f"building {building.name!r} has {of_height * len(heights):.1e} bins; make bin_m or bin_rad larger"
        )
    low_xy_m = np.array([column0, row0]) * params.bin_m - world.origin_xy_m
    real, whole = np.float32, np.int32
    grid = kernels.Grid(
        x=real(low_xy_m[0]),
        y=real(low_xy_m[1]),
        per_m=real(1 / params.bin_m),
        turn_bins=whole(params.heading_bins),
        last_column=whole(columns - 1),
        last_row=whole(rows - 1),
        columns=whole(columns),
    )
    return grid, (which * of_height).astype(np.int32), of_height * len(heights)
