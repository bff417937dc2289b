"""Particles on a map, moved by displacements with a covariance; each has an own share of length and an own heading.

A network's errors are of two kinds: what differs from second to second, which its covariance tells, and what a walk
keeps, the length of this person's steps and the yaw between phone and person. The second kind is a state: walls tell it
apart. A wall kills a particle, and it comes back beside a live one, with nearly its state.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numba
import numpy as np
from numpy.typing import NDArray

from pdrbench.building import Building
from pdrbench.filters import kernels
from pdrbench.filters import stride_kernels as parts
from pdrbench.filters.level_map import level_map
from pdrbench.geometry import BoolArray, FloatArray, IntArray

MOST_RESTART_M: Final = 16.0


@dataclass(frozen=True, slots=True)
class MapFilterParams:
    """Defaults, ours unless a line says otherwise.

    Attributes:
        num_particles: Always as many.
        start_sigma_m: Spread around a start, per axis.
        scale_sigma: Spread of the factor on lengths.
        bias_sigma_rad: Spread of the error of headings.
        bias_walk_rad: By which it wanders in a second.
        noise_share: Part of the claimed standard deviation that is drawn anew every second.
        near_m: Of the jitter around a live particle, per axis.
        near_scale, near_bias_rad: Of its state.
    """

    num_particles: int = 2000
    start_sigma_m: float = 0.5
    scale_sigma: float = 0.06  # sources.md 1.2: people differ by so much at the same cadence
    bias_sigma_rad: float = math.radians(9.0)  # sources.md 1.5: 11.3 degrees, of which training takes the mean
    bias_walk_rad: float = math.radians(1.0)
    noise_share: float = 1.0
    near_m: float = 0.2  # as Li et al. 2012 here
    near_scale: float = 0.01
    near_bias_rad: float = math.radians(1.0)


class MapFilter:
    """See the module.

    Args:
        building: The map.
        rng: Start, motion and renewal draw from children of their own.
        params: See `MapFilterParams`.
        xy_m: (2,) the start; off the floor it is taken to the nearest floor of its level.
        level: Of the start.
        radius_m: Of the disc it is told to lie in.
    """

    def __init__(
        self,
        building: Building,
        rng: np.random.Generator,
        params: MapFilterParams,
        xy_m: FloatArray,
        level: int,
        radius_m: float = 0.0,
    ) -> None:
        p = self._params = params
        self._rng_start, self._rng_motion, self._rng_renewal = rng.spawn(3)
        self._map = level_map(building, level)
        self._origin_m = self._map.pieces.origin_xy_m
        self.scale = np.exp(p.scale_sigma * self._rng_start.standard_normal(p.num_particles))
        self.bias_rad = p.bias_sigma_rad * self._rng_start.standard_normal(p.num_particles)
        self.level, self.resets, self._deaths_in_a_row = level, 0, 0
        self._local_m: FloatArray = np.zeros((p.num_particles, 2))
        self._piece: NDArray[np.int32] = np.zeros(p.num_particles, dtype=np.int32)
        self._spread(np.asarray(xy_m, dtype=np.float64), max(p.start_sigma_m, radius_m / 2))

    @property
    def particles_xy_m(self) -> FloatArray:
        """(N, 2)."""
        xy_m: FloatArray = self._local_m + self._origin_m
        return xy_m

    @property
    def particles_level(self) -> IntArray:
        """(N,)."""
        level: IntArray = self._map.level[self._piece]
        return level

    def move(self, move_m: FloatArray, covariance_m2: FloatArray) -> None:
        """One displacement (2,) and its covariance (2, 2)."""
        p, rng = self._params, self._rng_motion
        noise = rng.standard_normal((p.num_particles, 2))
        self.bias_rad = self.bias_rad + p.bias_walk_rad * rng.standard_normal(p.num_particles)
        drawn_m = move_m + p.noise_share * noise @ np.linalg.cholesky(covariance_m2).T
        cosine, sine = np.cos(self.bias_rad), np.sin(self.bias_rad)
        step_m = self.scale[:, None] * np.column_stack(
            [cosine * drawn_m[:, 0] - sine * drawn_m[:, 1], sine * drawn_m[:, 0] + cosine * drawn_m[:, 1]]
        )
        to_m = self._local_m + step_m
        piece = self._piece.copy()
        alive = self._walk(self._local_m, to_m, piece)
        if not alive.any():
            self._restart(move_m)
            return
        self._deaths_in_a_row = 0
        self._local_m[alive], self._piece[alive] = to_m[alive], piece[alive]
        self._renew(np.flatnonzero(~alive), np.flatnonzero(alive))
        self._locate()

    def _renew(self, dead: IntArray, live: IntArray) -> None:
        p, rng = self._params, self._rng_renewal
        chosen = live[rng.integers(len(live), size=len(dead))]
        self.scale[dead] = self.scale[chosen] * np.exp(p.near_scale * rng.standard_normal(len(dead)))
        self.bias_rad[dead] = self.bias_rad[chosen] + p.near_bias_rad * rng.standard_normal(len(dead))
        self._place(dead, self._local_m[chosen], self._piece[chosen], p.near_m, rng)

    def _place(
        self, which: IntArray, near_m: FloatArray, piece: NDArray[np.int32], sigma_m: float, rng: np.random.Generator
    ) -> None:
        """Puts particles around places; where a wall is between, at the place itself."""
        ended = piece.copy()
        to_m = near_m + sigma_m * rng.standard_normal((len(which), 2))
        free = self._walk(near_m, to_m, ended)
        self._local_m[which] = np.where(free[:, None], to_m, near_m)
        self._piece[which] = np.where(free, ended, piece)

    def _spread(self, xy_m: FloatArray, sigma_m: float) -> None:
        count = self._params.num_particles
        xy_m, piece = self._map.nearest(xy_m, self.level)
        self._local_m[:] = xy_m - self._origin_m
        self._piece[:] = piece
        everyone = np.arange(count)
        self._place(everyone, self._local_m.copy(), self._piece.copy(), sigma_m, self._rng_start)
        self._locate()

    def _restart(self, move_m: FloatArray) -> None:
        """Everybody has died: spread again around where the mean would have come to, wider with every time."""
        self.resets += 1
        sigma_m = min(1.0 * 2.0**self._deaths_in_a_row, MOST_RESTART_M)
        self._deaths_in_a_row += 1
        self._spread(self.xy_m + move_m, sigma_m)

    def _walk(self, from_m: FloatArray, to_m: FloatArray, piece: NDArray[np.int32]) -> BoolArray:
        """(n,) whether no wall is between; `piece` becomes where each ends."""
        order = parts.by_piece(piece, len(self._map.pieces))
        x, y = np.ascontiguousarray(from_m[order].T, dtype=np.float32)
        x_end, y_end = np.ascontiguousarray(to_m[order].T, dtype=np.float32)
        pieces, weight = piece[order], np.empty(len(order), dtype=np.float32)
        threads = numba.get_num_threads()
        numba.set_num_threads(1)  # some thousand particles take less time than waking another thread
        try:
            kernels.walk(self._map.world, x, y, x_end, y_end, pieces, weight)
        finally:
            numba.set_num_threads(threads)
        piece[order] = pieces
        alive = np.empty(len(order), dtype=np.bool_)
        alive[order] = weight > 0
        return alive

    def _locate(self) -> None:
        x_m, y_m, self.sigma_m = parts.centre(self._local_m)
        self.xy_m: FloatArray = self._origin_m + np.array([x_m, y_m])
        if self._map.num_levels > 1:
            levels, number = np.unique(self._map.level[self._piece], return_counts=True)
            self.level = int(levels[np.argmax(number)])
