"""Particles of `fusion` that carry a belief on the offset of the magnetometer."""

from __future__ import annotations

import math

import numpy as np

from pdrbench.building import Building
from pdrbench.filters import systematic
from pdrbench.geometry import FloatArray, IntArray
from pdrbench_baselines.fusion.cloud import Cloud
from pdrbench_baselines.fusion.radio import RadioEvidence
from pdrbench_baselines.learned.map_filter import SHRINK, TRIES, LearnedMapFilterParams
from pdrbench_lab.magnetic.evidence import START_M, FieldSample, MagneticEvidence, OffsetBelief


class MagneticCloud(Cloud):
    """A cloud that samples of a magnetometer weigh.

    Args:
        building, rng, params, level, radio: As `Cloud`.
        magnetic: The magnetic survey.
    """

    def __init__(
        self,
        building: Building,
        rng: np.random.Generator,
        params: LearnedMapFilterParams,
        level: int,
        radio: RadioEvidence | None,
        magnetic: MagneticEvidence,
    ) -> None:
        super().__init__(building, rng, params, level, radio)
        self._magnetic = magnetic
        if radio is None:
            self._offset = np.zeros(params.num_particles, dtype=np.int64)
        self._prior = OffsetBelief.prior(1, magnetic.params.field.offset_ut)
        self.belief = OffsetBelief.prior(params.num_particles, magnetic.params.field.offset_ut)

    def begin_over_survey(self) -> None:
        """Evenly over the surveyed part of its levels; the evidence begins with how much that is."""
        assert self._map is not None
        rng, levels = self._rng_start, [one for one in self._magnetic.field.levels.tolist() if one in self.levels]
        places = [self._magnetic.starts_on(level, self._map) for level in levels]
        xy_m, cell = (np.concatenate(part) for part in zip(*places, strict=True))
        self.log_evidence = math.log(len(xy_m))
        drawn = rng.integers(len(xy_m), size=self.num_particles)
        which, near_m = np.arange(self.num_particles), xy_m[drawn] - self._origin_m
        self._local_m, self._cell = near_m.copy(), cell[drawn]
        self._scatter(which, near_m, cell[drawn], 0.5 * START_M, rng, tries=TRIES, shrink=SHRINK)
        self._locate(on_level=True)

    def weigh_by_field(self, sample: FieldSample) -> None:
        """Chooses between particles by a sample, and adds to the evidence."""
        start, jitter = self._rng_scans.spawn(2)
        log_likelihood = sample.log_likelihood(self.particles_xy_m, self.particles_level, self.belief)
        best = float(log_likelihood.max())
        weight = np.exp(log_likelihood - best)
        self.log_evidence += best + math.log(float(weight.mean()))
        self._choose(systematic(weight, start.random()), jitter)
        self._locate(on_level=True)

    def _choose(self, chosen: IntArray, rng: np.random.Generator) -> None:
        super()._choose(chosen, rng)
        self.belief.copy_to(np.arange(len(chosen)), self.belief, chosen)

    def _inherit(self, which: IntArray, chosen: IntArray) -> None:
        self.belief.copy_to(which, self.belief, chosen)

    def _put_over(self, which: IntArray, weight: FloatArray, rng: np.random.Generator) -> None:
        super()._put_over(which, weight, rng)
        self.belief.copy_to(which, self._prior, np.zeros(len(which), dtype=np.int64))
