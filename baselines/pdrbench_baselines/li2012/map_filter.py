"""The particle filter of Li et al. 2012: where a walker is, and how long their steps are (claims L13 to L21).

Every particle is a place and a step model, eq. (4). A step moves it by a + b times the frequency, eq. (3), along the
heading of the step, eq. (7). A wall kills it, and it comes back near a live one with the model it had: on the straight
the heading is to blame. When a turn has ended, those that died in it take the model of a neighbour: there the length
was.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from pdrbench.building import Building
from pdrbench.errors import PdrbenchError
from pdrbench.filters import stride_kernels as parts
from pdrbench.filters.level_map import LevelMap, level_map
from pdrbench.filters.params import FilterError
from pdrbench.geometry import BoolArray, FloatArray
from pdrbench_baselines.li2012.corridor import tile_map

MOST_TRIES: Final = 20  # to place a particle around the start without a wall between
NEVER: Final = -(10**6)  # a step before all
DOUBTFUL_STEPS: Final = 20  # a turn is known some ten steps after it began
MOST_RESTART_M: Final = 16.0  # wider than that, a cloud that was lost says nothing


@dataclass(frozen=True, slots=True)
class StepModel:
    """The length of steps as L = a f + b, eq. (3).

    Attributes:
        a_m_per_hz: Growth with the frequency f of steps.
        b_m: The rest.
    """

    a_m_per_hz: float
    b_m: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.a_m_per_hz) and math.isfinite(self.b_m) and self.length_m(1.9) > 0):
            raise PdrbenchError(f"a step model gives steps of positive length at 1.9 Hz; got {self}")

    def length_m(self, frequency_hz: float) -> float:
        """Of a step."""
        return self.a_m_per_hz * frequency_hz + self.b_m


@dataclass(frozen=True, slots=True)
class StrideFilterParams:
    """Defaults from Li et al. 2012 unless a line says otherwise.

    Attributes:
        num_particles: Always as many.
        start_sigma_m: Spread around a tapped start, per axis.
        length_share: Noise of a step's length, as a part of it.
        heading_sigma_rad: Noise of its heading.
        delta_a: The models of particles lie so far around the one at the start, in m/Hz; uniform.
        delta_b: Likewise, in metres.
        adjustment: K, the part of the survivors' mean noise by which the next heading is corrected.
        near_m: Of the jitter around a live particle, per axis.
        middle_weight: Factor on the weight in the middle of a pathway.
        bias_sigma_rad: Beyond the paper: spread of a heading error that each particle keeps; 0 for none.
        bias_walk_rad: By which that error wanders in a step.
        top_particles: p of the summary.
        num_frequencies: q of the summary.
        band_hz: Within which these frequencies lie.
    """

    num_particles: int = 3000
    start_sigma_m: float = 1.0  # L3
    length_share: float = 0.10  # L18
    heading_sigma_rad: float = math.radians(10.0)  # L18, in the hand
    delta_a: float = 0.10  # L15
    delta_b: float = 0.15  # L15
    adjustment: float = 1.0  # L13
    near_m: float = 0.2  # L16
    middle_weight: float = 2.0  # L19
    bias_sigma_rad: float = 0.0
    bias_walk_rad: float = 0.0
    top_particles: int = 50  # L21
    num_frequencies: int = 9  # L21
    band_hz: tuple[float, float] = (1.4, 2.4)  # L21

    def __post_init__(self) -> None:
        if self.num_particles < 1 or self.top_particles < 1 or self.num_frequencies < 2:
            raise FilterError(f"stride filter: particles from 1 and frequencies from 2 on; got {self}")
        low, high = self.band_hz
        if not (0 < low < high and self.middle_weight > 0):
            raise FilterError(f"stride filter: a rising band of frequencies and a positive weight; got {self}")
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if isinstance(value, float) and not 0 <= value < math.inf:
                raise FilterError(f"stride filter: {field.name} is 0 or more; got {value!r}")


class StrideFilter:
    """Particles on a map, moved by steps.

    Where every particle has died, they are spread again around the mean of before, as around a start but wider: the
    radius is doubled with every death in a row. `resets` counts these.

    Args:
        building: The map, or None: nothing kills.
        rng: Draws everything; motion, renewal and start draw from children of their own.
        params: None for the defaults.
    """

    def __init__(self, building: Building | None, rng: np.random.Generator, params: StrideFilterParams | None = None):
        self._params = params or StrideFilterParams()
        self._building = building
        self._rng_start, self._rng_motion, self._rng_renewal, self._rng_bias = rng.spawn(4)
        self.resets, self.num_steps = 0, 0
        self._local_m: FloatArray = np.zeros((0, 2))
        self._piece: NDArray[np.int32] = np.zeros(0, dtype=np.int32)
        self.weight: FloatArray = np.zeros(0)

    def start(self, xy_m: FloatArray, level: int, model: StepModel, sigma_m: float | None = None) -> None:
        """Spreads particles around a place; one off the floor is taken to the nearest floor of the level.

        Args:
            xy_m: (2,) the tap.
            level: Its level.
            model: The generic model, or that of this person.
            sigma_m: Spread per axis; None for that of the parameters.
        """
        p, count = self._params, self._params.num_particles
        self._map: LevelMap | None = None
        self._origin: FloatArray = np.array(xy_m, dtype=np.float64)
        self._tiles: tuple[BoolArray, FloatArray, float] = (np.zeros((1, 1), dtype=np.bool_), self._origin, 1.0)
        if self._building is not None:
            self._map, tiles = level_map(self._building, level), tile_map(self._building, level)
            self._origin = self._map.pieces.origin_xy_m
            self._tiles = tiles.is_middle, tiles.origin_xy_m - self._origin, tiles.tile_m
        self._level = level
        around = self._rng_start
        self.a = model.a_m_per_hz + p.delta_a * around.uniform(-1, 1, count)
        self.b = model.b_m + p.delta_b * around.uniform(-1, 1, count)
        self._bias_rad = p.bias_sigma_rad * self._rng_bias.standard_normal(count)
        self._correction_rad = 0.0
        self._died_at = np.full(count, NEVER)
        self._heir_a, self._heir_b = self.a.copy(), self.b.copy()
        self._deaths_in_a_row = 0
        self._spread(np.asarray(xy_m, dtype=np.float64), p.start_sigma_m if sigma_m is None else sigma_m)

    def step(self, frequency_hz: float, heading_rad: float) -> None:
        """One step, eq. (2), (3) and (7), then walls, weights and renewal of the dead.

        Args:
            frequency_hz: Of the step: one over how long it took.
            heading_rad: Of the walker.
        """
        if not (math.isfinite(frequency_hz) and math.isfinite(heading_rad)):
            raise FilterError(f"a step of {frequency_hz} Hz along {heading_rad} rad: give finite numbers")
        p, count = self._params, self._params.num_particles
        noise, off_rad = self._rng_motion.standard_normal((2, count))
        off_rad *= p.heading_sigma_rad
        if p.bias_walk_rad:
            self._bias_rad += p.bias_walk_rad * self._rng_bias.standard_normal(count)
        course_rad = heading_rad + self._correction_rad
        to_m = parts.propagate(
            self._local_m, self.a, self.b, self._bias_rad, off_rad, noise, p.length_share, frequency_hz, course_rad
        )
        alive = self._walk(self._local_m, to_m, self._piece)
        self._local_m = to_m
        self.num_steps += 1
        is_middle, corner_m, tile_m = self._tiles
        num_alive, total_rad = parts.weigh(
            to_m, alive, off_rad, is_middle, corner_m[0], corner_m[1], tile_m, p.middle_weight, self.weight
        )
        if not num_alive:
            self._correction_rad = 0.0
            self._restart()
            return
        self._correction_rad = p.adjustment * total_rad / num_alive
        self._deaths_in_a_row = 0
        if num_alive < count:
            self._renew(alive)
        self._locate()

    def turned(self, first_step: int, last_step: int) -> None:
        """A turn has ended: those that died in it take the model of whom they were put near.

        Args:
            first_step: From which deaths belong to the turn, counted from 0.
            last_step: Up to which they do.
        """
        died = (self._died_at >= first_step) & (self._died_at <= last_step)
        self.a[died], self.b[died] = self._heir_a[died], self._heir_b[died]
        self._died_at[died] = NEVER

    @property
    def num_particles(self) -> int:
        return self._params.num_particles

    @property
    def particles_xy_m(self) -> FloatArray:
        """(N, 2)."""
        xy_m: FloatArray = self._local_m + self._origin
        return xy_m

    @property
    def particles_level(self) -> np.ndarray:
        """(N,)."""
        return np.full(len(self._piece), self._level) if self._map is None else self._map.level[self._piece]

    @property
    def model(self) -> StepModel:
        """Mean over the particles."""
        return StepModel(float(self.a.mean()), float(self.b.mean()))

    @property
    def bias_rad(self) -> float:
        """Mean over the particles of what the heading is off by."""
        return float(self._bias_rad.mean())

    @property
    def correction_rad(self) -> float:
        """By which the next heading will be corrected, eq. (2)."""
        return self._correction_rad

    def summary(self) -> StepModel:
        """The model to keep: a line through q steps of each of the p particles of most weight (L21).

        Weights have few values; among equal ones the particles count that lived longest.
        """
        p = self._params
        best = np.lexsort((self._died_at, -self.weight))[: p.top_particles]
        frequency_hz = np.linspace(*p.band_hz, p.num_frequencies)
        length_m = self.a[best, None] * frequency_hz + self.b[best, None]
        a, b = np.polyfit(np.tile(frequency_hz, len(best)), length_m.ravel(), 1)
        return StepModel(float(a), float(b))

    # Parts of a step.

    def _walk(self, from_m: FloatArray, to_m: FloatArray, piece: np.ndarray) -> BoolArray:
        """(n,) whether no wall is between; `piece` becomes where each ends."""
        if self._map is None:
            return np.ones(len(to_m), dtype=np.bool_)
        return self._map.walk(from_m, to_m, piece)

    def _renew(self, alive: BoolArray) -> None:
        """Puts the dead near live ones, drawn by weight (L16); they keep their models."""
        dead, rng = np.flatnonzero(~alive), self._rng_renewal
        chosen = parts.choose(self.weight, rng.random(len(dead)))
        self._place(dead, self._local_m[chosen], self._piece[chosen], self._params.near_m, rng)
        # A neighbour that itself died a moment ago has a model that is as doubtful, and passes on what it would take.
        is_doubtful = self._died_at[chosen] >= self.num_steps - DOUBTFUL_STEPS
        self._heir_a[dead] = np.where(is_doubtful, self._heir_a[chosen], self.a[chosen])
        self._heir_b[dead] = np.where(is_doubtful, self._heir_b[chosen], self.b[chosen])
        self._died_at[dead] = self.num_steps - 1
        self.weight[dead] = self.weight[chosen]
        self._bias_rad[dead] = self._bias_rad[chosen]

    def _place(
        self, which: np.ndarray, near_m: FloatArray, piece: np.ndarray, sigma_m: float, rng: np.random.Generator
    ) -> BoolArray:
        """Puts particles around places; where a wall is between, at the place itself. Returns where none was."""
        ended = piece.copy()
        to_m = near_m + sigma_m * rng.standard_normal((len(which), 2))
        free = self._walk(near_m, to_m, ended)
        self._local_m[which] = np.where(free[:, None], to_m, near_m)
        self._piece[which] = np.where(free, ended, piece)
        return free

    def _spread(self, xy_m: FloatArray, sigma_m: float) -> None:
        """All particles anew around a place, each where it can be reached in a straight line."""
        count, piece = self.num_particles, 0
        if self._map is not None:
            xy_m, piece = self._map.nearest(xy_m, self._level)
        self._local_m = np.tile(xy_m - self._origin, (count, 1))
        self._piece = np.full(count, piece, dtype=np.int32)
        self.weight = np.ones(count)
        missing = np.arange(count)
        for _ in range(MOST_TRIES):
            free = self._place(missing, self._local_m[missing], self._piece[missing], sigma_m, self._rng_start)
            missing = missing[~free]
            if not len(missing):
                break
        self._locate()

    def _restart(self) -> None:
        """Every particle has died: spread again around the mean of the last step."""
        self.resets += 1
        sigma_m = min(self._params.start_sigma_m * 2.0**self._deaths_in_a_row, MOST_RESTART_M)
        self._deaths_in_a_row += 1
        self._died_at[:] = NEVER
        self._spread(self.xy_m, sigma_m)

    def _locate(self) -> None:
        """The centroid of the particles, after renewal and without weights (L20)."""
        x_m, y_m, self.sigma_m = parts.centre(self._local_m)
        self.xy_m: FloatArray = self._origin + np.array([x_m, y_m])
        if self._map is not None and self._map.num_levels > 1:
            levels, number = np.unique(self._map.level[self._piece], return_counts=True)
            self._level = int(levels[np.argmax(number)])
        self.level = self._level
