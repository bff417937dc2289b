"""The particle filter of Woodman & Harle 2008 to the letter: one particle after the other, in float64.

The reference that the fast filter is held against, and slow: some millions of particles a second.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from pdrbench.building import Building
from pdrbench.building.building import Edges, snapped_edges
from pdrbench.building.kernels import walk_segment
from pdrbench.compiled import compiled
from pdrbench.filters import FilterError
from pdrbench.geometry import FloatArray, IntArray, wrap_rad
from pdrbench_baselines.woodman2008.generation import Bound, enough
from pdrbench_baselines.woodman2008.map_filter import bound_of, check_stride, no_floor, no_live_particle
from pdrbench_baselines.woodman2008.params import Cloud, HeadingPrior, WoodmanFilterParams

if TYPE_CHECKING:
    from pdrbench.building.region import FloorRegion

MIN_WEIGHT: Final = 1e-300  # of a particle that hit no wall: nothing but a wall gives exactly zero
MAX_BINS: Final = 2**32  # bytes of address space; memory is used where particles come
PARTICLE: Final = np.dtype([("x_m", "f8"), ("y_m", "f8"), ("heading_rad", "f8"), ("polygon", "i8"), ("weight", "f8")])
AHEAD: Final = 64  # ancestors drawn at a time; those beyond the end of a generation are left
MARGIN_M: Final = 8.0  # around the floor: the longest stride and its noise; particles farther out share its bins


class _Walls(NamedTuple):
    """Edges of the building as `walk_segment` takes them, and the height of each polygon."""

    edges: Edges
    height_m: FloatArray


class _Bins(NamedTuple):
    """A byte for every bin of the building, which holds the last generation that had a particle in it.

    Attributes:
        stamp: (slab, row, column, sector) uint8.
        generation: Number of this one.
        slab: (P,) int, of the floor height of each polygon.
        first_column: Of floor(x / bin_m).
        first_row: Of floor(y / bin_m).
        bin_m: Edge.
        bin_rad: Width in heading.
    """

    stamp: Any
    generation: int
    slab: IntArray
    first_column: int
    first_row: int
    bin_m: float
    bin_rad: float


class _Motion(NamedTuple):
    """A stride event (1) and what is known of its errors; see `WoodmanFilterParams`."""

    length_m: float
    height_m: float
    turn_rad: float
    length_sigma_m: float
    heading_sigma_rad: float
    height_sigma_m: float
    clip_length: bool
    live_only: bool


class LiteralFilter:
    """Algorithm 1 inside sequential KLD sampling (claims W4-W6, W8-W11).

    A generation is drawn particle by particle: re-sample one of the last generation by its weight (multinomial),
    propagate it, correct its weight, look whether it occupies a new bin. It is complete when the number of particles
    has reached the bound of the bins that they occupy.

    Args:
        building: The map.
        rng: Draws everything.
        params: See `WoodmanFilterParams`.
    """

    overshoot = 0  # particles drawn beyond the bound: none, it is looked at after every one

    def __init__(self, building: Building, rng: np.random.Generator, params: WoodmanFilterParams | None = None) -> None:
        self._params = params = params or WoodmanFilterParams()
        self._rng = rng
        height_m = building.height(np.arange(len(building.polygons)))
        self._walls = _Walls(snapped_edges(building), height_m)
        self._bins = _lay_out(building, params)
        self._bound = bound_of(params)
        self._particles = np.empty(params.max_particles, dtype=PARTICLE)  # memory is used where it is written
        self._previous = np.empty(params.max_particles, dtype=PARTICLE)
        self._cumulative = np.empty(params.max_particles)
        self._guide = np.empty(params.max_particles, dtype=np.int64)
        self.num_particles, self.num_bins, self._total_weight = 0, 0, 0.0

    @property
    def is_depleted(self) -> bool:
        """True where every particle has hit a wall."""
        return self.num_particles > 0 and self._total_weight == 0.0

    def start(self, region: FloorRegion, heading: HeadingPrior | None = None) -> None:
        """Draws the prior: uniform over the region and the headings, as many particles as KLD sampling asks for.

        Raises:
            FilterError: The region covers no floor.
        """
        cumulative_m2 = np.cumsum(region.triangle_area_m2())
        if not len(cumulative_m2) or not cumulative_m2[-1] > 0:
            raise no_floor()
        heading = heading or HeadingPrior()
        self._begin()
        self.num_particles, self.num_bins = _draw_prior(
            self._rng,
            region.corners_xy_m,
            cumulative_m2,
            region.polygon,
            float(heading.centre_rad),
            float(heading.half_width_rad),
            self._particles,
            self._bins,
            self._bound,
        )
        self._total_weight = float(self.num_particles)

    def update(self, length_m: float, height_m: float, turn_rad: float) -> None:
        """Advances the particles by one stride (l, dz, dtheta), eq. (1).

        Raises:
            FilterError: Not started, no particle alive, or a number is not finite.
        """
        if self.num_particles == 0:
            raise FilterError("no particles yet; call start(region) before update")
        if self.is_depleted:
            raise no_live_particle()
        check_stride(length_m, height_m, turn_rad)
        p = self._params
        sigmas = (p.length_sigma_m, p.heading_sigma_rad, p.height_sigma_m)
        motion = _Motion(float(length_m), float(height_m), float(turn_rad), *sigmas, p.clip_length, p.live_only)
        self._begin()
        self._particles, self._previous = self._previous, self._particles
        self.num_particles, self.num_bins, self._total_weight = _next_generation(
            self._rng,
            self._previous[: self.num_particles],
            self._cumulative[: self.num_particles],
            self._guide[: self.num_particles],
            motion,
            self._walls,
            self._particles,
            self._bins,
            self._bound,
        )

    def cloud(self, most: int | None = None) -> Cloud:
        """The particles of this generation, thinned evenly to at most `most`."""
        every = 1 if most is None else max(1, math.ceil(self.num_particles / most))
        now = self._particles[: self.num_particles : every]
        xy_m = np.column_stack([now["x_m"], now["y_m"]])
        return Cloud(xy_m, wrap_rad(now["heading_rad"]), now["polygon"], now["weight"])

    def _begin(self) -> None:
        """No bin is occupied yet."""
        generation = self._bins.generation + 1
        if generation > np.iinfo(np.uint8).max:
            self._bins = self._bins._replace(stamp=np.zeros_like(self._bins.stamp), generation=1)
        else:
            self._bins = self._bins._replace(generation=generation)


def _lay_out(building: Building, params: WoodmanFilterParams) -> _Bins:
    """Bins around the building, one slab for each height that has floor."""
    x0, y0, x1, y1 = building.bounds_m()
    first_column, first_row = (math.floor((low - MARGIN_M) / params.bin_m) for low in (x0, y0))
    columns = math.floor((x1 + MARGIN_M) / params.bin_m) + 1 - first_column
    rows = math.floor((y1 + MARGIN_M) / params.bin_m) + 1 - first_row
    height_m = building.height(np.arange(len(building.polygons)))
    heights, slab = np.unique(np.floor(height_m / params.bin_m), return_inverse=True)
    shape = (len(heights), rows, columns, params.heading_bins)
    if math.prod(shape) > MAX_BINS:
        raise FilterError(f"building {building.name!r} has {math.prod(shape):.1e} bins; make bin_m or bin_rad larger")
    stamp = np.zeros(shape, dtype=np.uint8)
    return _Bins(stamp, 0, slab.astype(np.int64), first_column, first_row, float(params.bin_m), float(params.bin_rad))


@compiled
def _is_new_bin(particle: Any, bins: _Bins) -> bool:
    """Marks the bin (floor x, floor y, floor height of the polygon, floor heading); True for its first particle."""
    _, rows, columns, sectors = bins.stamp.shape
    column = min(max(math.floor(particle.x_m / bins.bin_m) - bins.first_column, 0), columns - 1)
    row = min(max(math.floor(particle.y_m / bins.bin_m) - bins.first_row, 0), rows - 1)
    turn_rad = particle.heading_rad - 2.0 * math.pi * math.floor(particle.heading_rad / (2.0 * math.pi))
    place = bins.slab[particle.polygon], row, column, int(turn_rad / bins.bin_rad) % sectors
    if bins.stamp[place] == bins.generation:
        return False
    bins.stamp[place] = bins.generation
    return True


@compiled
def _draw_prior(
    rng: np.random.Generator,
    corners_xy_m: FloatArray,
    cumulative_m2: FloatArray,
    polygon: IntArray,
    centre_rad: float,
    half_width_rad: float,
    particles: Any,
    bins: _Bins,
    bound: Bound,
) -> tuple[int, int]:
    """Fills `particles` with the prior; how many, and how many bins they occupy."""
    count, num_bins, needed = 0, 0, bound.min_particles
    while count < needed:
        new = particles[count]
        triangle = np.searchsorted(cumulative_m2, rng.random() * cumulative_m2[-1], side="right")
        u, v = rng.random(), rng.random()
        if u + v > 1.0:
            u, v = 1.0 - u, 1.0 - v
        a, b, c = corners_xy_m[triangle, 0], corners_xy_m[triangle, 1], corners_xy_m[triangle, 2]
        new.x_m = a[0] + u * (b[0] - a[0]) + v * (c[0] - a[0])
        new.y_m = a[1] + u * (b[1] - a[1]) + v * (c[1] - a[1])
        new.heading_rad = centre_rad + half_width_rad * (2.0 * rng.random() - 1.0)
        new.polygon = polygon[triangle]
        new.weight = 1.0
        count += 1
        if _is_new_bin(new, bins):
            num_bins += 1
            needed = enough(num_bins, bound)
    return count, num_bins


@compiled
def _next_generation(
    rng: np.random.Generator,
    previous: Any,
    cumulative: FloatArray,
    guide: IntArray,
    motion: _Motion,
    walls: _Walls,
    particles: Any,
    bins: _Bins,
    bound: Bound,
) -> tuple[int, int, float]:
    """Fills `particles` from `previous`; how many, how many bins they occupy, the sum of their weights."""
    _accumulate(previous, cumulative, guide)
    ancestors = np.empty(AHEAD, dtype=previous.dtype)
    count, num_bins, needed, total = 0, 0, bound.min_particles, 0.0
    while count < needed:
        if count % AHEAD == 0:
            _resample(rng, previous, cumulative, guide, ancestors)
        old, new = ancestors[count % AHEAD], particles[count]
        _propagate(old, new, motion, rng.standard_normal(), rng.standard_normal())
        alive = _constrain(old, new, walls)
        _correct(old, new, motion, walls, alive)
        total += new.weight
        count += 1
        if (alive or not motion.live_only) and _is_new_bin(new, bins):
            num_bins += 1
            needed = enough(num_bins, bound)
    return count, num_bins, total


@compiled
def _accumulate(particles: Any, cumulative: FloatArray, guide: IntArray) -> None:
    """Partial sums of the weights, and for every j of N the first of them above j/N of the last."""
    count = len(cumulative)
    cumulative[:] = np.cumsum(particles["weight"])
    j = 0
    for i in range(count):
        while j < count and j * cumulative[-1] < count * cumulative[i]:
            guide[j] = i
            j += 1


@compiled
def _resample(
    rng: np.random.Generator, particles: Any, cumulative: FloatArray, guide: IntArray, ancestors: Any
) -> None:
    """Fills `ancestors` with particles drawn by weight; one of weight 0 has no room between two partial sums.

    Where the paper searches by bisection, this begins at the guide (Chen & Asau 1974): the same particle, one or two
    looks at memory on average instead of log2(N). The loops are apart so that the waits for memory overlap.
    """
    num_draws, count = len(ancestors), len(cumulative)
    share = np.empty(num_draws)
    drawn = np.empty(num_draws, dtype=np.int64)
    for k in range(num_draws):
        share[k] = rng.random()
        drawn[k] = guide[int(share[k] * count)]
    for k in range(num_draws):
        wanted, i = share[k] * cumulative[-1], drawn[k]
        while i > 0 and cumulative[i - 1] > wanted:  # by rounding of the guide only
            i -= 1
        while cumulative[i] <= wanted:
            i += 1
        drawn[k] = i
    for k in range(num_draws):
        ancestors[k] = particles[drawn[k]]


@compiled
def _propagate(old: Any, new: Any, motion: _Motion, length_noise: float, heading_noise: float) -> None:
    """Eq. (7)-(11): the noise goes by role, not by the letters of Algorithm 1 (W4); heading first (W5)."""
    length_m = motion.length_m + motion.length_sigma_m * length_noise
    if motion.clip_length:
        length_m = max(length_m, 0.0)
    new.heading_rad = old.heading_rad + motion.turn_rad + motion.heading_sigma_rad * heading_noise
    new.x_m = old.x_m + length_m * math.cos(new.heading_rad)
    new.y_m = old.y_m + length_m * math.sin(new.heading_rad)


@compiled
def _constrain(old: Any, new: Any, walls: _Walls) -> bool:
    """Eq. (12), (13) and the loop of Algorithm 1: the polygon reached; False where a wall is on the way."""
    new.polygon, alive = walk_segment(old.polygon, old.x_m, old.y_m, new.x_m, new.y_m, walls.edges)
    return alive


@compiled
def _correct(old: Any, new: Any, motion: _Motion, walls: _Walls, alive: bool) -> None:
    """Eq. (14)-(16), without the factor that all weights share."""
    if not alive:
        new.weight = 0.0
        return
    rise_m = walls.height_m[new.polygon] - walls.height_m[old.polygon]
    deviation = (motion.height_m - rise_m) / motion.height_sigma_m
    new.weight = max(math.exp(-0.5 * deviation * deviation), MIN_WEIGHT)
