"""The particle filter of Woodman & Harle 2008 for millions of particles."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final

import numba
import numpy as np
from numpy.typing import NDArray

from pdrbench.building import Building, FloorRegion
from pdrbench.building.convex import compile_map
from pdrbench.compiled import in_threads
from pdrbench.filters import FilterError, kld_bound, normal_quantile
from pdrbench.geometry import FloatArray
from pdrbench_baselines.woodman2008 import generation, resampling
from pdrbench_baselines.woodman2008.generation import Bins, Bound, Motion, Particles, Prior
from pdrbench_baselines.woodman2008.params import HeadingPrior, ParticleCloud, WoodmanFilterParams
from pdrbench_baselines.woodman2008.random_numbers import random_offset

FEW: Final = 20_000  # particles that one thread handles in one call
FIRST_BATCH: Final = 0.85  # of the many particles that a generation is expected to need come in its first batch
MIN_BATCH: Final = 64  # a batch is no smaller than this part of what is there; particles too many, at most
PRIOR_BATCH: Final = 0.5  # of the particles that a prior needs, if its region fills its bins, come in its first batch
MARGIN_BINS: Final = 4  # around the building, for particles that hit its outer walls
MAX_BINS: Final = 2**30  # that fit into memory as one byte each
FULL_TURN_RAD: Final = 2 * math.pi


class WoodmanFilter:
    """Tracks a walker through a building by strides: resample, propagate, correct (eq. 3-16; claims W4 to W10).

    Algorithm 1 with two differences that keep the distribution (W9): the draw is systematic instead of multinomial, and
    KLD sampling looks at its bins after batches instead of after every particle. Coordinates are float32 relative to
    the middle of the building. Same generator, same bytes, whatever the number of threads.

    Args:
        building: The map; compiled once per building.
        rng: Draws the key of all random numbers of this filter.
        params: None for the paper's.

    Attributes:
        num_particles: Of the last generation.
        num_bins: That they occupy.
        overshoot: Particles beyond the bound for that many bins.
    """

    def __init__(self, building: Building, rng: np.random.Generator, params: WoodmanFilterParams | None = None) -> None:
        self._params = params or WoodmanFilterParams()
        self._convex = compile_map(building)
        self._origin_m = self._convex.origin_xy_m
        self._keys = np.array([*rng.integers(2**32, size=2), 0], dtype=np.uint64)
        self._bound = bound_of(self._params)
        self._bins, self._all_bins = lay_out(building, self._convex.polygon, self._origin_m, self._params, np.float32)
        self._now, self._next = _room(0), _room(0)
        self._excess = 1.0  # of the need of the last generation over what was expected
        self._stamps: Any = None
        self._few: generation.Few | None = None  # of the present rooms and settings
        self.num_particles, self.num_bins, self.overshoot = 0, 0, 0

    @property
    def is_depleted(self) -> bool:
        """True where every particle of the last generation hit a wall."""
        return not self._now.state[3, : self.num_particles].any()

    @property
    def nbytes(self) -> int:
        """Memory of the particles, both generations."""
        return int(sum(array.nbytes for room in (self._now, self._next) for array in room))

    def start(self, region: FloorRegion, heading: HeadingPrior | None = None) -> None:
        """Draws the prior: uniform over a region and over headings, as many particles as KLD sampling asks for.

        Args:
            region: Of the building's floor.
            heading: None for all directions.

        Raises:
            FilterError: The region covers no floor.
        """
        p, heading = self._params, heading or HeadingPrior()
        prior = prior_of(*self._convex.cells_of(region), heading, np.float32, FULL_TURN_RAD)
        self._begin()

        def fill(first: int, count: int, offset: float, into: Particles, marks: Any) -> None:
            arguments = prior, offset, self._keys, self._bins, first, count, into, marks
            in_threads(generation.draw_prior, resampling.chunks_of(count), *arguments)

        filled_bins = prior.area[-1] / p.bin_m**2 * abs(2 * heading.half_width_rad / FULL_TURN_RAD) * p.heading_bins
        self._generate(fill, int(PRIOR_BATCH * kld_bound(int(filled_bins), self._bound.epsilon, self._bound.z)))

    def update(self, length_m: float, height_m: float, turn_rad: float) -> None:
        """One stride event u = (l, dz, dtheta): a new generation, Algorithm 1 for each of its particles.

        Args:
            length_m: Horizontal length; zero and negative lengths are walked as they are.
            height_m: Change of height.
            turn_rad: Change of heading, made before the length is walked.

        Raises:
            FilterError: There is no live particle to draw from, or a number is not finite.
        """
        stride = length_m, height_m, turn_rad
        require_finite(stride)
        if self.num_particles > FEW:
            self._begin()
        elif self._step_few(float(length_m), float(height_m), turn_rad / FULL_TURN_RAD):
            return
        self._step_many(motion_of(self._params, stride, np.float32, FULL_TURN_RAD))

    def propagate(self, length_m: float, height_m: float, turn_rad: float) -> None:
        """Moves and weighs the particles where they are, without drawing anew: `update` without its first part.

        Weights of before are lost; arguments and errors as in `update`.
        """
        motion = motion_of(self._params, (length_m, height_m, turn_rad), np.float32, FULL_TURN_RAD)
        self._begin()
        marks = self._marks()
        no_ancestors = self._now._replace(cell=self._now.cell[:0])
        self._advance(motion, 0, self.num_particles, no_ancestors, self._now, marks)
        self.num_bins, self.overshoot = int(generation.count_marks(marks)), 0

    def adjust(self, params: WoodmanFilterParams) -> None:
        """Other settings from the next stride on.

        Raises:
            FilterError: They ask for other bins.
        """
        if (params.bin_m, params.bin_rad) != (self._params.bin_m, self._params.bin_rad):
            raise FilterError("a filter keeps its bins; make a new one")
        if params == self._params:
            return
        self._params, self._bound, self._few = params, bound_of(params), None
        self._bins = self._bins._replace(live_only=params.live_only)

    def cloud(self, most: int | None = None) -> ParticleCloud:
        """The particles of the last generation, thinned evenly to at most `most`."""
        every = 1 if most is None else max(1, math.ceil(self.num_particles / most))
        chosen = slice(0, self.num_particles, every)
        x, y, turns, weight = self._now.state[:, chosen].astype(np.float64)
        return ParticleCloud(
            xy_m=np.column_stack([x, y]) + self._origin_m,
            heading_rad=turns * FULL_TURN_RAD,
            polygon=self._convex.polygon[self._now.cell[chosen]],
            weight=weight,
        )

    def _marks(self) -> Any:
        """(threads, bins) none of which is occupied."""
        return np.zeros((numba.get_num_threads(), self._all_bins), dtype=np.uint8)

    def _begin(self) -> None:
        """Random numbers of the next generation differ from all before."""
        self._keys[2] += np.uint64(1)

    def _complete(self, filled: int, num_bins: int, needed: int) -> None:
        """The generation that was written becomes the present one."""
        self._now, self._next, self.num_particles = self._next, self._now, filled
        self.num_bins, self.overshoot = num_bins, filled - needed

    def _step_few(self, length_m: float, height_m: float, turns: float) -> bool:
        """Begins a generation, made by one thread in one call; False where it grows too large for that."""
        if self._few is None or not FEW <= len(self._next.cell) <= 2 * FEW:
            self._few = self._hand_over()
        count, num_bins = self.num_particles, self.num_bins
        filled, num_bins, needed = generation.next_generation(self._few, count, num_bins, length_m, height_m, turns)
        if filled > len(self._next.cell):
            return False
        if not filled:
            raise no_live_particle()
        self._complete(filled, num_bins, needed)
        return True

    def _hand_over(self) -> generation.Few:
        """What a call takes long to be given, once for all strides."""
        if self._stamps is None:
            self._stamps, self._slot = np.zeros(self._all_bins, np.int32), np.zeros(len(self._convex), np.int32)
        if not FEW <= len(self._next.cell) <= 2 * FEW:
            self._next = _room(FEW)
        still = motion_of(self._params, (0.0, 0.0, 0.0), np.float32, FULL_TURN_RAD)
        return generation.few_of(
            self._convex.world, still, self._keys, self._bins, self._bound, self._now, self._next, self._stamps,
            self._slot,
        )  # fmt: skip

    def _step_many(self, motion: Motion) -> None:
        """A generation in parallel: every batch is drawn from the whole of the old generation, sorted by cell."""
        old, count = self._now, self.num_particles
        weight = old.state[3]
        chunks = resampling.chunks_of(count)
        sums = np.empty((chunks, 2))
        in_threads(resampling.sum_weights, chunks, weight, count, sums)
        before = np.concatenate([[0.0], np.cumsum(sums[:, 0])])
        total, squares = float(before[-1]), float(sums[:, 1].sum())
        if not total > 0:
            raise no_live_particle()
        offspring = np.empty((chunks, len(self._convex)), dtype=np.int32)

        def fill(first: int, number: int, offset: float, into: Particles, marks: Any) -> None:
            scale = number / total
            offspring[:] = 0
            drawn = weight, old.cell, count, before, scale, offset, offspring
            in_threads(resampling.count_offspring, chunks, *drawn)
            resampling.place_offspring(offspring, first)
            in_threads(resampling.choose_ancestors, chunks, *drawn, into.cell)
            self._advance(motion, first, number, old, into, marks)

        expected = generation.expected_need(self.num_bins, count, total, squares, self._bound)
        self._generate(fill, int(FIRST_BATCH * self._excess * expected))
        self._excess = min(max((self.num_particles - self.overshoot) / expected, 0.5), 1.2)

    def _advance(self, motion: Motion, first: int, count: int, old: Particles, new: Particles, marks: Any) -> None:
        arguments = self._convex.world, motion, self._keys, self._bins, first, count, old, new, marks
        in_threads(generation.advance, resampling.chunks_of(count), *arguments)

    def _generate(self, fill: Callable[[int, int, float, Particles, Any], None], first_batch: int) -> None:
        """Fills a generation batch by batch until it has enough particles for its bins (KLD sampling, W10)."""
        bound, marks, self._few = self._bound, self._marks(), None
        filled, batch, num_bins, needed = 0, 0, 0, bound.min_particles
        wanted = min(max(first_batch, bound.min_particles), bound.max_particles)
        while filled < wanted:
            self._next = _grown(self._next, filled, wanted)
            offset = random_offset(self._keys, batch)
            fill(filled, wanted - filled, offset, self._next, marks)
            num_bins = int(generation.count_marks(marks))
            needed = generation.enough(num_bins, bound)
            filled, batch = wanted, batch + 1
            if needed > filled:
                wanted = min(max(needed, filled + filled // MIN_BATCH), bound.max_particles)
        self._complete(filled, num_bins, needed)


def _room(capacity: int) -> Particles:
    """Room for one generation."""
    return Particles(np.empty((4, capacity), dtype=np.float32), np.empty(capacity, dtype=np.int32))


def _grown(room: Particles, filled: int, wanted: int) -> Particles:
    """Room for `wanted` particles that holds the first `filled`; the same, where it fits well."""
    capacity = len(room.cell)
    if wanted <= capacity and (filled or capacity <= 2 * max(wanted, FEW)):
        return room
    larger = _room(wanted)
    larger.state[:, :filled], larger.cell[:filled] = room.state[:, :filled], room.cell[:filled]
    return larger


def prior_of(corners: NDArray[Any], cell: NDArray[Any], heading: HeadingPrior, real: Any, unit_rad: float) -> Prior:
    """Uniform over triangles (T, 3, 2) in their cells (T,), and over headings, in units of `unit_rad`.

    Raises:
        FilterError: The triangles have no area.
    """
    side = np.diff(corners.astype(np.float64), axis=1)
    area_m2 = np.abs(side[:, 0, 0] * side[:, 1, 1] - side[:, 0, 1] * side[:, 1, 0]) / 2
    if not area_m2.sum() > 0:
        raise FilterError("the region to start in covers no floor; check its polygons, or start on the whole floor")
    turns = np.array([heading.centre_rad - heading.half_width_rad, 2 * heading.half_width_rad]) / unit_rad
    return Prior(corners, cell, np.cumsum(area_m2), *turns.astype(real))


def motion_of(params: WoodmanFilterParams, stride: tuple[float, float, float], real: Any, unit_rad: float) -> Motion:
    """A stride and what is known of its errors, turns in units of `unit_rad`.

    Raises:
        FilterError: A number is not finite.
    """
    length_m, height_m, turn_rad = stride
    require_finite(stride)
    return Motion(
        length=real(length_m),
        length_sigma=real(params.length_sigma_m),
        turn=real(turn_rad / unit_rad),
        turn_sigma=real(params.heading_sigma_rad / unit_rad),
        min_length=real(0.0 if params.clip_length else -math.inf),
        rise=float(height_m),
        rise_sigma=float(params.height_sigma_m),
    )


def require_finite(stride: tuple[float, float, float]) -> None:
    if not all(map(math.isfinite, stride)):
        length_m, height_m, turn_rad = stride
        raise FilterError(f"a stride of {length_m} m, {height_m} m up, {turn_rad} rad: give finite numbers")


def no_live_particle() -> FilterError:
    return FilterError("no particle is alive to draw from; start() again")


def bound_of(params: WoodmanFilterParams) -> Bound:
    """When a generation is complete."""
    return Bound(params.kld_epsilon, normal_quantile(params.kld_delta), params.min_particles, params.max_particles)


def lay_out(
    building: Building, polygon: NDArray[Any], origin_xy_m: FloatArray, params: WoodmanFilterParams, real: Any
) -> tuple[Bins, int]:
    """Bins around the building over x, y, floor height and heading (W10), and how many they are.

    Args:
        building: The map.
        polygon: (K,) of each cell of the map.
        origin_xy_m: (2,) to which places are relative.
        params: Sizes of the bins.
        real: Floating-point type of places.
    """
    x0, y0, x1, y1 = building.bounds_m()
    column0, row0 = (math.floor(low / params.bin_m) - MARGIN_BINS for low in (x0, y0))
    columns = math.floor(x1 / params.bin_m) + MARGIN_BINS + 1 - column0
    rows = math.floor(y1 / params.bin_m) + MARGIN_BINS + 1 - row0
    height = np.floor(building.height(polygon) / params.bin_m).astype(np.int64)
    heights, which = np.unique(height, return_inverse=True)
    of_height = rows * columns * params.heading_bins
    num_bins = of_height * len(heights)
    if num_bins > MAX_BINS:
        raise FilterError(f"building {building.name!r} has {num_bins:.1e} bins; make bin_m or bin_rad larger")
    low_xy_m = np.array([column0, row0]) * params.bin_m - origin_xy_m
    whole = np.int32
    bins = Bins(
        x=real(low_xy_m[0]),
        y=real(low_xy_m[1]),
        per_m=real(1 / params.bin_m),
        turn_bins=whole(params.heading_bins),
        last_column=whole(columns - 1),
        last_row=whole(rows - 1),
        columns=whole(columns),
        first=(which * of_height).astype(np.int32),
        live_only=params.live_only,
    )
    return bins, num_bins
