"""Algorithm 1 of Woodman & Harle 2008 to the letter: one particle after the other, in float64.

The reference for the fast filter, and slow: some millions of particles a second.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from pdrbench.building import Building
from pdrbench.building.building import Edges, snapped_edges
from pdrbench.building.kernels import walk_segment
from pdrbench.compiled import compiled
from pdrbench.filters import FilterError
from pdrbench.geometry import FloatArray, IntArray, wrap_rad
from pdrbench_baselines.woodman2008.generation import Bins, Bound, Motion, Prior, enough
from pdrbench_baselines.woodman2008.localizer import Woodman2008
from pdrbench_baselines.woodman2008.map_filter import (
    WoodmanFilter,
    bound_of,
    lay_out,
    motion_of,
    no_live_particle,
    prior_of,
)
from pdrbench_baselines.woodman2008.params import HeadingPrior, ParticleCloud, WoodmanFilterParams

if TYPE_CHECKING:
    from pdrbench.building.region import FloorRegion

MIN_WEIGHT: Final = 1e-300  # of a particle that hit no wall: nothing but a wall gives exactly zero
PARTICLE: Final = np.dtype([("x_m", "f8"), ("y_m", "f8"), ("heading_rad", "f8"), ("polygon", "i8"), ("weight", "f8")])
AHEAD: Final = 64  # ancestors drawn at a time; those beyond the end of a generation are left


class _World(NamedTuple):
    """The building, and the bins that are occupied.

    Attributes:
        edges: As `walk_segment` takes them.
        height_m: (P,) of each polygon.
        bins: Over x, y, height and heading.
        stamp: (bins,) uint8, last generation that had a particle in the bin.
    """

    edges: Edges
    height_m: FloatArray
    bins: Bins
    stamp: Any


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
        polygons = np.arange(len(building.polygons))
        bins, num_bins = lay_out(building, polygons, np.zeros(2), params, np.float64)
        stamp = np.zeros(num_bins, dtype=np.uint8)
        self._world, self._generation = _World(snapped_edges(building), building.height(polygons), bins, stamp), 0
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
        prior = prior_of(region.corners_xy_m, region.polygon, heading or HeadingPrior(), np.float64, 1.0)
        self._begin()
        self.num_particles, self.num_bins = _draw_prior(
            self._rng, prior, self._particles, self._world, self._generation, self._bound
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
        motion = motion_of(self._params, (length_m, height_m, turn_rad), np.float64, 1.0)
        self._begin()
        self._particles, self._previous = self._previous, self._particles
        self.num_particles, self.num_bins, self._total_weight = _next_generation(
            self._rng,
            self._previous[: self.num_particles],
            self._cumulative[: self.num_particles],
            self._guide[: self.num_particles],
            motion,
            self._particles,
            self._world,
            self._generation,
            self._bound,
        )

    def cloud(self, most: int | None = None) -> ParticleCloud:
        """The particles of this generation, thinned evenly to at most `most`."""
        every = 1 if most is None else max(1, math.ceil(self.num_particles / most))
        now = self._particles[: self.num_particles : every]
        xy_m = np.column_stack([now["x_m"], now["y_m"]])
        return ParticleCloud(xy_m, wrap_rad(now["heading_rad"]), now["polygon"], now["weight"])

    def _begin(self) -> None:
        """No bin is occupied yet."""
        if self._generation == np.iinfo(np.uint8).max:
            self._world.stamp[:], self._generation = 0, 0
        self._generation += 1


FILTERS: Final[Mapping[str, type[WoodmanFilter] | type[LiteralFilter]]] = {
    "fast": WoodmanFilter,
    "literal": LiteralFilter,
}


class Woodman2008Literal(Woodman2008):
    """`woodman2008` with its particles in a `LiteralFilter`, which does not learn a drift."""

    def _filter_type(self) -> Callable[..., Any]:
        return LiteralFilter


@compiled
def _is_new_bin(particle: Any, bins: Bins, stamp: Any, generation: int) -> bool:
    """Marks the bin (floor x, floor y, floor height of the polygon, floor heading); True for its first particle."""
    column = min(max(int((particle.x_m - bins.x) * bins.per_m), 0), bins.last_column)
    row = min(max(int((particle.y_m - bins.y) * bins.per_m), 0), bins.last_row)
    turns = particle.heading_rad / (2.0 * math.pi)
    sector = min(int((turns - math.floor(turns)) * bins.turn_bins), bins.turn_bins - 1)
    place = bins.first[particle.polygon] + (row * bins.columns + column) * bins.turn_bins + sector
    if stamp[place] == generation:
        return False
    stamp[place] = generation
    return True


@compiled
def _draw_prior(
    rng: np.random.Generator, prior: Prior, particles: Any, world: _World, generation: int, bound: Bound
) -> tuple[int, int]:
    """Fills `particles` with the prior; how many, and how many bins they occupy."""
    corners, polygon, area, first_rad, width_rad = prior
    _, _, bins, stamp = world
    count, num_bins, needed = 0, 0, bound.min_particles
    while count < needed:
        new = particles[count]
        triangle = np.searchsorted(area, rng.random() * area[-1], side="right")
        u, v = rng.random(), rng.random()
        if u + v > 1.0:
            u, v = 1.0 - u, 1.0 - v
        a, b, c = corners[triangle, 0], corners[triangle, 1], corners[triangle, 2]
        new.x_m = a[0] + u * (b[0] - a[0]) + v * (c[0] - a[0])
        new.y_m = a[1] + u * (b[1] - a[1]) + v * (c[1] - a[1])
        new.heading_rad = first_rad + width_rad * rng.random()
        new.polygon = polygon[triangle]
        new.weight = 1.0
        count += 1
        if _is_new_bin(new, bins, stamp, generation):
            num_bins += 1
            needed = enough(num_bins, bound)
    return count, num_bins


@compiled
def _next_generation(
    rng: np.random.Generator,
    previous: Any,
    cumulative: FloatArray,
    guide: IntArray,
    motion: Motion,
    particles: Any,
    world: _World,
    generation: int,
    bound: Bound,
) -> tuple[int, int, float]:
    """Fills `particles` from `previous`; how many, how many bins they occupy, the sum of their weights."""
    edges, height_m, bins, stamp = world
    _accumulate(previous, cumulative, guide)
    ancestors = np.empty(AHEAD, dtype=previous.dtype)
    count, num_bins, needed, total = 0, 0, bound.min_particles, 0.0
    while count < needed:
        if count % AHEAD == 0:
            _resample(rng, previous, cumulative, guide, ancestors)
        old, new = ancestors[count % AHEAD], particles[count]
        _propagate(old, new, motion, rng.standard_normal(), rng.standard_normal())
        alive = _constrain(old, new, edges)
        _correct(old, new, motion, height_m, alive)
        total += new.weight
        count += 1
        if (alive or not bins.live_only) and _is_new_bin(new, bins, stamp, generation):
            num_bins += 1
            needed = enough(num_bins, bound)
    return count, num_bins, total


@compiled
def _accumulate(particles: Any, cumulative: FloatArray, guide: IntArray) -> None:
    """Partial sums of the weights, and for every j of N the first of them above j/N of the last."""
    count = len(cumulative)
    total, j = 0.0, 0
    for i in range(count):  # an assignment of arrays takes Numba seconds to compile
        total += particles[i].weight
        cumulative[i] = total
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
    fraction = np.empty(num_draws)
    drawn = np.empty(num_draws, dtype=np.int64)
    for k in range(num_draws):
        fraction[k] = rng.random()
        drawn[k] = guide[int(fraction[k] * count)]
    for k in range(num_draws):
        wanted, i = fraction[k] * cumulative[-1], drawn[k]
        while i > 0 and cumulative[i - 1] > wanted:  # by rounding of the guide only
            i -= 1
        while cumulative[i] <= wanted:
            i += 1
        drawn[k] = i
    for k in range(num_draws):
        ancestors[k] = particles[drawn[k]]


@compiled
def _propagate(old: Any, new: Any, motion: Motion, length_noise: float, heading_noise: float) -> None:
    """Eq. (7)-(11): the noise goes by role, not by the letters of Algorithm 1 (W4); heading first (W5)."""
    length_m = max(motion.length + motion.length_sigma * length_noise, motion.min_length)
    new.heading_rad = old.heading_rad + motion.turn + motion.turn_sigma * heading_noise
    new.x_m = old.x_m + length_m * math.cos(new.heading_rad)
    new.y_m = old.y_m + length_m * math.sin(new.heading_rad)


@compiled
def _constrain(old: Any, new: Any, edges: Edges) -> bool:
    """Eq. (12), (13) and the loop of Algorithm 1: the polygon reached; False where a wall is on the way."""
    new.polygon, alive = walk_segment(old.polygon, old.x_m, old.y_m, new.x_m, new.y_m, edges)
    return alive


@compiled
def _correct(old: Any, new: Any, motion: Motion, height_m: FloatArray, alive: bool) -> None:
    """Eq. (14)-(16), without the factor that all weights have in common."""
    if not alive:
        new.weight = 0.0
        return
    rise_m = height_m[new.polygon] - height_m[old.polygon]
    deviation = (motion.rise - rise_m) / motion.rise_sigma
    new.weight = max(math.exp(-0.5 * deviation * deviation), MIN_WEIGHT)
