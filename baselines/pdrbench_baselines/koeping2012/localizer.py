"""Köping et al. 2012: particles that move on a precomputed table of the map and are weighed by an inertial position.

L. Köping, T. Mühsam, C. Ofenberg, B. Czech, M. Bernard, J. Schmer, F. Deinzer, "Indoor navigation using particle filter
and sensor fusion", Annual of Navigation 19/2012, part 2.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from pdrbench.building import Building
from pdrbench.errors import PdrbenchError, UnsuitableError, unknown_name
from pdrbench.geometry import BoolArray, FloatArray, IntArray
from pdrbench.localizer import Briefing, Estimate, Observation
from pdrbench.sensors.position import PositionErrors
from pdrbench_baselines.backward import BackwardSampler, StoredCloud, Transition
from pdrbench_baselines.koeping2012.movement import MovementParams, movement_table
from pdrbench_baselines.koeping2012.movement_kernels import draw_sorted

Kind = Literal["mean", "map"]
DEBUG_PARTICLES: Final = 20_000  # that `debug` hands out, at most


@dataclass(frozen=True, slots=True)
class KoepingParams:
    """Defaults from Köping et al. 2012 where the paper has a number, else from our reading of it.

    Attributes:
        num_particles: N of eq. (2).
        cell_m: Edge of a cell of the movement table.
        speed_mps: Mean and standard deviation of the walking speed.
        prune: Movements of a smaller probability are left out of the table.
        sigma0_m: Error of the observed position per axis, at the beginning.
        q_m2ps: Growth of its variance.
        estimate: "mean": the weighted mean; "map": the cell that holds most weight.
        revises: Whether clouds are kept, from which `revise` draws the past.
    """

    num_particles: int = 2000  # [P] Fig. 2, K8
    cell_m: float = 0.5  # K4
    speed_mps: tuple[float, float] = (1.34, 0.26)  # K4 [R] Weidmann 1993
    prune: float = 1e-4  # K4
    sigma0_m: float = 0.3  # K5
    q_m2ps: float = 0.02  # K5
    estimate: Kind = "mean"  # K12
    revises: bool = True

    def __post_init__(self) -> None:
        if self.num_particles < 1:
            raise PdrbenchError(f"koeping2012: a filter needs a particle at least; got {self.num_particles}")
        if self.estimate not in get_args(Kind):
            raise unknown_name("estimate of koeping2012", self.estimate, get_args(Kind))
        if not self.sigma0_m > 0:
            raise PdrbenchError(f"koeping2012: sigma0_m must be positive; got {self.sigma0_m:g}")
        self.errors()

    def errors(self) -> PositionErrors:
        """The sensor error model (K5)."""
        return PositionErrors(self.sigma0_m, self.q_m2ps)

    def movement(self, update_s: float) -> MovementParams:
        """How the table is made for updates of that rhythm."""
        return MovementParams(self.cell_m, self.speed_mps, self.prune, update_s)


KOEPING: Final = KoepingParams()


class Koeping2012:
    """Particles on a plan, as in Köping et al. 2012: x and y (3), a uniform start, no heading asked for.

    Every update moves every particle by an entry of the movement table, weighs it by the observed position under a
    Gaussian of growing variance, and draws N particles in proportion to the weights, in time linear in N.

    The table is made for the rhythm of `position` in the briefing. Where an observation does not come, particles move
    without being weighed; where it comes late or several come at once, they move as often as the time between asks for.
    Rows that are not finite, repeat a time or go back in time are passed over. Weights are compared as logarithms and
    never vanish: an observation far from every particle is followed to the particles that are nearest to it.

    `revise` gives the past by lines through the clouds, which move by the law of the movement table: the distance is
    normal about what the speed gives, the direction any, and no wall is between.

    Args:
        params: See `KoepingParams`.
    """

    def __init__(self, params: KoepingParams = KOEPING) -> None:
        self._params = params
        self._errors = self._params.errors()

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        self._building = building_of(briefing)
        rate_hz = briefing.sensors["position"].rate_hz
        update_s = 1.0 / rate_hz if rate_hz else briefing.period_s
        self._table = movement_table(self._building, self._params.movement(update_s))
        self._level = self._building.level(self._table.cells.polygon)
        self._levels, self._which_level = np.unique(self._level, return_inverse=True)
        self._rng = rng
        self._clock = Clock(update_s)
        self._cell = self._table.start(rng, self._params.num_particles)
        self._table.move(self._cell[:0], rng)  # compiles, so that no observation waits for it
        self._estimate = self._locate(np.full(len(self._cell), 1.0 / len(self._cell)))
        self._past, self._last_s = BackwardSampler() if self._params.revises else None, 0.0
        if self._past is not None:
            self._past.follow(self._stored(0.0), 0.0)

    def step(self, observation: Observation) -> Estimate:
        for t_s, x_m, y_m in self._clock.rows(observation["position"]):
            self._take(t_s, np.array([x_m, y_m]))
        missed = self._clock.updates_missed(observation.now_s)
        if missed:
            self._move(missed)
            self._estimate = self._locate(np.full(len(self._cell), 1.0 / len(self._cell)))
        return self._estimate if self._past is None else self._past.answered(observation.now_s, self._estimate)

    def revise(self) -> FloatArray | None:
        """(K, 5) t_s, x_m, y_m, level, sigma_m at the times of the answers; None where no clouds were kept."""
        return None if self._past is None else self._past.revised(self._rng.spawn(1)[0])

    def debug(self) -> dict[str, NDArray[Any]]:
        """The particles after the draw, at most `DEBUG_PARTICLES` of them."""
        shown = self._cell[:: -(-len(self._cell) // DEBUG_PARTICLES)]
        return {
            "particles_xy_m": self._table.cells.xy_m[shown],
            "particles_level": self._level[shown],
            "particles_polygon": self._table.cells.polygon[shown],
            "particles_weight": np.full(len(shown), 1.0 / len(shown)),
            "num_particles": np.array(len(self._cell)),
        }

    def _take(self, t_s: float, xy_m: FloatArray) -> None:
        """One observed position: move, weigh, locate, draw."""
        self._move(self._clock.updates_to(t_s))
        weight = self._weigh(t_s, xy_m)
        self._estimate = self._locate(weight)
        self._cell = self._cell[draw_sorted(weight, self._rng.standard_exponential(len(weight) + 1))]
        if self._past is not None:
            self._past.follow(self._stored(t_s), self._last_s, self._transition(t_s - self._last_s))
        self._last_s = t_s

    def _move(self, updates: int) -> None:
        for _ in range(updates):
            self._cell = self._table.move(self._cell, self._rng)

    def _weigh(self, t_s: float, xy_m: FloatArray) -> FloatArray:
        """(N,) weights, 1 in total (4): the density of the observed position around each particle (K5)."""
        sigma_m = float(self._errors.sigma_m(np.array(t_s)))
        by_cell = -0.5 * ((self._table.cells.xy_m - xy_m) ** 2).sum(axis=1) / sigma_m**2
        return normalised(by_cell[self._cell])

    def _locate(self, weight: FloatArray) -> Estimate:
        """Weighted mean on the level that holds most weight, or the heaviest cell (K12)."""
        cells, where_m = self._table.num_cells, self._table.cells.xy_m
        in_cell = np.asarray(np.bincount(self._cell, weights=weight, minlength=cells), dtype=np.float64)
        heaviest = int(np.argmax(np.bincount(self._which_level, weights=in_cell)))
        if len(self._levels) > 1:
            in_cell = np.where(self._which_level == heaviest, in_cell, 0.0)
        in_cell /= in_cell.sum()
        mean_m = in_cell @ where_m
        variance_m2 = float(in_cell @ ((where_m - mean_m) ** 2).sum(axis=1)) / 2
        xy_m = mean_m if self._params.estimate == "mean" else where_m[int(np.argmax(in_cell))]
        # The walker is anywhere in the cell: a uniform law of that width, whatever the particles agree on.
        sigma_m = math.sqrt(variance_m2 + self._params.cell_m**2 / 12)
        return Estimate(xy_m, int(self._levels[heaviest]), sigma_m=sigma_m)

    def _stored(self, t_s: float) -> StoredCloud:
        cells, cell = self._table.cells, self._cell
        polygon = cells.polygon[cell]
        return StoredCloud(t_s, cells.xy_m[cell], self._level[cell], polygon, np.ones(len(cell)), self._is_free)

    def _is_free(self, from_xy_m: FloatArray, polygon: IntArray, to_xy_m: FloatArray) -> BoolArray:
        return self._building.move(polygon, from_xy_m, to_xy_m)[1]

    def _transition(self, lasts_s: float) -> Transition:
        mean_m, sigma_m = (max(lasts_s, self._clock.update_s) * value for value in self._params.speed_mps)
        cell_m = self._params.cell_m

        def log_density(before: FloatArray, after: FloatArray) -> FloatArray:
            away_m = np.hypot(*(after[:, None, :] - before[None, :, :]).transpose(2, 0, 1))
            law: FloatArray = -0.5 * ((away_m - mean_m) / sigma_m) ** 2 - np.log(np.maximum(away_m, cell_m))
            return law

        return log_density


class Clock:
    """When particles were last moved, in updates of one rhythm.

    Args:
        update_s: Time between updates.
    """

    def __init__(self, update_s: float) -> None:
        self.update_s = update_s
        self._moved = 0  # updates since t = 0
        self._last_s = -np.inf

    def rows(self, rows: FloatArray) -> Iterator[tuple[float, float, float]]:
        """Rows of `position` that can be used, in order of time."""
        for t_s, x_m, y_m in rows.tolist():
            if np.isfinite([t_s, x_m, y_m]).all() and t_s > self._last_s:
                self._last_s = t_s
                yield t_s, x_m, y_m

    def updates_to(self, t_s: float) -> int:
        """Updates until a row of that time, to the nearest one."""
        return self._count(round(t_s / self.update_s))

    def updates_missed(self, now_s: float) -> int:
        """Updates that are due although no row came; half an update is waited for one that is late."""
        return self._count(int(np.floor(now_s / self.update_s - 0.5)))

    def _count(self, due: int) -> int:
        updates = max(due - self._moved, 0)
        self._moved += updates
        return updates


def building_of(briefing: Briefing) -> Building:
    """The map, where the briefing has what the localizers of this paper need."""
    briefing.require(sensors=("position",))
    if briefing.building is None:
        raise UnsuitableError("needs a building; this environment has no map")
    return briefing.building


def normalised(log_weight: FloatArray) -> FloatArray:
    """(N,) weights, 1 in total, of logarithms; the largest is never lost, however small all are."""
    weight: FloatArray = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    return weight
