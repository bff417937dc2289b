"""Particles on a map, moved by displacements with a covariance; each has a factor on lengths and an error of headings.

A network's errors are of two kinds: what differs from second to second, which its covariance describes, and what a walk
keeps, the length of this person's steps and the yaw between phone and person. The second kind is a state: walls
reveal it. A wall kills a particle, and it comes back beside a live one, with nearly its state. Where there is a radio
survey, scans choose between particles, and where the start is unknown the first scan gives it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from pdrbench.building import Building
from pdrbench.filters import MapFilter, level_map, systematic
from pdrbench.geometry import FloatArray, IntArray
from pdrbench_baselines.learned.wlan import ScanPlaces

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
        scan_trust: Power of what a scan says: neighbouring scans err alike, so that none is news of its own.
        drawn_trust: The same of a survey whose places were interpolated between surveyed ones.
        lost_fraction: How often, at a scan, all particles are in the wrong place.
    """

    num_particles: int = 2000
    start_sigma_m: float = 0.5
    scale_sigma: float = 0.06  # sources.md 1.2: people differ by so much at the same cadence
    bias_sigma_rad: float = math.radians(9.0)  # sources.md 1.5: 11.3 degrees, of which training takes the mean
    bias_walk_rad: float = math.radians(1.0)
    near_m: float = 0.2  # as Li et al. 2012 here
    near_scale: float = 0.01
    near_bias_rad: float = math.radians(1.0)
    scan_trust: float = 0.5
    drawn_trust: float = 0.2
    lost_fraction: float = 0.002


class LearnedMapFilter(MapFilter):
    """See the module; `begin_near` or `begin_among` comes first.

    Args:
        building: The map.
        rng: Start, motion, renewal and scans draw from children of their own.
        params: See `LearnedMapFilterParams`.
        level: Where the walk begins; a map that cannot be compiled as a whole is walked on this level only.
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

    def begin_among(self, places: ScanPlaces) -> None:
        """Where a scan may have been received."""
        self._put_among(np.arange(self.num_particles), places, self._rng_start)
        self._locate(on_level=True)

    def weigh(self, places: ScanPlaces, *, trust: float, may_be_lost: bool) -> None:
        """Chooses between particles by the density of a scan at their places.

        Args:
            places: Where the scan may have been received.
            trust: Power of that density.
            may_be_lost: Whether some particles are put where the scan was received, more if all others are unlikely.
        """
        p, rng = self._params, self._rng_scans
        weight = places.density_per_m2(self.particles_xy_m, self.particles_level) ** trust
        lost = p.lost_fraction * places.area_m2**-trust  # a scan received just anywhere has this density
        fraction = lost / (lost + float(weight.mean())) if may_be_lost else 0.0
        start, pick, fresh, jitter = rng.spawn(4)
        chosen = systematic(weight, start.random())
        twin = np.flatnonzero(np.diff(chosen, prepend=-1) == 0)
        self._local_m, self._cell = self._local_m[chosen], self._cell[chosen]
        self.scale, self.bias_rad = self.scale[chosen], self.bias_rad[chosen]
        self.scale[twin] *= np.exp(p.near_scale * jitter.standard_normal(len(twin)))
        self.bias_rad[twin] += p.near_bias_rad * jitter.standard_normal(len(twin))
        moved = np.flatnonzero(pick.random(p.num_particles) < fraction)
        self._put_among(moved, places, fresh)
        self._locate(on_level=True)

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

    def _put_among(self, which: IntArray, places: ScanPlaces, rng: np.random.Generator) -> None:
        """Puts particles among surveyed places, by weight; those off this map are left out."""
        assert self._map is not None
        on_map = np.isin(places.level, self._map.level)
        if not on_map.any() or not len(which):
            return
        weight = places.weight * on_map
        drawn = rng.choice(len(weight), size=len(which), p=weight / weight.sum())
        drawn, number = np.unique(drawn, return_inverse=True)
        near_m, cell = self._on_floor(places.xy_m[drawn], places.level[drawn])
        self._scatter(which, near_m[number], cell[number], places.spread_m, rng, tries=TRIES, shrink=SHRINK)

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
