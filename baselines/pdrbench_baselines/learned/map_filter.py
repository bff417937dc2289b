"""Particles on a map, moved by displacements with a covariance; each has a factor on lengths and an error of headings.

A network's errors are of two kinds: what differs from second to second, which its covariance describes, and what a walk
keeps, the length of this person's steps and the yaw between phone and person. The second kind is a state: walls
reveal it. A wall kills a particle, and it comes back beside a live one, with nearly its state.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from pdrbench.building import Building
from pdrbench.filters import MapFilter, level_map
from pdrbench.geometry import FloatArray, IntArray
from pdrbench_baselines.backward import StoredCloud, Transition, gaussian
from pdrbench_baselines.learned.reckoning import Move

TRIES: Final = 4  # to place a particle without a wall between
SHRINK: Final = 0.6  # of the spread from one try to the next: else all behind walls would crowd on the place
RESTART_M: Final = 1.0  # spread of the first restart in a row


@dataclass(frozen=True, slots=True)
class LearnedMapFilterParams:
    """Defaults, ours unless a line says otherwise.

    Attributes:
        num_particles: Always as many.
        start_sigma_m: Spread around a start, per axis.
        scale_sigma: Spread of the factor on lengths.
        bias_sigma_rad: Spread of the error of headings.
        bias_walk_rad: By which it wanders in a second.
        near_m: Of the jitter around a live particle, per axis.
        near_scale, near_bias_rad: Of its state.
    """

    num_particles: int = 2000
    start_sigma_m: float = 0.5
    scale_sigma: float = 0.06  # sources.md 1.2: people differ by so much at the same cadence
    bias_sigma_rad: float = math.radians(9.0)  # sources.md 1.5: 11.3 degrees, of which training takes the mean
    bias_walk_rad: float = math.radians(1.0)
    near_m: float = 0.2  # as Li et al. 2012 here
    near_scale: float = 0.01
    near_bias_rad: float = math.radians(1.0)


class LearnedMapFilter(MapFilter):
    """See the module; `begin_near` comes first.

    Args:
        building: The map.
        rng: Start, motion, renewal and scans draw from children of their own.
        params: See `LearnedMapFilterParams`.
        level: Where the walk begins; a map that cannot be compiled as a whole is walked on this level only.

    Attributes:
        free_fraction: Of the particles, that no wall stopped at the last move.
    """

    def __init__(
        self, building: Building, rng: np.random.Generator, params: LearnedMapFilterParams, level: int
    ) -> None:
        super().__init__()
        p = self._params = params
        self._rng_start, self._rng_motion, self._rng_renewal, self._rng_scans = rng.spawn(4)
        convex = level_map(building, level)
        self._enter(convex, convex.origin_xy_m, level)
        self.scale = np.exp(p.scale_sigma * self._rng_start.standard_normal(p.num_particles))
        self.bias_rad = p.bias_sigma_rad * self._rng_start.standard_normal(p.num_particles)
        self._local_m = np.zeros((p.num_particles, 2))
        self._cell = np.zeros(p.num_particles, dtype=np.int32)
        self.free_fraction = 1.0

    @property
    def mean_scale(self) -> float:
        """Factor on lengths."""
        return float(self.scale.mean())

    @property
    def mean_bias_rad(self) -> float:
        """Error of headings."""
        return float(self.bias_rad.mean())

    def begin_near(self, xy_m: FloatArray, radius_m: float = 0.0) -> None:
        """Around a place (2,), known to lie in a disc; off the floor it is taken to the nearest floor of its level."""
        self._begin_around(np.asarray(xy_m, dtype=np.float64), max(self._params.start_sigma_m, radius_m / 2))

    def change_level(self, levels: int, *, by_lift: bool) -> None:
        """So many levels up, by a change of pressure."""
        chosen = self._change_level(levels, by_lift=by_lift, rng=self._rng_renewal)
        if chosen is not None:
            self.scale, self.bias_rad = self.scale[chosen], self.bias_rad[chosen]

    def move(self, move_m: FloatArray, covariance_m2: FloatArray) -> None:
        """One displacement (2,) and its covariance (2, 2): propagate, stop at walls, renew, locate."""
        to_m = self._local_m + self._displacements(move_m, covariance_m2)
        cell = self._cell.copy()
        alive = self._walk(self._local_m, to_m, cell)
        self.free_fraction = float(alive.mean())
        if not alive.any():
            self._begin_around(self.xy_m + move_m, self._restart_sigma_m(RESTART_M))
            return
        self._resets_in_a_row = 0
        self._local_m[alive], self._cell[alive] = to_m[alive], cell[alive]
        self._renew(np.flatnonzero(~alive), np.flatnonzero(alive))
        self._locate(on_level=True)

    def _displacements(self, move_m: FloatArray, covariance_m2: FloatArray) -> FloatArray:
        """(N, 2) drawn from the network's distribution, turned and scaled by the state of each particle."""
        p, rng = self._params, self._rng_motion
        noise = rng.standard_normal((p.num_particles, 2))
        self.bias_rad = self.bias_rad + p.bias_walk_rad * rng.standard_normal(p.num_particles)
        drawn_m = move_m + noise @ np.linalg.cholesky(covariance_m2).T
        cosine, sine = np.cos(self.bias_rad), np.sin(self.bias_rad)
        step_m: FloatArray = self.scale[:, None] * np.column_stack(
            [cosine * drawn_m[:, 0] - sine * drawn_m[:, 1], sine * drawn_m[:, 0] + cosine * drawn_m[:, 1]]
        )
        return step_m

    def _renew(self, stopped: IntArray, live: IntArray) -> None:
        """Puts particles that hit a wall beside live ones, with nearly their state."""
        p, rng = self._params, self._rng_renewal
        chosen = live[rng.integers(len(live), size=len(stopped))]
        self.scale[stopped] = self.scale[chosen] * np.exp(p.near_scale * rng.standard_normal(len(stopped)))
        self.bias_rad[stopped] = self.bias_rad[chosen] + p.near_bias_rad * rng.standard_normal(len(stopped))
        self._inherit(stopped, chosen)
        self._place(stopped, self._local_m[chosen], self._cell[chosen], p.near_m, rng)

    def _inherit(self, which: IntArray, chosen: IntArray) -> None:
        """Particles (n,) that are put beside others (n,) take what those keep besides; here nothing."""

    def _on_floor(self, xy_m: FloatArray, level: IntArray) -> tuple[FloatArray, NDArray[np.int32]]:
        """(n, 2) local, and (n,) cells: the nearest floor to places (n, 2) on levels (n,) of the map."""
        assert self._map is not None
        near_m, cell = np.empty((len(xy_m), 2)), np.empty(len(xy_m), dtype=np.int32)
        for one in np.unique(level).tolist():
            near_m[level == one], cell[level == one] = self._map.nearest(xy_m[level == one], one)
        return near_m - self._origin_m, cell

    def _begin_around(self, xy_m: FloatArray, sigma_m: float) -> None:
        self._spread(self._params.num_particles, xy_m, sigma_m, self._rng_start, tries=TRIES, shrink=SHRINK)
        self._locate(on_level=True)


def debug_of(cloud: LearnedMapFilter | None) -> dict[str, NDArray[Any]]:
    """What `debug` says of particles; None before there are any."""
    if cloud is None:
        return {"num_particles": np.array(0)}
    return {
        "particles_xy_m": cloud.particles_xy_m,
        "particles_level": cloud.particles_level,
        "num_particles": np.array(cloud.num_particles),
        "resets": np.array(cloud.resets),
        "scale": np.array(cloud.mean_scale),
        "bias_rad": np.array(cloud.mean_bias_rad),
    }


def stored(cloud: LearnedMapFilter, t_s: float, most: int) -> StoredCloud:
    """At most so many particles as backward sampling takes them: place, log of the factor on lengths, error of the
    heading."""
    kept = slice(None, None, -(-cloud.num_particles // most))
    state = np.column_stack([cloud.particles_xy_m[kept], np.log(cloud.scale[kept]), cloud.bias_rad[kept]])
    level, cell = cloud.particles_level[kept], cloud.particles_cell[kept]
    return StoredCloud(t_s, state, level, cell, np.ones(len(state)), cloud.line_check())


def motion_of(move: Move, params: LearnedMapFilterParams, turn_rad: float = 0.0) -> Transition:
    """The motion of particles in a second, with the jitter that renewal adds to their state.

    Errors of headings are less by `turn_rad` from that second on.
    """
    p = params
    covariance = np.diag(np.square([p.near_m, p.near_m, p.scale_sigma / 4, p.bias_walk_rad + p.bias_sigma_rad / 6]))
    covariance[:2, :2] += move.covariance_m2

    def expected(state: FloatArray) -> FloatArray:
        log_scale, bias_rad = state[:, 2], state[:, 3] - turn_rad
        cosine, sine = np.cos(bias_rad), np.sin(bias_rad)
        (x_m, y_m), scale = move.move_m, np.exp(log_scale)
        steps = np.column_stack([cosine * x_m - sine * y_m, sine * x_m + cosine * y_m]) * scale[:, None]
        return np.column_stack([state[:, :2] + steps, log_scale, bias_rad])

    return gaussian(expected, covariance)
