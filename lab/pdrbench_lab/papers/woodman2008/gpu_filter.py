"""The particle filter of Woodman & Harle 2008 on a GPU: of one walk, or of many walks at once."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, Final

import numba
import numpy as np
from numpy.typing import NDArray

from pdrbench.building import Building, FloorRegion
from pdrbench.building.convex import compile_map
from pdrbench.compiled import compiled
from pdrbench.filters import FilterError, kld_bound
from pdrbench.filters.map_walk import MAX_EXPONENT, exp_minus
from pdrbench.geometry import BoolArray, FloatArray
from pdrbench_baselines.woodman2008.generation import FIRST_BATCH as FIRST_BATCH_OF_FEW
from pdrbench_baselines.woodman2008.generation import enough, expected_need
from pdrbench_baselines.woodman2008.map_filter import (
    FEW,
    FIRST_BATCH,
    FULL_TURN_RAD,
    MIN_BATCH,
    PRIOR_BATCH,
    bound_of,
    lay_out,
    motion_of,
    no_live_particle,
    prior_of,
)
from pdrbench_baselines.woodman2008.params import HeadingPrior, ParticleCloud, WoodmanFilterParams
from pdrbench_lab.papers.woodman2008 import gpu_kernels as gpu
from pdrbench_lab.papers.woodman2008.gpu_kernels import NUM_BINS, DeviceBins, DeviceWorld, cuda

MIN_BLOCKS: Final = (
    1 if getattr(numba.config, "ENABLE_CUDASIM", 0) else 128
)  # Numba warns of fewer; those too many return at once
MIN_CAPACITY: Final = 1024  # particles of a walk for which there is room


class GpuFilters:
    """W walkers in one building, each with a particle filter of its own; a launch of a kernel serves all of them.

    The algorithm of `WoodmanFilter`, with the same random numbers and batches. Its particles stay in the order in which
    they were drawn, where a processor sorts many of them by cell. Sums of weights and counts are of whole numbers:
    same generators, same bytes, whatever the size of a block.

    Args:
        building: The map; compiled once per building.
        rngs: One for each walk; draws the key of all its random numbers.
        params: None for the paper's.
        threads: Of a block, a power of two.

    Attributes:
        num_particles: (W,) of the last generation of each walk.
        num_bins: (W,) that they occupy.
        num_live: (W,) of the particles that hit no wall.
        overshoot: (W,) particles beyond the bound for that many bins.
    """

    def __init__(
        self,
        building: Building,
        rngs: Sequence[np.random.Generator],
        params: WoodmanFilterParams | None = None,
        threads: int = gpu.THREADS,
    ) -> None:
        self._params, walks = params or WoodmanFilterParams(), len(rngs)
        self._bound, self._threads, self._kernels = bound_of(self._params), threads, gpu.kernels(threads)
        self._convex = compile_map(building)
        self._origin_m = self._convex.origin_xy_m
        self._keys = np.array([[*rng.integers(2**32, size=2), 0] for rng in rngs], dtype=np.uint64)
        bins, all_bins = lay_out(building, self._convex.polygon, self._origin_m, self._params, np.float32)
        self._world = DeviceWorld(*map(cuda.to_device, map(_filled, (*self._convex.world, bins.first))))
        self._bins = DeviceBins(*bins[:7], np.int32(self._params.live_only))
        self._plan = np.zeros((walks, gpu.COLUMNS))
        self._device_plan = cuda.to_device(self._plan)
        self._result = np.zeros((walks, gpu.RESULTS), dtype=np.int64)
        self._device_result = cuda.to_device(self._result)
        self._stamps = cuda.to_device(np.zeros((walks, all_bins), dtype=np.int32))
        self._best = cuda.to_device(np.zeros((2, walks), dtype=np.float32))
        self._side = np.zeros(walks, dtype=np.int64)  # which half of the memory has the last generation
        self._excess = np.ones(walks)
        self._capacity = 0
        self._state: Any = None
        self._cells: Any = None
        self._cumulative: Any = None
        self._sums: Any = None
        self.num_particles, self.num_bins, self.num_live, self.overshoot = np.zeros((4, walks), dtype=np.int64)
        self._room_for(MIN_CAPACITY)

    def __len__(self) -> int:
        return len(self._plan)

    @property
    def nbytes(self) -> int:
        """Memory of the particles, both generations, and of the running sums of their weights."""
        return int(self._state.nbytes + self._cells.nbytes + self._cumulative.nbytes)

    def start(self, region: FloorRegion, heading: HeadingPrior | None = None, walks: BoolArray | None = None) -> None:
        """Draws the prior of some walks: uniform over a region and headings, as many particles as KLD asks for.

        Args:
            region: Of the building's floor.
            heading: None for all directions.
            walks: (W,) which; None for all.

        Raises:
            FilterError: The region covers no floor.
        """
        p, heading = self._params, heading or HeadingPrior()
        active = self._active(walks)
        prior = prior_of(*self._convex.cells_of(region), heading, np.float32, FULL_TURN_RAD)
        corners, owner, area = (cuda.to_device(_filled(array)) for array in prior[:3])
        self._begin(active)
        self._plan[:, gpu.FIRST_TURN], self._plan[:, gpu.TURNS] = prior.first_turn, prior.turns
        self._plan[:, gpu.TARGET] = 1 - self._side
        self._clear()

        def fill(grid: tuple[int, int]) -> None:
            self._kernels.draw_prior[grid, self._threads](
                self._device_plan, corners, owner, area, self._world, self._bins, self._state, self._cells,
                self._stamps, self._device_result, self._best,
            )  # fmt: skip

        filled_bins = prior.area[-1] / p.bin_m**2 * abs(2 * heading.half_width_rad / FULL_TURN_RAD) * p.heading_bins
        first = int(PRIOR_BATCH * kld_bound(int(filled_bins), self._bound.epsilon, self._bound.z))
        self._generate(fill, active, np.full(len(self), first), active, np.full(len(self), prior.area[-1]))

    def update(self, stride: FloatArray, walks: BoolArray | None = None) -> None:
        """One stride event of some walks: a new generation of each, Algorithm 1 for each of its particles.

        Args:
            stride: (W, 3) u = (l, dz, dtheta): length, change of height, and turn, which is made first.
            walks: (W,) which; None for all.

        Raises:
            FilterError: One of these has no live particle to draw from, or a number is not finite.
        """
        active = self._active(walks)
        motions = self._motions(stride, active)
        if not self.num_live[active].all():
            raise no_live_particle()
        self._begin(active)
        self._plan[:, gpu.LENGTH : gpu.SAME + 1] = motions
        self._plan[:, gpu.TARGET] = 1 - self._side
        self._sum_weights(active)
        total, squares = self._result[:, gpu.TOTAL], self._result[:, gpu.SQUARES] * 2.0 ** (2 * gpu.SQUARE_SHIFT)
        expected, first = np.zeros((2, len(self)), dtype=np.int64)
        size = self.num_particles, self.num_bins
        _plan_first(active, *size, total, squares, self._excess, self._bound, expected, first)
        many = active & (self.num_particles > FEW)
        self._generate(self._advance, active, first, many, total.copy())
        needed = self.num_particles - self.overshoot
        self._excess[many] = np.clip(needed[many] / expected[many], 0.5, 1.2)

    def propagate(self, stride: FloatArray) -> None:
        """Moves and weighs the particles where they are, without drawing anew: `update` without its first part.

        Weights of before are lost; arguments and errors as in `update`.
        """
        active = self._active(None)
        motions = self._motions(stride, active)
        self._begin(active)
        self._plan[:, gpu.LENGTH : gpu.SAME + 1] = motions
        self._plan[:, gpu.TARGET] = self._side
        self._clear()
        self._plan[:, gpu.FIRST], self._plan[:, gpu.NUMBER] = 0, self.num_particles
        self._upload()
        self._advance(self._grid(int(self.num_particles.max()), self._threads))
        self._read()
        self.num_bins, self.num_live = self._result[:, NUM_BINS].copy(), self._result[:, gpu.LIVE].copy()
        self.overshoot[:] = 0

    def adjust(self, params: WoodmanFilterParams) -> None:
        """Other settings from the next stride on.

        Raises:
            FilterError: They ask for other bins.
        """
        if (params.bin_m, params.bin_rad) != (self._params.bin_m, self._params.bin_rad):
            raise FilterError("a filter keeps its bins; make a new one")
        self._params, self._bound = params, bound_of(params)
        self._bins = self._bins._replace(live_only=np.int32(params.live_only))

    def cloud(self, walk: int, most: int | None = None) -> ParticleCloud:
        """The particles of the last generation of a walk, thinned evenly to at most `most`."""
        count = int(self.num_particles[walk])
        every = 1 if most is None else max(1, math.ceil(count / most))
        state, cell = self.particles(walk, every)
        x, y, turns, weight = state.astype(np.float64)
        return ParticleCloud(
            xy_m=np.column_stack([x, y]) + self._origin_m,
            heading_rad=turns * FULL_TURN_RAD,
            polygon=self._convex.polygon[cell].astype(np.int64),
            weight=weight,
        )

    def particles(self, walk: int, every: int = 1) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
        """Every so many-th particle: state (4, n) and cell (n,), as `generation.Particles` has them."""
        number = -(-int(self.num_particles[walk]) // every)
        state, cell = cuda.device_array((4, number), np.float32), cuda.device_array(number, np.int32)
        if number:
            blocks = max(MIN_BLOCKS, -(-number // self._threads))
            self._kernels.thin[blocks, self._threads](
                self._state, self._cells, int(self._side[walk]), walk, every, state, cell
            )
        return state.copy_to_host(), cell.copy_to_host()

    def _active(self, walks: BoolArray | None) -> BoolArray:
        return np.ones(len(self), dtype=np.bool_) if walks is None else np.asarray(walks, dtype=np.bool_)

    def _motions(self, stride: FloatArray, active: BoolArray) -> FloatArray:
        """(W, 8) columns of the plan, in which a row of a walk that is left out is not used."""
        stride = np.where(active[:, None], stride, 0.0)
        still = motion_of(self._params, (0.0, 0.0, 0.0), np.float32, FULL_TURN_RAD)
        if not np.isfinite(stride).all():
            motion_of(self._params, tuple(stride[~np.isfinite(stride).all(axis=1)][0]), np.float32, FULL_TURN_RAD)
        motions = np.tile(np.array([*still, 0.0]), (len(self), 1))
        motions[:, 0], motions[:, 5] = stride[:, 0].astype(np.float32), stride[:, 1]
        motions[:, 2] = (stride[:, 2] / FULL_TURN_RAD).astype(np.float32)
        _weigh_level(motions)
        return motions

    def _begin(self, active: BoolArray) -> None:
        """Random numbers of the next generation differ from all before."""
        self._keys[active, 2] += np.uint64(1)
        self._plan[:, gpu.KEY_0], self._plan[:, gpu.KEY_1], self._plan[:, gpu.GENERATION] = self._keys.T
        self._plan[:, gpu.SIDE] = self._side
        self._plan[:, gpu.OLD_COUNT] = np.where(active, self.num_particles, -1)
        self._plan[:, gpu.NUMBER] = 0

    def _upload(self) -> None:
        self._device_plan.copy_to_device(self._plan)

    def _read(self) -> None:
        self._device_result.copy_to_host(self._result)

    def _grid(self, most: int, each: int) -> tuple[int, int]:
        """Blocks for at most so many particles of a walk, `each` a block; so many that Numba finds no GPU idle."""
        return max(-(-MIN_BLOCKS // len(self)), -(-most // each)), len(self)

    def _clear(self) -> None:
        self._upload()
        blocks = max(MIN_BLOCKS, -(-len(self) // self._threads))
        self._kernels.clear[blocks, self._threads](self._device_plan, self._device_result, self._best)

    def _sum_weights(self, active: BoolArray) -> None:
        """Running sums of the weights of the old generation, and their total."""
        kernels, threads, plan = self._kernels, self._threads, self._device_plan
        self._upload()
        grid = self._grid(int(self.num_particles[active].max(initial=0)), threads * gpu.ITEMS)
        kernels.sum_weights[grid, threads](plan, self._state, self._best, self._sums)
        kernels.accumulate[grid, threads](
            plan, self._state, self._best, self._sums, self._device_result, self._cumulative
        )
        self._read()

    def _advance(self, grid: tuple[int, int]) -> None:
        self._kernels.advance[grid, self._threads](
            self._device_plan, self._world, self._bins, self._state, self._cells, self._cumulative, self._stamps,
            self._device_result, self._best,
        )  # fmt: skip

    def _generate(
        self,
        fill: Callable[[tuple[int, int]], None],
        active: BoolArray,
        first: NDArray[np.int64],
        many: BoolArray,
        extent: NDArray[Any],
    ) -> None:
        """Fills generations batch by batch until each has enough particles for its bins (KLD sampling, W10).

        Args:
            fill: Launches the kernel that fills one batch of every walk.
            active: (W,) walks that have a new generation.
            first: (W,) particles of their first batches.
            many: (W,) walks whose batches have a least size, as those of many particles have.
            extent: (W,) over which a batch is drawn evenly: the sum of the weights, or the area of a prior.
        """
        bound = self._bound
        wanted = np.where(active, np.clip(first, bound.min_particles, bound.max_particles), 0)
        filled, needed, batch = np.zeros_like(wanted), np.zeros_like(wanted), 0
        while (filled < wanted).any():
            number = wanted - filled
            self._room_for(int(wanted.max()))
            self._plan[:, gpu.FIRST], self._plan[:, gpu.NUMBER] = filled, number
            self._plan[:, gpu.SPACING] = extent / np.maximum(number, 1)
            self._plan[:, gpu.BATCH] = batch
            self._upload()
            fill(self._grid(int(number.max()), self._threads))
            self._read()
            filled, wanted = wanted, _plan_next(wanted, self._result[:, NUM_BINS], number, many, bound, needed)
            batch += 1
        self._side[active] = 1 - self._side[active]
        self.num_particles[active], self.num_bins[active] = filled[active], self._result[active, NUM_BINS]
        self.num_live[active], self.overshoot[active] = self._result[active, gpu.LIVE], (filled - needed)[active]

    def _room_for(self, capacity: int) -> None:
        """Room for so many particles of each walk, and those that there are."""
        if capacity <= self._capacity:
            return
        walks, threads, old = len(self), self._threads, self._capacity
        capacity = max(capacity, old + old // 8)
        state = cuda.device_array((2, walks, 4, capacity), np.float32)
        cells = cuda.device_array((2, walks, capacity), np.int32)
        cumulative = cuda.device_array((walks, capacity), np.int64)
        if old:
            self._kernels.regrow[self._grid(old, threads), threads](
                self._state, self._cells, self._cumulative, state, cells, cumulative
            )
        self._state, self._cells, self._cumulative, self._capacity = state, cells, cumulative, capacity
        self._sums = cuda.device_array((walks, -(-capacity // (threads * gpu.ITEMS)), 2), np.int64)


class GpuFilter:
    """One walker's filter on a GPU, in place of `WoodmanFilter`; see `GpuFilters`.

    Args:
        building: The map.
        rng: Draws the key of all random numbers.
        params: None for the paper's.
    """

    def __init__(self, building: Building, rng: np.random.Generator, params: WoodmanFilterParams | None = None) -> None:
        self._all = GpuFilters(building, [rng], params)
        self.adjust = self._all.adjust

    @property
    def num_particles(self) -> int:
        """Of the last generation."""
        return int(self._all.num_particles[0])

    @property
    def num_bins(self) -> int:
        """That they occupy."""
        return int(self._all.num_bins[0])

    @property
    def overshoot(self) -> int:
        """Particles beyond the bound for that many bins."""
        return int(self._all.overshoot[0])

    @property
    def is_depleted(self) -> bool:
        """True where every particle of the last generation hit a wall."""
        return not self._all.num_live[0]

    @property
    def nbytes(self) -> int:
        """Memory of the particles."""
        return self._all.nbytes

    def start(self, region: FloorRegion, heading: HeadingPrior | None = None) -> None:
        """As `WoodmanFilter.start`."""
        self._all.start(region, heading)

    def update(self, length_m: float, height_m: float, turn_rad: float) -> None:
        """As `WoodmanFilter.update`."""
        self._all.update(np.array([[length_m, height_m, turn_rad]]))

    def propagate(self, length_m: float, height_m: float, turn_rad: float) -> None:
        """As `WoodmanFilter.propagate`."""
        self._all.propagate(np.array([[length_m, height_m, turn_rad]]))

    def cloud(self, most: int | None = None) -> ParticleCloud:
        """As `WoodmanFilter.cloud`."""
        return self._all.cloud(0, most)


def _filled(array: NDArray[Any]) -> NDArray[Any]:
    """The array, with a row of zeros where it has none: a kernel takes no empty one, and never reads it."""
    return np.ascontiguousarray(array) if len(array) else np.zeros((1, *array.shape[1:]), dtype=array.dtype)


@compiled
def _weigh_level(motions: Any) -> None:
    """The last column: the weight of a particle whose floor does not rise."""
    for walk in range(len(motions)):
        rise, sigma = motions[walk, 5], motions[walk, 6]
        motions[walk, 7] = np.float32(exp_minus(min(rise * rise / (2 * sigma * sigma), MAX_EXPONENT)))


@compiled
def _plan_first(
    active: Any, count: Any, num_bins: Any, total: Any, squares: Any, excess: Any, bound: Any, expected: Any, first: Any
) -> None:
    """Particles of the first batch of each walk, from what its generation is likely to need."""
    for walk in range(len(active)):
        if active[walk]:
            need = expected_need(num_bins[walk], count[walk], float(total[walk]), squares[walk], bound)
            fraction = FIRST_BATCH_OF_FEW if count[walk] <= FEW else FIRST_BATCH * excess[walk]
            expected[walk], first[walk] = need, int(fraction * need)


@compiled
def _plan_next(filled: Any, num_bins: Any, number: Any, many: Any, bound: Any, needed: Any) -> Any:
    """(W,) particles that each generation is to have after its next batch; as many as it has where it is complete."""
    wanted = filled.copy()
    for walk in range(len(filled)):
        if number[walk] > 0:
            needed[walk] = enough(num_bins[walk], bound)
            if needed[walk] > filled[walk]:
                least = filled[walk] + filled[walk] // MIN_BATCH if many[walk] else 0
                wanted[walk] = min(max(needed[walk], least), bound.max_particles)
    return wanted
