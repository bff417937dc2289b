"""Particles on a map, moved by displacements with a covariance; each has an own share of length and an own heading.

A network's errors are of two kinds: what differs from second to second, which its covariance tells, and what a walk
keeps, the length of this person's steps and the yaw between phone and person. The second kind is a state: walls tell it
apart. A wall kills a particle, and it comes back beside a live one, with nearly its state. Where there is a radio
survey, scans choose between particles, and where no start is told the first scan says where to look.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from pdrbench.building import Building
from pdrbench.filters import stride_kernels as parts
from pdrbench.filters.level_map import level_map
from pdrbench.geometry import BoolArray, FloatArray, IntArray
from pdrbench_baselines.learned.wlan import ScanPlaces

MOST_RESTART_M: Final = 16.0
TRIES: Final = 4


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
        scan_trust: Power of what a scan says: neighbouring scans err alike, so that none is news of its own.
        drawn_trust: The same of a survey whose places were interpolated between surveyed ones.
        lost_share: How often, at a scan, all particles are in the wrong place.
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
    scan_trust: float = 0.5
    drawn_trust: float = 0.2
    lost_share: float = 0.002


class MapFilter:
    """See the module; `begin_near` or `begin_among` comes first.

    Args:
        building: The map.
        rng: Start, motion, renewal and scans draw from children of their own.
        params: See `MapFilterParams`.
        level: Where the walk begins; a map that cannot be compiled as a whole is walked on this level only.
    """

    def __init__(self, building: Building, rng: np.random.Generator, params: MapFilterParams, level: int) -> None:
        p = self._params = params
        self._rng_start, self._rng_motion, self._rng_renewal, self._rng_scans = rng.spawn(4)
        self._map = level_map(building, level)
        self._origin_m = self._map.pieces.origin_xy_m
        self.scale = np.exp(p.scale_sigma * self._rng_start.standard_normal(p.num_particles))
        self.bias_rad = p.bias_sigma_rad * self._rng_start.standard_normal(p.num_particles)
        self.level, self.resets, self._deaths_in_a_row = level, 0, 0
        self._local_m: FloatArray = np.zeros((p.num_particles, 2))
        self._piece: NDArray[np.int32] = np.zeros(p.num_particles, dtype=np.int32)
        self._floor: dict[tuple[float, float, int], tuple[FloatArray, int]] = {}

    def begin_near(self, xy_m: FloatArray, radius_m: float = 0.0) -> None:
        """Around a place (2,), told to lie in a disc; off the floor it is taken to the nearest floor of its level."""
        self._spread(np.asarray(xy_m, dtype=np.float64), max(self._params.start_sigma_m, radius_m / 2))

    def begin_among(self, places: ScanPlaces) -> None:
        """Where a scan may have been heard."""
        self._scatter(np.arange(self._params.num_particles), places, self._rng_start)
        self._locate()

    def weigh(self, places: ScanPlaces, *, trust: float, may_be_lost: bool) -> None:
        """Chooses between particles by what a scan says of their places.

        Args:
            places: What it says.
            trust: Power of that.
            may_be_lost: Whether some particles are put where the scan was heard, more if it tells against all others.
        """
        p, rng = self._params, self._rng_scans
        weight = places.density_per_m2(self.particles_xy_m, self.particles_level) ** trust
        lost = p.lost_share * places.area_m2**-trust  # a scan heard just anywhere has this density
        share = lost / (lost + float(weight.mean())) if may_be_lost else 0.0
        start, pick, fresh, jitter = rng.spawn(4)
        heights = (start.random() + np.arange(p.num_particles)) / p.num_particles
        cumulative = np.cumsum(weight)
        chosen = np.searchsorted(cumulative / cumulative[-1], heights, side="right").clip(max=p.num_particles - 1)
        twin = np.flatnonzero(np.diff(chosen, prepend=-1) == 0)
        self._local_m, self._piece = self._local_m[chosen], self._piece[chosen]
        self.scale, self.bias_rad = self.scale[chosen], self.bias_rad[chosen]
        self.scale[twin] *= np.exp(p.near_scale * jitter.standard_normal(len(twin)))
        self.bias_rad[twin] += p.near_bias_rad * jitter.standard_normal(len(twin))
        moved = np.flatnonzero(pick.random(p.num_particles) < share)
        self._scatter(moved, places, fresh)
        self._locate()

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
        alive = self._map.walk(self._local_m, to_m, piece)
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
    ) -> BoolArray:
        """Puts particles around places; where a wall is between (those are False), at the place itself."""
        ended = piece.copy()
        to_m = near_m + sigma_m * rng.standard_normal((len(which), 2))
        free = self._map.walk(near_m, to_m, ended)
        self._local_m[which] = np.where(free[:, None], to_m, near_m)
        self._piece[which] = np.where(free, ended, piece)
        return free

    def _scatter(self, which: IntArray, places: ScanPlaces, rng: np.random.Generator) -> None:
        """Puts particles among surveyed places, by weight; those off this map are left out."""
        on_map = np.isin(places.level, self._map.level)
        if not on_map.any() or not len(which):
            return
        share = places.weight * on_map
        drawn = rng.choice(len(share), size=len(which), p=share / share.sum())
        near_m, piece = np.empty((len(which), 2)), np.empty(len(which), dtype=np.int32)
        for place in np.unique(drawn).tolist():
            here = drawn == place
            xy_m, piece[here] = self._on_floor(places.xy_m[place], int(places.level[place]))
            near_m[here] = xy_m - self._origin_m
        self._place_near(which, near_m, piece, places.spread_m, rng)

    def _place_near(
        self, which: IntArray, near_m: FloatArray, piece: NDArray[np.int32], sigma_m: float, rng: np.random.Generator
    ) -> None:
        """Puts particles around places; across a wall nearer ones, else all would crowd on the place."""
        left = np.arange(len(which))
        for _ in range(TRIES):
            free = self._place(which[left], near_m[left], piece[left], sigma_m, rng)
            left, sigma_m = left[~free], 0.6 * sigma_m

    def _on_floor(self, xy_m: FloatArray, level: int) -> tuple[FloatArray, int]:
        """Nearest floor, remembered: scans name the same surveyed places again and again."""
        key = (float(xy_m[0]), float(xy_m[1]), level)
        if key not in self._floor:
            self._floor[key] = self._map.nearest(xy_m, level)
        return self._floor[key]

    def _spread(self, xy_m: FloatArray, sigma_m: float) -> None:
        count = self._params.num_particles
        xy_m, piece = self._map.nearest(xy_m, self.level)
        self._local_m[:] = xy_m - self._origin_m
        self._piece[:] = piece
        everyone = np.arange(count)
        self._place_near(everyone, self._local_m.copy(), self._piece.copy(), sigma_m, self._rng_start)
        self._locate()

    def _restart(self, move_m: FloatArray) -> None:
        """Everybody has died: spread again around where the mean would have come to, wider with every time."""
        self.resets += 1
        sigma_m = min(1.0 * 2.0**self._deaths_in_a_row, MOST_RESTART_M)
        self._deaths_in_a_row += 1
        self._spread(self.xy_m + move_m, sigma_m)

    def _locate(self) -> None:
        here = self._local_m
        if self._map.num_levels > 1:
            level = self.particles_level
            levels, number = np.unique(level, return_counts=True)
            self.level = int(levels[np.argmax(number)])
            here = here[level == self.level]
        x_m, y_m, self.sigma_m = parts.centre(here)
        self.xy_m: FloatArray = self._origin_m + np.array([x_m, y_m])
