"""Particles, put and weighed by likelihoods on a lattice, which also say how likely the cloud is."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from pdrbench.building import Building
from pdrbench.filters import systematic
from pdrbench.geometry import BoolArray, FloatArray, IntArray
from pdrbench_baselines.fusion.compass import CompassMean
from pdrbench_baselines.fusion.lost import States
from pdrbench_baselines.fusion.middle import geometric_median
from pdrbench_baselines.fusion.radio import RadioEvidence
from pdrbench_baselines.learned.map_filter import SHRINK, TRIES, LearnedMapFilter, LearnedMapFilterParams

WITHIN: Final = 1.0 / 3.0  # of the side of a square: spread of particles that are put there, per axis


class Cloud(LearnedMapFilter):
    """Particles on a map; each has an offset of the device as well.

    Args:
        building: The map.
        rng: As `LearnedMapFilter`.
        params: See `LearnedMapFilterParams`.
        level: Where the walk begins, or may begin.
        radio: None without a survey.
        is_open: The map is open space in place of a plan: beside its floor, scans are as likely as on the nearest.
    """

    def __init__(
        self,
        building: Building,
        rng: np.random.Generator,
        params: LearnedMapFilterParams,
        level: int,
        radio: RadioEvidence | None,
        *,
        is_open: bool = False,
    ) -> None:
        self._is_open = is_open
        self._median_m: FloatArray | None = None
        self._mean_bias_rad: float | None = None
        self._may_be_turned = params.bias_sigma_rad >= math.pi
        super().__init__(building, rng, params, level)
        self._radio = radio
        self.log_evidence = 0.0
        self._offset: IntArray = np.zeros(params.num_particles, dtype=np.int64)
        if radio is not None:
            self._offset = self._rng_scans.choice(len(radio.prior), size=params.num_particles, p=radio.prior)

    @property
    def levels(self) -> frozenset[int]:
        """That particles may be on."""
        return frozenset(() if self._map is None else self._levels.tolist())

    @property
    def levels_now(self) -> frozenset[int]:
        """That particles are on."""
        return frozenset(self._levels[np.flatnonzero(np.bincount(self._storey[self._cell]))].tolist())

    @property
    def median_m(self) -> FloatArray:
        """(2,) geometric median of the particles on the level of the estimate."""
        if self._median_m is None:
            here_m = self._local_m
            if not self._is_one_level:
                here_m = here_m[self.particles_level == self.level]
            self._median_m = self._origin_m + geometric_median(here_m)
        return self._median_m

    @property
    def mean_bias_rad(self) -> float:
        """Error of headings; on a circle where particles may walk in any direction."""
        if self._mean_bias_rad is None:
            self._mean_bias_rad = super().mean_bias_rad
            if self._may_be_turned:
                self._mean_bias_rad = float(np.angle(np.exp(1j * self.bias_rad).mean()))
        return self._mean_bias_rad

    @property
    def mean_offset_db(self) -> float:
        """Offset of the device; 0 without a survey."""
        return 0.0 if self._radio is None else float(self._radio.offset_db[self._offset].mean())

    @property
    def offset_fraction(self) -> FloatArray:
        """(K,) of the particles, by their offset."""
        assert self._radio is not None
        return np.bincount(self._offset, minlength=len(self._radio.prior)) / self.num_particles

    def beside(self, floor: Building, params: LearnedMapFilterParams, level: int) -> Cloud:
        """Another cloud by the same survey, in open space."""
        return Cloud(floor, self._rng_start.spawn(1)[0], params, level, self._radio, is_open=True)

    def begin_over(self, log_likelihood: FloatArray) -> None:
        """Over the lattice by the log-likelihoods (N, K) of a first scan; they begin the evidence."""
        assert self._radio is not None
        weight = np.exp(log_likelihood - log_likelihood.max()) * self._on_map()[:, None] * self._radio.prior
        self.log_evidence = math.log(max(float(weight.sum()), np.finfo(np.float64).tiny))
        self._put_over(np.arange(self.num_particles), weight, self._rng_start)
        self._locate(on_level=True)

    def weigh_by(
        self, log_likelihood: FloatArray, lost_fraction: float, turned_fraction: float = 0.0, *, resets: bool = False
    ) -> float:
        """Chooses between particles by the log-likelihoods (N, K) of a scan, and adds to the evidence.

        Returns:
            What it adds.

        Args:
            log_likelihood: On the lattice, for every offset.
            lost_fraction: How often, at a scan, the walker may be anywhere; particles are put by the scan alone in
                proportion to how much likelier that is then.
            turned_fraction: Of those particles, how many walk in any direction from there on.
            resets: Whether a walker who is lost is taken to be where the scan is likely instead of anywhere (sensor
                resetting, Lenser & Veloso 2000): else one scan whose likelihood has a floor cannot show that he is.
        """
        assert self._radio is not None
        start, pick, fresh, jitter = self._rng_scans.spawn(4)
        log_likelihood = log_likelihood - log_likelihood.max()
        square = self._radio.squares_at(self.particles_xy_m, self.particles_level, nearest=self._is_open)
        elsewhere = self._radio.elsewhere(log_likelihood)
        weight = np.exp(np.where(square >= 0, log_likelihood[square, self._offset], elsewhere))
        lost, anywhere = 0.0, np.zeros((0, 0))
        if lost_fraction > 0.0:
            likelihood = np.exp(log_likelihood)
            anywhere = likelihood * self._on_map()[:, None] * self._radio.prior
            total = float(max(len(self._radio.level), 1))
            if resets and anywhere.any():
                anywhere, total = likelihood * anywhere, float(anywhere.sum())
            lost = lost_fraction * float(anywhere.sum()) / total
        found = (1.0 - lost_fraction) * float(weight.mean())
        if lost + found <= 0.0:
            return 0.0
        gain = math.log(lost + found)
        self.log_evidence += gain
        self._choose(systematic(weight, start.random()), jitter)
        carried = np.flatnonzero(pick.random(self.num_particles) < lost / (lost + found))
        self._put_over(carried, anywhere, fresh)
        if turned_fraction > 0.0:
            (turn,) = self._rng_scans.spawn(1)
            turned = carried[turn.random(len(carried)) < turned_fraction]
            self.bias_rad[turned] = turn.uniform(-math.pi, math.pi, len(turned))
            self._may_be_turned = True
        self._locate(on_level=True)
        return gain

    def turn(self, turn_rad: float, compass: CompassMean) -> None:
        """Particles keep their headings while the frame of displacements turns; the compass chooses between them."""
        before_rad, self.bias_rad = self.bias_rad, self.bias_rad - turn_rad
        gain = compass.log_gain(before_rad, self.bias_rad)
        start, jitter = self._rng_scans.spawn(2)
        self._choose(systematic(np.exp(gain - gain.max()), start.random()), jitter)
        self._locate(on_level=True)

    def take(self, states: States) -> None:
        """Puts particles, drawn at random, in other states, on the nearest floor of the level."""
        assert self._map is not None
        pick, jitter = self._rng_scans.spawn(2)
        which = pick.choice(self.num_particles, size=len(states.scale), replace=False)
        near_m, cell = self._on_floor(states.xy_m, np.full(len(which), self.level))
        self.scale[which], self.bias_rad[which] = states.scale, states.bias_rad
        self._offset[which] = states.offset
        self._place(which, near_m, cell, self._params.near_m, jitter)
        self._may_be_turned = True
        self._locate(on_level=True)

    def _choose(self, chosen: IntArray, rng: np.random.Generator) -> None:
        """Takes particles, those twice taken with a jitter of their state."""
        p, twin = self._params, np.flatnonzero(np.diff(chosen, prepend=-1) == 0)
        self._local_m, self._cell, self._offset = self._local_m[chosen], self._cell[chosen], self._offset[chosen]
        self.scale, self.bias_rad = self.scale[chosen], self.bias_rad[chosen]
        self.scale[twin] *= np.exp(p.near_scale * rng.standard_normal(len(twin)))
        self.bias_rad[twin] += p.near_bias_rad * rng.standard_normal(len(twin))

    def _locate(self, *, on_level: bool = False) -> None:
        super()._locate(on_level=on_level)
        self._median_m = self._mean_bias_rad = None

    def _on_map(self) -> BoolArray:
        """(N,) which places of the lattice are on levels of this cloud."""
        assert self._radio is not None
        return np.isin(self._radio.level, list(self.levels))

    def _put_over(self, which: IntArray, weight: FloatArray, rng: np.random.Generator) -> None:
        """Puts particles over the lattice by weights (N, K) of places and offsets."""
        if not len(which):
            return
        total = np.cumsum(weight.ravel())
        if total[-1] <= 0.0:
            return
        assert self._radio is not None
        drawn = np.searchsorted(total, total[-1] * rng.random(len(which)), side="right")
        place, self._offset[which] = np.divmod(np.minimum(drawn, len(total) - 1), weight.shape[1])
        places, number = np.unique(place, return_inverse=True)
        near_m, cell = self._on_floor(self._radio.xy_m[places], self._radio.level[places])
        spread_m = WITHIN * self._radio.lattice_m
        self._scatter(which, near_m[number], cell[number], spread_m, rng, tries=TRIES, shrink=SHRINK)
