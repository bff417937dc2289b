"""Whether a cloud is lost: what scans alone say of a walk, wherever it leads.

A phone in a bag or at an ear may point elsewhere than its displacements say, and headings that are wrong find room
where the right ones meet walls. A cloud on a map that has lost the right ones never finds them again: particles stay
together, and where none is, a scan cannot choose one. A belief on the lattice of the radio map, that walks anywhere, is
weighed by the same scans. When their evidence has become far better for it, it is the cloud that is lost.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial import KDTree

from pdrbench.geometry import FloatArray, IntArray
from pdrbench.trajectory import Start
from pdrbench_baselines.fusion.radio import RadioEvidence

MIN_TOTAL: Final = 1e-300  # of a belief that has left the floor


@dataclass(frozen=True, slots=True)
class LostParams:
    """Ours; see the notebook on fusion.

    Attributes:
        lead: Logarithm of the odds by which the evidence for the belief is to be better, since the cloud was last no
            worse. Chosen on 29 train and four val walks of CampusPhone-v1; 50 other train walks, left out of that, went
            from 3.21 to 2.88 m.
        fraction: Of the cloud, that is then put where the belief is.
        speed_mps: The belief spreads by so much per second, per axis.
        anywhere: Part of it that is spread over the level at every scan.
        start_sigma_m: Around the start, at least.
        surveyed_m: While the cloud is farther than that from every scan of the survey, scans do not count: what the map
            says there is guessed, and places that were surveyed contradict it less. 90 train walks of MallPhone-v2 that
            it was not seen on: 2.13 m, and 2.56 if all scans count.
    """

    lead: float = 8.0
    fraction: float = 0.5
    speed_mps: float = 1.0
    anywhere: float = 0.003
    start_sigma_m: float = 2.0
    surveyed_m: float = 10.0


@dataclass(frozen=True, slots=True, eq=False)
class States:
    """Of particles (N,): places (N, 2), factors on lengths, errors of headings, and which offset of the device."""

    xy_m: FloatArray
    scale: FloatArray
    bias_rad: FloatArray
    offset: IntArray


class ScanBelief:
    """A belief over the places and offsets of one level, and by how much its evidence is ahead of that of a cloud.

    Args:
        params: See `LostParams`.
        scale_sigma: Of the logarithm of factors on lengths.
        radio: The survey.
        start: Of the walk.
        rng: Particles are drawn from it.

    Attributes:
        params: See `LostParams`.
        lead: By how much its log-evidence is ahead since the cloud was last no worse.
    """

    def __init__(
        self, params: LostParams, scale_sigma: float, radio: RadioEvidence, start: Start, rng: np.random.Generator
    ) -> None:
        self.params, self._scale_sigma, self._radio, self._rng, self.lead = params, scale_sigma, radio, rng, 0.0
        self._level, self._scanned_s = start.level, 0.0
        self._belief: FloatArray = np.outer(radio.places.near(start, params.start_sigma_m), radio.prior)
        survey = radio.radio_map
        self._tree = {int(one): KDTree(survey.xy_m[survey.level == one]) for one in radio.places.levels}

    def weigh_by(
        self, log_likelihood: FloatArray, now_s: float, cloud_m: FloatArray, level: int, cloud_gain: float
    ) -> None:
        """Weighs by the log-likelihoods (N, K) of a scan, for which the gain of `Cloud.weigh_by` is given.

        Args:
            log_likelihood: (N, K).
            now_s: Time of the scan.
            cloud_m: (2,) where the cloud is.
            level: And on which level.
            cloud_gain: What it gained.
        """
        radio, p = self._radio, self.params
        if level not in radio.places.levels:
            return  # it has no survey
        self._climb_to(level)
        here, number = radio.level == level, int(np.searchsorted(radio.places.levels, level))
        spread = radio.places.smoothed(number, self._belief[here], p.speed_mps * (now_s - self._scanned_s))
        self._scanned_s = now_s
        spread = (1.0 - p.anywhere) * spread / max(spread.sum(), MIN_TOTAL) + p.anywhere * radio.prior / len(spread)
        weight = spread * np.exp(log_likelihood[here] - log_likelihood.max())
        total = float(weight.sum())
        if total > 0.0:
            self._belief[here] = weight / total
            if self._tree[level].query(cloud_m)[0] <= p.surveyed_m:
                self.lead = max(self.lead + math.log(total) - cloud_gain, 0.0)

    def draw(self, count: int) -> States:
        """States of so many particles by the belief, which walk in any direction."""
        rng = self._rng
        chosen = rng.choice(self._belief.size, size=count, p=self._belief.ravel() / self._belief.sum())
        place, offset = np.divmod(chosen, self._belief.shape[1])
        within_m = self._radio.lattice_m * (rng.random((count, 2)) - 0.5)
        scale = np.exp(self._scale_sigma * rng.standard_normal(count))
        return States(self._radio.xy_m[place] + within_m, scale, rng.uniform(-math.pi, math.pi, count), offset)

    def _climb_to(self, level: int) -> None:
        """Everything is on another level at once, at the nearest places."""
        if level != self._level:
            before, radio = self._belief, self._radio
            place = radio.squares_at(radio.xy_m, np.full(len(radio.xy_m), level), nearest=True)
            self._belief, self._level = np.zeros_like(before), level
            np.add.at(self._belief, place, before)
