"""The particle filter of Li et al. 2012: where a walker is, and how long their steps are (claims L13 to L21).

Every particle is a place and a step model, eq. (4). A step moves it by a + b times the frequency, eq. (3), along the
heading of the step, eq. (7). One that hits a wall is drawn again near a live one with the model it had: on the straight
the heading is to blame. When a turn has ended, those that hit a wall in it take the model of a neighbour: there the
length was.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from pdrbench.building import Building
from pdrbench.errors import PdrbenchError
from pdrbench.filters import FilterError, MapFilter, level_map, multinomial
from pdrbench.geometry import BoolArray, FloatArray
from pdrbench_baselines.li2012 import kernels
from pdrbench_baselines.li2012.corridor import tile_map

MAX_TRIES: Final = 20  # to place a particle around the start without a wall between
STEP_HZ: Final = 1.9  # of usual walking, where the length of a step is positive
MIN_STEP_M: Final = 0.05  # there, of a particle
NEVER: Final = -(10**6)  # a step before all
DOUBTFUL_STEPS: Final = 20  # a turn is detected some ten steps after it began


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
        if not (math.isfinite(self.a_m_per_hz) and math.isfinite(self.b_m) and self.length_m(STEP_HZ) > 0):
            raise PdrbenchError(f"a step model gives steps of positive length at {STEP_HZ:g} Hz; got {self}")

    def length_m(self, frequency_hz: float) -> float:
        """Of a step."""
        return self.a_m_per_hz * frequency_hz + self.b_m


@dataclass(frozen=True, slots=True)
class StepModelFilterParams:
    """Defaults from Li et al. 2012 unless a line says otherwise.

    Attributes:
        num_particles: Always as many.
        start_sigma_m: Standard deviation around a tapped start, per axis.
        length_fraction: Noise of a step's length, as a part of it.
        heading_sigma_rad: Noise of its heading.
        delta_a: The models of particles lie so far around the one at the start, in m/Hz; uniform.
        delta_b: Likewise, in metres.
        adjustment: K, the part of the survivors' mean noise by which the next heading is corrected.
        near_m: Standard deviation per axis of the place of a renewed particle around its live one.
        inherits_always: Beyond the paper: a renewed particle takes the model of its live one on the straight as well.
        middle_weight: Factor on the weight in the middle of a pathway.
        bias_sigma_rad: Beyond the paper: spread of a heading error that each particle keeps; 0 for none.
        bias_walk_rad: By which that error wanders in a step.
        top_particles: p of the summary.
        num_frequencies: q of the summary.
        band_hz: Within which these frequencies lie.
    """

    num_particles: int = 3000
    start_sigma_m: float = 1.0  # L3
    length_fraction: float = 0.10  # L18
    heading_sigma_rad: float = math.radians(10.0)  # L18, in the hand
    delta_a: float = 0.10  # L15
    delta_b: float = 0.15  # L15
    adjustment: float = 1.0  # L13
    near_m: float = 0.2  # L16
    inherits_always: bool = False
    middle_weight: float = 2.0  # L19
    bias_sigma_rad: float = 0.0
    bias_walk_rad: float = 0.0
    top_particles: int = 50  # L21
    num_frequencies: int = 9  # L21
    band_hz: tuple[float, float] = (1.4, 2.4)  # L21

    def __post_init__(self) -> None:
        if self.num_particles < 1 or self.top_particles < 1 or self.num_frequencies < 2:
            raise FilterError(f"step model filter: particles from 1 and frequencies from 2 on; got {self}")
        low, high = self.band_hz
        if not (0 < low < high and self.middle_weight > 0):
            raise FilterError(f"step model filter: a rising band of frequencies and a positive weight; got {self}")
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if isinstance(value, float) and not 0 <= value < math.inf:
                raise FilterError(f"step model filter: {field.name} is 0 or more; got {value!r}")


class StepModelFilter(MapFilter):
    """Particles on a map, moved by steps.

    Where every particle has hit a wall, all are spread again around the mean of before, as around a start but wider:
    the radius is doubled with every reset in a row.

    Args:
        building: The map, or None: nothing stops a particle.
        rng: Draws everything; motion, renewal and start draw from children of their own.
        params: None for the defaults.
    """

    def __init__(
        self, building: Building | None, rng: np.random.Generator, params: StepModelFilterParams | None = None
    ):
        super().__init__()
        self._params = params or StepModelFilterParams()
        self._building = building
        self._rng_start, self._rng_motion, self._rng_renewal, self._rng_bias = rng.spawn(4)
        self.num_steps = 0
        self.weight: FloatArray = np.zeros(0)

    def start(self, xy_m: FloatArray, level: int, model: StepModel, sigma_m: float | None = None) -> None:
        """Spreads particles around a place; one off the floor is taken to the nearest floor of the level.

        Args:
            xy_m: (2,) the tap.
            level: Its level.
            model: The generic model, or that of this person.
            sigma_m: Standard deviation per axis; None for that of the parameters.
        """
        p, count = self._params, self._params.num_particles
        origin = np.array(xy_m, dtype=np.float64)
        self._enter(None if self._building is None else level_map(self._building, level), origin, level)
        self._tiles: tuple[BoolArray, FloatArray, float] = (np.zeros((1, 1), dtype=np.bool_), origin, 1.0)
        if self._building is not None:
            tiles = tile_map(self._building, level)
            self._tiles = tiles.is_middle.copy(), tiles.origin_xy_m - self._origin_m, tiles.tile_m
        around = self._rng_start
        self.a = model.a_m_per_hz + p.delta_a * around.uniform(-1, 1, count)
        drawn_m = model.b_m + p.delta_b * around.uniform(-1, 1, count)
        self.b = np.maximum(drawn_m, MIN_STEP_M - self.a * STEP_HZ)
        self._bias_rad = p.bias_sigma_rad * self._rng_bias.standard_normal(count)
        self.correction_rad = 0.0
        self._stopped_at = np.full(count, NEVER)
        self._heir_a, self._heir_b = self.a.copy(), self.b.copy()
        self._resets_in_a_row = 0
        self._begin_around(np.asarray(xy_m, dtype=np.float64), p.start_sigma_m if sigma_m is None else sigma_m)

    def step(self, frequency_hz: float, heading_rad: float) -> None:
        """One step: propagate by eq. (2), (3) and (7), stop at walls, weigh, renew, locate.

        Args:
            frequency_hz: Of the step: one over how long it took.
            heading_rad: Of the walker.
        """
        if not (math.isfinite(frequency_hz) and math.isfinite(heading_rad)):
            raise FilterError(f"a step of {frequency_hz} Hz along {heading_rad} rad: give finite numbers")
        to_m, off_rad = self._propagate(frequency_hz, heading_rad)
        alive = self._walk(self._local_m, to_m, self._cell)
        self._local_m, self.num_steps = to_m, self.num_steps + 1
        num_alive = self._weigh(alive, off_rad)
        if not num_alive:
            self._restart()
            return
        self._resets_in_a_row = 0
        if num_alive < self.num_particles:
            self._renew(alive)
        self._locate()

    def change_level(self, levels: int, *, by_lift: bool) -> None:
        """So many levels up, by a change of pressure."""
        chosen = self._change_level(levels, by_lift=by_lift, rng=self._rng_renewal)
        if chosen is not None:
            self.a, self.b, self._bias_rad = self.a[chosen], self.b[chosen], self._bias_rad[chosen]
            self._stopped_at, self.weight = self._stopped_at[chosen], self.weight[chosen]
            self._heir_a, self._heir_b = self._heir_a[chosen], self._heir_b[chosen]

    def turned(self, first_step: int, last_step: int) -> None:
        """A turn has ended: particles that hit a wall in it take the model of the one they were put near.

        Args:
            first_step: From which walls belong to the turn, counted from 0.
            last_step: Up to which they do.
        """
        stopped = (self._stopped_at >= first_step) & (self._stopped_at <= last_step)
        self.a[stopped], self.b[stopped] = self._heir_a[stopped], self._heir_b[stopped]
        self._stopped_at[stopped] = NEVER

    @property
    def model(self) -> StepModel:
        """Mean over the particles."""
        return StepModel(float(self.a.mean()), float(self.b.mean()))

    @property
    def particles_bias_rad(self) -> FloatArray:
        """(N,) what the heading of each particle is off by."""
        return self._bias_rad

    @property
    def bias_rad(self) -> float:
        """Mean over the particles of what the heading is off by."""
        return float(self._bias_rad.mean())

    def summary(self) -> StepModel | None:
        """The model to keep: a line through q steps of each of the p particles of most weight (L21).

        Weights have few values; among equal ones the particles count that have gone longest without a wall. None where
        the line has steps of no length: particles of a lost user may stand still before a wall.
        """
        p = self._params
        best = np.lexsort((self._stopped_at, -self.weight))[: p.top_particles]
        frequency_hz = np.linspace(*p.band_hz, p.num_frequencies)
        length_m = self.a[best, None] * frequency_hz + self.b[best, None]
        a, b = np.polyfit(np.tile(frequency_hz, len(best)), length_m.ravel(), 1)
        return StepModel(float(a), float(b)) if a * STEP_HZ + b > 0 else None

    # Parts of a step.

    def _propagate(self, frequency_hz: float, heading_rad: float) -> tuple[FloatArray, FloatArray]:
        """Where each particle would end (N, 2), and the noise of its heading (N,)."""
        p = self._params
        noise, off_rad = self._rng_motion.standard_normal((2, self.num_particles))
        off_rad *= p.heading_sigma_rad
        if p.bias_walk_rad:
            self._bias_rad += p.bias_walk_rad * self._rng_bias.standard_normal(self.num_particles)
        corrected_rad = heading_rad + self.correction_rad
        to_m: FloatArray = kernels.propagate(
            self._local_m,
            self.a,
            self.b,
            self._bias_rad,
            off_rad,
            noise,
            p.length_fraction,
            frequency_hz,
            corrected_rad,
        )
        return to_m, off_rad

    def _weigh(self, alive: BoolArray, off_rad: FloatArray) -> int:
        """Weighs the particles (L19) and corrects the next heading (L13); how many hit no wall."""
        p = self._params
        num_alive, total_rad = kernels.weigh(self._local_m, alive, off_rad, *self._tiles, p.middle_weight, self.weight)
        self.correction_rad = p.adjustment * total_rad / num_alive if num_alive else 0.0
        return int(num_alive)

    def _renew(self, alive: BoolArray) -> None:
        """Puts particles that hit a wall near live ones, drawn by weight (L16); they keep their models."""
        stopped, rng = np.flatnonzero(~alive), self._rng_renewal
        chosen = multinomial(self.weight, rng.random(len(stopped)))
        self._place(stopped, self._local_m[chosen], self._cell[chosen], self._params.near_m, rng)
        # A neighbour that itself hit a wall a moment ago has a model as doubtful, and passes on what it would take.
        is_doubtful = self._stopped_at[chosen] >= self.num_steps - DOUBTFUL_STEPS
        self._heir_a[stopped] = np.where(is_doubtful, self._heir_a[chosen], self.a[chosen])
        self._heir_b[stopped] = np.where(is_doubtful, self._heir_b[chosen], self.b[chosen])
        if self._params.inherits_always:
            self.a[stopped], self.b[stopped] = self.a[chosen], self.b[chosen]
        self._stopped_at[stopped] = self.num_steps - 1
        self.weight[stopped] = self.weight[chosen]
        self._bias_rad[stopped] = self._bias_rad[chosen]

    def _begin_around(self, xy_m: FloatArray, sigma_m: float) -> None:
        self._spread(self._params.num_particles, xy_m, sigma_m, self._rng_start, tries=MAX_TRIES)
        self.weight = np.ones(self.num_particles)
        self._locate()

    def _restart(self) -> None:
        """Every particle has hit a wall: spread again around the mean of the last step."""
        self._stopped_at[:] = NEVER
        self._begin_around(self.xy_m, self._restart_sigma_m(self._params.start_sigma_m))
